//! Unscented Kalman filter on SO(3) x R^12: position, velocity, rotation, gyro
//! bias and accelerometer bias of the IMU, driven by its readings and corrected by poses.
//!
//! Brossard, Barrau, Bonnabel, "A code for unscented Kalman filtering on
//! manifolds (UKF-M)", ICRA 2020: the mean is propagated on the manifold, the
//! covariance by sigma points in the tangent space, with the retraction
//!
//! ```text
//! (p, v, R, b_g, b_a) (+) (dp, dv, dr, db_g, db_a) = (p + dp, v + dv, exp(dr) R, b_g + db_g, b_a + db_a)
//! ```
//!
//! The rotation error is thus in world coordinates. The 2n+1 points (`alpha^2 = 1/5`, `beta = 2`, `kappa = 0`) come
//! from the Cholesky factor of the covariance in the order (gyro bias, rotation, accelerometer bias, velocity,
//! position); `sigma.rs` says which work this order saves. The process noise is white and additive in the tangent
//! space. A pose is linear in the error state (both errors are in the tangent space of the mean), so that the
//! unscented update equals the Kalman update exactly.
//!
//! # Why the covariance stays positive definite
//! A prediction is a sum of squares with positive weights plus process noise; it is computed as a change of the covariance
//! before, with the same rounding. The process noise adds to each variance
//! (1e-9 and more of it in each step) far more than the rounding of the sum (1e-14). An update subtracts `W W^T` with
//! the measurement noise inside `W`; lower limits of that noise and upper limits of the covariance keep their ratio
//! below 1e13. After each update the whole covariance is factorised; if this still fails, the correlations are reduced
//! until it succeeds, and the event is counted. A prediction factorises the columns that it needs.

mod innovation;
mod matrix;
mod moved;
mod params;
mod quaternion;
mod sigma;

pub use innovation::{Innovation, PoseNoise};
pub use params::{InitialDeviation, ProcessNoise};

use crate::{
    Error, so3,
    types::{Matrix3, Vector3},
};
use matrix::{Column, LANES, N, Triangle};
use sigma::{ACCELEROMETER_BIAS, CURVED, GYRO_BIAS, POSITION, Pairs, ROTATION, VELOCITY};

/// Covariance of the error state `(position, velocity, rotation, gyro bias,
/// accelerometer bias)`: SI units, world coordinates for the first three, IMU coordinates for the biases.
pub type Covariance = nalgebra::SMatrix<f64, 15, 15>;

/// The index inside the filter of each entry of the public order.
const PUBLIC: [usize; N] = [12, 13, 14, 9, 10, 11, 3, 4, 5, 0, 1, 2, 6, 7, 8];

/// Largest variances. A state with such a variance is unknown, and a larger variance would only lose digits. By part
/// in internal order: (rad/s)^2, rad^2, (m/s^2)^2, (m/s)^2, m^2.
const CEILING: [f64; 5] = [0.25, 0.21, 25.0, 1e4, 1e6];

/// Position, velocity and rotation of the IMU, and its biases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Navigation {
    /// Position of the IMU, m, world.
    pub position_w: Vector3,
    /// Velocity of the IMU, m/s, world.
    pub velocity_w: Vector3,
    /// Maps IMU coordinates to world coordinates.
    pub rotation_wi: Matrix3,
    /// Value of the gyro at rest, rad/s.
    pub gyro_bias_i: Vector3,
    /// Value of the accelerometer minus the specific force, m/s^2.
    pub accelerometer_bias_i: Vector3,
}

impl Navigation {
    /// At rest at the origin, level, with zero biases.
    pub const ORIGIN: Self = Self {
        position_w: Vector3::new(0.0, 0.0, 0.0),
        velocity_w: Vector3::new(0.0, 0.0, 0.0),
        rotation_wi: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        gyro_bias_i: Vector3::new(0.0, 0.0, 0.0),
        accelerometer_bias_i: Vector3::new(0.0, 0.0, 0.0),
    };
}

/// Mean and covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UkfState {
    /// The mean.
    pub mean: Navigation,
    covariance: Triangle,
    recoveries: u32,
}

/// Mean and deviation of the gyro's bias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroBias {
    /// Its mean, rad/s, IMU coordinates.
    pub mean_i: Vector3,
    /// Its standard deviation per axis, rad/s.
    pub deviation: f64,
}

/// A [`UkfState`] in little more than half the memory.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PackedState {
    mean: Navigation,
    covariance: [f64; N * (N + 1) / 2],
    recoveries: u32,
}

impl PackedState {
    pub(crate) const EMPTY: Self =
        Self { mean: Navigation::ORIGIN, covariance: [0.0; N * (N + 1) / 2], recoveries: 0 };

