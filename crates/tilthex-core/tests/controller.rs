//! The closed loop on the plant: convergence, invariance, the shaped spring.

#![allow(clippy::unwrap_used)]

mod common;

use common::{rotation, tilt_hex, vector, wrench};
use proptest::prelude::*;
use tilthex_core::{
    Matrix3, Matrix6, RobotState, RotorVector, Setpoint, Vector3, Vector6, Vehicle, Wrench,
    admittance::{AdmittanceParams, Axes},
    allocation::AllocatorParams,
    attitude::AttitudeParams,
    controller::{Controller, ControllerInput, ControllerOutput, ControllerParams, ControllerState},
    force_axes::ForceAxes,
    plant::{Plant, PlantState, SensorParams, Sensors},
    pose_control::PoseGains,
    so3,
    trajectory::{Limits, Trajectory, Waypoint},
    vehicle::{Mounting, Rotor},
    wrench_observer::ObserverGains,
};

const PERIOD: f64 = 0.002;

fn params() -> ControllerParams {
    let m = |t: f64, r: [f64; 3]| Matrix6::from_diagonal(&Vector6::new(t, t, t, r[0], r[1], r[2]));
    ControllerParams {
        pose: PoseGains {
            position: Vector3::repeat(36.0),
            velocity: Vector3::repeat(12.0),
            rotation: Vector3::repeat(150.0),
            angular_velocity: Vector3::repeat(22.0),
        },
        observer: ObserverGains { force: Vector3::repeat(20.0), torque: Vector3::repeat(20.0) },
        admittance: AdmittanceParams {
            mass: m(1.5, [0.01, 0.01, 0.02]),
            damping: m(10.0, [4.0; 3]),
            stiffness: m(6.0, [10.0, 10.0, 5.0]),
            max_translation: 1.0,
            max_rotation: 1.0,
            axes: Axes::World,
        },
        force_dead_zone: 0.2,
        torque_dead_zone: 0.2,
        low_pass_hz: 10.0,
        room_torque: 0.0,
        free_wrench: tilthex_core::free_wrench::FreeWrenchParams::default(),
        bounds: tilthex_core::reference_bounds::ReferenceBounds::default(),
        contact: tilthex_core::contact::ContactParams::default(),
        allocation: AllocatorParams::default(),
        attitude: AttitudeParams::default(),
    }
}

/// The Tilt-Hex with rotors that follow at once and turn either way: what the laws assume.
fn ideal() -> Vehicle {
    let rotors: Vec<Rotor> =
        tilt_hex().rotors().iter().map(|r| Rotor { min_speed: -1e3, max_speed: 1e3, ..*r }).collect();
    let v = tilt_hex();
    Vehicle::new(v.mass(), *v.inertia(), &rotors, 0.0, *v.tool(), Mounting::default()).unwrap()
}

struct Loop {
    plant: Plant,
    controller: Controller,
    sensors: Sensors,
    state: PlantState,
    memory: ControllerState,
}

impl Loop {
    fn new(vehicle: Vehicle, params: ControllerParams, noise: SensorParams, state: PlantState) -> Self {
        Self {
            plant: Plant::new(vehicle),
            controller: Controller::new(vehicle, params).unwrap(),
            sensors: Sensors::new(noise, 1),
            state,
            memory: ControllerState::default(),
        }
    }

