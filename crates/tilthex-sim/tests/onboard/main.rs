//! A vehicle that flies itself, with its base at the other end of the line, on virtual time.

#![allow(clippy::unwrap_used)]

mod limits;
mod rotors;
mod world;

use proptest::{collection::vec, prelude::*};
use tilthex_core::{
    RotorVector, Vector3, Vector6, Wrench,
    flight::{Command, Commanded, Flight, Measured, MotorCommand, Record},
    supervisor::{Fault, Phase},
    trajectory::Limits,
};
use tilthex_link::{
    onboard::{GoTo, Order, Part, ToVehicle},
    tk3::{HostMessage, MAX_FRAME, MotorValues, Stream},
};
use tilthex_sim::onboard::firmware_params;

use world::{World, config};

#[test]
fn it_takes_off_yields_to_a_push_and_lands_by_order() {
    let mut world = World::hover();
    assert_eq!(world.answers, [true]);
    world.run(2.0);
    let before = world.simulation.truth().tool_position_w;
    let force = Vector3::new(1.4, 0.0, 0.0);
    world.simulation.disturb(Wrench { force, torque: Vector3::zeros() }, Wrench::ZERO);
    world.run(6.0);
    let yielded = world.simulation.truth().tool_position_w - before;
    let admittance = config().admittance().clone();
    let spring = (force.x - admittance.force_dead_zone) / admittance.stiffness.0[(0, 0)];
    assert!((yielded.x - spring).abs() < 0.03, "{yielded} {spring}");
    // The base sees what the vehicle estimates.
    let (here, there) = (world.record(), world.records.last().unwrap());
    assert_eq!((there.phase, there.compliant), (Phase::Flying, true));
    assert!((there.state.position_w - here.state.position_w).norm() < 0.01);
    assert!((there.wrench_tool_w.force - force).norm() < 0.3, "{}", there.wrench_tool_w.force);
    assert!((there.position_error_w - here.position_error_w).norm() < 0.01);
    assert!((there.setpoint.position_w - here.setpoint.position_w).norm() < 1e-6);
    assert!((there.input.time - world.now()).abs() < 0.05);
    assert!((there.rotor_speeds[0] - here.rotor_speeds[0]).abs() < 3.0 && there.battery > 10.0);
    assert!(there.contact_likelihood().is_nan(), "what the vehicle does not send is not known");
    world.simulation.disturb(Wrench::ZERO, Wrench::ZERO);
    world.order(Order::Land);
    world.landed();
    for text in ["phase: flying", "phase: landing", "fault: operator", "phase: disarmed"] {
        assert!(world.texts.iter().any(|said| said == text), "{text}: {:?}", world.texts);
    }
    // The next flight.
    world.run(3.0);
    world.base = World::new().base;
    world.until(5.0, |world| world.base.flight().is_some());
    world.order(Order::TakeOff);
    world.until(30.0, World::on_mission);
}

#[test]
fn it_flies_to_a_place_holds_and_refuses_what_it_cannot() {
    let mut world = World::hover();
    let start = world.record().setpoint;
    let limits =
        Limits { velocity: 0.5, acceleration: 0.5, angular_velocity: 0.5, angular_acceleration: 0.5 };
    let place = GoTo {
        position_w: start.position_w + Vector3::new(0.4, 0.0, 0.2),
        rotation_we: start.rotation_we,
        duration: 0.0,
        limits,
    };
    world.order(Order::GoTo(place));
    world.run(5.0);
    assert!((world.record().setpoint.position_w - place.position_w).norm() < 1e-6);
    world.order(Order::GoTo(GoTo { position_w: start.position_w, ..place }));
    world.run(0.8);
    world.order(Order::Hold);
    world.run(0.1);
    let held = world.record().setpoint.position_w;
    world.run(3.0);
    assert!((world.record().setpoint.position_w - held).norm() < 0.15);
    assert!((world.record().setpoint.position_w - start.position_w).norm() > 0.1);
    world.order(Order::GoTo(GoTo { position_w: Vector3::new(500.0, 0.0, 1.0), ..place }));
    world.run(0.5);
    world.order(Order::TakeOff);
    world.run(0.5);
    assert_eq!(world.answers, [true, true, true, true, false, false]);
    assert!(
        world.texts.iter().any(|text| text == "order refused: outside the geofence"),
        "{:?}",
        world.texts
    );
    assert!(world.texts.iter().any(|text| text == "order refused: the vehicle has taken off already"));
    assert_eq!(world.phase(), Phase::Flying);
}

