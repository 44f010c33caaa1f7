//! The section of the state estimator.

use super::{
    section::{ConfigError, Section, section},
    values::{Axes, Square},
    vehicle::mounting,
};
use tilthex_core::{
    Vehicle,
    estimator::{Estimator, EstimatorParams, RestParams},
    ukf::{InitialDeviation, ProcessNoise},
};

section! {
    /// The state estimator, an unscented Kalman filter on SO(3) x R^12. The place of the IMU
    /// is in `[vehicle]`: `imu_position` and `imu_rotation_deg`.
    pub EstimatorSection as "estimator" {
        /// Standard deviation of a captured position, each axis.
        position_noise: f64 = 0.3e-3 => "m" from 1e-4 to 1.0,
        /// Standard deviation of a captured orientation, each axis.
        rotation_noise_deg: f64 = 0.12 => "degrees" from 0.006 to 57.0,
        /// White noise of the gyro.
        gyro_noise: f64 = 5e-4 => "rad/s/sqrt(Hz)" from 1e-6 to 1.0,
        /// White noise of the accelerometer.
        accelerometer_noise: f64 = 0.01 => "m/s^2/sqrt(Hz)" from 1e-5 to 10.0,
        /// Random walk of the gyro's bias.
        gyro_bias_walk: f64 = 1e-4 => "rad/s/sqrt(s)" from 1e-8 to 1.0,
        /// Random walk of the accelerometer's bias.
        accelerometer_bias_walk: f64 = 1e-3 => "m/s^2/sqrt(s)" from 1e-7 to 10.0,
        /// Scale and misalignment of the gyro: the rate with its bias is this matrix times the reading, IMU axes. Three
        /// numbers, its diagonal, or 3x3; `tilthex calibrate` finds it.
        gyro_matrix: Square<3> = Square::diagonal([1.0; 3]) => "1",
        /// Scale and misalignment of the accelerometer, as of the gyro; `tilthex calibrate` finds its diagonal.
        accelerometer_matrix: Square<3> = Square::diagonal([1.0; 3]) => "1",
        /// Origin of the captured body, robot frame; `tilthex calibrate` finds it.
        body_position: Axes<3> = Axes([0.0; 3]) => "m" from -10.0 to 10.0,
        /// Captured body to robot frame: roll, pitch, yaw (yaw first).
        body_rotation_deg: Axes<3> = Axes([0.0; 3]) => "degrees",
        /// Probability with which a good pose passes the gate; poses outside of the gate get a smaller weight. 1
        /// switches the gate off.
        gate_probability: f64 = 0.9999 => "1" from 0.5 to 1.0,
        /// Largest age of a late pose that is still applied.
        history: f64 = 0.3 => "s" from 0.02 to 1.0,
        /// Constant latency that is subtracted from the time of every pose, for capture systems that stamp on
        /// arrival. Negative if the IMU is late; `tilthex calibrate` finds it.
        latency: f64 = 0.0 => "s" from -0.05 to 0.5,
        /// If no pose has fitted for this time, and five poses in a row agree, the estimator takes over their rotation, or
        /// their whole motion if a drift of the gyro explains the difference.
        reacquire_after: f64 = 0.3 => "s" from 0.0 to 60.0,
        /// Cut-off frequency of the angular acceleration for the correction of the IMU's lever arm.
        angular_acceleration_hz: f64 = 20.0 => "Hz" from 0.1 to 1000.0,
        /// Standard deviation of the first position, each axis.
        initial_position: f64 = 0.01 => "m" from 1e-5 to 1e3,
        /// Standard deviation of the first velocity, each axis.
        initial_velocity: f64 = 0.1 => "m/s" from 1e-5 to 100.0,
        /// Standard deviation of the first rotation, each axis.
        initial_rotation_deg: f64 = 1.0 => "degrees" from 6e-4 to 22.9,
        /// Standard deviation of the gyro's bias without a start at rest, each axis.
        initial_gyro_bias: f64 = 0.02 => "rad/s" from 1e-7 to 0.5,
        /// Standard deviation of the accelerometer's bias without a start at rest, each axis.
        initial_accelerometer_bias: f64 = 0.2 => "m/s^2" from 1e-6 to 5.0,
        /// Time over which the vehicle must be at rest.
        rest_duration: f64 = 1.0 => "s" from 0.05 to 60.0,
        /// Largest standard deviation of a gyro axis at rest.
        rest_gyro_deviation: f64 = 0.05 => "rad/s" from 1e-6 to 10.0,
        /// Largest standard deviation of an accelerometer axis at rest.
        rest_accelerometer_deviation: f64 = 0.5 => "m/s^2" from 1e-6 to 100.0,
        /// Largest bias of the gyro at rest.
        rest_gyro_bias: f64 = 0.1 => "rad/s" from 1e-6 to 10.0,
        /// Largest distance of the specific force at rest from 9.81 m/s^2.
        rest_accelerometer_bias: f64 = 0.6 => "m/s^2" from 1e-6 to 10.0,
    }
}