    fn tick(&mut self, setpoint: &Setpoint, tool_push: &Wrench) -> ControllerOutput {
        let external = self.plant.from_tool(&self.state, tool_push);
        let imu = self.sensors.imu(&self.plant.imu(&self.state, &external));
        let input = ControllerInput {
            state: self.state.robot,
            specific_force_r: imu.specific_force_i,
            rotor_speeds: self.sensors.rotor_speeds(&self.plant, &self.state),
            setpoint: *setpoint,
            compliant: true,
            unyielding: None,
            learn_bias: false,
            lost_rotors: 0,
            fixed_attitude: false,
        };
        let out = self.controller.step(&mut self.memory, &input, PERIOD);
        for _ in 0..2 {
            let external = self.plant.from_tool(&self.state, tool_push);
            self.plant.step(&mut self.state, &out.rotor_speeds, &external, 0.5 * PERIOD);
        }
        out
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn converges_exponentially_from_any_attitude_below_90_degrees(
        axis in vector(1.0), angle in 0.1..1.55f64, wanted in rotation(), offset in vector(0.5),
    ) {
        prop_assume!(axis.norm() > 0.1);
        let wrong = wanted * so3::exp(&(axis.normalize() * angle));
        let vehicle = ideal();
        let state = PlantState::new(
            RobotState { rotation_wr: wrong, ..RobotState::at_rest(offset) },
            vehicle.hover_speeds(&wrong),
);
        let mut flown = Loop::new(vehicle, params(), SensorParams::IDEAL, state);
        let tool = vehicle.tool();
        let setpoint = Setpoint::hold(wanted * tool.position_r, wanted * tool.rotation_r);
        let error = |s: &RobotState| so3::angle(&(wanted.transpose() * s.rotation_wr)) + s.position_w.norm();
        let mut at_two_seconds = 0.0;
        for i in 0..2000 {
            flown.tick(&setpoint, &Wrench::ZERO);
            if i == 999 {
                at_two_seconds = error(&flown.state.robot);
            }
        }
        let at_four = error(&flown.state.robot);
        prop_assert!(at_two_seconds < 0.05 && at_four < 1e-3, "{at_two_seconds} {at_four}");
        // At least exp(-2 t) of the error that was left.
        prop_assert!(at_four < at_two_seconds * (-4.0f64).exp() + 1e-7);
    }

    #[test]
    fn turning_the_world_turns_the_loop(
        yaw in -3.0..3.0f64, push in wrench(2.0, 0.1), start in vector(0.1), tilt in vector(0.3),
    ) {
        let vehicle = tilt_hex();
        let turn = so3::rot_z(yaw);
        let begin = |q: &Matrix3| PlantState::new(
            RobotState { rotation_wr: q * so3::exp(&tilt), ..RobotState::at_rest(q * start) },
            vehicle.hover_speeds(&Matrix3::identity()),
);
        let mut a = Loop::new(vehicle, params(), SensorParams::IDEAL, begin(&Matrix3::identity()));
        let mut b = Loop::new(vehicle, params(), SensorParams::IDEAL, begin(&turn));
        let sa = Setpoint::hold(Vector3::new(0.2, 0.1, 0.3), Matrix3::identity());
        let sb = Setpoint::hold(turn * sa.position_w, turn);
        let turned = Wrench { force: turn * push.force, torque: turn * push.torque };
        for _ in 0..500 {
            let x = a.tick(&sa, &push);
            let y = b.tick(&sb, &turned);
            prop_assert!((x.rotor_speeds - y.rotor_speeds).amax() < 1e-6);
            prop_assert!((turn * x.wrench_tool_w.force - y.wrench_tool_w.force).amax() < 1e-7);
        }
    }
}

/// Deflection of m x'' + d x' + k x = f, m = 1.5, d = 10 (over-damped).
fn ideal_spring(k: f64, f: f64, t: f64) -> f64 {
    let (m, d) = (1.5, 10.0);
    let root = (d * d - 4.0 * m * k).sqrt();
    let (a, b) = ((-d + root) / (2.0 * m), (-d - root) / (2.0 * m));
    f / k * (1.0 + (b * (a * t).exp() - a * (b * t).exp()) / (a - b))
}

#[test]
fn a_pushed_tool_yields_like_the_spring_it_was_told_to_be() {
    let vehicle = tilt_hex();
    let tool = Vector3::new(0.0, 0.0, 1.0);
    let plant = Plant::new(vehicle);
    let hover = plant.hover(tool - vehicle.tool().position_r);
    let noise = SensorParams { position: 0.0, orientation: 0.0, ..SensorParams::EXPERIMENTS };
    let mut flown = Loop::new(vehicle, params(), noise, hover);
    let setpoint = Setpoint::hold(tool, Matrix3::identity());
    let push = Wrench { force: Vector3::new(1.4, 0.0, 0.0), torque: Vector3::zeros() };
    for _ in 0..500 {
        flown.tick(&setpoint, &Wrench::ZERO);
    }
    let (mut worst, mut sum, mut tracking) = (0.0f64, 0.0, 0.0f64);
    for i in 0..5000 {
        let out = flown.tick(&setpoint, &push);
        let x = out.reference.position_w.x;
        worst = worst.max((x - ideal_spring(6.0, 1.2, f64::from(i) * PERIOD)).abs());
        tracking = tracking.max(out.pose.position_error_w.norm());
        if i >= 4500 {
            sum += x / 500.0;
        }
    }
    println!("steady {sum:.5} (ideal 0.2), worst distance {worst:.5}, tracking {tracking:.5}");
    assert!((sum - 0.2).abs() < 2e-3);
    assert!(worst < 0.010);
    assert!(tracking < 0.02);
    let flat: RotorVector = flown.state.rotor_speeds;
    assert!(flat.iter().all(|w| w.is_finite()));
}

/// Force control along the normal of a tilted wall: the wall feels the commanded force, without the dead zone's offset, wherever
/// the set-point is and moves, and the tool stays where it is told along the wall.
#[test]
fn presses_on_a_wall_as_hard_as_it_is_told() {
    let vehicle = tilt_hex();
    let mut given = params();
    given.admittance.damping = Matrix6::from_diagonal(&Vector6::new(60.0, 60.0, 60.0, 4.0, 4.0, 4.0));
    let surface = so3::rot_y(-0.3);
    let normal = surface * Vector3::z();
    let lever = vehicle.tool().position_r;
    let state = PlantState::new(
        RobotState::at_rest(normal * 0.02 - lever),
        vehicle.hover_speeds(&Matrix3::identity()),
    );
    let mut flown = Loop::new(vehicle, given, SensorParams::IDEAL, state);
    let limits =
        Limits { velocity: 0.4, acceleration: 0.8, angular_velocity: 0.5, angular_acceleration: 1.0 };
    let at = |depth: f64, force: f64| Waypoint {
        position_w: -normal * depth,
        rotation_we: vehicle.tool().rotation_r,
        wrench_w: Wrench { force: -normal * force, torque: Vector3::zeros() },
        force_axes: ForceAxes { force: [false, false, true], surface_ws: Some(surface), ..ForceAxes::NONE },
        duration: 0.0,
        hold: 0.0,
    };
    // The set-point moves behind the wall, and back into the free air.
    for (from, to, force) in [(0.0, 0.0, 2.0), (0.0, 0.15, 4.0), (0.15, -0.2, 4.0)] {
        let way = Trajectory::new(at(from, force), &[at(to, force)], &limits).unwrap();
        let (mut pressed, mut off) = (0.0, 0.0_f64);
        for k in 0..6000 {
            let setpoint = way.sample(PERIOD * f64::from(k));
            let tip = flown.state.robot.position_w + flown.state.robot.rotation_wr * lever;
            pressed = (-500.0 * normal.dot(&tip)).max(0.0);
            flown.tick(&setpoint, &Wrench { force: normal * pressed, torque: Vector3::zeros() });
            if to < 0.0 {
                off = off.max(f64::abs(pressed - force));
            }
        }
        assert!((pressed - force).abs() < 0.05, "{pressed} N of {force} N");
        assert!(off < 0.3, "{off} N while the set-point moves away");
        let tip = flown.state.robot.position_w + flown.state.robot.rotation_wr * lever;
        assert!((tip - normal * normal.dot(&tip)).norm() < 2e-3, "{tip}");
    }
}

/// In free air, with an error of the model inside the dead zone: the tool goes no farther than a wrench set-point may carry it.
#[test]
fn force_axes_do_not_drift_where_nothing_resists() {
    let vehicle = tilt_hex();
    let given = params();
    let state =
        PlantState::new(RobotState::at_rest(Vector3::zeros()), vehicle.hover_speeds(&Matrix3::identity()));
    for commanded in [-1.0, 0.0] {
        let mut flown = Loop::new(vehicle, given, SensorParams::IDEAL, state);
        let setpoint = Setpoint {
            wrench_w: Wrench { force: Vector3::new(0.0, 0.0, commanded), torque: Vector3::zeros() },
            force_axes: ForceAxes { force: [false, false, true], ..ForceAxes::NONE },
            ..Setpoint::hold(vehicle.tool().position_r, vehicle.tool().rotation_r)
        };
        for _ in 0..15_000 {
            flown.tick(&setpoint, &Wrench { force: Vector3::new(0.0, 0.0, -0.15), torque: Vector3::zeros() });
        }
        let fallen = -flown.state.robot.position_w.z;
        let way = given.free_wrench.way * f64::from(u8::from(commanded != 0.0));
        assert!(fallen < way + 0.02, "{fallen} m");
    }
}
