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
//! * columns 12..15 (position), 9..12 (velocity) and 6..9 (accelerometer bias) propagate linearly: no point is
//!   evaluated;
//! * columns 3..6 rotate the frame and do not change the rate: the rotation error does not change, and the sum and
//!   difference of a pair of points have closed forms;
//! * columns 0..3 are evaluated as pairs of points.
//!
//! A pair `+-x` maps to `even +- odd`. The odd halves of all pairs are again a lower triangular matrix `A`. The
//! covariance of the points is `A A^T` plus the outer products of the even halves; this module returns both. Nothing
//! is linearised: the result equals that of the 31 points to rounding.

use super::{
    Navigation,
    matrix::{Column, Triangle},
};
use crate::{
    GRAVITY, so3,
    types::{Matrix3, Vector3},
};
use libm::{atan2, sqrt};

/// First index of each part of the error state, inside the filter.
pub(super) const GYRO_BIAS: usize = 0;
pub(super) const ROTATION: usize = 3;
pub(super) const ACCELEROMETER_BIAS: usize = 6;
pub(super) const VELOCITY: usize = 9;
pub(super) const POSITION: usize = 12;

/// Square of the points' distance from the mean in standard deviations: the value that matches the fourth moment of a
/// normal distribution (`alpha^2 = 3/15`, `kappa = 0`).
const SPREAD_SQUARED: f64 = 3.0;
/// `sqrt(3)`.
const SPREAD: f64 = 1.732_050_807_568_877_2;
/// Weight of the outer product of the even halves' mean: `2 - alpha^2`, for `beta = 2`.
const MEAN_WEIGHT: f64 = 1.8;

/// Three lanes of a column, from `first`.
pub(super) fn part(column: &Column, first: usize) -> Vector3 {
    Vector3::new(column[first], column[first + 1], column[first + 2])
}

fn set_part(column: &mut Column, first: usize, v: &Vector3) {
    column[first] = v.x;
    column[first + 1] = v.y;
    column[first + 2] = v.z;
}

/// The rotation by a rotation vector, applied to vectors.
struct Turn {
    vector: Vector3,
    /// `sin(t)/t` and `(1 - cos(t))/t^2`.
    a: f64,
    b: f64,
}

impl Turn {
    fn new(vector: Vector3) -> Self {
        let (a, b, _) = so3::ratios(vector.norm_squared());
        Self { vector, a, b }
    }

    fn apply(&self, u: &Vector3) -> Vector3 {
        let c = self.vector.cross(u);
        u + self.a * c + self.b * self.vector.cross(&c)
    }
}

/// A unit quaternion: scalar, vector.
#[derive(Clone, Copy)]
struct Quaternion(f64, Vector3);

impl Quaternion {
    fn exp(v: &Vector3) -> Self {
        let h2 = 0.25 * v.norm_squared();
        let (a, b, _) = so3::ratios(h2);
        Self(1.0 - b * h2, 0.5 * a * v)
    }

    fn times(&self, other: &Self) -> Self {
        Self(
            self.0 * other.0 - self.1.dot(&other.1),
            self.0 * other.1 + other.0 * self.1 + self.1.cross(&other.1),
        )
    }

    /// Rotation vector, with an angle in `[0, pi]`.
    fn log(&self) -> Vector3 {
        let (w, v) = if self.0 < 0.0 { (-self.0, -self.1) } else { (self.0, self.1) };
        let n2 = v.norm_squared();
        let q2 = n2 / (w * w);
        if q2 < 1e-2 {
            // 2 atan(q)/q / w as a series, exact to rounding for q < 0.1.
            let s = 1.0 / 13.0 - q2 * (1.0 / 15.0 - q2 / 17.0);
            let s = 1.0 / 7.0 - q2 * (1.0 / 9.0 - q2 * (1.0 / 11.0 - q2 * s));
            let s = 1.0 - q2 * (1.0 / 3.0 - q2 * (1.0 / 5.0 - q2 * s));
            (2.0 / w * s) * v
        } else {
            let n = sqrt(n2);
            (2.0 * atan2(n, w) / n) * v
        }
    }
}

impl Navigation {
    /// The state after `dt` seconds of constant readings.
    ///
    /// `gyro_i` in rad/s and `specific_force_i` in m/s^2, IMU coordinates, including their biases.
    #[must_use]
    pub fn advance(&self, gyro_i: &Vector3, specific_force_i: &Vector3, dt: f64) -> Self {
        let turned = self.rotation_wi * so3::exp(&((gyro_i - self.gyro_bias_i) * dt));
        self.advance_turned(turned, specific_force_i, dt)
    }

