//! The process model, and its sigma points in the form that the structure of the model allows.
//!
//! The error state in the order `(gyro bias, rotation, accelerometer bias,
//! velocity, position)` makes most of the 31 sigma points of a lower
//! triangular factor trivial, because the model
//!
//! ```text
//! R' = R exp(w dt)              w = gyro - gyro bias
//! v' = v + a dt                 a = 1/2 (R + R') (s - accelerometer bias) - g e3
//! p' = p + v dt + a dt^2 / 2
//! ```
//!
//! is linear in everything but the gyro bias and the rotation:
//! * columns 6..15 (accelerometer bias, velocity, position) propagate linearly: neither the points nor the columns are
//!   needed (`moved.rs`);
//! * columns 3..6 rotate the frame and do not change the rate: the rotation error does not change, and the sum and
//!   difference of a pair of points have closed forms;
//! * columns 0..3 are evaluated as pairs of points.
//!
//! A pair `+-x` maps to `even +- odd`. This module returns the odd halves of rotation error and acceleration without
//! what is linear in the state, and the sums of the squares of both halves. Nothing is linearised: the result equals
//! that of the 31 points to rounding.

use super::{Navigation, matrix::Column, quaternion::Quaternion};
use crate::{
    GRAVITY, so3,
    types::{Matrix3, Vector3},
};

/// First index of each part of the error state, inside the filter.
pub(super) const GYRO_BIAS: usize = 0;
pub(super) const ROTATION: usize = 3;
pub(super) const ACCELEROMETER_BIAS: usize = 6;
pub(super) const VELOCITY: usize = 9;
pub(super) const POSITION: usize = 12;

/// Number of columns in which the model is not linear.
pub(super) const CURVED: usize = 6;

/// Square of the points' distance from the mean in standard deviations: the value that matches the fourth moment of a
/// normal distribution (`alpha^2 = 3/15`, `kappa = 0`).
const SPREAD_SQUARED: f64 = 3.0;
/// `sqrt(3)`.
const SPREAD: f64 = 1.732_050_807_568_877_2;
/// From the sum or difference of a pair to its half, in units of the columns.
const HALF: f64 = 0.5 / SPREAD;
/// Root of the weight of the outer product of the even halves' sum, in these units: `(2 - alpha^2) / 3` for `beta = 2`.
const SUM_WEIGHT: f64 = 0.774_596_669_241_483_4;

/// Below this square of the angles of a point, rad^2, series suffice for all of its rotations.
const SMALL: f64 = 8e-3;

/// Three lanes of a column, from `first`.
pub(super) fn part(column: &Column, first: usize) -> Vector3 {
    Vector3::new(column[first], column[first + 1], column[first + 2])
}

/// A number for each column in which the model is not linear.
pub(super) type Row = [f64; CURVED];

/// A vector for each column.
type Rows = [Row; 3];

fn at(rows: &Rows, k: usize) -> Vector3 {
    Vector3::new(rows[0][k], rows[1][k], rows[2][k])
}

fn put(rows: &mut Rows, k: usize, v: &Vector3) {
    (rows[0][k], rows[1][k], rows[2][k]) = (v.x, v.y, v.z);
}

/// Halves of the pairs.
#[derive(Clone, Copy)]
pub(super) struct Halves {
    /// Change of the rotation error, rad.
    pub(super) rotation: Rows,
    /// Acceleration, m/s^2.
    pub(super) force: Rows,
}

impl Halves {
    const ZERO: Self = Self { rotation: [[0.0; CURVED]; 3], force: [[0.0; CURVED]; 3] };

    fn rows(&self) -> [&Row; 6] {
        let [a, b, c] = &self.rotation;
        let [x, y, z] = &self.force;
        [a, b, c, x, y, z]
    }
}

/// Outer products over (rotation error, acceleration).
pub(super) type Squares = [[f64; 6]; 6];

