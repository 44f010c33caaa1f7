//! The complete loop on virtual time: the simulated vehicle, the real codecs, estimator, supervisor and controller,
//! and the faults.

use std::collections::VecDeque;

use tilthex_core::{
    flight::{Command, HostFacts, MAX_POSES, Record},
    random::Random,
    types::PoseSample,
};
use tilthex_link::{LinkedFlight, LinkedOutput, MAX_BYTES_IN, WireInput};

use super::{
    acts::{Act, Bytes, Memory, OnVehicle},
    disk::Disk,
    faults::Injection,
};
use crate::{STEP, Simulation};

/// Cycles of the board in a period of the loop.
const CYCLES: u64 = 2;
/// Ticks between two poses.
const CAPTURE_EVERY: u64 = 5;
/// The smallest delay of a pose, s; the largest is 1.5 times this.
const CAPTURE_LATENCY: f64 = 0.008;
/// How many bytes wait at most for a loop that does not read.
const LINE_BUFFER: usize = 4096;
/// The host's time when the board was powered, s.
const EPOCH: f64 = 100.0;

/// A direction on the line.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    /// From the vehicle.
    Received,
    /// To the vehicle.
    Sent,
}

/// Whether a fault is active, and what it remembers.
#[derive(Clone, Debug, Default)]
struct Active {
    on: bool,
    stalls: bool,
    memory: Memory,
}

/// A vehicle, its controller and the faults of both.
#[derive(Clone)]
pub struct World {
    /// The vehicle.
    pub simulation: Simulation,
    /// Its controller, behind its link.
    pub linked: LinkedFlight,
    /// Facts that only the host observes.
    pub host: HostFacts,
    /// Their faults.
    pub injections: Vec<Injection>,
    out: LinkedOutput,
    to_host: Vec<u8>,
    poses: VecDeque<PoseSample>,
    active: Vec<Active>,
    random: Random,
    ticks: u64,
    stopped: u64,
    /// Commands of the tick in which the program stands still.
    unsent: Option<Vec<u8>>,
    disk: Disk,
}

impl World {
    /// A flight that begins without faults.
    #[must_use]
    pub fn new(simulation: Simulation, linked: LinkedFlight, seed: u64) -> Self {
        Self {
            simulation,
            linked,
            host: HostFacts::default(),
            injections: Vec::new(),
            out: LinkedOutput::default(),
            to_host: Vec::new(),
            poses: VecDeque::new(),
            active: Vec::new(),
            random: Random::new(seed),
            ticks: 0,
            stopped: 0,
            unsent: None,
            disk: Disk::default(),
        }
    }

    /// Adds faults with their own seed. Their times count from now.
    pub fn inject(&mut self, injections: Vec<Injection>, seed: u64) {
        self.random = Random::new(seed);
        self.active = vec![Active::default(); injections.len()];
        let now = self.now();
        self.injections = injections;
        for injection in &mut self.injections {
            injection.begin += now;
        }
    }

    /// Time since the board was powered, s.
    #[must_use]
    pub fn now(&self) -> f64 {
        self.simulation.now() as f64 * 1e-6
    }

    /// The bytes that the last tick sent.
    #[must_use]
    pub fn sent(&self) -> &[u8] {
        self.out.wire.sent.bytes()
    }

