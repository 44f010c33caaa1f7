//! A whole flight through its link against the simulated vehicle, on virtual time, with a capture system and a
//! serial line that a test may spoil.

use std::{cell::RefCell, collections::VecDeque, path::Path, rc::Rc};

use tilthex_config::{Config, TruthSection};
use tilthex_core::{
    PoseSample, Vector3,
    flight::{Command, HostFacts, Record},
    plant::{Plant, SensorParams},
    supervisor::{Fault, Phase},
};
use tilthex_link::{LinkedFlight, LinkedOutput, MAX_BYTES_IN, WireInput};
use tilthex_sim::{Firmware, FirmwareParams, Simulation};

use crate::rig::{Cruelty, Rig};

/// What a capture system makes of a pose at a time, s.
pub(crate) type Capture = Box<dyn FnMut(f64, PoseSample) -> Option<PoseSample>>;

/// What wires make of the bytes of a tick.
pub(crate) type Wires = Box<dyn FnMut(&[u8]) -> Vec<u8>>;

/// The vehicle, its controller, and what is between them.
pub(crate) struct World {
    pub(crate) simulation: Simulation<Rig>,
    pub(crate) linked: LinkedFlight,
    pub(crate) host: HostFacts,
    pub(crate) cruelty: Rc<RefCell<Cruelty>>,
    pub(crate) capture: Capture,
    /// Age of poses when they arrive, s, and delay of the line either way, s.
    pub(crate) pose_age: f64,
    pub(crate) line_delay: f64,
    /// What becomes of the bytes of a tick on their way to the vehicle.
    pub(crate) wires: Wires,
    out: LinkedOutput,
    to_host: VecDeque<(f64, Vec<u8>)>,
    to_vehicle: VecDeque<(f64, Vec<u8>)>,
    poses: VecDeque<PoseSample>,
    ticks: u64,
    start_w: Vector3,
    /// Ticks from one printed line to the next, where VERBOSE is set.
    every: u64,
    /// Farthest along x or y, and highest above the start, m; fastest, m/s: all true.
    pub(crate) farthest: f64,
    pub(crate) highest: f64,
    pub(crate) fastest: f64,
    /// Height above the ground at which motors were stopped after they flew, m.
    pub(crate) stopped_at: Option<f64>,
}

impl World {
    /// Of a configuration's text, on the ground; the vehicle is drawn by a truth and a seed.
    pub(crate) fn new(text: &str, truth: &str, seed: u64) -> Self {
        let config = Config::from_text(text, Path::new("")).unwrap();
        let drawn = TruthSection::named(truth).unwrap().draw(config.vehicle(), seed).unwrap();
        let plant = drawn.plant().unwrap();
        Self::of(&config, plant, drawn.sensors(&SensorParams::EXPERIMENTS), None, seed)
    }

    /// The default configuration of a preset.
    pub(crate) fn preset(name: &str, truth: &str, seed: u64) -> Self {
        Self::new(&format!("vehicle.preset = \"{name}\""), truth, seed)
    }

    /// Of a configuration, for a plant whose legs are `leg` long where that is not what the tool needs.
    pub(crate) fn of(
        config: &Config,
        plant: Plant,
        sensors: SensorParams,
        leg: Option<f64>,
        seed: u64,
    ) -> Self {
        let leg = leg.unwrap_or_else(|| (-plant.vehicle().tool().position_r.z).max(0.1) + 0.05);
        let (rig, cruelty) = Rig::new(plant, leg, seed);
        let board = Firmware::new(plant.vehicle(), FirmwareParams::default());
        let simulation = Simulation::with_body(rig, plant, sensors, board, seed);
        let start_w = simulation.truth().robot.position_w;
        let linked = LinkedFlight::new(config.linked_params(true).unwrap(), None).unwrap();
        Self {
            simulation,
            linked,
            host: HostFacts::default(),
            cruelty,
            capture: Box::new(|_, pose| Some(pose)),
            pose_age: 0.008,
            line_delay: 0.0,
            wires: Box::new(<[u8]>::to_vec),
            out: LinkedOutput::default(),
            to_host: VecDeque::new(),
            to_vehicle: VecDeque::new(),
            poses: VecDeque::new(),
            ticks: 0,
            start_w,
            every: std::env::var("VERBOSE").ok().and_then(|text| text.parse().ok()).unwrap_or(100),
            farthest: 0.0,
            highest: 0.0,
            fastest: 0.0,
            stopped_at: None,
        }
    }

    /// Simulated time, s.
    pub(crate) fn now(&self) -> f64 {
        self.simulation.now() as f64 * 1e-6
    }

    pub(crate) fn phase(&self) -> Phase {
        self.linked.flight.supervisor().phase()
    }

    pub(crate) fn saw(&self, fault: Fault) -> bool {
        self.linked.flight.supervisor().seen().contains(fault)
    }

    pub(crate) fn ended_by(&self) -> Option<Fault> {
        self.linked.flight.supervisor().ended_by()
    }

    /// Height of the centre of mass above where it stands, m.
    pub(crate) fn height(&self) -> f64 {
        self.simulation.truth().robot.position_w.z - self.start_w.z
    }

