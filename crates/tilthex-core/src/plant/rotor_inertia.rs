//! The rotors' own angular momentum: reaction to acceleration, and gyroscopic torque.

use crate::{
    types::{RotorVector, Vector3},
    vehicle::Vehicle,
};
use core::f64::consts::TAU;

/// Angular momentum of the rotors, N m s, robot coordinates, of speeds in Hz.
///
/// A rotor turns against the drag moment that its `spin` names:
/// `h = -J sum(spin_i 2 pi w_i axis_i)`.
#[must_use]
pub fn momentum(vehicle: &Vehicle, inertia: f64, speeds: &RotorVector) -> Vector3 {
    vehicle
        .rotors()
        .iter()
        .zip(speeds.iter())
        .fold(Vector3::zeros(), |h, (rotor, w)| h - inertia * rotor.spin * TAU * *w * rotor.axis_r)
}

/// Torque on the airframe, N m, robot coordinates: `-dh/dt` for accelerations in Hz/s, the robot
/// turning at an angular velocity (rad/s): `-h' - omega x h` (Euler's equation of a body with rotors;
/// Hughes, Spacecraft Attitude Dynamics, ch. 3.4).
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