impl Navigation {
    /// The state after `dt` seconds of constant readings.
    ///
    /// `gyro_i` in rad/s and `specific_force_i` in m/s^2, IMU coordinates, including their biases.
    #[must_use]
    #[inline(always)]
    pub fn advance(&self, gyro_i: &Vector3, specific_force_i: &Vector3, dt: f64) -> Self {
        let turned = self.rotation_wi * so3::exp(&((gyro_i - self.gyro_bias_i) * dt));
        let mid = 0.5 * (self.rotation_wi + turned);
        self.advance_turned(turned, &(mid * (specific_force_i - self.accelerometer_bias_i)), dt)
    }

    /// The state after `dt` seconds with the mean specific force `force_w`.
    #[inline(always)]
    fn advance_turned(&self, turned: Matrix3, force_w: &Vector3, dt: f64) -> Self {
        let acceleration = Vector3::new(force_w.x, force_w.y, force_w.z - GRAVITY);
        Self {
            position_w: self.position_w + dt * (self.velocity_w + 0.5 * dt * acceleration),
            velocity_w: self.velocity_w + dt * acceleration,
            rotation_wi: turned,
            ..*self
        }
    }
}

/// How the mean moves.
struct Motion {
    /// The mean rate times the length of the interval, rad, IMU.
    turn: Vector3,
    back: Quaternion,
    /// The rotation before and after; their mean.
    rotation: Matrix3,
    turned: Matrix3,
    mid: Matrix3,
    /// The specific force, W: mean, and after the turn.
    force_w: Vector3,
    turned_force_w: Vector3,
}

/// The pairs of points of one prediction after propagation.
pub(super) struct Pairs {
    /// Odd halves. The rotation error is without that of the column, the acceleration without that of the column's
    /// accelerometer bias.
    pub(super) odd: Halves,
    /// Even halves.
    even: Halves,
}

impl Pairs {
    pub(super) const ZERO: Self = Self { odd: Halves::ZERO, even: Halves::ZERO };

    /// Propagates the points of the first columns of the factor (see [`Triangle::cholesky`](super::matrix::Triangle)) about
    /// `mean` through the model. Returns the propagated mean, and the map of a specific force, IMU, to its mean over the
    /// interval, W.
    pub(super) fn propagate(
        &mut self,
        mean: &Navigation,
        factor: &[Column; CURVED],
        gyro_i: &Vector3,
        specific_force_i: &Vector3,
        dt: f64,
    ) -> (Navigation, Matrix3) {
        let turn = (gyro_i - mean.gyro_bias_i) * dt;
        let force = specific_force_i - mean.accelerometer_bias_i;
        let step = Quaternion::exp::<false>(&turn);
        let rotation = mean.rotation_wi;
        let turned = rotation * step.matrix();
        // a = mid (s - bias) - g e3 for every point that rotates at the mean rate.
        let mid = 0.5 * (rotation + turned);
        let (force_w, turned_force_w) = (mid * force, turned * force);
        let motion = Motion { turn, back: step.inverse(), rotation, turned, mid, force_w, turned_force_w };
        let mut largest = turn.norm_squared();
        for column in factor {
            let squares =
                [part(column, ROTATION).norm_squared(), dt * dt * part(column, GYRO_BIAS).norm_squared()];
            largest = squares.iter().fold(largest, |most, x| most.max(SPREAD_SQUARED * x));
        }
        if largest < SMALL {
            self.bend::<true>(factor, &motion, dt);
        } else {
            self.bend::<false>(factor, &motion, dt);
        }
        (mean.advance_turned(turned, &force_w, dt), mid)
    }

