//! The sections of what surrounds the controller. Their owners read the fields.

use super::section::{ConfigError, section};
use tilthex_core::{Vehicle, estimator::EstimatorParams};

section! {
    /// The state estimator, an unscented Kalman filter on SO(3) x R^12.
    pub EstimatorSection as "estimator" {
        /// Standard deviation of a captured position, m an axis.
        position_noise: f64 = 0.3e-3,
        /// Standard deviation of a captured orientation, degrees an axis.
        rotation_noise_deg: f64 = 0.12,
    }
}

section! {
    /// Motion capture.
    pub MocapSection as "mocap" {
        /// Where poses come from: "natnet://HOST" or "vrpn://BODY@HOST"; empty for none.
        uri: String = String::new(),
    }
}

section! {
    /// The log.
    pub LogSection as "log" {
        /// The MCAP file to write; empty for none.
        path: String = String::new(),
    }
}

impl EstimatorSection {
    /// The estimator's parameters on a vehicle.
    ///
    /// # Errors
    /// One sentence with the parameter.
    pub fn params(&self, vehicle: &Vehicle) -> Result<EstimatorParams, ConfigError> {
        Ok(EstimatorParams {
            position_noise: self.position_noise,
            rotation_noise: self.rotation_noise_deg.to_radians(),
            imu_position_r: vehicle.imu().position_r,
            imu_rotation_ri: vehicle.imu().rotation_r,
            ..EstimatorParams::default()
        })
    }
}
