//! What C can do wrong is refused with a status, and changes nothing; what it does right is what the core does.
#![allow(unsafe_code)]

use std::{ffi::CStr, mem::zeroed, ptr::null};
use tilthex_c::*;
use tilthex_core::{
    RobotState, Setpoint, Vector3, Wrench,
    controller::{Controller, ControllerInput, ControllerParams, ControllerState},
    examples,
    plant::Plant,
    random::Random,
    so3,
};

const PERIOD: f64 = 0.002;

fn vehicle() -> TilthexVehicle {
    let mut vehicle = TilthexVehicle::default();
    assert_eq!(unsafe { tilthex_vehicle_tilt_hex(&mut vehicle) }, TilthexStatus::Ok);
    vehicle
}

fn params() -> TilthexControllerParams {
    let mut params = TilthexControllerParams::default();
    assert_eq!(unsafe { tilthex_controller_defaults(&mut params) }, TilthexStatus::Ok);
    params
}

/// A block in memory that is zero.
fn empty<B>() -> Box<B> {
    // SAFETY: the blocks are words.
    unsafe { Box::new(zeroed()) }
}

fn controller() -> Box<TilthexController> {
    let mut block = empty();
    let done =
        unsafe { tilthex_controller_init(&mut *block, &vehicle(), &params(), PERIOD, std::ptr::null_mut()) };
    assert_eq!(done, TilthexStatus::Ok);
    block
}

fn rows(m: &tilthex_core::Matrix3) -> [[f64; 3]; 3] {
    m.transpose().into()
}

/// A hover that is disturbed, at a random attitude.
fn input(random: &mut Random) -> TilthexControllerInput {
    let mut small = |size: f64| [(); 3].map(|()| size * random.normal());
    let rotation = so3::exp(&Vector3::from(small(0.2)));
    let hover = Plant::new(examples::tilt_hex().expect("a vehicle")).hover(Vector3::zeros());
    let mut input = TilthexControllerInput { compliant: 1, ..TilthexControllerInput::default() };
    input.measured = TilthexMeasured {
        position_w: small(0.1),
        velocity_w: small(0.1),
        rotation_wr: rows(&rotation),
        angular_velocity_r: small(0.3),
        specific_force_r: (rotation.transpose() * Vector3::new(0.0, 0.0, 9.81) + Vector3::from(small(0.5)))
            .into(),
        rotor_speeds: hover.rotor_speeds.into(),
    };
    input.setpoint.position_w = small(0.1);
    input.setpoint.rotation_we = rows(&so3::exp(&Vector3::from(small(0.2))));
    input
}

fn to_core(input: &TilthexControllerInput) -> ControllerInput {
    let (m, s) = (&input.measured, &input.setpoint);
    let matrix = |rows: [[f64; 3]; 3]| tilthex_core::Matrix3::from(rows).transpose();
    ControllerInput {
        state: RobotState {
            position_w: m.position_w.into(),
            velocity_w: m.velocity_w.into(),
            rotation_wr: matrix(m.rotation_wr),
            angular_velocity_r: m.angular_velocity_r.into(),
        },
        specific_force_r: m.specific_force_r.into(),
        rotor_speeds: m.rotor_speeds.into(),
        setpoint: Setpoint {
            wrench_w: Wrench::ZERO,
            ..Setpoint::hold(s.position_w.into(), matrix(s.rotation_we))
        },
        compliant: true,
        unyielding: None,
        learn_bias: false,
        lost_rotors: 0,
        fixed_attitude: false,
    }
}

#[test]
fn the_controller_is_that_of_the_core_bit_for_bit() {
    let mut block = controller();
    let mut core = Controller::new(examples::tilt_hex().unwrap(), ControllerParams::default()).unwrap();
    core.prepare(PERIOD);
    let (mut state, mut random) = (ControllerState::default(), Random::new(11));
    for _ in 0..200 {
        let input = input(&mut random);
        let mut output = TilthexControllerOutput::default();
        let done = unsafe { tilthex_controller_step(&mut *block, &input, PERIOD, &mut output) };
        assert_eq!(done, TilthexStatus::Ok);
        let expected = core.step(&mut state, &to_core(&input), PERIOD);
        assert_eq!(output.rotor_speeds, <[f64; 12]>::from(expected.rotor_speeds));
        assert_eq!(output.wrench_tool_w, TilthexWrench::from(expected.wrench_tool_w));
        assert_eq!(output.reference.position_w, <[f64; 3]>::from(expected.reference.position_w));
        assert_eq!(output.allocation.wrench_r, <[f64; 6]>::from(expected.allocation.wrench));
    }
}