    /// What is wrong with the log: a tick that is neither written nor counted, or a tick that was dropped though the
    /// disk did not stand still.
    pub(super) fn log_fault(&self) -> Option<&'static str> {
        let may_drop =
            self.injections.iter().any(|i| i.kind.acts().iter().any(|act| matches!(act, Act::Disk)));
        match (self.disk.accounts_for_all(), self.disk.dropped()) {
            (false, _) => Some("the log lost a tick that was not counted"),
            (_, 1..) if !may_drop => Some("the log dropped a tick though the disk did not stand still"),
            _ => None,
        }
    }

    /// The output of the last tick.
    #[must_use]
    pub fn output(&self) -> &LinkedOutput {
        &self.out
    }

    /// The record of the last tick.
    #[must_use]
    pub fn record(&self) -> &Record {
        &self.out.commanded.record
    }

    /// Simulates one period: the vehicle, and the controller unless its program stands still. Returns whether the
    /// controller ran.
    pub fn tick(&mut self, command: Option<&Command>) -> bool {
        self.switch();
        for _ in 0..CYCLES {
            let mut bytes = Vec::new();
            self.simulation.advance(&mut bytes);
            self.arrive(bytes);
        }
        self.ticks += 1;
        if self.ticks.is_multiple_of(CAPTURE_EVERY) {
            self.capture();
        }
        if self.stopped > 0 {
            self.stopped -= 1;
            return false;
        }
        if let Some(command) = self.unsent.take() {
            self.send(command);
        }
        self.control(command);
        true
    }

    /// Begins and ends faults at their times.
    fn switch(&mut self) {
        let now = self.now();
        let mut out = Vec::new();
        for (injection, active) in self.injections.iter().zip(&mut self.active) {
            let due = injection.acts_at(now);
            let (begins, ends) = (due && !active.on, !due && active.on);
            active.on = due;
            let mut on =
                OnVehicle { simulation: &mut self.simulation, out: &mut out, random: &mut self.random };
            for act in injection.kind.acts() {
                match act {
                    Act::Vehicle { begin, during, end } => {
                        if begins {
                            begin(injection, &mut on);
                        }
                        if due {
                            during(injection, &mut on);
                        }
                        if ends {
                            end(injection, &mut on);
                        }
                    }
                    Act::Host(tell) => tell(&mut self.host, due),
                    Act::Stopped if begins => self.stopped = periods(injection),
                    Act::Stalled if begins => active.stalls = true,
                    Act::Stopped
                    | Act::Stalled
                    | Act::Received(_)
                    | Act::Sent(_)
                    | Act::Pose(_)
                    | Act::Disk => {}
                }
            }
        }
        self.to_host.extend(out);
    }

    fn lasts(&self, is: impl Fn(&Act) -> bool) -> bool {
        self.injections.iter().zip(&self.active).any(|(i, active)| active.on && i.kind.acts().iter().any(&is))
    }

    fn arrive(&mut self, mut bytes: Vec<u8>) {
        self.spoil(Way::Received, &mut bytes);
        self.to_host.extend(bytes);
        self.to_host.truncate(LINE_BUFFER);
    }

    /// Applies the active faults of the line to bytes that go in one direction.
    fn spoil(&mut self, way: Way, bytes: &mut Vec<u8>) {
        let (now, rotors) = (self.simulation.now(), self.simulation.vehicle().rotor_count());
        for (injection, active) in self.injections.iter().zip(&mut self.active) {
            let Memory { imu, received, sent, .. } = &mut active.memory;
            for act in injection.kind.acts() {
                let (spoil, held) = match (act, way) {
                    (Act::Received(spoil), Way::Received) => (spoil, &mut *received),
                    (Act::Sent(spoil), Way::Sent) => (spoil, &mut *sent),
                    (Act::Received(_) | Act::Sent(_), _) => continue,
                    (Act::Vehicle { .. } | Act::Pose(_) | Act::Host(_), _) => continue,
                    (Act::Disk | Act::Stopped | Act::Stalled, _) => continue,
                };
                let random = &mut self.random;
                pass(active.on, spoil, injection, Bytes { bytes, held, imu, random, now, rotors });
            }
        }
    }

    fn capture(&mut self) {
        let time = EPOCH + self.now();
        let (position_w, rotation_wr) = self.simulation.captured_pose();
        let arrival = time + CAPTURE_LATENCY * (1.0 + 0.5 * self.random.uniform());
        let mut pose = Some(PoseSample { time, arrival, position_w, rotation_wr, tracking_valid: true });
        for (injection, active) in self.injections.iter().zip(&mut self.active).filter(|(_, a)| a.on) {
            for act in injection.kind.acts() {
                if let Act::Pose(spoil) = act {
                    pose = pose.and_then(|p| spoil(injection, p, &mut active.memory, &mut self.random));
                }
            }
        }
        self.poses.extend(pose);
    }

    fn control(&mut self, command: Option<&Command>) {
        let time = EPOCH + self.now() + 1e-6 * (STEP as f64) * 0.05 * self.random.uniform();
        let count = self.to_host.len().min(MAX_BYTES_IN);
        let mut poses = Vec::with_capacity(MAX_POSES);
        while poses.len() < MAX_POSES && self.poses.front().is_some_and(|pose| pose.arrival <= time) {
            poses.extend(self.poses.pop_front());
        }
        let input =
            WireInput { time, bytes: &self.to_host[..count], poses: &poses, command, host: self.host };
        self.linked.tick(&input, &mut self.out);
        let stands_still = self.lasts(|act| matches!(act, Act::Disk));
        self.disk.record(&self.out, stands_still);
        self.to_host.drain(..count);
        let command = self.sent().to_vec();
        for (injection, active) in self.injections.iter().zip(&mut self.active) {
            if std::mem::take(&mut active.stalls) {
                self.stopped = periods(injection);
            }
        }
        if self.stopped > 0 {
            self.unsent = Some(command);
        } else {
            self.send(command);
        }
    }

    /// Passes bytes to the vehicle.
    fn send(&mut self, mut command: Vec<u8>) {
        self.spoil(Way::Sent, &mut command);
        let mut answer = Vec::new();
        self.simulation.receive(&command, &mut answer);
        self.to_host.extend(answer);
    }
}

/// How many periods a stopped program does not run: 5 to 500 ms.
fn periods(injection: &Injection) -> u64 {
    (2.5 + 247.5 * injection.strength) as u64
}

/// Applies a fault to the bytes if it is active. If it is over, the bytes that it held back go first.
fn pass(on: bool, spoil: &fn(&Injection, &mut Bytes<'_>), injection: &Injection, mut line: Bytes<'_>) {
    if on {
        spoil(injection, &mut line);
    } else if !line.held.is_empty() {
        let held: Vec<u8> = line.held.drain(..).flat_map(|(_, bytes)| bytes).collect();
        line.bytes.splice(0..0, held);
    }
}
