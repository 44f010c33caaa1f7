//! Runs one step function of the core some times, for a counter of instructions around it:
//! `valgrind --tool=callgrind target/release/examples/instructions "controller tick" 1000`.
//! Without arguments it names the step functions. `python -m benchmarks.instructions` makes a table.

use std::hint::black_box;
use tilthex_core::{
    GRAVITY, Matrix3, Matrix6, PoseSample, Reference, Setpoint, Vector3, Vector6, Vehicle, Wrench,
    admittance::{AdmittanceFilter, AdmittanceParams, AdmittanceState, Axes},
    allocation::{Allocator, RotorStatus},
    attitude::{AttitudeParams, AttitudeSelector, AttitudeState},
    controller::{Controller, ControllerInput, ControllerParams, ControllerState},
    estimator::{Estimator, EstimatorParams},
    examples,
    plant::Plant,
};

const PERIOD: f64 = 0.002;
/// Age of a pose when it arrives, s.
const LATENCY: f64 = 0.016;

/// The Tilt-Hex.
fn vehicle() -> Vehicle {
    examples::tilt_hex().expect("a vehicle")
}

fn admittance(damping: f64) -> AdmittanceParams {
    let m = |t: f64, r: [f64; 3]| Matrix6::from_diagonal(&Vector6::new(t, t, t, r[0], r[1], r[2]));
    AdmittanceParams {
        mass: m(1.5, [0.01, 0.01, 0.02]),
        damping: m(10.0, [damping; 3]),
        stiffness: m(6.0, [10.0, 10.0, 5.0]),
        max_translation: 1.0,
        max_rotation: 1.0,
        axes: Axes::World,
    }
}

fn parameters(damping: f64) -> ControllerParams {
    ControllerParams { admittance: admittance(damping), ..ControllerParams::default() }
}

fn controller_tick(count: usize, damping: f64) {
    let vehicle = vehicle();
    let controller = Controller::new(vehicle, parameters(damping)).expect("checked");
    let hover = Plant::new(vehicle).hover(Vector3::zeros());
    let mut state = ControllerState::default();
    let mut input = ControllerInput {
        state: hover.robot,
        specific_force_r: Vector3::new(0.05, 0.08, GRAVITY),
        rotor_speeds: hover.rotor_speeds,
        setpoint: Setpoint::hold(vehicle.tool().position_r, Matrix3::identity()),
        compliant: true,
        learn_bias: false,
        lost_rotors: 0,
        fixed_attitude: false,
        unyielding: None,
    };
    for k in 0..count {
        input.specific_force_r.z = GRAVITY + 0.001 * (k % 7) as f64;
        // By reference: the output is not copied.
        black_box(&controller.step(&mut state, black_box(&input), black_box(PERIOD)));
    }
}

fn admittance_step(count: usize, dt: f64) {
    let filter = AdmittanceFilter::new(admittance(4.0)).expect("checked");
    let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
    let push = Wrench { force: Vector3::new(1.0, 0.5, 0.2), torque: Vector3::new(0.5, 0.2, -0.3) };
    let mut state = AdmittanceState::default();
    for _ in 0..count {
        black_box(filter.step(&mut state, black_box(&setpoint), black_box(&push), black_box(dt)));
    }
}

/// One inertial sample of 500 Hz, and a fifth of a pose.
fn estimator_tick(count: usize) {
    let mut estimator = Estimator::new(EstimatorParams::default()).expect("checked");
    let up = Vector3::new(0.0, 0.0, GRAVITY);
    let pose = |now: f64| PoseSample {
        time: (now - LATENCY).max(0.0),
        arrival: now,
        position_w: Vector3::zeros(),
        rotation_wr: Matrix3::identity(),
        tracking_valid: true,
    };
    estimator.initialize(0.0, &Vector3::zeros(), &Matrix3::identity()).expect("a pose");
    for k in 0..count {
        let time = PERIOD * (k + 1) as f64;
        estimator.predict(black_box(time), black_box(&Vector3::zeros()), black_box(&up));
        if k % 5 == 4 {
            black_box(estimator.update_pose(black_box(&pose(time))));
        }
    }
}

fn allocation(count: usize, wrench: &Vector6) {
    let allocator = Allocator::new(&vehicle());
    for _ in 0..count {
        black_box(allocator.allocate(black_box(wrench)));
    }
}

fn attitude(count: usize, lateral: f64) {
    let vehicle = vehicle();
    let selector = AttitudeSelector::new(&vehicle, AttitudeParams::default()).expect("checked");
    let reference = Reference::hold(Vector3::zeros(), Matrix3::identity());
    let force = Vector3::new(lateral, 0.3 * lateral, vehicle.weight());
    let mut state = AttitudeState::default();
    let rotors = RotorStatus::default();
    for _ in 0..count {
        black_box(selector.step(&mut state, &reference, black_box(&force), &rotors, PERIOD));
    }
}

type Case = (&'static str, fn(usize));

const CASES: [Case; 11] = [
    ("controller tick", |n| controller_tick(n, 4.0)),
    ("controller tick, soft rotational damping", |n| controller_tick(n, 0.05)),
    ("admittance filter", |n| admittance_step(n, PERIOD)),
    ("admittance filter, period 1 % off", |n| admittance_step(n, 1.01 * PERIOD)),
    ("admittance filter, period 10 % off", |n| admittance_step(n, 1.1 * PERIOD)),
    ("estimator tick", estimator_tick),
    ("allocation, no limit", |n| allocation(n, &Vector6::new(2.0, 1.0, 23.5, 0.1, -0.1, 0.05))),
    ("allocation, several limits, cold", |n| {
        allocation(n, &Vector6::new(30.0, 5.0, 23.5, 0.5, -0.5, 0.2));
    }),
    ("attitude, none needed", |n| attitude(n, 3.0)),
    ("attitude, turned", |n| attitude(n, 20.0)),
    ("attitude, force cut", |n| attitude(n, 80.0)),
];

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, name, count] = arguments.as_slice() else {
        CASES.iter().for_each(|(name, _)| println!("{name}"));
        return;
    };
    let case =
        CASES.iter().find(|(known, _)| known == name).expect("a name that is printed without arguments");
    case.1(count.parse().expect("a number"));
}
