//! Each effect of the plant against its closed form.

#![allow(clippy::unwrap_used)]

mod common;
#[path = "effects/wind.rs"]
mod wind;

use common::{rotation, tilt_hex, vector};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};
use tilthex_core::{
    GRAVITY, Matrix3, RobotState, Rotor, RotorVector, Vector3, Vehicle, Wrench,
    plant::{
        Battery, BodyDrag, Effects, EffectsState, Plant, PlantState, Rod, RotorDrag, Rotors, SensorParams,
        Sensors, Surface, Wind, induced_velocity, rotor_current, rotor_momentum,
    },
    random::Random,
    so3,
    vehicle::Mounting,
};

const DT: f64 = 1e-3;

fn rotors(speeds: RotorVector) -> Rotors {
    Rotors { speeds, accelerations: RotorVector::zeros() }
}

/// The Tilt-Hex with every rotor replaced.
fn with_rotors(change: impl Fn(&mut Rotor)) -> Vehicle {
    let hex = tilt_hex();
    let mut all = hex.rotors().to_vec();
    all.iter_mut().for_each(change);
    Vehicle::new(hex.mass(), *hex.inertia(), &all, 0.03, *hex.tool(), *hex.imu()).unwrap()
}

fn upright() -> Vehicle {
    with_rotors(|r| r.axis_r = Vector3::z())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn drag_of_upright_rotors_is_the_sum_of_their_speeds_times_the_lateral_velocity(
        velocity_w in vector(8.0), rotation_wr in rotation(), speed in 20.0..100.0f64, d in 1e-5..1e-3f64,
    ) {
        let vehicle = upright();
        let effects = Effects { rotor_drag: RotorDrag { drag: d, flapping: 0.0 }, ..Effects::OFF };
        let robot = RobotState { velocity_w, rotation_wr, ..RobotState::at_rest(Vector3::zeros()) };
        let wrench = effects.wrench(&vehicle, &robot, &rotors(RotorVector::repeat(speed)), &Vector3::zeros());
        let v = rotation_wr.transpose() * velocity_w;
        let closed = -d * 6.0 * speed * Vector3::new(v.x, v.y, 0.0);
        prop_assert!((wrench.force - closed).amax() < 1e-12);
        // All hubs of this vehicle lie in the plane of the centre of mass: no torque but about z, and that cancels.
        let lever = vehicle.rotors().iter().fold(Vector3::zeros(), |sum, r| sum + r.position_r);
        prop_assert!((wrench.torque - lever.cross(&closed) / 6.0).amax() < 1e-9);
    }

    #[test]
    fn drag_takes_energy_out_of_the_air_and_never_gives_any(
        velocity_w in vector(8.0), wind_w in vector(5.0), rotation_wr in rotation(), omega in vector(3.0),
        speed in 20.0..100.0f64,
    ) {
        let effects = Effects {
            rotor_drag: RotorDrag { drag: 3e-4, flapping: 0.0 },
            body_drag: BodyDrag { area_r: Vector3::new(0.02, 0.03, 0.05), centre_r: Vector3::zeros() },
            ..Effects::OFF
        };
        let robot = RobotState { velocity_w, rotation_wr, angular_velocity_r: omega, position_w: Vector3::zeros() };
        let wrench = effects.wrench(&tilt_hex(), &robot, &rotors(RotorVector::repeat(speed)), &wind_w);
        let through = rotation_wr.transpose() * (velocity_w - wind_w);
        prop_assert!(wrench.force.dot(&through) + wrench.torque.dot(&omega) <= 1e-12);
    }

    #[test]
    fn flapping_torques_add_up(
        velocity_w in vector(8.0), speed in 20.0..100.0f64, c in 1e-6..1e-3f64,
    ) {
        let vehicle = upright();
        let effects = Effects { rotor_drag: RotorDrag { drag: 0.0, flapping: c }, ..Effects::OFF };
        let robot = RobotState { velocity_w, ..RobotState::at_rest(Vector3::zeros()) };
        let wrench = effects.wrench(&vehicle, &robot, &rotors(RotorVector::repeat(speed)), &Vector3::zeros());
        let closed = -c * 6.0 * speed * Vector3::z().cross(&velocity_w);
        prop_assert!(wrench.force.amax() == 0.0);
        prop_assert!((wrench.torque - closed).amax() < 1e-12);
        // Forwards it lifts the nose: a negative turn about y.
        prop_assert!(velocity_w.x * wrench.torque.y <= 0.0);
    }

    #[test]
    fn the_ground_adds_what_cheeseman_and_bennett_say(height in 0.08..3.0f64, speed in 30.0..100.0f64) {
        let (radius, vehicle) = (0.15, upright());
        let ground = Surface { normal_w: Vector3::z(), offset: 0.4 };
        let effects = Effects { rotor_radius: radius, surfaces: [Some(ground), None], ..Effects::OFF };
        // The hub of the first rotor at the height; all hubs of this vehicle are as high.
        let hub = vehicle.rotors()[0].position_r.z;
        let robot = RobotState::at_rest(Vector3::new(1.0, 2.0, 0.4 + height - hub));
        let wrench = effects.wrench(&vehicle, &robot, &rotors(RotorVector::repeat(speed)), &Vector3::zeros());
        let thrust = 6.0 * vehicle.rotors()[0].thrust_coefficient * speed * speed;
        let closed = 1.0 / (1.0 - (radius / (4.0 * height)).powi(2));
        prop_assert!(((thrust + wrench.force.z) / thrust - closed).abs() < 1e-12);
        prop_assert!(wrench.force.xy().amax() < 1e-12);
        prop_assert!(wrench.torque.amax() < 1e-9);
    }

    #[test]
    fn a_wall_blows_along_its_normal_and_a_ceiling_is_a_ground_upside_down(
        distance in 0.2..2.0f64, speed in 30.0..100.0f64, yaw in -3.0..3.0f64,
    ) {
        let radius = 0.15;
        let drag = RotorDrag { drag: 3e-4, flapping: 0.0 };
        let normal_w = so3::rot_z(yaw) * Vector3::x();
        let wall = Surface { normal_w, offset: 0.0 };
        let effects = Effects { rotor_radius: radius, surfaces: [None, Some(wall)], rotor_drag: drag, ..Effects::OFF };
        let rotor = upright().rotors()[0];
        let robot = RobotState::at_rest(distance * normal_w - rotor.position_r);
        let influence = wall.influence(&robot, &rotor, radius, speed, effects.air_density);
        let induced = induced_velocity(&rotor, radius, speed, effects.air_density);
        // Momentum theory: the thrust is the flow of mass times twice the induced velocity.
        let flow = effects.air_density * PI * radius * radius * induced;
        prop_assert!((2.0 * flow * induced - rotor.thrust_coefficient * speed * speed).abs() < 1e-9);
        let closed = induced * (radius / (4.0 * distance)).powi(2) * normal_w;
        prop_assert!((influence.wind_r - closed).amax() < 1e-12);
        prop_assert_eq!(influence.part, 0.0);
        let ceiling = Surface { normal_w: -Vector3::z(), offset: 0.0 };
        let under = RobotState::at_rest(-distance * Vector3::z() - rotor.position_r);
        let above = ceiling.influence(&under, &rotor, radius, speed, effects.air_density);
        prop_assert!((above.part + (radius / (4.0 * distance)).powi(2)).abs() < 1e-12);
    }

    #[test]
    fn rotors_that_accelerate_keep_the_angular_momentum(
        omega in vector(2.0), start in 20.0..90.0f64, asked in vector(60.0),
    ) {
        // Without thrust nothing outside acts, so body and rotors keep their common angular momentum.
        let vehicle = with_rotors(|r| (r.thrust_coefficient, r.drag_coefficient) = (1e-15, 1e-15));
        let inertia = 6e-5;
        let plant = Plant::with_effects(vehicle, Effects { rotor_inertia: inertia, ..Effects::OFF }).unwrap();
        let robot = RobotState { angular_velocity_r: omega, ..RobotState::at_rest(Vector3::zeros()) };
        let mut state = PlantState::new(robot, RotorVector::repeat(start));
        let command = RotorVector::from_fn(|i, _| start + asked[i % 3] / (1.0 + i as f64));
        let total = |s: &PlantState| {
            let body = vehicle.inertia() * s.robot.angular_velocity_r;
            s.robot.rotation_wr * (body + rotor_momentum(&vehicle, inertia, &s.rotor_speeds))
        };
        let before = total(&state);
        for _ in 0..300 {
            plant.step(&mut state, &command, &Wrench::ZERO, DT);
        }
        let exchanged = rotor_momentum(&vehicle, inertia, &(state.rotor_speeds - RotorVector::repeat(start))).norm();
        prop_assert!((total(&state) - before).norm() < 1e-6 * (exchanged + 1e-3), "{}", (total(&state) - before).norm());
    }

    #[test]
    fn a_rod_bends_as_a_cantilever(force in vector(20.0), stiffness in 300.0..5000.0f64) {
        let rod = Rod { stiffness, length: 0.4 };
        let tool = Mounting { position_r: Vector3::new(0.1, 0.0, -0.4), rotation_r: so3::rot_x(0.3) };
        let bent = rod.bent(&tool, &force);
        let moved = tool.rotation_r.transpose() * (bent.position_r - tool.position_r);
        prop_assert!((moved - Vector3::new(force.x, force.y, 0.0) / stiffness).amax() < 1e-12);
        // The tip's slope under an end load is F L^2 / (2 E I) = 3/2 of the displacement by the length.
        let slope = so3::angle(&(tool.rotation_r.transpose() * bent.rotation_r));
        prop_assert!((slope - 1.5 * moved.norm() / 0.4).abs() < 1e-9);
        // The rod's axis points from tip to clamp: the tip leads.
        let axis = tool.rotation_r.transpose() * (bent.rotation_r * Vector3::z());
        prop_assert!(axis.dot(&moved) <= 0.0);
    }
}

