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
    GRAVITY,
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

/// Square root of 3. The points' distance from the mean in standard deviations: the value that matches the fourth
/// moment of a normal distribution (`alpha^2 = 3/15`, `kappa = 0`).
const SPREAD: f64 = 1.732_050_807_568_877_2;
/// From the sum or difference of a pair to its half, in units of the columns.
const HALF: f64 = 0.5 / SPREAD;
/// Root of the weight of the outer product of the even halves' sum, in these units: `(2 - alpha^2) / 3` for `beta = 2`.
const SUM_WEIGHT: f64 = 0.774_596_669_241_483_4;

/// Three lanes of a column, from `first`.
pub(super) fn part(column: &Column, first: usize) -> Vector3 {
    Vector3::new(column[first], column[first + 1], column[first + 2])
}

/// A change of the rotation error and an acceleration, one after the other.
pub(super) type Bend = [f64; 6];

fn bend(rotation: &Vector3, force: &Vector3) -> Bend {
    [rotation.x, rotation.y, rotation.z, force.x, force.y, force.z]
}

impl Navigation {
    /// The state after `dt` seconds of constant readings.
    ///
    /// `gyro_i` in rad/s and `specific_force_i` in m/s^2, IMU coordinates, including their biases.
    #[must_use]
    pub fn advance(&self, gyro_i: &Vector3, specific_force_i: &Vector3, dt: f64) -> Self {
        let step = Quaternion::exp(&((gyro_i - self.gyro_bias_i) * dt));
        let turned = self.rotation_wi * step.matrix();
        let mid = 0.5 * (self.rotation_wi + turned);
        self.advance_turned(turned, &(mid * (specific_force_i - self.accelerometer_bias_i)), dt)
    }

    /// The state after `dt` seconds with the mean specific force `force_w`.
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

/// The points of one prediction after propagation.
pub(super) struct Prediction {
    /// The propagated mean.
    pub(super) mean: Navigation,
    /// Maps a specific force, IMU, to its mean over the interval, W.
    pub(super) mid: Matrix3,
    /// Odd halves of the pairs. The rotation error is without that of the column, the acceleration without that of the
    /// column's accelerometer bias.
    pub(super) odd: [Bend; CURVED],
    /// Sum of the outer products of these and of the (weighted) even halves, lower triangle by columns.
    pub(super) squares: [Bend; 6],
}

/// Propagates the points of the first columns of the factor (see [`Triangle::cholesky`](super::matrix::Triangle)) about
/// `mean` through the model.
#[inline]
pub(super) fn propagate(
    mean: &Navigation,
    factor: &[Column; CURVED],
    gyro_i: &Vector3,
    specific_force_i: &Vector3,
    dt: f64,
) -> Prediction {
    let turn = (gyro_i - mean.gyro_bias_i) * dt;
    let force = specific_force_i - mean.accelerometer_bias_i;
    let step = Quaternion::exp(&turn);
    let back = step.inverse();
    let rotation = mean.rotation_wi;
    let turned = rotation * step.matrix();
    // a = mid (s - bias) - g e3 for every point that rotates at the mean rate.
    let mid = 0.5 * (rotation + turned);
    let (mean_force_w, turned_force_w) = (mid * force, turned * force);

    let (mut odd, mut even) = ([[0.0; 6]; CURVED], [[0.0; 6]; CURVED]);
    for (k, column) in factor.iter().enumerate() {
        let angle = Quaternion::exp(&(SPREAD * part(column, ROTATION)));
        let bias = SPREAD * part(column, ACCELEROMETER_BIAS);
        // Sums and differences of a pair; first the mean specific force before the rotation error turns it.
        let (mut sum, mut difference) = (2.0 * mean_force_w, -2.0 * (mid * bias));
        let (mut odd_force, mut even_force) = (Vector3::zeros(), Vector3::zeros());
        let (mut odd_rotation, mut even_rotation) = (Vector3::zeros(), Vector3::zeros());
        if k < 3 {
            let gyro_bias = (SPREAD * dt) * part(column, GYRO_BIAS);
            let turned_bias_w = turned * bias;
            let point = |angle: &Quaternion, gyro_bias: &Vector3, force_w: &Vector3| {
                // R exp(turn) exp(-rate dt) R^T: what the point turns beyond the mean.
                let beyond = Quaternion::exp(&(turn - gyro_bias)).times(&back);
                let beyond = Quaternion { w: beyond.w, v: rotation * beyond.v };
                (angle.times(&beyond).log(), 0.5 * beyond.change(force_w))
            };
            let plus = point(&angle, &gyro_bias, &(turned_force_w - turned_bias_w));
            let minus = point(&angle.inverse(), &-gyro_bias, &(turned_force_w + turned_bias_w));
            odd_rotation = HALF * (plus.0 - minus.0) - part(column, ROTATION);
            even_rotation = HALF * (plus.0 + minus.0);
            (odd_force, even_force) = (plus.1 - minus.1, plus.1 + minus.1);
            difference += odd_force;
            sum += even_force;
        }
        // exp(+-x) u = u +- 2 w n x u + 2 n x (n x u) of the quaternion (w, n).
        let n = 2.0 * angle.v;
        let (of_sum, of_difference) = (n.cross(&sum), n.cross(&difference));
        odd_force += angle.w * of_sum + angle.v.cross(&of_difference);
        even_force += angle.w * of_difference + angle.v.cross(&of_sum);
        odd[k] = bend(&odd_rotation, &(HALF * odd_force));
        even[k] = bend(&even_rotation, &(HALF * even_force));
    }
    let mean = mean.advance_turned(turned, &mean_force_w, dt);
    Prediction { mean, mid, squares: squares(&odd, &even), odd }
}

/// The outer products of the odd halves and those of the even halves `e`, lower triangle by columns. With `c` the square
/// of the spread, weights `1/(2c)` and `beta = 2`, the sum over the deviations of the points and of the centre from their
/// mean `m = 1/c sum e` is `1/c sum e e^T + (2 - alpha^2) m m^T`: a sum of squares, although the weight of the centre
/// itself is negative.
#[allow(clippy::needless_range_loop)] // Indices are the mathematics here.
fn squares(odd: &[Bend; CURVED], even: &[Bend; CURVED]) -> [Bend; 6] {
    let mut sum = [0.0; 6];
    for e in even {
        for i in 0..6 {
            sum[i] += SUM_WEIGHT * e[i];
        }
    }
    let mut squares = [[0.0; 6]; 6];
    for e in odd.iter().chain(even).chain([&sum]) {
        for j in 0..6 {
            for i in j..6 {
                squares[j][i] += e[j] * e[i];
            }
        }
    }
    squares
}
