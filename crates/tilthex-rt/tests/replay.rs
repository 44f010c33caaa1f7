//! A logged flight, run again from its raw inputs, does to the bit what it did.

use std::path::Path;

use tilthex_config::{
    Config,
    orders::{self, Orders},
};
use tilthex_core::supervisor::Phase;
use tilthex_link::LinkedFlight;
use tilthex_rt::{
    log::{Attachments, Epoch, FlightLog, Index, LogReader},
    replay,
};
use tilthex_sim::{
    Simulation, SimulationParams,
    campaign::{Injection, Kind, World},
    feed::{Tick, Timing},
};

const TRAJECTORY: &str =
    "[[waypoint]]\nposition = [0.3, 0.1, 0.7]\nyaw_pitch_roll_deg = [20.0, 5.0, 0.0]\nhold = 0.5\n";

/// Orders of the flight, and when they are given, s.
const ORDERS: [(f64, &str); 3] = [
    (13.0, r#"{"command": "set_admittance", "stiffness": [8, 8, 8, 10, 10, 5]}"#),
    (14.0, r#"{"command": "set_wrench", "force": [0.1, 0.2, 0.3]}"#),
    (15.0, r#"{"command": "play", "waypoint": [{"position": [0.0, 0.0, 0.8]}]}"#),
];

/// An order to land goes past the ring, s.
const LANDS: f64 = 16.5;

/// The log of a faulty flight with orders and a trajectory, and `attached` as its configuration.
fn faulty_flight(attached: impl FnOnce(&Config) -> String) -> Vec<u8> {
    let config = Config::from_text("vehicle.preset = \"tilt-hex\"", Path::new("")).expect("valid");
    let params = config.linked_params(true).expect("valid");
    let route = orders::parse_route(TRAJECTORY, &config.mission().limits()).expect("valid");
    let linked = LinkedFlight::new(params, Some(route)).expect("valid");
    let mut world = World::new(Simulation::new(SimulationParams::new(params.flight.vehicle)), linked, 3);
    let fault = |kind, begin, duration| Injection { kind, begin, duration, strength: 0.6, index: 1 };
    world.inject(
        vec![
            fault(Kind::BitFlips, 10.0, 6.0),
            fault(Kind::Garbage, 10.0, 2.0),
            fault(Kind::CaptureJumps, 11.5, 0.3),
            fault(Kind::Stopped, 12.0, 0.1),
            fault(Kind::Reboot, 17.0, 0.1),
        ],
        3,
    );
    let attachments = Attachments {
        config: attached(&config),
        trajectory: Some(TRAJECTORY.into()),
        take_off: true,
        on_board: false,
    };
    let mut log = FlightLog::new(Vec::new(), Index::Written, Epoch::now(), 6, &attachments).expect("begins");
    let mut orders = Orders::new(&config);
    let mut pending = ORDERS.iter().peekable();
    let mut phases = Vec::new();
    while world.now() < 40.0 && !world.linked.finished() {
        let line = pending.peek().filter(|(time, _)| world.now() >= *time).map(|(_, line)| *line);
        let command = line.map(|line| orders.parse(line).expect("valid"));
        world.host.operator_silent = (14.2..14.6).contains(&world.now());
        if world.now() >= LANDS && !world.host.land {
            world.host.land = true;
            log.command(world.now(), r#"{"command": "land"}"#, true).expect("logged");
        }
        if world.tick(command.as_ref()) {
            if let Some(line) = line {
                pending.next();
                log.command(world.now(), line, false).expect("logged");
            }
            log.tick(&Tick::new(world.output(), Timing::default())).expect("logged");
            if phases.last() != Some(&world.record().phase) {
                phases.push(world.record().phase);
            }
        }
    }
    assert!(phases.contains(&Phase::Flying) && phases.contains(&Phase::Landing), "{phases:?}");
    assert!(pending.peek().is_none(), "every order was given");
    log.finish().expect("ends")
}

#[test]
fn every_output_of_a_faulty_flight_is_reproduced_bit_for_bit() {
    let bytes = faulty_flight(Config::to_toml);
    let replayed = replay::replay(&LogReader::new(bytes.clone()).expect("sound")).expect("complete");
    assert!(replayed.ticks > 5000, "{replayed:?}");
    assert_eq!(replayed.messages, 11 * replayed.ticks);
    assert_eq!(replayed.first_difference, None);

    // What was cut off is missing, the rest is reproduced all the same.
    let cut =
        replay::replay(&LogReader::new(bytes[..bytes.len() / 2].to_vec()).expect("sound")).expect("readable");
    assert!(cut.ticks > 100 && cut.ticks < replayed.ticks, "{cut:?}");
    assert_eq!(cut.first_difference, None);
    assert!(replayed.missing.is_none() && cut.missing.is_some_and(|text| text.contains("breaks off")));
}

#[test]
fn another_set_up_does_not_reproduce_it() {
    let bytes = faulty_flight(|config| {
        let changes = "[pose_control]\nposition_gain = 99.0\n".parse().expect("TOML");
        config.overlaid(changes).expect("valid").to_toml()
    });
    let replayed = replay::replay(&LogReader::new(bytes).expect("sound")).expect("complete");
    assert!(replayed.first_difference.is_some());
}