#[test]
fn ten_hertz_in_thirty_milliseconds_react_with_the_torque_of_the_books() {
    let vehicle = upright();
    let effects = Effects { rotor_inertia: 6e-5, ..Effects::OFF };
    let mut accelerations = RotorVector::zeros();
    accelerations[0] = 10.0 / 0.03;
    let rotors = Rotors { speeds: RotorVector::repeat(60.0), accelerations };
    let robot = RobotState::at_rest(Vector3::zeros());
    let torque = effects.wrench(&vehicle, &robot, &rotors, &Vector3::zeros()).torque;
    let closed = 6e-5 * TAU * 10.0 / 0.03 * vehicle.rotors()[0].spin;
    assert!((torque - Vector3::new(0.0, 0.0, closed)).amax() < 1e-12 && (closed.abs() - 0.1257).abs() < 1e-4);
}

#[test]
fn a_fall_reaches_its_terminal_speed_as_the_hyperbolic_tangent() {
    let area = 0.08;
    let effects = Effects {
        body_drag: BodyDrag { area_r: Vector3::repeat(area), centre_r: Vector3::zeros() },
        ..Effects::OFF
    };
    let plant = Plant::with_effects(tilt_hex(), effects).unwrap();
    let mut state = PlantState::new(RobotState::at_rest(Vector3::zeros()), RotorVector::zeros());
    let terminal = (2.0 * 2.4 * GRAVITY / (effects.air_density * area)).sqrt();
    for step in 1..=20_000 {
        plant.step(&mut state, &RotorVector::zeros(), &Wrench::ZERO, DT);
        let closed = -terminal * (GRAVITY * f64::from(step) * DT / terminal).tanh();
        assert!(
            (state.robot.velocity_w.z - closed).abs() < 1e-6,
            "{step}: {}",
            state.robot.velocity_w.z - closed
        );
    }
    assert!((state.robot.velocity_w.z + terminal).abs() < 1e-3 * terminal);
}

