//! The vehicle of the examples in this documentation. Vehicles for flights are files, which `tilthex-config` reads.

use crate::{
    Error, Matrix3, Vector3, Vehicle,
    vehicle::{Mounting, TiltedHexarotor},
};

/// The Tilt-Hex of the paper's table 1: six rotors tilted by 35 and 10 degrees, 2.4 kg, a tool 0.4 m below.
///
/// # Errors
/// None: the figures are accepted.
pub fn tilt_hex() -> Result<Vehicle, Error> {
    let rotors = TiltedHexarotor {
        arm: 0.39,
        rotor_offset: Vector3::zeros(),
        alpha: 35f64.to_radians(),
        beta: 10f64.to_radians(),
        thrust_coefficient: 11.4e-4,
        drag_coefficient: 2.4e-5,
        min_speed: 16.0,
        max_speed: 110.0,
    }
    .rotors();
    let inertia = Matrix3::from_diagonal(&Vector3::new(11.5e-3, 11.4e-3, 19.4e-3));
    let at = |position_r| Mounting { position_r, rotation_r: Matrix3::identity() };
    Vehicle::new(2.4, inertia, &rotors, 0.03, at(Vector3::new(0.12, 0.0, -0.4)), at(Vector3::zeros()))
}
