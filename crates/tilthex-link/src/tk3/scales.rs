//! Counts of the IMU and physical units.

use super::{Board, Identity, ImuFrame};
use tilthex_core::types::Vector3;

/// The physical values of one count of the IMU. They can be configured, because newer firmware has configurable ranges and
/// announces the range in an unknown way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuScales {
    /// m/s^2 per count.
    pub accelerometer: f64,
    /// rad/s per count.
    pub gyro: f64,
}

impl ImuScales {
    /// Of the `mkfl` and `flymu` boards: 1e-3 m/s^2 and 1e-3 rad/s.
    pub const MILLI: Self = Self { accelerometer: 1e-3, gyro: 1e-3 };
    /// Of `chimera` boards from 1.1 on: ranges of +-8 g and +-1000 deg/s.
    pub const CHIMERA: Self = Self {
        accelerometer: 8.0 * 9.81 / 32_768.0,
        gyro: 1000.0 * core::f64::consts::PI / 180.0 / 32_768.0,
    };

    /// The known scales of a board; `None` if the configuration must give them.
    #[must_use]
    pub fn known(identity: &Identity) -> Option<Self> {
        match identity.board {
            Board::Mkfl | Board::Flymu => Some(Self::MILLI),
            Board::Chimera if (identity.major, identity.minor) >= (1, 1) => Some(Self::CHIMERA),
            Board::Chimera | Board::Teensy => None,
        }
    }

    /// Specific force, m/s^2, and angular velocity, rad/s, in IMU coordinates.
    #[must_use]
    pub fn decode(&self, frame: &ImuFrame) -> (Vector3, Vector3) {
        let vector = |counts: [i16; 3]| Vector3::from(counts.map(f64::from));
        (self.accelerometer * vector(frame.accelerometer), self.gyro * vector(frame.gyro))
    }

    /// The nearest counts to a specific force, m/s^2, and an angular velocity,
    /// rad/s, saturated at the ends of the range as the sensor does.
    #[must_use]
    pub fn encode(&self, specific_force_i: &Vector3, gyro_i: &Vector3) -> ([i16; 3], [i16; 3]) {
        let counts = |v: &Vector3, scale: f64| <[f64; 3]>::from(*v).map(|x| libm::rint(x / scale) as i16);
        (counts(specific_force_i, self.accelerometer), counts(gyro_i, self.gyro))
    }
}
