//! The parameters of the filter: the noise of the IMU, and the deviations of an initial state.

use crate::{Error, error::check_range};

/// Noise of the IMU, as noise densities and random walks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProcessNoise {
    /// White noise of the gyro, rad/s/sqrt(Hz).
    pub gyro: f64,
    /// White noise of the accelerometer, m/s^2/sqrt(Hz).
    pub accelerometer: f64,
    /// Random walk of the gyro bias, rad/s/sqrt(s).
    pub gyro_bias: f64,
    /// Random walk of the accelerometer bias, m/s^2/sqrt(s).
    pub accelerometer_bias: f64,
}

impl Default for ProcessNoise {
    /// A good MEMS IMU on a vibrating frame.
    fn default() -> Self {
        Self { gyro: 5e-4, accelerometer: 1e-2, gyro_bias: 1e-4, accelerometer_bias: 1e-3 }
    }
}

impl ProcessNoise {
    pub(super) fn check(&self) -> Result<(), Error> {
        check_range("gyro_noise", self.gyro, 1e-6, 1.0)?;
        check_range("accelerometer_noise", self.accelerometer, 1e-5, 10.0)?;
        check_range("gyro_bias_walk", self.gyro_bias, 1e-8, 1.0)?;
        check_range("accelerometer_bias_walk", self.accelerometer_bias, 1e-7, 10.0)
    }
}

/// Standard deviations of an initial state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InitialDeviation {
    /// Position, m.
    pub position: f64,
    /// Velocity, m/s.
    pub velocity: f64,
    /// Rotation, rad.
    pub rotation: f64,
    /// Gyro bias, rad/s.
    pub gyro_bias: f64,
    /// Accelerometer bias, m/s^2.
    pub accelerometer_bias: f64,
}

impl Default for InitialDeviation {
    fn default() -> Self {
        Self {
            position: 0.01,
            velocity: 0.1,
            rotation: 1f64.to_radians(),
            gyro_bias: 0.02,
            accelerometer_bias: 0.2,
        }
    }
}

impl InitialDeviation {
    /// Refuses deviations that are not positive, or too large for the filter.
    ///
    /// # Errors
    /// [`Error`], which names the deviation.
    pub fn check(&self) -> Result<(), Error> {
        check_range("initial_position", self.position, 1e-5, 1e3)?;
        check_range("initial_velocity", self.velocity, 1e-5, 1e2)?;
        check_range("initial_rotation", self.rotation, 1e-5, 0.4)?;
        check_range("initial_gyro_bias", self.gyro_bias, 1e-7, 0.5)?;
        check_range("initial_accelerometer_bias", self.accelerometer_bias, 1e-6, 5.0)
    }

    /// Variances by part, in internal order.
    pub(super) fn variances(&self) -> [f64; 5] {
        [self.gyro_bias, self.rotation, self.accelerometer_bias, self.velocity, self.position].map(|s| s * s)
    }
}