#[test]
fn its_admittance_is_tuned_in_flight() {
    let mut world = World::hover();
    let stiffness = Vector6::new(20.0, 20.0, 20.0, 10.0, 10.0, 5.0);
    world.order(Order::Admittance(Part::Stiffness, stiffness));
    world.run(0.2);
    world.order(Order::Admittance(Part::Mass, Vector6::zeros()));
    world.run(0.2);
    assert_eq!(world.answers, [true, true, false], "{:?}", world.texts);
    world.run(2.0);
    let before = world.simulation.truth().tool_position_w;
    let force = Vector3::new(3.0, 0.0, 0.0);
    world.simulation.disturb(Wrench { force, torque: Vector3::zeros() }, Wrench::ZERO);
    world.run(6.0);
    let yielded = world.simulation.truth().tool_position_w - before;
    let spring = (force.x - config().admittance().force_dead_zone) / stiffness.x;
    assert!((yielded.x - spring).abs() < 0.03, "{yielded} {spring}");
}

/// The reactions of docs/faults.md, without a base.
#[test]
fn a_line_that_is_cut_in_flight_makes_it_land() {
    let mut world = World::hover();
    world.cut = true;
    world.until(0.4, |world| world.phase() == Phase::Holding);
    world.until(1.0, |world| world.phase() == Phase::Landing);
    assert!(world.record().faults.contains(Fault::PoseLostLong));
    assert!(!world.record().faults.contains(Fault::LinkLost), "its sensors are on board");
    world.landed();
}

#[test]
fn a_blind_base_makes_it_land_although_the_operator_is_there() {
    let mut world = World::hover();
    world.blind = true;
    world.until(2.0, |world| world.phase() == Phase::Landing);
    assert!(!world.record().faults.contains(Fault::OperatorGone));
    world.landed();
}

#[test]
fn a_silent_operator_makes_it_hold_and_then_land() {
    let mut world = World::hover();
    let timeout = config().supervisor().operator_timeout;
    world.silence = timeout + 0.1;
    world.run(0.5);
    assert_eq!(world.phase(), Phase::Holding);
    world.silence = 0.0;
    world.run(1.0);
    assert_eq!(world.phase(), Phase::Flying);
    world.silence = timeout + 0.1;
    world.until(10.0, |world| world.phase() == Phase::Landing);
    assert!(world.record().faults.contains(Fault::OperatorGoneForGood));
    world.landed();
}

#[test]
fn messages_without_a_checksum_turn_no_motor_and_stop_none_in_the_air() {
    let mut world = World::hover();
    let commanded = |world: &World| world.simulation.firmware().firmware().output().motors;
    let mut other = world.clone();
    let send = |world: &mut World, message| world.send(&[ToVehicle::Tk3(message)]);
    let values = MotorValues::from_speeds(&[60.0; 6]).unwrap();
    let speeds = HostMessage::Speeds(values);
    let throttles = HostMessage::Throttles(MotorValues::new(&[0; 6]).unwrap());
    for message in [HostMessage::Start(1), speeds, throttles, HostMessage::Stop(1), HostMessage::StopAll] {
        world.texts.clear();
        send(&mut world, message);
        world.run(1.0);
        other.run(1.0);
        assert_eq!(commanded(&world), commanded(&other), "{message:?}");
        let stop = message == HostMessage::StopAll;
        let said = if stop { "x in flight is refused" } else { "refused: the vehicle flies by itself" };
        assert!(
            matches!(&world.texts[..], [text] if text.starts_with(said)),
            "{message:?}: {:?}",
            world.texts
        );
    }
    // A program that commands motors all the time does not hide what the vehicle says.
    world.texts.clear();
    for _ in 0..500 {
        send(&mut world, speeds);
        world.tick();
    }
    assert!((1..=3).contains(&world.texts.len()), "{:?}", world.texts);
    for _ in 0..100 {
        send(&mut world, HostMessage::StopAll);
        world.tick();
        assert!(matches!(commanded(&world), MotorCommand::Turn(_)));
    }
    // On the ground a stop is the safest end.
    let mut starting = World::new();
    starting.until(5.0, |world| world.base.flight().is_some());
    starting.run(2.0);
    starting.order(Order::TakeOff);
    starting.until(5.0, |world| world.phase() == Phase::Starting);
    send(&mut starting, HostMessage::StopAll);
    starting.tick();
    assert_eq!(commanded(&starting), MotorCommand::Kill);
}