#[test]
fn a_centre_of_pressure_turns_the_force_into_a_torque() {
    let centre_r = Vector3::new(0.0, 0.0, 0.1);
    let effects = Effects { body_drag: BodyDrag { area_r: Vector3::repeat(0.05), centre_r }, ..Effects::OFF };
    let robot = RobotState::at_rest(Vector3::zeros());
    let wind_w = Vector3::new(4.0, 0.0, 0.0);
    let wrench = effects.wrench(&tilt_hex(), &robot, &rotors(RotorVector::zeros()), &wind_w);
    let force = 0.5 * effects.air_density * 0.05 * 16.0;
    assert!((wrench.force - Vector3::new(force, 0.0, 0.0)).amax() < 1e-12);
    assert!((wrench.torque - Vector3::new(0.0, 0.1 * force, 0.0)).amax() < 1e-12);
}

#[test]
fn thrust_of_throttles_falls_with_the_square_of_the_voltage() {
    let nominal = 16.0;
    let battery = Battery::new(5.0, 0.5);
    let effects = Effects { throttle_voltage: nominal, battery, ..Effects::OFF };
    let plant = Plant::with_effects(tilt_hex(), effects).unwrap();
    let mut state = plant.hover(Vector3::zeros());
    state.effects = EffectsState::new(&effects, 0);
    let command = state.rotor_speeds;
    for _ in 0..3000 {
        let weight = Wrench { force: Vector3::new(0.0, 0.0, 0.0), torque: Vector3::zeros() };
        plant.step(&mut state, &command, &weight, DT);
    }
    let voltage = state.effects.battery.voltage();
    let thrust = |s: &PlantState| plant.vehicle().body_wrench(&s.rotor_speeds).force.z;
    let hover = plant.hover(Vector3::zeros());
    let closed = (voltage / nominal).powi(2);
    assert!((thrust(&state) / thrust(&hover) - closed).abs() < 1e-4);
    // The charge that 3 s of these currents take.
    let current = 0.5 + state.rotor_speeds.iter().map(|w| rotor_current(*w)).sum::<f64>();
    let taken = battery.charge - state.effects.battery.charge;
    assert!((taken - 3.0 * current).abs() < 0.02 * taken, "{taken} {}", 3.0 * current);
}

