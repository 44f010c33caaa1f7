//! Conservation laws of the simulated rigid body.

#![allow(clippy::unwrap_used)]

mod common;

use common::{inertia, rotation, tilt_hex, vector};
use proptest::prelude::*;
use tilthex_core::{
    GRAVITY, Matrix3, RobotState, RotorVector, Vector3, Vehicle, Wrench,
    plant::{Loads, Plant, PlantState},
    so3,
    vehicle::Mounting,
};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn a_free_body_keeps_energy_momentum_and_rotation(
        inertia in inertia(), rotation_wr in rotation(), omega in vector(6.0), velocity_w in vector(2.0),
    ) {
        let hex = tilt_hex();
        let inertia = 0.5 * (inertia + inertia.transpose());
        let vehicle =
            Vehicle::new(2.4, inertia, hex.rotors(), 0.03, Mounting::default(), Mounting::default()).unwrap();
        let plant = Plant::new(vehicle);
        let robot = RobotState { position_w: Vector3::zeros(), velocity_w, rotation_wr, angular_velocity_r: omega };
        let mut state = PlantState::new(robot, RotorVector::zeros());
        let rotational = |s: &PlantState| 0.5 * s.robot.angular_velocity_r.dot(&(inertia * s.robot.angular_velocity_r));
        let momentum = |s: &PlantState| s.robot.rotation_wr * inertia * s.robot.angular_velocity_r;
        let (e0, h0) = (rotational(&state), momentum(&state));
        for _ in 0..60_000 {
            plant.step(&mut state, &RotorVector::zeros(), &Wrench::ZERO, 1e-3);
        }
        prop_assert!((rotational(&state) - e0).abs() <= 1e-6 * e0.max(1e-3), "{} {}", rotational(&state), e0);
        prop_assert!((momentum(&state) - h0).norm() <= 1e-6 * h0.norm().max(1e-3));
        prop_assert!(so3::rotation_defect(&state.robot.rotation_wr) < 1e-12);
        let fallen = velocity_w - Vector3::new(0.0, 0.0, 60.0 * GRAVITY);
        prop_assert!((state.robot.velocity_w - fallen).amax() < 1e-6);
    }
}

proptest! {
    /// A simulation may take a control period of 2 ms in one step.
    #[test]
    fn one_step_of_a_period_is_two_of_its_half(
        rotation_wr in rotation(), omega in vector(5.0), velocity_w in vector(2.0), force in vector(10.0),
        torque in vector(0.5), push in vector(10.0), twist in vector(0.5),
        speeds in prop::array::uniform6(30.0..100.0f64), order in prop::array::uniform6(30.0..100.0f64),
    ) {
        let plant = Plant::new(tilt_hex());
        let rotors = |speeds: [f64; 6]| RotorVector::from_fn(|i, _| speeds.get(i).copied().unwrap_or(0.0));
        let robot = RobotState { position_w: Vector3::zeros(), velocity_w, rotation_wr, angular_velocity_r: omega };
        let mut whole = PlantState::new(robot, rotors(speeds));
        let mut halves = whole;
        let tool_w = Wrench { force: push, torque: twist };
        let loads = Loads { external: Wrench { force, torque }, tool_w };
        let step = |state: &mut PlantState, dt: f64| {
            let mut nominal = plant.vehicle().body_wrench(&state.rotor_speeds);
            plant.step_by(&plant.time_step(dt), state, &mut nominal, &rotors(order), &loads);
        };
        step(&mut whole, 2e-3);
        for _ in 0..2 {
            step(&mut halves, 1e-3);
        }
        let (w, h) = (whole.robot, halves.robot);
        prop_assert!((w.position_w - h.position_w).amax() < 1e-9);
        prop_assert!((w.velocity_w - h.velocity_w).amax() < 1e-8);
        prop_assert!((w.rotation_wr - h.rotation_wr).amax() < 1e-8);
        prop_assert!((w.angular_velocity_r - h.angular_velocity_r).amax() < 1e-6);
    }
}

#[test]
fn hover_stays_where_it_is() {
    let plant = Plant::new(tilt_hex());
    let mut state = plant.hover(Vector3::new(1.0, 2.0, 3.0));
    let command = state.rotor_speeds;
    for _ in 0..10_000 {
        plant.step(&mut state, &command, &Wrench::ZERO, 1e-3);
    }
    assert!((state.robot.position_w - Vector3::new(1.0, 2.0, 3.0)).amax() < 1e-9);
    assert!((state.robot.rotation_wr - Matrix3::identity()).amax() < 1e-9);
}

#[test]
fn the_step_is_of_fourth_order() {
    let plant = Plant::new(tilt_hex());
    let external = Wrench { force: Vector3::new(1.0, -2.0, 0.5), torque: Vector3::new(0.02, 0.05, -0.03) };
    let run = |steps: u32| {
        let mut state = plant.hover(Vector3::zeros());
        state.robot.angular_velocity_r = Vector3::new(3.0, -2.0, 4.0);
        let command = state.rotor_speeds * 1.2;
        for _ in 0..steps {
            plant.step(&mut state, &command, &external, 0.5 / f64::from(steps));
        }
        state.robot
    };
    let best = run(4000);
    let error =
        |n| (run(n).rotation_wr - best.rotation_wr).amax() + (run(n).position_w - best.position_w).amax();
    let ratio = error(40) / error(80);
    assert!((12.0..22.0).contains(&ratio), "halving the step divides the error by {ratio}");
}