    /// Height of its lowest point above the ground, however it lies, m.
    pub(crate) fn clearance(&self) -> f64 {
        let (robot, leg) = (self.simulation.truth().robot, self.start_w.z);
        let feet =
            [(0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3)].map(|(x, y)| Vector3::new(x, y, -leg));
        let body = [(0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4)].map(|(x, y)| Vector3::new(x, y, 0.0));
        let tip = self.cruelty.borrow().tip.then(|| self.tool());
        let points =
            feet.iter().chain(&body).chain(&tip).map(|r| (robot.position_w + robot.rotation_wr * r).z);
        points.fold(f64::INFINITY, f64::min)
    }

    /// One period of the loop.
    pub(crate) fn tick(&mut self, command: Option<&Command>) -> Record {
        for _ in 0..2 {
            let now = self.now();
            let mut due = Vec::new();
            while self.to_vehicle.front().is_some_and(|(at, _)| *at <= now) {
                due.extend(self.to_vehicle.pop_front().map(|(_, bytes)| bytes).unwrap_or_default());
            }
            let mut bytes = Vec::new();
            self.simulation.receive(&due, &mut bytes);
            self.simulation.advance(&mut bytes);
            self.to_host.push_back((now + self.line_delay, bytes));
        }
        self.ticks += 1;
        let now = self.now();
        let time = 100.0 + now;
        if self.ticks.is_multiple_of(5) {
            let (position_w, rotation_wr) = self.simulation.captured_pose();
            let arrival = time + self.pose_age;
            let pose = PoseSample { time, arrival, position_w, rotation_wr, tracking_valid: true };
            self.poses.extend((self.capture)(now, pose));
        }
        let mut poses = Vec::new();
        while poses.len() < 4 && self.poses.front().is_some_and(|pose| pose.arrival <= time) {
            poses.extend(self.poses.pop_front());
        }
        let mut bytes = Vec::new();
        while bytes.len() < MAX_BYTES_IN && self.to_host.front().is_some_and(|(at, _)| *at < now) {
            bytes.extend(self.to_host.pop_front().map(|(_, bytes)| bytes).unwrap_or_default());
        }
        let count = bytes.len().min(MAX_BYTES_IN);
        if count < bytes.len() {
            self.to_host.push_front((now - 1.0, bytes.split_off(count)));
        }
        let before = self.phase();
        let input = WireInput { time, bytes: &bytes, poses: &poses, command, host: self.host };
        self.linked.tick(&input, &mut self.out);
        let bytes = (self.wires)(self.out.wire.sent.bytes());
        self.to_vehicle.push_back((now + self.line_delay, bytes));
        self.judge(before);
        self.out.commanded.record
    }

    fn judge(&mut self, before: Phase) {
        let robot = self.simulation.truth().robot;
        let way = robot.position_w - self.start_w;
        if before.in_flight() {
            self.farthest = self.farthest.max(way.x.abs()).max(way.y.abs());
            self.highest = self.highest.max(way.z);
            self.fastest = self.fastest.max(robot.velocity_w.norm());
            if self.phase() == Phase::Disarmed {
                self.stopped_at = Some(self.clearance());
            }
        }
        if std::env::var_os("VERBOSE").is_some()
            && (before != self.phase() || self.ticks.is_multiple_of(self.every))
        {
            let record = &self.out.commanded.record;
            let names: Vec<_> = record.faults.rows().map(|r| r.name).collect();
            println!(
                "{:6.2} {:9} at {:+.2?} v {:+.2?} up {:.2} ref {:+.2?} f {:+.1?} t {:+.2?} w {:.0?} {:?} {:?}",
                self.now(),
                record.phase.name(),
                way.as_slice(),
                robot.velocity_w.as_slice(),
                robot.rotation_wr[(2, 2)],
                record.reference.position_w.as_slice(),
                record.wrench_robot.force.as_slice(),
                record.wrench_robot.torque.as_slice(),
                &record.rotor_command.as_slice()[..6],
                names,
                self.linked.flight.start_refused().map(|e| e.to_string()).unwrap_or_default()
            );
        }
    }

    /// Goes on for this long, s, or until something holds; whether it does.
    pub(crate) fn until(&mut self, seconds: f64, mut holds: impl FnMut(&Self) -> bool) -> bool {
        for _ in 0..(seconds * 500.0) as usize {
            self.tick(None);
            if holds(self) {
                return true;
            }
        }
        false
    }

    /// Goes on for this long, s.
    pub(crate) fn run(&mut self, seconds: f64) {
        self.until(seconds, |_| false);
    }

    /// Takes off and hovers until its mission begins.
    pub(crate) fn fly(&mut self) {
        let begun = self.until(30.0, |w| w.linked.flight.on_mission());
        assert!(begun, "{:?} {:?}", self.phase(), self.linked.flight.supervisor().active());
    }

    /// Asks to land and waits for the end; whether it comes.
    pub(crate) fn land(&mut self, within: f64) -> bool {
        self.host.land = true;
        self.until(within, |w| w.linked.finished())
    }

    /// Waits for the end; whether it comes.
    pub(crate) fn ends(&mut self, within: f64) -> bool {
        self.until(within, |w| w.linked.finished())
    }

    /// Pushes with a force, N, world, on a place of the vehicle, m, robot.
    pub(crate) fn push(&mut self, force_w: Vector3, at_r: Vector3) {
        self.cruelty.borrow_mut().push = (force_w, at_r);
    }

    /// Where the tool is, m, robot.
    pub(crate) fn tool(&self) -> Vector3 {
        self.simulation.vehicle().tool().position_r
    }
}
