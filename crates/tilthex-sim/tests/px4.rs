//! Whole flights over the PX4 link: the simulated body, its sensors, and a board that speaks as PX4 does.

#![allow(clippy::unwrap_used)]

use std::path::Path;
use tilthex_config::Config;
use tilthex_core::{
    PoseSample,
    flight::{HostFacts, MotorCommand, Record},
    plant::Battery,
    supervisor::{Fault, Phase},
};
use tilthex_link::{
    Complaint::Px4,
    LinkedFlight, LinkedOutput, MAX_BYTES_IN, VehicleLink, WireInput,
    px4::{
        Complaint, Topic,
        board::{Client, ClientParams, OFFBOARD_LOST},
    },
};
use tilthex_sim::{Own, Push, Pushes, Simulation, SimulationParams};

/// Throttles that a falling battery makes weaker.
const MAP: &str = "vehicle.preset = \"tilt-hex\"\n[link]\nprotocol = \"px4\"\nbaud = 0\n\
    throttle = [-0.05, 0.005, 2.5e-5]\nthrottle_voltage = 15.0\n";

/// A host and a vehicle on virtual time.
struct World {
    simulation: Simulation<Own, Client>,
    linked: LinkedFlight,
    out: LinkedOutput,
    to_host: Vec<u8>,
    host: HostFacts,
    ticks: u64,
    /// Nothing passes the line in either direction.
    cut: bool,
    /// One byte in this many is damaged on its way to the host; 0 for none.
    damage: u64,
    bytes: u64,
    /// The host's time when the board was powered, s.
    begin: f64,
}

impl World {
    fn new(pushes: Vec<Push>, change: impl FnOnce(&mut ClientParams)) -> Self {
        Self::with(MAP, pushes, change)
    }

    fn with(config: &str, pushes: Vec<Push>, change: impl FnOnce(&mut ClientParams)) -> Self {
        let params = Config::from_text(config, Path::new("")).unwrap().linked_params(true).unwrap();
        let mut simulated = SimulationParams::new(params.flight.vehicle);
        simulated.pushes = Pushes::new(pushes);
        let (battery, throttle) = (simulated.firmware.battery, params.link.throttle);
        let mut board = ClientParams { battery, throttle, periods: (2000, 4000), without: None };
        change(&mut board);
        let board = Client::new(&params.flight.vehicle, board);
        Self {
            simulation: Simulation::with_board(simulated, board),
            linked: LinkedFlight::new(params, None).unwrap(),
            out: LinkedOutput::default(),
            to_host: Vec::new(),
            host: HostFacts::default(),
            ticks: 0,
            cut: false,
            damage: 0,
            bytes: 0,
            begin: 100.0,
        }
    }

    fn tick(&mut self) -> Record {
        for _ in 0..2 {
            self.simulation.advance(&mut self.to_host);
        }
        if self.cut {
            self.to_host.clear();
        }
        for byte in &mut self.to_host {
            self.bytes += 1;
            *byte ^= u8::from(self.damage > 0 && self.bytes.is_multiple_of(self.damage)) << (self.bytes % 7);
        }
        self.ticks += 1;
        let time = self.begin + self.simulation.now() as f64 * 1e-6;
        let (position_w, rotation_wr) = self.simulation.captured_pose();
        let pose = PoseSample { time, arrival: time, position_w, rotation_wr, tracking_valid: true };
        let poses = if self.ticks.is_multiple_of(5) { &[pose][..] } else { &[] };
        let count = self.to_host.len().min(MAX_BYTES_IN);
        let bytes = &self.to_host[..count];
        self.linked.tick(&WireInput { time, bytes, poses, command: None, host: self.host }, &mut self.out);
        self.to_host.drain(..count);
        if !self.cut {
            self.simulation.receive(self.out.wire.sent.bytes(), &mut self.to_host);
        }
        self.out.commanded.record
    }

    /// Runs until `each` says so, for at most this long, s.
    fn run(&mut self, seconds: f64, mut each: impl FnMut(&Self, &Record) -> bool) -> bool {
        (0..(500.0 * seconds) as u64).any(|_| {
            let record = self.tick();
            each(self, &record)
        })
    }

    fn flies(&mut self) {
        let flies = self.run(40.0, |world, _| world.linked.flight.on_mission());
        assert!(flies, "{:?} {:?}", self.linked.flight.supervisor(), self.linked.link.complaint());
    }
}