#[test]
fn a_kill_is_obeyed_in_the_next_tick_and_nothing_starts_the_motors_again() {
    let mut world = World::hover();
    world.order(Order::Kill);
    world.run(0.006);
    assert!(!world.simulation.firmware().any_spins());
    world.run(3.0);
    world.order(Order::TakeOff);
    world.run(3.0);
    assert_eq!(world.phase(), Phase::Disarmed);
    assert_eq!(world.answers.last(), Some(&false));
    assert!(world.base.flight().unwrap().facts.has(tilthex_link::onboard::Facts::KILLED));
}

#[test]
fn a_take_off_that_is_called_off_does_not_wait_for_the_next_operator() {
    let mut world = World::new();
    world.blind = true;
    world.until(5.0, |world| world.base.flight().is_some());
    world.order(Order::TakeOff);
    world.run(0.5);
    world.order(Order::Land);
    world.run(2.0);
    world.blind = false;
    world.run(5.0);
    assert_eq!(world.phase(), Phase::Disarmed);
}

#[test]
fn after_a_start_that_was_called_off_motors_start_only_by_a_new_order() {
    for phase in [Phase::Starting, Phase::Grounded] {
        let mut world = World::new();
        world.until(5.0, |world| world.base.flight().is_some());
        world.run(2.0);
        world.order(Order::TakeOff);
        world.until(20.0, |world| world.phase() == phase);
        world.blind = true;
        world.until(1.0, |world| world.phase() == Phase::Disarmed);
        world.blind = false;
        world.run(5.0);
        assert_eq!(world.phase(), Phase::Disarmed, "after {phase:?}");
        assert!(!world.simulation.firmware().any_spins());
        let said = "the start is called off; order the take-off again";
        assert!(world.texts.iter().any(|text| text == said), "{:?}", world.texts);
        world.order(Order::TakeOff);
        world.until(1.0, |world| world.phase() == Phase::Starting);
        world.run(0.1);
        assert_eq!(world.answers, [true, true]);
    }
}

#[test]
fn x_on_the_ground_ends_the_order_to_take_off() {
    let mut world = World::new();
    world.blind = true;
    world.until(5.0, |world| world.base.flight().is_some());
    world.order(Order::TakeOff);
    world.run(0.5);
    world.send(&[ToVehicle::Tk3(HostMessage::StopAll)]);
    world.blind = false;
    world.run(5.0);
    assert_eq!(world.phase(), Phase::Disarmed);
    world.order(Order::TakeOff);
    world.until(1.0, |world| world.phase() == Phase::Starting);
}

#[test]
fn what_ends_a_flight_wins_against_an_order_that_comes_with_it() {
    let take_off = ToVehicle::Order(1, Order::TakeOff);
    let (land, stop) = (ToVehicle::Order(0, Order::Land), ToVehicle::Tk3(HostMessage::StopAll));
    for together in [[take_off, land], [land, take_off], [take_off, stop], [stop, take_off]] {
        let mut world = World::new();
        world.until(5.0, |world| world.base.flight().is_some());
        world.run(2.0);
        world.send(&together);
        world.run(5.0);
        assert_eq!(world.phase(), Phase::Disarmed, "{together:?}");
        let said = "order refused: an order to land or to stop came with it";
        assert!(world.texts.iter().any(|text| text == said), "{together:?} {:?}", world.texts);
        world.order(Order::TakeOff);
        world.until(1.0, |world| world.phase() == Phase::Starting);
    }
}