    fn advance_turned(&self, turned: Matrix3, specific_force_i: &Vector3, dt: f64) -> Self {
        let s = specific_force_i - self.accelerometer_bias_i;
        let mut acceleration = 0.5 * (self.rotation_wi * s + turned * s);
        acceleration.z -= GRAVITY;
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
    /// Odd halves of the pairs: a lower triangular factor of the covariance.
    pub(super) factor: Triangle,
    /// Even halves: their (weighted) outer products over (rotation error, acceleration).
    pub(super) even: [[f64; 6]; 6],
}

/// Propagates the points of `factor` (see [`Triangle::cholesky`]) about `mean` through the model.
pub(super) fn propagate(
    mean: &Navigation,
    mut factor: Triangle,
    gyro_i: &Vector3,
    specific_force_i: &Vector3,
    dt: f64,
) -> Prediction {
    let rate = gyro_i - mean.gyro_bias_i;
    let force = specific_force_i - mean.accelerometer_bias_i;
    let step = so3::exp(&(rate * dt));
    let rotation = mean.rotation_wi;
    let turned = rotation * step;
    // a = mid (s - bias) - g e3 for every point that rotates at the mean rate.
    let mid = 0.5 * (rotation + turned);
    let mean_force_w = mid * force;
    let back = Quaternion::exp(&(rate * -dt));

    let mut evens = [[0.0; 6]; 6];
    for (k, (column, even)) in factor.0.iter_mut().zip(&mut evens).enumerate() {
        let angle = SPREAD * part(column, ROTATION);
        let bias = SPREAD * part(column, ACCELEROMETER_BIAS);
        let (odd_force, even_rotation, even_force);
        if k < 3 {
            let gyro_bias = SPREAD * part(column, GYRO_BIAS);
            let point = |sign: f64| {
                let turn = (rate - sign * gyro_bias) * dt;
                // exp(angle) R exp(turn) exp(-rate dt) R^T, and its logarithm.
                let Quaternion(w, v) = Quaternion::exp(&turn).times(&back);
                let error = Quaternion::exp(&(sign * angle)).times(&Quaternion(w, rotation * v)).log();
                let s = force - sign * bias;
                let mid_force_i = 0.5 * (s + Turn::new(turn).apply(&s));
                (error, Turn::new(sign * angle).apply(&(rotation * mid_force_i)))
            };
            let (plus, minus) = (point(1.0), point(-1.0));
            set_part(column, ROTATION, &((plus.0 - minus.0) * (0.5 / SPREAD)));
            odd_force = (plus.1 - minus.1) * (0.5 / SPREAD);
            even_rotation = 0.5 * (plus.0 + minus.0);
            even_force = 0.5 * (plus.1 + minus.1) - mean_force_w;
        } else {
            // exp(+-x) (u -+ w), halves of the sum and of the difference.
            let turn = Turn::new(angle);
            let (u, w) = (mean_force_w, mid * bias);
            let (xu, xw) = (angle.cross(&u), angle.cross(&w));
            odd_force = (turn.a * xu - w - turn.b * angle.cross(&xw)) / SPREAD;
            even_force = turn.b * angle.cross(&xu) - turn.a * xw;
            even_rotation = Vector3::zeros();
        }
        move_column(column, &odd_force, dt);
        *even = [even_rotation.x, even_rotation.y, even_rotation.z, even_force.x, even_force.y, even_force.z];
    }
    for column in &mut factor.0[6..9] {
        let odd_force = -(mid * part(column, ACCELEROMETER_BIAS));
        move_column(column, &odd_force, dt);
    }
    for column in &mut factor.0[9..12] {
        move_column(column, &Vector3::zeros(), dt);
    }

    let mean = mean.advance_turned(turned, specific_force_i, dt);
    Prediction { mean, factor, even: even_products(&evens) }
}

/// Velocity and position parts of a column whose acceleration is `odd_force`.
fn move_column(column: &mut Column, odd_force: &Vector3, dt: f64) {
    let velocity = part(column, VELOCITY);
    let position = part(column, POSITION) + dt * (velocity + 0.5 * dt * odd_force);
    set_part(column, POSITION, &position);
    set_part(column, VELOCITY, &(velocity + dt * odd_force));
}

/// The part of the covariance that comes from the even halves `e`. With `c` the square of the spread, weights
/// `1/(2c)` and `beta = 2`, the sum over the deviations of the points and of the centre from their mean `m = 1/c sum
/// e` is `1/c sum e e^T + (2 - alpha^2) m m^T`: a sum of squares, although the weight of the centre itself is
/// negative.
#[allow(clippy::needless_range_loop)]
fn even_products(evens: &[[f64; 6]; 6]) -> [[f64; 6]; 6] {
    let mut products = [[0.0; 6]; 6];
    let mut mean = [0.0; 6];
    for e in evens {
        for j in 0..6 {
            mean[j] += e[j];
            for i in 0..6 {
                products[j][i] += e[j] * e[i];
            }
        }
    }
    for j in 0..6 {
        for i in 0..6 {
            products[j][i] =
                (products[j][i] + MEAN_WEIGHT / SPREAD_SQUARED * mean[j] * mean[i]) / SPREAD_SQUARED;
        }
    }
    products
}