#[test]
fn it_takes_off_hovers_yields_and_lands() {
    let push = Push { at: 12.0, duration: 9.0, force: [1.4, 0.0, 0.0], torque: [0.0; 3] };
    let mut world = World::new(vec![push], |_| {});
    world.flies();
    let start = world.simulation.truth().tool_position_w;
    world.run(11.5, |_, _| false);
    let deflection = world.simulation.truth().tool_position_w.x - start.x;
    assert!((deflection - 0.2).abs() < 0.01, "{deflection}");
    assert_eq!(world.linked.flight.supervisor().phase(), Phase::Flying);
    world.host.land = true;
    assert!(world.run(30.0, |world, _| world.linked.finished()), "{:?}", world.linked.flight.supervisor());
    assert_eq!(world.linked.flight.supervisor().ended_by(), Some(Fault::Operator));
    assert!(world.simulation.stands() && !world.simulation.firmware().is_armed());
    let board = world.simulation.firmware();
    assert!(board.failsafe().is_none());
}

#[test]
fn throttles_that_are_wrong_are_corrected_by_the_measured_speeds() {
    // The motors turn 5 % slower than the map says.
    let mut world = World::new(vec![], |board| {
        let [c0, c1, c2] = board.throttle.coefficients;
        board.throttle.coefficients = [c0, c1 / 0.95, c2 / (0.95 * 0.95)];
    });
    world.flies();
    world.run(3.0, |_, _| false);
    let truth = world.simulation.truth().rotor_speeds;
    let MotorCommand::Turn(commanded) = world.out.commanded.motors else { panic!("it flies") };
    let off = (truth - commanded).amax();
    assert!(off < 1.5, "{off} {truth} {commanded}");
}

#[test]
fn throttles_of_an_empty_battery_follow_the_exponent_of_the_link() {
    // Nothing corrects the throttles, and the voltage is far from that of the map.
    let off = |ours: f64, theirs: f64| {
        let text = format!("{MAP}throttle_correction = 0.0\nthrottle_exponent = {ours}\n");
        let mut world = World::with(&text, vec![], |board| {
            board.throttle.exponent = theirs;
            board.battery = Battery::new(5.0, 0.2);
        });
        world.flies();
        let truth = world.simulation.truth().rotor_speeds;
        let MotorCommand::Turn(commanded) = world.out.commanded.motors else { panic!("it flies") };
        (truth - commanded).sum() / commanded.sum()
    };
    let (equal, other) = (off(0.5, 0.5), off(1.0, 0.5));
    assert!(equal.abs() < 0.005, "{equal}");
    assert!(other > 0.02, "{other}");
}

#[test]
fn it_survives_damaged_bytes_and_a_line_that_is_gone_for_a_moment() {
    let mut world = World::new(vec![], |_| {});
    world.flies();
    // Of the inertial samples 2 % are lost, of the messages with all motors 11 %.
    world.damage = 3000;
    world.run(3.0, |_, _| false);
    assert_eq!(world.linked.flight.supervisor().phase(), Phase::Flying);
    assert!(world.linked.link.telemetry().link.refused_frames > 30);
    world.damage = 0;
    world.cut = true;
    world.run(0.3, |_, _| false);
    world.cut = false;
    world.run(1.0, |_, _| false);
    assert!(world.linked.flight.supervisor().phase().in_flight());
    assert!(world.simulation.firmware().failsafe().is_none(), "its limit is 0.5 s");
    world.host.land = true;
    assert!(world.run(30.0, |world, _| world.linked.finished()), "{:?}", world.linked.flight.supervisor());
    assert!(world.simulation.stands());
}

#[test]
fn a_line_that_stays_away_ends_in_the_failsafe_of_the_board() {
    let mut world = World::new(vec![], |_| {});
    world.flies();
    world.cut = true;
    let begin = world.simulation.now();
    assert!(world.run(0.6, |world, _| world.simulation.firmware().failsafe().is_some()));
    let since = world.simulation.firmware().failsafe().unwrap() - begin;
    assert!((OFFBOARD_LOST - 30_000..OFFBOARD_LOST + 30_000).contains(&since), "{since}");
    assert!(world.run(2.0, |world, _| world.linked.flight.supervisor().phase() == Phase::Emergency));
    assert!(world.linked.flight.supervisor().active().contains(Fault::LinkLost));
    assert!(world.run(20.0, |world, _| !world.simulation.firmware().is_armed()));
}