    pub(crate) fn pack(state: &UkfState) -> Self {
        let mut packed = Self { mean: state.mean, recoveries: state.recoveries, ..Self::EMPTY };
        let entries =
            state.covariance.0.iter().enumerate().flat_map(|(j, column)| column.iter().take(N).skip(j));
        for (slot, entry) in packed.covariance.iter_mut().zip(entries) {
            *slot = *entry;
        }
        packed
    }

    pub(crate) fn unpack(&self) -> UkfState {
        let mut covariance = Triangle::ZERO;
        let entries =
            covariance.0.iter_mut().enumerate().flat_map(|(j, column)| column.iter_mut().take(N).skip(j));
        for (entry, slot) in entries.zip(&self.covariance) {
            *entry = *slot;
        }
        UkfState { mean: self.mean, covariance, recoveries: self.recoveries }
    }
}

/// The filter's parameters.
#[derive(Clone, Copy, Debug)]
pub struct Ukf {
    noise: ProcessNoise,
}

/// Whether an entry of the (internal) error state belongs to a bias.
fn is_bias(i: usize) -> bool {
    (GYRO_BIAS..GYRO_BIAS + 3).contains(&i) || (ACCELEROMETER_BIAS..ACCELEROMETER_BIAS + 3).contains(&i)
}

impl UkfState {
    /// A state with this mean and independent errors of the given deviations.
    #[must_use]
    pub fn new(mean: Navigation, deviation: &InitialDeviation) -> Self {
        let mut state = Self { mean, covariance: Triangle::ZERO, recoveries: 0 };
        for (i, variance) in deviation.variances().iter().enumerate() {
            for j in 3 * i..3 * i + 3 {
                state.covariance.0[j][j] = *variance;
            }
        }
        state
    }

    /// The covariance, in the public order (position, velocity, rotation, biases).
    #[must_use]
    pub fn covariance(&self) -> Covariance {
        Covariance::from_fn(|i, j| self.covariance.get(PUBLIC[i], PUBLIC[j]))
    }

    /// How often a factorisation failed and the correlations were reduced.
    #[must_use]
    pub fn recoveries(&self) -> u32 {
        self.recoveries
    }

    /// Sum of the three variances of a part of the (internal) error state.
    #[inline(always)]
    fn trace(&self, first: usize) -> f64 {
        (first..first + 3).map(|i| self.covariance.diagonal(i)).sum()
    }

    /// Root of the summed variances of position (m), velocity (m/s) and rotation (rad).
    #[must_use]
    pub fn deviations(&self) -> [f64; 3] {
        [POSITION, VELOCITY, ROTATION].map(|part| libm::sqrt(self.trace(part)))
    }

    /// Standard deviation per axis of each part. A filter that starts with these is as certain, but without
    /// correlations.
    #[must_use]
    pub(crate) fn axis_deviations(&self) -> InitialDeviation {
        let axis = |part: usize| libm::sqrt(self.trace(part) / 3.0);
        InitialDeviation {
            position: axis(POSITION),
            velocity: axis(VELOCITY),
            rotation: axis(ROTATION),
            gyro_bias: axis(GYRO_BIAS),
            accelerometer_bias: axis(ACCELEROMETER_BIAS),
        }
    }

    /// The gyro's bias.
    #[must_use]
    pub fn gyro_bias(&self) -> GyroBias {
        let deviation = libm::sqrt(self.trace(GYRO_BIAS) / 3.0);
        GyroBias { mean_i: self.mean.gyro_bias_i, deviation }
    }

    /// Replaces the bias of the gyro by a known one, which is independent of all other parts of the state.
    pub fn set_gyro_bias(&mut self, bias: &GyroBias) {
        self.mean.gyro_bias_i = bias.mean_i;
        for j in GYRO_BIAS..GYRO_BIAS + 3 {
            // The gyro bias comes first, so that its columns contain all its correlations.
            self.covariance.0[j] = [0.0; LANES];
            self.covariance.0[j][j] = bias.deviation * bias.deviation;
        }
    }

    /// Replaces position, velocity and rotation, with independent errors of the given deviations. The biases stay.
    pub fn restart(&mut self, mean: Navigation, deviation: &InitialDeviation) {
        let fresh = Self::new(mean, deviation);
        let mut biases = self.covariance;
        for i in (0..N).filter(|i| !is_bias(*i)) {
            biases.scale(i, 0.0);
            biases.0[i][i] = fresh.covariance.0[i][i];
        }
        (self.mean, self.covariance) = (mean, biases);
    }

    /// Multiplies the deviations of position, velocity and rotation by `factor`. The biases stay.
    pub fn loosen(&mut self, factor: f64) {
        for i in (0..N).filter(|i| !is_bias(*i)) {
            self.covariance.scale(i, factor);
        }
        self.limit();
    }

