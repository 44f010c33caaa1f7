//! The identities of the wrench observer, on random vehicles.

#![allow(clippy::unwrap_used)]

mod common;

use common::{rotation, vector, vehicle, wrench};
use proptest::prelude::*;
use tilthex_core::{
    GRAVITY, RobotState, RotorVector, Vector3, Vehicle, Wrench,
    plant::{ImuSample, Plant, PlantState},
    wrench_observer::{
        ObserverGains, ObserverInput, WrenchObserver, WrenchObserverState, robot_wrench, tool_wrench,
    },
};

fn observer(vehicle: &Vehicle, force: f64, torque: f64) -> WrenchObserver {
    let gains = ObserverGains { force: Vector3::repeat(force), torque: Vector3::repeat(torque) };
    WrenchObserver::new(vehicle, gains).unwrap()
}

fn measure(plant: &Plant, state: &PlantState, external: &Wrench) -> ObserverInput {
    let ImuSample { specific_force_i, .. } = plant.imu(state, external);
    ObserverInput {
        rotation_wr: state.robot.rotation_wr,
        angular_velocity_r: state.robot.angular_velocity_r,
        specific_force_r: specific_force_i,
        rotor_speeds: state.rotor_speeds,
    }
}

fn gain() -> impl Strategy<Value = f64> {
    (-1.0..2.7f64).prop_map(|e| 10f64.powf(e))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_freely_tumbling_body_feels_nothing(
        vehicle in vehicle(), rotation_wr in rotation(), omega in vector(10.0),
        l in gain(), k in gain(), dt in 0.5e-3..10e-3f64,
    ) {
        let plant = Plant::new(vehicle);
        let observer = observer(&vehicle, l, k);
        let mut state = PlantState::new(
            RobotState { rotation_wr, angular_velocity_r: omega, ..RobotState::at_rest(Vector3::zeros()) },
            RotorVector::zeros(),
);
        let mut seen = WrenchObserverState::default();
        for _ in 0..100 {
            let estimate = observer.step(&mut seen, &measure(&plant, &state, &Wrench::ZERO), dt);
            prop_assert!(estimate.force.norm() < 1e-9, "{:?}", estimate.force);
            prop_assert!(estimate.torque.norm() < 1e-9, "{:?}", estimate.torque);
            // Sub-steps: the plant's own error is not the observer's.
            for _ in 0..10 {
                plant.step(&mut state, &RotorVector::zeros(), &Wrench::ZERO, 0.1 * dt);
            }
        }
    }

    #[test]
    fn hover_in_any_attitude_gives_zero(vehicle in vehicle(), rotation_wr in rotation(), l in gain(), k in gain()) {
        let observer = observer(&vehicle, l, k);
        let input = ObserverInput {
            rotation_wr,
            angular_velocity_r: Vector3::zeros(),
            specific_force_r: rotation_wr.transpose() * Vector3::new(0.0, 0.0, GRAVITY),
            rotor_speeds: vehicle.hover_speeds(&rotation_wr),
        };
        let mut seen = WrenchObserverState::default();
        for _ in 0..50 {
            let estimate = observer.step(&mut seen, &input, 0.002);
            prop_assert!(estimate.to_vector().amax() < 1e-9);
        }
    }

    #[test]
    fn a_constant_wrench_is_recovered_exponentially(
        vehicle in vehicle(), rotation_wr in rotation(), external in wrench(10.0, 2.0),
        l in gain(), k in gain(), dt in 0.5e-3..10e-3f64,
    ) {
        // Held still: the rotors carry the weight and the external wrench.
        let observer = observer(&vehicle, l, k);
        let force_r = rotation_wr.transpose() * (Vector3::new(0.0, 0.0, vehicle.weight()) - external.force);
        let wrench_r = Wrench { force: force_r, torque: -external.torque }.to_vector();
        let input = ObserverInput {
            rotation_wr,
            angular_velocity_r: Vector3::zeros(),
            specific_force_r: rotation_wr.transpose() * Vector3::new(0.0, 0.0, GRAVITY),
            rotor_speeds: tilthex_core::vehicle::speeds(&(vehicle.allocation_inverse() * wrench_r)),
        };
        let mut seen = WrenchObserverState::default();
        for i in 0..200 {
            let estimate = observer.step(&mut seen, &input, dt);
            let t = f64::from(i) * dt;
            let force = external.force * (1.0 - (-l * t).exp());
            let torque = external.torque * (1.0 - (-k * t).exp());
            prop_assert!((estimate.force - force).amax() < 1e-9);
            prop_assert!((estimate.torque - torque).amax() < 1e-9);
        }
    }

    #[test]
    fn a_constant_wrench_on_a_moving_body_is_recovered(
        vehicle in vehicle(), rotation_wr in rotation(), omega in vector(2.0),
        external in wrench(5.0, 0.05), k in 5.0..100.0f64,
    ) {
        let plant = Plant::new(vehicle);
        let observer = observer(&vehicle, k, k);
        let mut state = PlantState::new(
            RobotState { rotation_wr, angular_velocity_r: omega, ..RobotState::at_rest(Vector3::zeros()) },
            RotorVector::zeros(),
);
        let mut seen = WrenchObserverState::default();
        let dt = 1e-3;
        for i in 0..300 {
            let estimate = observer.step(&mut seen, &measure(&plant, &state, &external), dt);
            let part = 1.0 - (-k * dt * f64::from(i)).exp();
            prop_assert!((estimate.force - part * external.force).amax() < 1e-9);
            // The torque turns with the body within a period: second order in omega dt.
            prop_assert!((estimate.torque - part * external.torque).amax() < 2e-5 * (1.0 + external.torque.norm()));
            plant.step(&mut state, &RotorVector::zeros(), &external, dt);
        }
    }

    #[test]
    fn force_through_the_centre_of_mass_gives_no_torque(
        vehicle in vehicle(), rotation_wr in rotation(), force in vector(5.0), l in gain(), k in gain(),
    ) {
        let plant = Plant::new(vehicle);
        let observer = observer(&vehicle, l, k);
        let external = Wrench { force, torque: Vector3::zeros() };
        let hover = vehicle.hover_speeds(&rotation_wr);
        let mut state = PlantState::new(
            RobotState { rotation_wr, ..RobotState::at_rest(Vector3::zeros()) },
            hover,
);
        let mut seen = WrenchObserverState::default();
        for _ in 0..100 {
            let estimate = observer.step(&mut seen, &measure(&plant, &state, &external), 0.002);
            prop_assert!(estimate.torque.amax() < 1e-9);
            plant.step(&mut state, &hover, &external, 0.002);
        }
    }

    #[test]
    fn a_push_at_the_tool_gives_no_tool_torque(vehicle in vehicle(), rotation_wr in rotation(), force in vector(10.0)) {
        let push = Wrench { force, torque: Vector3::zeros() };
        let p = &vehicle.tool().position_r;
        let at_robot = robot_wrench(&push, &rotation_wr, p);
        let back = tool_wrench(&at_robot, &rotation_wr, p);
        prop_assert!((back.to_vector() - push.to_vector()).amax() < 1e-12);
    }

    #[test]
    fn tool_wrench_does_the_same_power(
        vehicle in vehicle(), rotation_wr in rotation(), tool in wrench(5.0, 1.0), v in vector(1.0), omega_r in vector(1.0),
    ) {
        let p = &vehicle.tool().position_r;
        let robot = robot_wrench(&tool, &rotation_wr, p);
        let omega_w = rotation_wr * omega_r;
        let tip = v + omega_w.cross(&(rotation_wr * p));
        let power_robot = robot.force.dot(&v) + robot.torque.dot(&omega_r);
        let power_tool = tool.force.dot(&tip) + tool.torque.dot(&omega_w);
        prop_assert!((power_robot - power_tool).abs() < 1e-10);
    }
}