#[test]
fn a_step_that_is_refused_changes_nothing() {
    let (mut random, mut clean, mut spoilt) = (Random::new(12), controller(), controller());
    let step = |block: &mut TilthexController, input: &TilthexControllerInput, dt: f64| {
        let mut output = TilthexControllerOutput::default();
        (unsafe { tilthex_controller_step(block, input, dt, &mut output) }, output)
    };
    for k in 0..200 {
        let good = input(&mut random);
        let (mut bad, mut dt) = (good, PERIOD);
        let wrong = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][k % 3];
        let expected = match k % 7 {
            0 => (bad.measured.position_w[k % 3] = wrong, TilthexStatus::NotFinite).1,
            1 => (bad.measured.specific_force_r[k % 3] = wrong, TilthexStatus::NotFinite).1,
            2 => (bad.measured.rotor_speeds[k % 12] = wrong, TilthexStatus::NotFinite).1,
            3 => (bad.setpoint.wrench_w.torque[k % 3] = wrong, TilthexStatus::NotFinite).1,
            4 => (bad.measured.rotation_wr[k % 3][0] += 0.01, TilthexStatus::NotRotation).1,
            5 => (bad.setpoint.rotation_we = [[0.0; 3]; 3], TilthexStatus::NotRotation).1,
            _ => (dt = [wrong, -PERIOD, 1.1][k / 7 % 3], TilthexStatus::Period).1,
        };
        let (status, output) = step(&mut spoilt, &bad, dt);
        assert_eq!((status, output), (expected, TilthexControllerOutput::default()), "case {k}");
        assert_eq!(step(&mut spoilt, &good, PERIOD), step(&mut clean, &good, PERIOD), "case {k}");
    }
}

#[test]
fn null_and_blocks_without_content_are_refused() {
    use TilthexStatus::{NotReady, Null};
    let (vehicle, params, mut block) = (vehicle(), params(), empty::<TilthexController>());
    let nothing = std::ptr::null_mut();
    let input = input(&mut Random::new(13));
    let mut output = TilthexControllerOutput::default();
    unsafe {
        assert_eq!(tilthex_vehicle_tilt_hex(std::ptr::null_mut()), Null);
        assert_eq!(tilthex_controller_init(std::ptr::null_mut(), &vehicle, &params, PERIOD, nothing), Null);
        assert_eq!(tilthex_controller_init(&mut *block, null(), &params, PERIOD, nothing), Null);
        assert_eq!(tilthex_controller_init(&mut *block, &vehicle, null(), PERIOD, nothing), Null);
        assert_eq!(tilthex_controller_step(&mut *block, &input, PERIOD, &mut output), NotReady);
        assert_eq!(tilthex_controller_step(std::ptr::null_mut(), &input, PERIOD, &mut output), Null);
        let mut ready = controller();
        assert_eq!(tilthex_controller_step(&mut *ready, null(), PERIOD, &mut output), Null);
        assert_eq!(tilthex_controller_step(&mut *ready, &input, PERIOD, std::ptr::null_mut()), Null);
        let mut wrench = TilthexWrench::default();
        let (measured, setpoint) = (input.measured, input.setpoint);
        assert_eq!(tilthex_observer_step(&mut *empty(), &measured, PERIOD, &mut wrench), NotReady);
        let mut reference = setpoint;
        let moved = tilthex_admittance_step(
            &mut *empty(),
            &setpoint,
            &TilthexWrench::default(),
            PERIOD,
            &mut reference,
        );
        assert_eq!(moved, NotReady);
        assert_eq!(tilthex_estimator_predict(&mut *empty(), 0.0, null(), null()), NotReady);
        assert_eq!(tilthex_plant_state(&mut *empty(), &mut TilthexPlantState::default()), NotReady);
    }
}

#[test]
fn a_refused_parameter_is_named() {
    let mut message = TilthexMessage { text: [0; TILTHEX_MESSAGE_LENGTH] };
    let mut sentence = |vehicle: &TilthexVehicle| {
        let status = unsafe { tilthex_vehicle_check(vehicle, &mut message) };
        let text = unsafe { CStr::from_ptr(message.text.as_ptr()) };
        (status, text.to_str().expect("ASCII").to_owned())
    };
    assert_eq!(sentence(&vehicle()), (TilthexStatus::Ok, String::new()));
    let mut heavy = vehicle();
    heavy.mass = 1e6;
    assert_eq!(
        sentence(&heavy),
        (TilthexStatus::Refused, "mass is 1000000; expected a number from 0.001 to 1000".into())
    );
    for count in [0, 13, u32::MAX] {
        let many = TilthexVehicle { rotor_count: count, ..vehicle() };
        assert!(sentence(&many).1.ends_with("rotors were given; expected 1 to 12"), "{count}");
    }
    let mut flat = vehicle();
    flat.rotors.iter_mut().for_each(|r| (r.axis_r, r.drag_coefficient) = ([0.0, 0.0, 1.0], 0.0));
    let (status, text) = sentence(&flat);
    assert_eq!(status, TilthexStatus::Refused);
    assert!(text.starts_with("the allocation matrix has rank 3") && text.ends_with("reverse it"), "{text}");
}

#[test]
fn every_status_has_a_sentence() {
    let text = |status: i32| unsafe { CStr::from_ptr(tilthex_status_text(status)) }.to_str().unwrap();
    let sentences: std::collections::HashSet<_> = (0..7).map(text).collect();
    assert_eq!(sentences.len(), 7);
    assert_eq!((text(0), text(-1), text(7)), ("done", "not a status", "not a status"));
}
