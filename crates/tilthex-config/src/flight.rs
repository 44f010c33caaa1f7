//! Converts a configuration to the parameters of a flight.

use std::time::Duration;

use super::{
    Config, ConfigError, LinkSection, MissionSection, MocapSection, OrdersSection, SupervisorSection,
    margins::LoopDelays, section,
};
use tilthex_core::{
    estimator::EstimatorParams,
    flight::{FlightParams, GuidanceParams, WatchParams},
    model_learning::{Calibration, ModelPrior},
    trajectory::Limits,
};
use tilthex_link::{LinkKind, LinkParams, LinkedParams, px4::ThrottleMap, tk3::ImuScales};
use tilthex_mocap::{ClientParams, UpAxis};

impl Config {
    /// The parameters of the state estimator.
    ///
    /// # Errors
    /// Names the key of `[estimator]` with an impossible value.
    pub fn estimator_params(&self) -> Result<EstimatorParams, ConfigError> {
        self.estimator.params(self.vehicle.vehicle())
    }

    /// The delays of the loop, for the stability margins.
    #[must_use]
    pub fn loop_delays(&self) -> LoopDelays {
        self.link.loop_delays()
    }

    /// The parameters of a flight; `take_off` starts it without a command. `Flight::new` accepts them: this was checked when the
    /// configuration was read.
    ///
    /// # Errors
    /// Names the section and the key with an impossible value.
    pub fn flight_params(&self, take_off: bool) -> Result<FlightParams, ConfigError> {
        let guidance = self.mission.params(self.orders.limits())?;
        if guidance.calibration == Calibration::Tilts && self.vehicle.vehicle().rank() < 6 {
            return Err(ConfigError::new(
                "[mission]: calibration is \"tilts\"; expected \"hover\" or \"none\": this vehicle hovers in one attitude",
            ));
        }
        Ok(FlightParams {
            vehicle: *self.vehicle.vehicle(),
            controller: *self.controller(),
            estimator: self.estimator_params()?,
            guidance,
            model_prior: ModelPrior { mass: self.mission.mass_deviation, ..ModelPrior::CAD },
            slow_learning: self.mission.slow_learning,
            watch: self.supervisor.params(),
            take_off,
            rotor_speed_age: self.link.rotor_speed_age,
        })
    }

    /// The parameters of a flight and its link; `take_off` starts it without a command.
    ///
    /// # Errors
    /// Names the section and the key with an impossible value.
    pub fn linked_params(&self, take_off: bool) -> Result<LinkedParams, ConfigError> {
        let link = self.link.params()?;
        // The line may have been changed since the configuration was read.
        self.check_line(link)?;
        self.check_hover()?;
        self.check_throttle()?;
        Ok(LinkedParams { kind: self.link.kind()?, link, flight: self.flight_params(take_off)? })
    }
}

impl LinkSection {
    pub(super) fn loop_delays(&self) -> LoopDelays {
        LoopDelays {
            period: 1.0 / self.imu_rate,
            line: self.loop_delay,
            // The newest speed of a motor is half a period old on average, unless it is corrected to the inertial sample's time.
            rotor_speeds: if self.rotor_speed_age > 0.0 { 0.0 } else { 0.5 / self.motor_rate },
        }
    }

    /// The kind of the vehicle's link.
    ///
    /// # Errors
    /// If no link has this name.
    pub fn kind(&self) -> Result<LinkKind, ConfigError> {
        LinkKind::ALL.iter().copied().find(|kind| kind.name() == self.protocol).ok_or_else(|| {
            let names: Vec<_> = LinkKind::ALL.iter().map(|kind| format!("\"{}\"", kind.name())).collect();
            ConfigError::new(format!(
                "[link]: protocol is \"{}\"; expected {}",
                self.protocol,
                names.join(" or ")
            ))
        })
    }

