//! The sections of the flight itself, and the whole of its parameters.

use super::{
    Config,
    section::{ConfigError, section},
};
use std::time::Duration;
use tilthex_core::{
    error::check_range,
    flight::{Flight, FlightParams, GuidanceParams, SessionParams, WatchParams},
    link::tk3::ImuScales,
    trajectory::Limits,
};

section! {
    /// The serial link to the vehicle.
    pub LinkSection as "link" {
        /// 57600, 115200, 500000, 2000000, or 0 to leave the speed alone (native USB, pseudo-terminals).
        baud: u32 = 500_000,
        /// Inertial samples, and ticks of the loop, a second.
        imu_rate: f64 = 500.0,
        /// Measurements of each motor a second.
        motor_rate: f64 = 250.0,
        /// Battery voltages a second.
        battery_rate: f64 = 1.0,
        /// One count of the accelerometer, m/s^2; 0 takes what is known of the board.
        accelerometer_scale: f64 = 0.0,
        /// One count of the gyroscope, rad/s; 0 takes what is known of the board.
        gyro_scale: f64 = 0.0,
    }
}

section! {
    /// Take-off, hover and landing.
    pub FlightSection as "flight" {
        /// Take off as soon as everything is ready, without an order to.
        take_off: bool = true,
        /// Height of the first hover above the start, m.
        take_off_height: f64 = 0.6,
        /// Time at the first hover in which the wrench bias is learnt, s; 0 leaves it out.
        bias_time: f64 = 2.0,
        /// Largest velocity of take-off and of way-points without limits of their own, m/s.
        velocity: f64 = 0.4,
        /// Largest acceleration likewise, m/s^2.
        acceleration: f64 = 0.8,
        /// Largest angular velocity likewise, degrees/s.
        angular_velocity_deg: f64 = 30.0,
        /// Largest angular acceleration likewise, degrees/s^2.
        angular_acceleration_deg: f64 = 60.0,
        /// Speed of the descent, m/s.
        landing_speed: f64 = 0.25,
        /// Streamed set-points may jump by at most this far, m.
        max_setpoint_jump: f64 = 0.05,
    }
}

section! {
    /// Limits whose crossing is a fault; docs/faults.md says what follows from each.
    pub SupervisorSection as "supervisor" {
        /// Battery voltage below which it lands, and does not start, V; 0 for no limit.
        battery_low: f64 = 0.0,
        /// Battery voltage below which it does so sooner, V; 0 for no limit.
        battery_critical: f64 = 0.0,
        /// Largest position error, m.
        max_position_error: f64 = 0.4,
        /// Largest rotation error, degrees.
        max_rotation_error_deg: f64 = 35.0,
        /// Largest tilt, degrees.
        max_tilt_deg: f64 = 60.0,
        /// Largest speed, m/s.
        max_speed: f64 = 3.0,
        /// Largest force at the tool, N.
        max_force: f64 = 20.0,
        /// Largest torque at the tool, N m.
        max_torque: f64 = 5.0,
        /// Longest time for the start of all motors, s.
        start_timeout: f64 = 30.0,
    }
}

impl LinkSection {
    /// Between two ticks.
    #[must_use]
    pub fn period(&self) -> Duration {
        Duration::from_secs_f64(1.0 / self.imu_rate)
    }

    fn session(&self) -> Result<SessionParams, ConfigError> {
        let period = |name, rate: f64, least: f64| {
            check_range(name, rate, least, 1000.0)?;
            Ok::<_, ConfigError>((1e6 / rate) as u32)
        };
        check_range("accelerometer_scale", self.accelerometer_scale, 0.0, 1.0)?;
        check_range("gyro_scale", self.gyro_scale, 0.0, 1.0)?;
        let scales = match (self.accelerometer_scale, self.gyro_scale) {
            (0.0, 0.0) => None,
            (accelerometer, gyro) if accelerometer > 0.0 && gyro > 0.0 => {
                Some(ImuScales { accelerometer, gyro })
            }
            _ => {
                return Err(ConfigError::new(
                    "one of accelerometer_scale and gyro_scale is 0; expected both, or none",
                ));
            }
        };
        Ok(SessionParams {
            imu_period_us: period("imu_rate", self.imu_rate, 100.0)?,
            motor_period_us: period("motor_rate", self.motor_rate, 20.0)?,
            battery_period_us: period("battery_rate", self.battery_rate, 0.1)?,
            scales,
        })
    }
}

