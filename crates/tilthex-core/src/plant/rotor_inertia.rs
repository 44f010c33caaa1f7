//! The angular momentum of the rotors: the reaction to their acceleration, and the gyroscopic torque.

use crate::{
    types::{RotorVector, Vector3},
    vehicle::Vehicle,
};
use core::f64::consts::TAU;

/// Angular momentum of the rotors, N m s, robot coordinates, at speeds in Hz.
///
/// The direction of rotation is opposite to the drag moment, whose sign is `spin`:
/// `h = -J sum(spin_i 2 pi w_i axis_i)`.
#[must_use]
pub fn momentum(vehicle: &Vehicle, inertia: f64, speeds: &RotorVector) -> Vector3 {
    vehicle
        .rotors()
        .iter()
        .zip(speeds.iter())
        .fold(Vector3::zeros(), |h, (rotor, w)| h - inertia * rotor.spin * TAU * *w * rotor.axis_r)
}

/// Torque on the airframe, N m, robot coordinates, for accelerations in Hz/s and an angular velocity of the robot
/// (rad/s): `-h' - omega x h` (Euler's equation of a body with rotors; Hughes, Spacecraft Attitude Dynamics, ch.
/// 3.4).
#[must_use]
pub fn torque(
    vehicle: &Vehicle,
    inertia: f64,
    speeds: &RotorVector,
    accelerations: &RotorVector,
    angular_velocity_r: &Vector3,
) -> Vector3 {
    -momentum(vehicle, inertia, accelerations) - angular_velocity_r.cross(&momentum(vehicle, inertia, speeds))
}
