//! The parameters of the documentation's vehicle: a start for those of another one.

use crate::FirmwareParams;
use tilthex_core::{
    Error,
    controller::ControllerParams,
    estimator::EstimatorParams,
    examples,
    flight::{FlightParams, GuidanceParams, WatchParams},
    model_learning::{Calibration, ModelPrior},
    trajectory::Limits,
};

/// The Tilt-Hex of the paper with the values of the configuration's preset `tilt-hex`, and limits of the battery, V: low and
/// critical.
///
/// # Errors
/// None: the figures are accepted.
pub fn tilt_hex((battery_low, battery_critical): (f64, f64)) -> Result<FirmwareParams, Error> {
    let guidance = GuidanceParams {
        take_off_height: 0.6,
        bias_time: 2.0,
        calibration: Calibration::None,
        limits: Limits {
            velocity: 0.4,
            acceleration: 0.8,
            angular_velocity: 30f64.to_radians(),
            angular_acceleration: 60f64.to_radians(),
        },
        landing_speed: 0.25,
        stream: Limits {
            velocity: 1.5,
            acceleration: 4.0,
            angular_velocity: 90f64.to_radians(),
            angular_acceleration: 360f64.to_radians(),
        },
        max_setpoint_jump: 0.05,
    };
    let watch = WatchParams {
        battery_low,
        battery_critical,
        max_position_error: 0.3,
        // The sine of 35 degrees.
        max_rotation_error: 0.573_576_436_351_046,
        max_tilt: 60f64.to_radians(),
        max_speed: 3.0,
        max_force: 27.0,
        max_torque: 6.2,
        start_timeout: 30.0,
        motor_check: true,
        geofence: 3.0,
        geofence_height: 3.0,
    };
    let flight = FlightParams {
        vehicle: examples::tilt_hex()?,
        controller: ControllerParams::default(),
        estimator: EstimatorParams::default(),
        guidance,
        model_prior: ModelPrior::CAD,
        slow_learning: true,
        watch,
        take_off: false,
        rotor_speed_age: 0.0,
    };
    Ok(FirmwareParams { flight, operator_timeout: 2.0 })
}