    /// Multiplies the deviations of the rotation by `factor`.
    pub fn loosen_rotation(&mut self, factor: f64) {
        self.reduce(ROTATION, factor);
        self.limit();
    }

    /// Whether mean and covariance are finite, and the covariance positive definite.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.covariance.is_sound() && self.covariance.is_definite() && self.mean_is_finite()
    }

    fn mean_is_finite(&self) -> bool {
        let m = &self.mean;
        [m.position_w, m.velocity_w, m.gyro_bias_i, m.accelerometer_bias_i]
            .iter()
            .all(crate::types::is_finite3)
            && m.rotation_wi.iter().all(|x| x.is_finite())
    }

    /// Reduces variances that are above their ceiling.
    #[inline(always)]
    fn limit(&mut self) {
        let parts = [GYRO_BIAS, ROTATION, ACCELEROMETER_BIAS, VELOCITY, POSITION];
        for (first, ceiling) in parts.into_iter().zip(CEILING) {
            let trace = self.trace(first);
            if trace > 3.0 * ceiling {
                self.reduce(first, libm::sqrt(3.0 * ceiling / trace));
            }
        }
    }

    /// Multiplies the deviations of a part by `factor`.
    #[cold]
    fn reduce(&mut self, first: usize, factor: f64) {
        for j in first..first + 3 {
            self.covariance.scale(j, factor);
        }
    }

    /// The first columns of the factor of the covariance.
    fn factor(&mut self, l: &mut [Column; CURVED]) {
        if !self.covariance.cholesky(l) {
            self.make_definite();
            self.covariance.cholesky(l);
        }
    }

    /// If rounding has made the covariance indefinite, reduces the correlations, by 1e-12 and then by more and more,
    /// until it is definite.
    fn make_definite(&mut self) {
        if self.covariance.is_definite() {
            return;
        }
        self.recoveries = self.recoveries.saturating_add(1);
        for shrink in [1e-12, 1e-9, 1e-6, 1e-3] {
            for j in 0..N {
                self.covariance.0[j][j] *= 1.0 + shrink;
            }
            if self.covariance.is_definite() {
                return;
            }
        }
        // At best the diagonal is left.
        for j in 0..N {
            let variance = self.covariance.0[j][j];
            let ceiling = CEILING[j / 3];
            let variance = if variance > 0.0 && variance < ceiling { variance } else { ceiling };
            self.covariance.0[j] = [0.0; LANES];
            self.covariance.0[j][j] = variance;
        }
    }
}

impl Ukf {
    /// A filter for an IMU of the given noise.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::NotFinite`] for a density that is not a small positive number.
    pub fn new(noise: ProcessNoise) -> Result<Self, Error> {
        noise.check()?;
        Ok(Self { noise })
    }

    /// A filter whose noise needs no check: one that was checked, and increased for a time.
    pub(crate) const fn unchecked(noise: ProcessNoise) -> Self {
        Self { noise }
    }

    /// Moves the state by `dt` seconds (0 to 1) with constant readings: `gyro_i` in rad/s and `specific_force_i` in
    /// m/s^2, IMU coordinates, including the biases.
    pub fn predict(&self, state: &mut UkfState, gyro_i: &Vector3, specific_force_i: &Vector3, dt: f64) {
        let mut factor = [[0.0; LANES]; CURVED];
        state.factor(&mut factor);
        let mut pairs = Pairs::ZERO;
        let (mean, mid) = pairs.propagate(&state.mean, &factor, gyro_i, specific_force_i, dt);
        state.mean = mean;
        // Rounding errors must not accumulate.
        state.mean.rotation_wi = so3::unrounded(&state.mean.rotation_wi);
        moved::propagate(&mut state.covariance, &factor, &pairs, &mid, dt);
        self.add_noise(&mut state.covariance, dt);
        state.limit();
    }

    /// White noise over `dt`, integrated exactly. It is isotropic, so that the frame does not matter.
    fn add_noise(&self, covariance: &mut Triangle, dt: f64) {
        let n = &self.noise;
        let force = n.accelerometer * n.accelerometer * dt;
        for i in 0..3 {
            covariance.0[GYRO_BIAS + i][GYRO_BIAS + i] += n.gyro_bias * n.gyro_bias * dt;
            covariance.0[ROTATION + i][ROTATION + i] += n.gyro * n.gyro * dt;
            let bias = ACCELEROMETER_BIAS + i;
            covariance.0[bias][bias] += n.accelerometer_bias * n.accelerometer_bias * dt;
            covariance.0[VELOCITY + i][VELOCITY + i] += force;
            covariance.0[VELOCITY + i][POSITION + i] += 0.5 * dt * force;
            covariance.0[POSITION + i][POSITION + i] += dt * dt / 3.0 * force;
        }
    }
}