    /// Sets the odd and the even halves. The loops are those over columns or points, so that these share vector instructions.
    #[allow(clippy::needless_range_loop)] // Several arrays have the same index.
    fn bend<const SERIES: bool>(&mut self, factor: &[Column; CURVED], motion: &Motion, dt: f64) {
        let zero = [[0.0; CURVED]; 3];
        // The columns' rotations as quaternions (w, n), and their accelerometer biases.
        let (mut w, mut n, mut bias) = ([0.0; CURVED], zero, zero);
        for k in 0..CURVED {
            let angle = Quaternion::exp::<SERIES>(&(SPREAD * part(&factor[k], ROTATION)));
            w[k] = angle.w;
            put(&mut n, k, &angle.v);
            put(&mut bias, k, &(SPREAD * part(&factor[k], ACCELEROMETER_BIAS)));
        }
        // The points of the first three columns: three plus, three minus.
        let (mut turns, mut angles, mut forces_w, mut scalars) = (zero, zero, zero, [0.0; CURVED]);
        for k in 0..3 {
            let gyro_bias = (SPREAD * dt) * part(&factor[k], GYRO_BIAS);
            let bias_w = motion.turned * at(&bias, k);
            for (k, column, sign) in [(k, k, 1.0), (k + 3, k, -1.0)] {
                scalars[k] = w[column];
                put(&mut angles, k, &(sign * at(&n, column)));
                put(&mut turns, k, &(motion.turn - sign * gyro_bias));
                put(&mut forces_w, k, &(motion.turned_force_w - sign * bias_w));
            }
        }
        let (mut errors, mut changes) = (zero, zero);
        for k in 0..CURVED {
            // R exp(turn) exp(-rate dt) R^T: what the point turns beyond the mean.
            let beyond = Quaternion::exp::<SERIES>(&at(&turns, k)).times(&motion.back);
            let beyond = Quaternion { w: beyond.w, v: motion.rotation * beyond.v };
            let angle = Quaternion { w: scalars[k], v: at(&angles, k) };
            put(&mut errors, k, &angle.times(&beyond).log::<SERIES>());
            put(&mut changes, k, &(0.5 * beyond.change(&at(&forces_w, k))));
        }
        let (odd, even) = (&mut self.odd, &mut self.even);
        for k in 0..3 {
            let (plus, minus) = (at(&errors, k), at(&errors, k + 3));
            put(&mut odd.rotation, k, &(HALF * (plus - minus) - part(&factor[k], ROTATION)));
            put(&mut even.rotation, k, &(HALF * (plus + minus)));
            let (plus, minus) = (at(&changes, k), at(&changes, k + 3));
            put(&mut odd.force, k, &(plus - minus));
            put(&mut even.force, k, &(plus + minus));
        }
        for k in 0..CURVED {
            // Difference and sum of a pair's mean specific forces, before the rotation error turns them by
            // exp(+-x) u = u +- 2 w n x u + 2 n x (n x u).
            let (odd_force, even_force) = (at(&odd.force, k), at(&even.force, k));
            let difference = odd_force - 2.0 * (motion.mid * at(&bias, k));
            let sum = even_force + 2.0 * motion.force_w;
            let n = at(&n, k);
            let (of_difference, of_sum) = (2.0 * n.cross(&difference), 2.0 * n.cross(&sum));
            put(&mut odd.force, k, &(HALF * (odd_force + w[k] * of_sum + n.cross(&of_difference))));
            put(&mut even.force, k, &(HALF * (even_force + w[k] * of_difference + n.cross(&of_sum))));
        }
    }

    /// The outer products of the odd halves and those of the even halves `e` over (rotation error, acceleration), lower triangle
    /// by columns. With `c` the square of the spread, weights `1/(2c)` and `beta = 2`, the sum over the deviations of the
    /// points and of the centre from their mean `m = 1/c sum e` is `1/c sum e e^T + (2 - alpha^2) m m^T`: a sum of squares,
    /// although the weight of the centre itself is negative.
    #[allow(clippy::needless_range_loop)] // Indices are the mathematics here.
    pub(super) fn squares(&self) -> Squares {
        let [odd, even] = [&self.odd, &self.even].map(Halves::rows);
        let sums = even.map(|row| SUM_WEIGHT * row.iter().sum::<f64>());
        let mut squares = [[0.0; 6]; 6];
        for j in 0..6 {
            // Only the first three columns change the rotation error.
            let columns = if j < 3 { 3 } else { CURVED };
            for i in j..6 {
                let mut square = sums[j] * sums[i];
                for k in 0..columns {
                    square += odd[j][k] * odd[i][k] + even[j][k] * even[i][k];
                }
                squares[j][i] = square;
            }
        }
        squares
    }
}
