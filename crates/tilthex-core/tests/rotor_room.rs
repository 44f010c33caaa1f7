//! The torque towards more room for the rotors, against hovers and differences.

#![allow(clippy::unwrap_used)]

mod common;

use common::{rotation, tilt_hex, vector};
use proptest::prelude::*;
use tilthex_core::{Matrix3, Rotor, Vector3, Vehicle, rotor_room::RotorRoom, so3, vehicle::Mounting};

/// Least distance of a hover's rotor inputs from their limits, parts of the range.
fn least_room(vehicle: &Vehicle, rotation_wr: &Matrix3) -> f64 {
    let weight_r = rotation_wr.transpose() * Vector3::new(0.0, 0.0, vehicle.weight());
    let inputs = vehicle.allocation_inverse().fixed_columns::<3>(0) * weight_r;
    let room = |(r, u): (&Rotor, &f64)| {
        let (lower, upper) = (r.min_speed * r.min_speed.abs(), r.max_speed * r.max_speed.abs());
        (u - lower).min(upper - u) / (upper - lower)
    };
    vehicle.rotors().iter().zip(inputs.iter()).map(room).fold(f64::INFINITY, f64::min)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn room_is_the_least_of_the_rotors(attitude in rotation(), axis in vector(1.0)) {
        let vehicle = tilt_hex();
        let (room, _) = RotorRoom::new(&vehicle, 0.1).unwrap().room(&attitude, &axis);
        let least = least_room(&vehicle, &attitude);
        prop_assert!(room <= least && room >= least - 12f64.ln() / 60.0);
    }

    #[test]
    fn its_slope_is_its_derivative(attitude in rotation(), axis in vector(1.0)) {
        prop_assume!(axis.norm() > 0.1);
        let axis = axis.normalize();
        let room = RotorRoom::new(&tilt_hex(), 0.1).unwrap();
        let at = |angle: f64| room.room(&(so3::exp(&(axis * angle)) * attitude), &axis).0;
        let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
        prop_assert!((room.room(&attitude, &axis).1 - difference).abs() < 1e-6);
    }

    #[test]
    fn the_torque_is_bounded_and_along_the_tool(attitude in rotation(), largest in 0.0..2.0f64) {
        let torque = RotorRoom::new(&tilt_hex(), largest).unwrap().torque(&attitude, &Mounting::default());
        prop_assert!(torque.norm() <= largest);
        prop_assert!(torque.cross(&attitude.column(2)).norm() < 1e-12);
    }

    /// From any heading but the worst, to the widest tilt that the Tilt-Hex can hold.
    #[test]
    fn following_it_finds_the_most_room(axis in -3.1..3.1f64, tilt in 0.1..0.3f64) {
        let vehicle = tilt_hex();
        let room = RotorRoom::new(&vehicle, 1.0).unwrap();
        let mut attitude = so3::exp(&(Vector3::new(axis.cos(), axis.sin(), 0.0) * tilt));
        let headings = || (0..3600).map(|i| f64::from(i) * 0.1f64.to_radians());
        let most = headings().map(|a| least_room(&vehicle, &(attitude * so3::rot_z(a)))).fold(0.0, f64::max);
        prop_assume!((1.5 * axis).cos().abs() > 0.02);
        for _ in 0..20_000 {
            attitude = so3::exp(&(room.torque(&attitude, &Mounting::default()) * 0.002)) * attitude;
        }
        prop_assert!(least_room(&vehicle, &attitude) > most - 0.01);
    }
}

#[test]
fn level_there_is_no_torque() {
    let torque = RotorRoom::new(&tilt_hex(), 1.0).unwrap().torque(&so3::rot_z(0.7), &Mounting::default());
    assert!(torque.norm() < 1e-12);
}

#[test]
fn a_torque_out_of_range_is_named() {
    let error = RotorRoom::new(&tilt_hex(), -1.0).unwrap_err().to_string();
    assert_eq!(error, "room_torque is -1; expected a number from 0 to 1000");
}