#[test]
fn without_fresh_commands_nothing_says_that_throttles_come_from_outside() {
    let mut world = World::new(vec![], |_| {});
    world.flies();
    let counts = |world: &World| {
        let board = world.simulation.firmware();
        (tilthex_link::board::Board::noted(board).commands_received, board.heartbeats_received())
    };
    let before = counts(&world);
    world.run(2.0, |_, _| false);
    let after = counts(&world);
    let (commands, heartbeats) = (after.0 - before.0, after.1 - before.1);
    assert!(commands == 1000 && (90..=110).contains(&heartbeats), "{commands} {heartbeats}");
    // The host's loop stands still: only the board goes on.
    let mut unheard = Vec::new();
    let stands = (0..600).any(|_| {
        world.simulation.advance(&mut unheard);
        world.simulation.firmware().failsafe().is_some()
    });
    assert!(stands, "PX4 acts when tilthex stops");
}

#[test]
fn what_px4_does_not_send_is_named_with_what_mends_it() {
    for (without, part) in [
        (
            Topic::EscStatus,
            "publications:` in PX4's src/modules/uxrce_dds_client/dds_topics.yaml the two lines `- topic: /fmu/out/esc_status`",
        ),
        (
            Topic::ActuatorMotors,
            "subscriptions:` in PX4's src/modules/uxrce_dds_client/dds_topics.yaml the two lines `- topic: /fmu/in/actuator_motors`",
        ),
    ] {
        let mut world = World::new(vec![], |board| board.without = Some(without));
        world.run(6.0, |_, _| false);
        assert_eq!(world.linked.flight.supervisor().phase(), Phase::Disarmed);
        let complaint = world.linked.link.complaint().unwrap().to_string();
        assert!(complaint.contains(part), "{complaint}");
    }
    let mut world = World::new(vec![], |board| board.periods = (10_000, 4000));
    world.run(6.0, |_, _| false);
    assert_eq!(world.linked.flight.supervisor().phase(), Phase::Disarmed);
    let complaint = world.linked.link.complaint().unwrap();
    let Px4(Complaint::Slow { topic: Topic::SensorCombined, found, expected }) = complaint else {
        panic!("{complaint}")
    };
    assert!((found - 100.0).abs() < 2.0 && expected == 500.0, "{complaint}");
    assert!(complaint.to_string().contains("rate_limit: 1000."), "{complaint}");
}

#[test]
fn a_host_that_is_started_again_in_flight_stops_motors_by_the_order_to_kill_only() {
    let mut world = World::new(vec![], |_| {});
    world.flies();
    world.linked = World::new(vec![], |_| {}).linked;
    let complains = |world: &World| world.linked.link.complaint() == Some(Px4(Complaint::Armed));
    let disarmed = |world: &World, _: &Record| !world.simulation.firmware().is_armed();
    assert!(world.run(6.0, |world, _| complains(world)), "{:?}", world.linked.link.complaint());
    assert!(!world.run(2.0, disarmed), "the failsafe of the board flies");
    assert!(!world.linked.link.telemetry().link.ready && complains(&world));
    world.host.kill = true;
    assert!(world.run(0.5, disarmed));
}

#[test]
fn motors_of_a_pilot_who_has_taken_over_are_stopped_by_the_order_to_kill_only() {
    let mut world = World::new(vec![], |_| {});
    world.flies();
    let now = world.simulation.now();
    world.simulation.firmware_mut().take_over(now);
    let over = |world: &World, _: &Record| world.linked.flight.supervisor().phase() == Phase::Disarmed;
    assert!(world.run(30.0, over), "{:?}", world.linked.flight.supervisor());
    let disarmed = |world: &World, _: &Record| !world.simulation.firmware().is_armed();
    assert!(!world.run(2.0, disarmed), "the pilot flies");
    assert!(!world.linked.finished());
    world.host.kill = true;
    assert!(world.run(0.5, disarmed));
}

#[test]
fn a_host_that_is_started_again_gets_a_session() {
    let mut world = World::new(vec![], |_| {});
    assert!(world.run(15.0, |world, _| world.linked.link.telemetry().link.ready));
    let other = World::new(vec![], |_| {});
    world.linked = other.linked;
    world.begin = 700.0;
    world.flies();
}
