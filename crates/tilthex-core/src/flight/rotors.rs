//! What the rotors and the IMU should read: a model that checks the
//! measurements, and stands in for them where they are missing.

use super::session::Motor;
use crate::{
    Vehicle,
    filters::lag_fraction,
    plant::ImuSample,
    types::{RobotState, RotorVector, Vector3, Wrench},
};

/// Measurements older than this are replaced by the model, s.
pub(super) const STALE: f64 = 0.1;
/// A motor this far from the model does not follow, Hz.
const WRONG_SPEED: f64 = 12.0;

/// The commanded speeds behind each rotor's lag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RotorModel {
    rate: f64,
    expected: RotorVector,
}

impl RotorModel {
    /// Rotors at rest.
    #[must_use]
    pub(super) fn new(vehicle: &Vehicle) -> Self {
        let constant = vehicle.rotor_time_constant();
        Self { rate: if constant > 0.0 { 1.0 / constant } else { 1e4 }, expected: RotorVector::zeros() }
    }

    /// Moves on by `dt` seconds of a command, Hz.
    pub(super) fn step(&mut self, command: &RotorVector, dt: f64) {
        self.expected += (command - self.expected) * lag_fraction(self.rate, dt);
    }

    /// Measured speeds, Hz, with the model in the place of stale ones.
    #[must_use]
    pub(super) fn speeds(&self, motors: &[Motor], now: f64) -> RotorVector {
        let mut speeds = RotorVector::zeros();
        for ((speed, expected), motor) in speeds.iter_mut().zip(self.expected.iter()).zip(motors) {
            *speed = if now - motor.heard > STALE { *expected } else { motor.speed };
        }
        speeds
    }

    /// How many motors are measured far from the model.
    #[must_use]
    pub(super) fn wrong_speeds(&self, motors: &[Motor], now: f64) -> usize {
        let wrong = |(motor, expected): &(&Motor, &f64)| {
            now - motor.heard <= STALE && libm::fabs(motor.speed - **expected) > WRONG_SPEED
        };
        motors.iter().zip(self.expected.iter()).filter(wrong).count()
    }
}

/// The inertial sample that the model predicts after `dt` from the last
/// estimate, rotor speeds and observed wrench, without biases.
#[must_use]
pub(super) fn modelled_imu(
    vehicle: &Vehicle,
    state: &RobotState,
    rotor_speeds: &RotorVector,
    external: &Wrench,
    dt: f64,
) -> ImuSample {
    let actuation = vehicle.body_wrench(rotor_speeds);
    let omega = state.angular_velocity_r;
    let torque = actuation.torque + external.torque - omega.cross(&(vehicle.inertia() * omega));
    let alpha = vehicle.inertia_inverse() * torque;
    let omega = omega + alpha * dt;
    let force = actuation.force + state.rotation_wr.transpose() * external.force;
    let imu = vehicle.imu();
    let lever: Vector3 = alpha.cross(&imu.position_r) + omega.cross(&omega.cross(&imu.position_r));
    let to_imu = imu.rotation_r.transpose();
    ImuSample { gyro_i: to_imu * omega, specific_force_i: to_imu * (force / vehicle.mass() + lever) }
}
