//! Random vehicles, attitudes and wrenches for the property tests.
#![allow(dead_code, clippy::unwrap_used)] // each test binary uses its part

pub(crate) mod hovers;

use proptest::prelude::*;
use tilthex_core::{
    Matrix3, Vector3, Vehicle, Wrench, so3,
    vehicle::{Mounting, TiltedHexarotor},
};

pub(crate) fn vector(size: f64) -> impl Strategy<Value = Vector3> {
    prop::array::uniform3(-size..size).prop_map(Vector3::from)
}

pub(crate) fn rotation() -> impl Strategy<Value = Matrix3> {
    vector(3.1).prop_map(|v| so3::exp(&v))
}

pub(crate) fn wrench(force: f64, torque: f64) -> impl Strategy<Value = Wrench> {
    (vector(force), vector(torque)).prop_map(|(force, torque)| Wrench { force, torque })
}

/// Principal moments that a rigid body can have, turned anyhow.
pub(crate) fn inertia() -> impl Strategy<Value = Matrix3> {
    (prop::array::uniform3(0.003..0.05f64), rotation()).prop_map(|(masses, r)| {
        // Point masses on three axes: the triangle inequality holds by construction.
        let [a, b, c] = masses;
        r * Matrix3::from_diagonal(&Vector3::new(b + c, a + c, a + b)) * r.transpose()
    })
}

pub(crate) fn vehicle() -> impl Strategy<Value = Vehicle> {
    (0.5..5.0f64, inertia(), 0.2..0.6f64, 15.0..40.0f64, 0.0..15.0f64, vector(0.5), rotation()).prop_map(
        |(mass, inertia, arm, alpha, beta, position_r, rotation_r)| {
            let hexarotor = TiltedHexarotor {
                arm,
                rotor_offset: Vector3::new(0.0, 0.0, 0.03),
                alpha: alpha.to_radians(),
                beta: beta.to_radians(),
                thrust_coefficient: 11.4e-4,
                drag_coefficient: 2.4e-5,
                min_speed: 16.0,
                max_speed: 200.0,
            };
            let tool = Mounting { position_r, rotation_r };
            let inertia = 0.5 * (inertia + inertia.transpose());
            Vehicle::new(mass, inertia, &hexarotor.rotors(), 0.03, tool, Mounting::default()).unwrap()
        },
    )
}

/// The paper's Tilt-Hex (table 1, with the published rotor figures).
pub(crate) fn tilt_hex() -> Vehicle {
    tilthex_core::examples::tilt_hex().unwrap()
}