#[test]
fn a_place_that_is_refused_is_refused_each_time() {
    let mut world = World::hover();
    let start = world.record().setpoint;
    let limits =
        Limits { velocity: 0.5, acceleration: 0.5, angular_velocity: 0.5, angular_acceleration: 0.5 };
    let position_w = Vector3::new(500.0, 0.0, 1.0);
    let far = GoTo { position_w, rotation_we: start.rotation_we, duration: 0.0, limits };
    for _ in 0..4 {
        world.order(Order::GoTo(far));
        let answers = world.answers.len();
        world.until(1.0, |world| world.answers.len() > answers);
    }
    assert_eq!(world.answers, [true, false, false, false, false]);
    assert_eq!(world.record().setpoint.position_w, start.position_w);
}

/// The flight's own inputs, given to another flight, give the same command to each rotor, bit for bit.
#[test]
fn it_is_the_same_flight_as_everywhere_bit_for_bit() {
    let mut world = World::new();
    let mut flight = Flight::new(firmware_params(&config()).unwrap().flight, None).unwrap();
    let mut out = Commanded::default();
    let mut poses = 0;
    for k in 0..10_000 {
        if k == 1000 {
            world.order(Order::TakeOff);
        }
        world.tick();
        let firmware = world.simulation.firmware().firmware();
        let input = &firmware.output().record.input;
        let command = input.command.then_some(&Command::TakeOff);
        poses += input.poses().len();
        let telemetry = firmware.telemetry();
        let measured = Measured {
            time: input.time,
            telemetry,
            poses: input.poses(),
            command,
            host: input.host,
            known: None,
        };
        flight.tick(&measured, &mut out);
        assert_eq!(out.motors, firmware.output().motors, "tick {k}");
        let bits = |record: &Record| record.rotor_command.map(f64::to_bits);
        assert_eq!(bits(&out.record), bits(&firmware.output().record), "tick {k}");
    }
    assert!(poses > 1000 && world.on_mission() && out.record.rotor_command != RotorVector::zeros());
}

/// The messages that set them have no checksum.
#[test]
fn a_stream_with_a_wrong_period_is_set_again() {
    let mut world = World::hover();
    world.texts.clear();
    for (stream, period_us) in
        [(Stream::Motors, 20_000 ^ 1 << 12), (Stream::Imu, 20_000), (Stream::Battery, 0)]
    {
        world.send(&[ToVehicle::Tk3(HostMessage::Rate { stream, period_us })]);
        world.until(2.0, |world| world.texts.iter().any(|text| text.starts_with("Periods")));
        world.texts.clear();
        world.run(2.0);
        assert!(world.texts.is_empty(), "{:?}", world.texts);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Bytes of a broken line, and orders to stop all motors with one wrong bit, between the messages of the base.
    #[test]
    fn garbage_on_the_line_changes_nothing(
        garbage in vec((vec(any::<u8>(), 0..80), any::<prop::sample::Index>(), 0u8..8), 100)
    ) {
        let mut world = World::hover();
        let mut clean = world.clone();
        for (bytes, at, bit) in garbage {
            let mut kill = [0; MAX_FRAME];
            let length = ToVehicle::Order(0, Order::Kill).encode(&mut kill);
            kill[at.index(length)] ^= 1 << bit;
            // It ends with a frame that is aborted, so that it does not hit the next message.
            world.simulation.receive(&[&bytes[..], &kill[..length], b"^!"].concat(), &mut Vec::new());
            world.tick();
            clean.tick();
            let [one, other] = [&world, &clean].map(|world| world.simulation.firmware().firmware().output());
            prop_assert_eq!(&one.motors, &other.motors);
        }
        prop_assert_eq!(world.phase(), Phase::Flying);
    }
}

/// The example that a person copies flies as the configuration of its vehicle.
#[test]
fn the_example_has_the_values_of_the_configuration() {
    let configured = firmware_params(&config()).unwrap();
    let watch = configured.flight.watch;
    let example = tilthex_firmware::example::tilt_hex((watch.battery_low, watch.battery_critical)).unwrap();
    let [example, configured] = [example, configured].map(|params| format!("{params:#?}"));
    let lines = example.lines().zip(configured.lines());
    let other: Vec<_> = lines.filter(|(one, other)| one != other).collect();
    assert!(other.is_empty() && example.len() == configured.len(), "{other:?}");
}