#[test]
fn vibration_has_the_rotors_frequency_and_grows_with_its_square() {
    let vehicle = upright();
    let plant = Plant::new(vehicle);
    let params = SensorParams { vibration: 0.7, ..SensorParams::IDEAL };
    let mut speeds = RotorVector::zeros();
    speeds[2] = 80.0;
    let state = PlantState::new(RobotState::at_rest(Vector3::zeros()), speeds);
    let truth = plant.imu(&state, &Wrench::ZERO);
    let mut sensors = Sensors::new(params, 1);
    let series: Vec<Vector3> = (0..4000)
        .map(|_| {
            sensors.pass(&plant, &state, DT);
            sensors.imu(&truth).specific_force_i - truth.specific_force_i
        })
        .collect();
    let amplitude = 0.7 * 0.8 * 0.8;
    assert!(series.iter().all(|a| (a.norm() - amplitude).abs() < 1e-9 && a.z.abs() < 1e-12));
    // 80 turns a second: after 1/80 s, 12.5 samples, it is where it was.
    for k in 0..3000 {
        assert!((series[k] - series[k + 25]).amax() < 1e-9);
        assert!((series[k] - series[k + 10]).amax() > 0.1 * amplitude);
    }
}

#[test]
fn the_gyroscope_has_its_scale_and_its_axes() {
    let params = SensorParams {
        gyro_scale_i: Vector3::new(0.01, -0.02, 0.03),
        gyro_misalignment_i: Vector3::new(0.0, 0.0, 0.005),
        ..SensorParams::IDEAL
    };
    let plant = Plant::new(tilt_hex());
    let turning = |omega: Vector3| {
        let robot = RobotState { angular_velocity_r: omega, ..RobotState::at_rest(Vector3::zeros()) };
        plant.imu(&PlantState::new(robot, RotorVector::zeros()), &Wrench::ZERO)
    };
    let said = |omega| Sensors::new(params, 1).imu(&turning(omega)).gyro_i;
    assert!((said(Vector3::x()) - Vector3::new(1.01, -0.005 * 0.98, 0.0)).amax() < 1e-15);
    assert!((said(Vector3::y()) - Vector3::new(0.005 * 1.01, 0.98, 0.0)).amax() < 1e-15);
    assert!((said(Vector3::z()) - Vector3::new(0.0, 0.0, 1.03)).amax() < 1e-15);
}

