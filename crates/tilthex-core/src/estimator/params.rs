//! The parameters of the estimator: IMU, capture system and mounting.

use super::{gate::chi_square_quantile, rest::RestParams};
use crate::{
    Error,
    error::check_range,
    so3,
    types::{Matrix3, Vector3, is_finite3},
    ukf::{InitialDeviation, PoseNoise, ProcessNoise},
};
use libm::sqrt;

/// Largest difference of an entry of a sensor's matrix from the identity.
const MATRIX_OFF: f64 = 0.3;

/// Parameters of the [`Estimator`](super::Estimator).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimatorParams {
    /// Noise of the IMU.
    pub process: ProcessNoise,
    /// Standard deviation of a captured position, m per axis.
    pub position_noise: f64,
    /// Standard deviation of a captured orientation, rad per axis.
    pub rotation_noise: f64,
    /// Position of the IMU, m, robot.
    pub imu_position_r: Vector3,
    /// Maps IMU coordinates to robot coordinates.
    pub imu_rotation_ri: Matrix3,
    /// Maps readings of the gyro to the rate and its bias: scale and misalignment, IMU axes.
    pub gyro_matrix_i: Matrix3,
    /// Maps readings of the accelerometer to the specific force and its bias, IMU axes.
    pub accelerometer_matrix_i: Matrix3,
    /// Position of the captured body's origin, m, robot.
    pub body_position_r: Vector3,
    /// Maps the captured body's coordinates to robot coordinates.
    pub body_rotation_rc: Matrix3,
    /// Probability with which a good pose passes the gate; 1 switches the gate off.
    pub gate_probability: f64,
    /// Time over which late poses are still applied, s.
    pub history: f64,
    /// Constant latency that is subtracted from the time of every pose, s: for systems that stamp poses on arrival.
    /// Negative if the stamps of the IMU are late.
    pub latency: f64,
    /// If no pose has fitted for this time, s, and five poses in a row agree on a rotation, the estimator takes over
    /// their rotation.
    pub reacquire_after: f64,
    /// Cut-off frequency of the angular acceleration for the lever-arm correction, Hz.
    pub angular_acceleration_hz: f64,
    /// Deviations of the state after a start from a pose.
    pub initial: InitialDeviation,
    /// Limits of a vehicle at rest.
    pub rest: RestParams,
}

impl Default for EstimatorParams {
    fn default() -> Self {
        Self {
            process: ProcessNoise::default(),
            position_noise: 0.3e-3,
            rotation_noise: 0.12f64.to_radians(),
            imu_position_r: Vector3::zeros(),
            imu_rotation_ri: Matrix3::identity(),
            gyro_matrix_i: Matrix3::identity(),
            accelerometer_matrix_i: Matrix3::identity(),
            body_position_r: Vector3::zeros(),
            body_rotation_rc: Matrix3::identity(),
            gate_probability: 0.9999,
            history: 0.3,
            latency: 0.0,
            reacquire_after: 0.3,
            angular_acceleration_hz: 20.0,
            initial: InitialDeviation::default(),
            rest: RestParams::default(),
        }
    }
}

/// A measured pose of the IMU.
pub(super) struct ImuPose {
    pub(super) position_w: Vector3,
    pub(super) rotation_wi: Matrix3,
    /// Vector from the IMU to the origin of the captured body, m, world.
    arm_w: Vector3,
}

/// Parameters in the form that the filter steps use.
#[derive(Clone, Copy, Debug)]
pub(super) struct Derived {
    /// Maps IMU coordinates to the captured body's.
    pub(super) rotation_ci: Matrix3,
    /// Origin of the captured body, m, IMU.
    pub(super) arm_i: Vector3,
    pub(super) gate_pose: f64,
    pub(super) gate_position: f64,
}

impl EstimatorParams {
    /// # Errors
    /// [`Error`], which names the first parameter that is not possible.
    pub(super) fn derive(&self) -> Result<Derived, Error> {
        check_range("position_noise", self.position_noise, 1e-4, 1.0)?;
        check_range("rotation_noise", self.rotation_noise, 1e-4, 1.0)?;
        check_range("gate_probability", self.gate_probability, 0.5, 1.0)?;
        check_range("history", self.history, 0.02, 1.0)?;
        check_range("latency", self.latency, -0.05, 0.5 * self.history)?;
        check_range("reacquire_after", self.reacquire_after, 0.0, 60.0)?;
        check_range("angular_acceleration_hz", self.angular_acceleration_hz, 0.1, 1e3)?;
        for (name, v) in [("imu_position", self.imu_position_r), ("body_position", self.body_position_r)] {
            if !is_finite3(&v) {
                return Err(Error::NotFinite { name });
            }
            check_range(name, v.amax(), 0.0, 10.0)?;
        }
        so3::check_rotation("imu_rotation", &self.imu_rotation_ri)?;
        so3::check_rotation("body_rotation", &self.body_rotation_rc)?;
        for (name, difference, matrix) in [
            ("gyro_matrix", "difference of gyro_matrix from the identity", &self.gyro_matrix_i),
            (
                "accelerometer_matrix",
                "difference of accelerometer_matrix from the identity",
                &self.accelerometer_matrix_i,
            ),
        ] {
            if !matrix.iter().all(|x| x.is_finite()) {
                return Err(Error::NotFinite { name });
            }
            check_range(difference, (matrix - Matrix3::identity()).amax(), 0.0, MATRIX_OFF)?;
        }
        self.initial.check()?;
        self.rest.check()?;
        Ok(Derived {
            rotation_ci: self.body_rotation_rc.transpose() * self.imu_rotation_ri,
            arm_i: self.imu_rotation_ri.transpose() * (self.body_position_r - self.imu_position_r),
            gate_pose: chi_square_quantile(self.gate_probability, 6),
            gate_position: chi_square_quantile(self.gate_probability, 3),
        })
    }

    /// The pose of the IMU that follows from a pose of the captured body.
    pub(super) fn imu_pose(&self, derived: &Derived, position_w: &Vector3, rotation_wc: &Matrix3) -> ImuPose {
        let rotation_wi = rotation_wc * derived.rotation_ci;
        let arm_w = rotation_wi * derived.arm_i;
        ImuPose { position_w: position_w - arm_w, rotation_wi, arm_w }
    }

    /// The noise of that pose, with the configured variances of position and rotation multiplied by these factors.
    pub(super) fn pose_noise(&self, pose: &ImuPose, (position, rotation): (f64, f64)) -> PoseNoise {
        PoseNoise::new(
            self.position_noise * sqrt(position),
            self.rotation_noise * sqrt(rotation),
            &pose.arm_w,
        )
    }
}

impl RestParams {
    fn check(&self) -> Result<(), Error> {
        check_range("rest_duration", self.duration, 0.05, 60.0)?;
        check_range("rest_gyro_deviation", self.gyro_deviation, 1e-6, 10.0)?;
        check_range("rest_accelerometer_deviation", self.accelerometer_deviation, 1e-6, 100.0)?;
        check_range("rest_gyro_bias", self.gyro_bias, 1e-6, 10.0)?;
        check_range("rest_accelerometer_bias", self.accelerometer_bias, 1e-6, 10.0)
    }
}