impl EstimatorSection {
    /// The estimator's parameters on a vehicle.
    ///
    /// # Errors
    /// One sentence with the section and the parameter.
    pub fn params(&self, vehicle: &Vehicle) -> Result<EstimatorParams, ConfigError> {
        let body = mounting(&self.body_position, &self.body_rotation_deg);
        let params = EstimatorParams {
            process: ProcessNoise {
                gyro: self.gyro_noise,
                accelerometer: self.accelerometer_noise,
                gyro_bias: self.gyro_bias_walk,
                accelerometer_bias: self.accelerometer_bias_walk,
            },
            position_noise: self.position_noise,
            rotation_noise: self.rotation_noise_deg.to_radians(),
            imu_position_r: vehicle.imu().position_r,
            imu_rotation_ri: vehicle.imu().rotation_r,
            gyro_matrix_i: self.gyro_matrix.0,
            accelerometer_matrix_i: self.accelerometer_matrix.0,
            body_position_r: body.position_r,
            body_rotation_rc: body.rotation_r,
            gate_probability: self.gate_probability,
            history: self.history,
            latency: self.latency,
            reacquire_after: self.reacquire_after,
            angular_acceleration_hz: self.angular_acceleration_hz,
            initial: InitialDeviation {
                position: self.initial_position,
                velocity: self.initial_velocity,
                rotation: self.initial_rotation_deg.to_radians(),
                gyro_bias: self.initial_gyro_bias,
                accelerometer_bias: self.initial_accelerometer_bias,
            },
            rest: RestParams {
                duration: self.rest_duration,
                gyro_deviation: self.rest_gyro_deviation,
                accelerometer_deviation: self.rest_accelerometer_deviation,
                gyro_bias: self.rest_gyro_bias,
                accelerometer_bias: self.rest_accelerometer_bias,
            },
        };
        match Estimator::new(params) {
            Ok(_) => Ok(params),
            Err(error) => Err(ConfigError::from(error).within(format_args!("[{}]", Self::NAME))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VehicleSection;

    #[test]
    fn defaults_are_the_cores() {
        let vehicle = VehicleSection::preset("tilt-hex").expect("a preset");
        let params = EstimatorSection::default().params(vehicle.vehicle()).expect("valid");
        let expected = EstimatorParams {
            imu_position_r: vehicle.vehicle().imu().position_r,
            imu_rotation_ri: vehicle.vehicle().imu().rotation_r,
            ..EstimatorParams::default()
        };
        assert_eq!(params, expected);
    }

    #[test]
    fn refuses_with_section_and_name() {
        let vehicle = VehicleSection::preset("tilt-hex").expect("a preset");
        let section = EstimatorSection { gate_probability: 1.5, ..EstimatorSection::default() };
        let error = section.params(vehicle.vehicle()).expect_err("refused").to_string();
        assert!(error.starts_with("[estimator]: gate_probability is 1.5; expected"), "{error}");
    }
}