#[test]
fn aged_rotor_speeds_are_those_of_then() {
    let plant = Plant::new(tilt_hex());
    for age in [0.001, 0.004, 0.0055, 0.05] {
        let params = SensorParams { rotor_speed_age: age, ..SensorParams::IDEAL };
        let mut sensors = Sensors::new(params, 1);
        let ramp = |time: f64| RotorVector::from_fn(|i, _| 50.0 + (1.0 + i as f64) * time);
        for step in 0..200 {
            let time = f64::from(step) * DT;
            let state = PlantState::new(RobotState::at_rest(Vector3::zeros()), ramp(time));
            sensors.pass(&plant, &state, DT);
            let measured = sensors.rotor_speeds(&plant, &state);
            let closed = ramp((time - age).max(0.0));
            assert!((measured - closed).amax() < 1e-9, "{age} at {time}");
        }
    }
}

#[test]
fn the_captured_point_turns_with_the_robot() {
    let captured_r = Vector3::new(0.01, 0.02, -0.03);
    let params = SensorParams { captured_r, ..SensorParams::IDEAL };
    let rotation_wr = so3::rot_z(1.0) * so3::rot_x(0.4);
    let robot = RobotState { rotation_wr, ..RobotState::at_rest(Vector3::new(1.0, 2.0, 3.0)) };
    let (position_w, _) = Sensors::new(params, 1).pose(&PlantState::new(robot, RotorVector::zeros()));
    assert!((position_w - (robot.position_w + rotation_wr * captured_r)).amax() < 1e-15);
}

#[test]
fn effects_that_are_off_change_no_bit_and_bad_ones_are_named() {
    let bare = Plant::new(tilt_hex());
    let off = Plant::with_effects(tilt_hex(), Effects::OFF).unwrap();
    let mut random = Random::new(3);
    let mut a = bare.hover(Vector3::zeros());
    let mut b = off.hover(Vector3::zeros());
    for _ in 0..200 {
        let command = a.rotor_speeds + RotorVector::from_fn(|_, _| random.normal());
        bare.step(&mut a, &command, &Wrench::ZERO, DT);
        off.step(&mut b, &command, &Wrench::ZERO, DT);
    }
    assert_eq!(a, b);
    let refused = |effects| Plant::with_effects(tilt_hex(), effects).unwrap_err().to_string();
    assert!(refused(Effects { rotor_inertia: -1.0, ..Effects::OFF }).contains("rotor_inertia"));
    let gusty = Wind { gust_deviation: f64::NAN, ..Wind::CALM };
    assert!(refused(Effects { wind: gusty, ..Effects::OFF }).contains("gust_deviation"));
    let _ = Matrix3::identity();
}