    /// The parameters of the link.
    ///
    /// # Errors
    /// Names the key with an impossible value.
    pub fn params(&self) -> Result<LinkParams, ConfigError> {
        let period = |rate: f64| (1e6 / rate).round() as u32;
        let scales = (self.accelerometer_scale > 0.0 && self.gyro_scale > 0.0)
            .then_some(ImuScales { accelerometer: self.accelerometer_scale, gyro: self.gyro_scale });
        if scales.is_none() && self.accelerometer_scale + self.gyro_scale > 0.0 {
            return Err(ConfigError::new(
                "[link]: one of accelerometer_scale and gyro_scale is set; expected both or none",
            ));
        }
        Ok(LinkParams {
            imu_period_us: period(self.imu_rate),
            motor_period_us: period(self.motor_rate),
            battery_period_us: period(self.battery_rate),
            scales,
            throttle: ThrottleMap {
                coefficients: self.throttle.0,
                voltage: self.throttle_voltage,
                exponent: self.throttle_exponent,
                correction: self.throttle_correction,
            },
        })
    }
}

impl MocapSection {
    /// The settings of the client of motion capture.
    ///
    /// # Errors
    /// If the axis is neither "y" nor "z".
    pub fn client(&self) -> Result<ClientParams, ConfigError> {
        Ok(ClientParams { up_axis: self.up_axis()?, latency: self.latency })
    }

    /// The capture system's upward axis.
    ///
    /// # Errors
    /// If it is neither "y" nor "z".
    pub fn up_axis(&self) -> Result<UpAxis, ConfigError> {
        match self.up_axis.as_str() {
            "y" => Ok(UpAxis::Y),
            "z" => Ok(UpAxis::Z),
            other => {
                Err(ConfigError::new(format!("[mocap]: up_axis is \"{other}\"; expected \"y\" or \"z\"")))
            }
        }
    }
}

/// Makes limits from m/s, m/s^2, and degrees/s, degrees/s^2.
fn limits((velocity, acceleration): (f64, f64), (turning_deg, turning_faster_deg): (f64, f64)) -> Limits {
    let (angular_velocity, angular_acceleration) =
        (turning_deg.to_radians(), turning_faster_deg.to_radians());
    Limits { velocity, acceleration, angular_velocity, angular_acceleration }
}

impl MissionSection {
    /// Limits of the motion to a way-point.
    #[must_use]
    pub fn limits(&self) -> Limits {
        limits(
            (self.max_velocity, self.max_acceleration),
            (self.max_angular_velocity_deg, self.max_angular_acceleration_deg),
        )
    }

    fn calibration(&self) -> Result<Calibration, ConfigError> {
        let known = Calibration::ALL.iter().map(|c| c.name());
        section::check_known("calibration", &self.calibration, known)
            .map_err(|e| e.within("[mission] calibration"))?;
        Ok(Calibration::from_name(&self.calibration).unwrap_or_default())
    }

    /// The parameters of guidance. `stream` has the largest rates of streamed set-points.
    fn params(&self, stream: Limits) -> Result<GuidanceParams, ConfigError> {
        Ok(GuidanceParams {
            take_off_height: self.take_off_height,
            bias_time: self.bias_time,
            calibration: self.calibration()?,
            limits: self.limits(),
            stream,
            landing_speed: self.landing_speed,
            max_setpoint_jump: self.max_setpoint_jump,
        })
    }
}

impl OrdersSection {
    /// The largest rates that an order may ask for.
    #[must_use]
    pub fn limits(&self) -> Limits {
        limits(
            (self.max_velocity, self.max_acceleration),
            (self.max_angular_velocity_deg, self.max_angular_acceleration_deg),
        )
    }
}

impl SupervisorSection {
    /// Longest silence of an operator whose orders are flown; `None` for no limit.
    #[must_use]
    pub fn operator_timeout(&self) -> Option<Duration> {
        (self.operator_timeout > 0.0).then(|| Duration::from_secs_f64(self.operator_timeout))
    }

    pub(super) fn params(&self) -> WatchParams {
        WatchParams {
            battery_low: self.battery_low,
            battery_critical: self.battery_critical,
            max_position_error: self.max_position_error,
            max_rotation_error: self.max_rotation_error_deg.to_radians().sin(),
            max_tilt: self.max_tilt_deg.to_radians(),
            max_speed: self.max_speed,
            max_force: self.max_force,
            max_torque: self.max_torque,
            start_timeout: self.start_timeout,
            motor_check: self.motor_check,
            geofence: self.geofence,
            geofence_height: self.geofence_height,
        }
    }
}