impl FlightSection {
    /// Limits of ways that have none of their own.
    #[must_use]
    pub fn limits(&self) -> Limits {
        Limits {
            velocity: self.velocity,
            acceleration: self.acceleration,
            angular_velocity: self.angular_velocity_deg.to_radians(),
            angular_acceleration: self.angular_acceleration_deg.to_radians(),
        }
    }

    fn guidance(&self) -> Result<GuidanceParams, ConfigError> {
        check_range("take_off_height", self.take_off_height, 0.05, 10.0)?;
        check_range("bias_time", self.bias_time, 0.0, 60.0)?;
        check_range("velocity", self.velocity, 0.01, 5.0)?;
        check_range("acceleration", self.acceleration, 0.01, 10.0)?;
        check_range("angular_velocity_deg", self.angular_velocity_deg, 1.0, 360.0)?;
        check_range("angular_acceleration_deg", self.angular_acceleration_deg, 1.0, 3600.0)?;
        check_range("landing_speed", self.landing_speed, 0.05, 2.0)?;
        check_range("max_setpoint_jump", self.max_setpoint_jump, 0.0, 10.0)?;
        Ok(GuidanceParams {
            take_off_height: self.take_off_height,
            bias_time: self.bias_time,
            limits: self.limits(),
            landing_speed: self.landing_speed,
            max_setpoint_jump: self.max_setpoint_jump,
        })
    }
}

impl SupervisorSection {
    fn watch(&self) -> Result<WatchParams, ConfigError> {
        check_range("battery_low", self.battery_low, 0.0, 100.0)?;
        check_range("battery_critical", self.battery_critical, 0.0, 100.0)?;
        check_range("max_position_error", self.max_position_error, 0.01, 10.0)?;
        check_range("max_rotation_error_deg", self.max_rotation_error_deg, 1.0, 89.0)?;
        check_range("max_tilt_deg", self.max_tilt_deg, 1.0, 180.0)?;
        check_range("max_speed", self.max_speed, 0.1, 50.0)?;
        check_range("max_force", self.max_force, 0.1, 1000.0)?;
        check_range("max_torque", self.max_torque, 0.01, 1000.0)?;
        check_range("start_timeout", self.start_timeout, 1.0, 300.0)?;
        Ok(WatchParams {
            battery_low: self.battery_low,
            battery_critical: self.battery_critical,
            max_position_error: self.max_position_error,
            // The norm of e_R is the sine of the angle.
            max_rotation_error: self.max_rotation_error_deg.to_radians().sin(),
            max_tilt: self.max_tilt_deg.to_radians(),
            max_speed: self.max_speed,
            max_force: self.max_force,
            max_torque: self.max_torque,
            start_timeout: self.start_timeout,
        })
    }
}

impl Config {
    /// The parameters of a flight.
    ///
    /// # Errors
    /// One sentence with the section and the key.
    pub fn flight_params(&self) -> Result<FlightParams, ConfigError> {
        let params = FlightParams {
            vehicle: *self.vehicle.vehicle(),
            controller: *self.controller(),
            estimator: self.estimator.params(self.vehicle.vehicle())?,
            session: self.link.session().map_err(|e| e.within("[link]"))?,
            guidance: self.flight.guidance().map_err(|e| e.within("[flight]"))?,
            watch: self.supervisor.watch().map_err(|e| e.within("[supervisor]"))?,
            take_off: self.flight.take_off,
        };
        Flight::new(params, None).map_err(ConfigError::from)?;
        Ok(params)
    }
}
