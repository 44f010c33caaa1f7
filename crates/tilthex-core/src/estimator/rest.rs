//! Whether the vehicle is at rest, and the biases that it shows at rest.

use crate::{
    GRAVITY,
    types::{Matrix3, Vector3},
};
use core::fmt;
use libm::{acos, fabs, sqrt};

/// Largest angle between the vertical of the pose and that of the accelerometer, degrees: if the captured body is
/// defined with a tilt, the vehicle flies with that tilt.
const MOST_TILT: f64 = 2.0;

/// Limits of a vehicle at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestParams {
    /// Length of the window of readings, s.
    pub duration: f64,
    /// Largest standard deviation of a gyro axis, rad/s.
    pub gyro_deviation: f64,
    /// Largest standard deviation of an accelerometer axis, m/s^2.
    pub accelerometer_deviation: f64,
    /// Largest mean rate, rad/s. Above it the vehicle turns, or the gyro is broken.
    pub gyro_bias: f64,
    /// Largest difference between the mean specific force and 9.81 m/s^2.
    pub accelerometer_bias: f64,
}

impl Default for RestParams {
    fn default() -> Self {
        Self {
            duration: 1.0,
            gyro_deviation: 0.05,
            accelerometer_deviation: 0.5,
            gyro_bias: 0.1,
            accelerometer_bias: 0.6,
        }
    }
}

/// Why a start at rest is refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StartError {
    /// There are too few readings.
    TooShort {
        /// Time of the readings, s.
        found: f64,
        /// Time that is needed, s.
        expected: f64,
    },
    /// The vehicle moves.
    Moving {
        /// The quantity that shows it, with its unit.
        what: &'static str,
        /// What was found.
        found: f64,
        /// Largest value that counts as rest.
        limit: f64,
    },
    /// The vertical of the pose differs from that of the accelerometer.
    GravityDisagrees {
        /// Angle between the two, degrees.
        degrees: f64,
    },
    /// The pose is not finite, or not a rotation.
    Pose(crate::Error),
}

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooShort { found, expected } => {
                write!(
                    f,
                    "the IMU was watched for {found:.2} s; a start at rest needs {expected:.2} s of readings"
                )
            }
            Self::Moving { what, found, limit } => write!(
                f,
                "the vehicle moves: {what} is {found:.3}, at rest it is at most {limit:.3}; put it down and keep it still"
            ),
            Self::GravityDisagrees { degrees } => write!(
                f,
                "up of the captured pose and of the accelerometer are {degrees:.1} degrees apart, at most 2 are flown with; check the capture \
                 system's up axis, imu_rotation and body_rotation"
            ),
            Self::Pose(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for StartError {}

/// Means over a window of rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RestMeans {
    pub(super) gyro: Vector3,
    pub(super) force: Vector3,
    pub(super) samples: f64,
}

/// Sums over one window. The last complete window decides.
#[derive(Clone, Copy, Debug)]
pub(super) struct RestDetector {
    start: f64,
    count: f64,
    // Relative to the first reading of the window, so that the squares keep their digits.
    origin: (Vector3, Vector3),
    sums: (Vector3, Vector3),
    squares: (Vector3, Vector3),
    watched: f64,
    verdict: Option<Result<RestMeans, StartError>>,
}

impl RestDetector {
    pub(super) const EMPTY: Self = {
        let zero = (Vector3::new(0.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.0));
        Self { start: 0.0, count: 0.0, origin: zero, sums: zero, squares: zero, watched: 0.0, verdict: None }
    };

    pub(super) fn push(&mut self, params: &RestParams, time: f64, gyro: &Vector3, force: &Vector3) {
        if self.count == 0.0 {
            *self = Self { start: time, origin: (*gyro, *force), verdict: self.verdict, ..Self::EMPTY };
        }
        let (g, s) = (gyro - self.origin.0, force - self.origin.1);
        self.count += 1.0;
        self.sums = (self.sums.0 + g, self.sums.1 + s);
        self.squares = (self.squares.0 + g.component_mul(&g), self.squares.1 + s.component_mul(&s));
        self.watched = time - self.start;
        if self.watched >= params.duration {
            self.verdict = Some(self.judge(params));
            self.count = 0.0;
        }
    }

    fn judge(&self, params: &RestParams) -> Result<RestMeans, StartError> {
        let spread = |sums: &Vector3, squares: &Vector3| {
            let mean = sums / self.count;
            let variance = (squares / self.count - mean.component_mul(&mean)).max();
            sqrt(if variance > 0.0 { variance } else { 0.0 })
        };
        let gyro = self.origin.0 + self.sums.0 / self.count;
        let force = self.origin.1 + self.sums.1 / self.count;
        for (what, found, limit) in [
            (
                "the gyro's standard deviation (rad/s)",
                spread(&self.sums.0, &self.squares.0),
                params.gyro_deviation,
            ),
            (
                "the accelerometer's standard deviation (m/s^2)",
                spread(&self.sums.1, &self.squares.1),
                params.accelerometer_deviation,
            ),
            ("the mean rate (rad/s)", gyro.norm(), params.gyro_bias),
            (
                "the distance of the mean specific force from 9.81 m/s^2",
                fabs(force.norm() - GRAVITY),
                params.accelerometer_bias,
            ),
        ] {
            if found > limit || found.is_nan() {
                return Err(StartError::Moving { what, found, limit });
            }
        }
        Ok(RestMeans { gyro, force, samples: self.count })
    }

    /// Whether the vehicle was at rest in the last complete window.
    pub(super) fn at_rest(&self) -> bool {
        matches!(self.verdict, Some(Ok(_)))
    }

    /// The means at rest, if the accelerometer agrees with the vertical of `rotation_wi`.
    pub(super) fn means(&self, params: &RestParams, rotation_wi: &Matrix3) -> Result<RestMeans, StartError> {
        let Some(verdict) = self.verdict else {
            return Err(StartError::TooShort { found: self.watched, expected: params.duration });
        };
        let means = verdict?;
        let up = (rotation_wi * means.force).z / means.force.norm();
        let degrees = acos(up.clamp(-1.0, 1.0)).to_degrees();
        if degrees > MOST_TILT { Err(StartError::GravityDisagrees { degrees }) } else { Ok(means) }
    }
}
