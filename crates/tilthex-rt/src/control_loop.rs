//! The loop: sleep, read the bytes that have arrived, tick, write, pass the record to the recorder.
//!
//! Its thread neither allocates, locks nor logs, and waits on nothing but the clock. Its system calls are `clock_nanosleep`,
//! and `ioctl` (`FIONREAD`), `read` and `write` on the port. `clock_gettime` needs no system call.

use std::time::Duration;

use rtrb::Consumer;
use tilthex_core::{
    PoseSample,
    estimator::StartError,
    flight::{Command, HostFacts, MAX_POSES, MotorFault, Record},
    supervisor::{Fault, FaultSet, Phase},
};
use tilthex_link::{
    Complaint, InertialDue, LinkedFlight, LinkedOutput, MAX_BYTES_IN, Outgoing, VehicleLink, WireInput,
};
use tilthex_sim::feed::{Feed, Tick, Timing};

use crate::{
    flags::Flags,
    phase_lock::{self, LOOK},
    port::{Port, Written},
    sleeper::{Clock, Monotonic, Nanos, Sleeper},
};

/// If the port is gone in flight, the loop ends after this time, s, because its commands no longer arrive.
const LINK_GONE: f64 = 1.0;

/// After a kill the loop repeats the stop for the first time, or for the second if a motor still spins, s.
const KILL_SAID: (f64, f64) = (0.5, 1.0);

/// A start that was broken off is tried again when its reason is gone. If the reason lasts longer than this, s, the start is
/// refused.
const REFUSED_FOR_GOOD: f64 = 3.0;

/// How the loop ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// The vehicle flew and landed. If a fault made it land, this is the fault.
    Landed(Option<Fault>),
    /// The vehicle flew, and stands with its motors off, but it has told of no landing: its board has started again.
    NotLanded,
    /// The user interrupted it before the flight began.
    Interrupted,
    /// The motors were stopped by the order to kill.
    Killed {
        /// Whether the vehicle was in the air.
        in_flight: bool,
    },
    /// No vehicle has identified itself.
    NoVehicle,
    /// The port is gone.
    LinkLost {
        /// Whether the vehicle was in the air.
        in_flight: bool,
    },
    /// The start of the motors was refused or broken off.
    Refused(FaultSet, Option<MotorFault>),
    /// The vehicle was not ready to fly in time.
    NotReady {
        /// Why the estimator has not started; `None` if it has, or if no pose arrived.
        estimator: Option<StartError>,
        /// Faults that keep the motors from starting.
        faults: FaultSet,
        /// Whether a usable pose has arrived.
        pose_seen: bool,
        /// Whether the vehicle answered and sent its streams.
        link_ready: bool,
        /// Why the link is not ready; `None` if it does not know.
        complaint: Option<Complaint>,
    },
}

/// The conditions under which the loop lands, or ends, by itself.
#[derive(Clone, Copy, Debug)]
pub struct LoopParams {
    /// Time between two ticks.
    pub period: Duration,
    /// Time from take-off to landing, s; `None` for no limit.
    pub duration: Option<f64>,
    /// Whether to land at the end of the route.
    pub land_after_route: bool,
    /// An operator whose orders are flown counts as silent after this time without a message; `None` for never.
    pub operator_timeout: Option<Duration>,
    /// Time in which the vehicle must begin to start its motors, s; `None` to wait for orders without a limit.
    pub patience: Option<f64>,
}

/// The parts that the loop works with.
pub struct ControlLoop {
    /// The flight, behind its link.
    pub linked: LinkedFlight,
    /// The line to the vehicle.
    pub port: Port,
    /// Poses from motion capture.
    pub poses: Consumer<PoseSample>,
    /// Orders.
    pub commands: Consumer<Command>,
    /// The ring to the recorder.
    pub feed: Feed,
    /// Flags of other threads: to land, to kill, and the time of the operator's last message.
    pub flags: Flags,
    /// When to land or end.
    pub params: LoopParams,
}

impl ControlLoop {
    /// Runs until the flight is over. Does not allocate until it returns (`tests/no_alloc.rs`).
    pub fn run(&mut self) -> End {
        let clock = Monotonic;
        let begin = clock.now();
        let mut memory = Memory::new(begin);
        let mut sleeper = Sleeper::new(self.params.period, begin + self.params.period.as_nanos() as Nanos);
        loop {
            let wake = sleeper.wait(&clock);
            memory.timing = Timing {
                wake_latency: wake.latency(),
                period: wake.woke - memory.last_woke,
                skipped: wake.skipped,
                ..Timing::default()
            };
            memory.last_woke = wake.woke;
            self.tick(&clock, &mut memory);
            sleeper.shift(memory.shift);
            if let Some(end) = self.end(&mut memory) {
                self.part();
                return end;
            }
        }
    }

    /// One tick: reads, flies, writes, and passes on the record.
    fn tick(&mut self, clock: &impl Clock, memory: &mut Memory) {
        let found = self.read(clock, memory);
        memory.now = found as f64 * 1e-9;
        let mut poses = [memory.no_pose; MAX_POSES];
        let mut pose_count = 0;
        while let Some(slot) = poses.get_mut(pose_count) {
            let Ok(pose) = self.poses.pop() else { break };
            *slot = pose;
            pose_count += 1;
        }
        memory.pose_seen |= poses[..pose_count].iter().any(|pose| pose.tracking_valid);
        let command = self.commands.pop().ok();
        let input = WireInput {
            time: memory.now,
            bytes: &memory.bytes[..memory.byte_count],
            poses: &poses[..pose_count],
            command: command.as_ref(),
            host: HostFacts {
                land: self.flags.lands() || self.time_to_land(memory),
                kill: self.flags.kills(),
                operator_silent: self
                    .params
                    .operator_timeout
                    .is_some_and(|patience| self.flags.operator_silent(found, patience.as_nanos() as Nanos)),
                link_lost: memory.gone,
                log_lost: self.feed.log_lost(),
            },
        };
        self.linked.tick(&input, &mut memory.out);
        let sent = memory.out.wire.sent.bytes();
        if !sent.is_empty() {
            memory.gone |= self.port.write(sent) == Written::Gone;
        }
        let written = clock.now();
        if self.linked.flight.supervisor().phase().in_flight() {
            memory.took_off.get_or_insert(memory.now);
        }
        memory.shift = phase_lock::shift(memory.due, memory.timing.polls);
        memory.timing.compute = written - memory.last_woke;
        memory.timing.imu_to_command = if memory.due.arrived { written - found } else { 0 };
        memory.timing.short_writes = self.port.short_writes();
        let complaint = self.linked.link.complaint();
        self.feed.push(&Tick { complaint, ..Tick::new(&memory.out, memory.timing) });
    }

    /// Reads the bytes that have arrived, and looks again if an inertial sample is due. Returns the time of the last look.
    fn read(&mut self, clock: &impl Clock, memory: &mut Memory) -> Nanos {
        let deadline = memory.last_woke.saturating_sub(memory.timing.wake_latency);
        memory.byte_count = 0;
        memory.due = self.linked.link.look(&[]);
        let mut looks = 0;
        loop {
            let at = clock.now();
            let free = memory.bytes.get_mut(memory.byte_count..).unwrap_or_default();
            match self.port.read(free) {
                Some(count) => {
                    memory.due = self.linked.link.look(&free[..count.min(free.len())]);
                    memory.byte_count += count;
                }
                None => memory.gone |= !free.is_empty(),
            }
            if memory.gone || !phase_lock::wants_look(memory.due, at.saturating_sub(deadline)) {
                memory.timing.polls = looks;
                return at;
            }
            looks += 1;
            clock.sleep_until(at + LOOK);
        }
    }

    fn time_to_land(&self, memory: &Memory) -> bool {
        let flown = memory.took_off.map(|since| memory.now - since);
        let late = |limit: f64| flown.is_some_and(|flown| flown >= limit);
        self.params.duration.is_some_and(late)
            || (self.params.land_after_route && self.linked.flight.mission_done())
    }

    fn end(&self, memory: &mut Memory) -> Option<End> {
        let supervisor = self.linked.flight.supervisor();
        if supervisor.killed() {
            let since = *memory.killed.get_or_insert(memory.now);
            let spins = self.linked.link.telemetry().any_spinning() && !memory.gone;
            let end = memory.now - since >= if spins { KILL_SAID.1 } else { KILL_SAID.0 };
            return end.then_some(End::Killed { in_flight: supervisor.landed() });
        }
        if self.linked.finished() {
            return Some(End::Landed(supervisor.ended_by()));
        }
        let in_flight = supervisor.phase().in_flight();
        let starting = matches!(supervisor.phase(), Phase::Starting | Phase::Grounded);
        let was_starting = std::mem::replace(&mut memory.starting, starting);
        if memory.gone {
            let since = *memory.gone_since.get_or_insert(memory.now);
            let end = !in_flight || memory.now - since >= LINK_GONE;
            return end.then_some(End::LinkLost { in_flight: memory.took_off.is_some() });
        }
        if supervisor.phase() != Phase::Disarmed || supervisor.landed() {
            memory.refused = None;
            return None;
        }
        if was_starting {
            memory.refused = Some((memory.now, supervisor.refusals()));
        }
        if self.linked.link.refused() {
            Some(End::NoVehicle)
        } else if self.flags.lands() {
            Some(End::Interrupted)
        } else if let Some((_, faults)) = memory.refused.filter(|(since, faults)| {
            faults.contains(Fault::StartTimeout)
                || faults.contains(Fault::MotorCheck)
                || memory.now - since >= REFUSED_FOR_GOOD
        }) {
            Some(End::Refused(faults, self.linked.flight.motor_fault()))
        } else if self.params.patience.is_some_and(|limit| memory.now - memory.begin >= limit) {
            Some(End::NotReady {
                estimator: self.linked.flight.start_refused(),
                faults: supervisor.refusals(),
                pose_seen: memory.pose_seen,
                link_ready: self.linked.link.telemetry().link.identified,
                complaint: self.linked.link.complaint(),
            })
        } else {
            None
        }
    }

    /// Ends the conversation with the vehicle.
    fn part(&mut self) {
        let mut out = Outgoing::default();
        self.linked.link.part(&mut out);
        self.port.write(out.bytes());
    }
}

/// What the loop keeps from tick to tick. All of it is allocated before the first tick.
struct Memory {
    bytes: [u8; MAX_BYTES_IN],
    byte_count: usize,
    out: LinkedOutput,
    due: InertialDue,
    timing: Timing,
    shift: i64,
    last_woke: Nanos,
    begin: f64,
    now: f64,
    took_off: Option<f64>,
    killed: Option<f64>,
    starting: bool,
    /// The time at which a start was broken off, and the reason.
    refused: Option<(f64, FaultSet)>,
    pose_seen: bool,
    gone: bool,
    gone_since: Option<f64>,
    no_pose: PoseSample,
}

impl Memory {
    fn new(begin: Nanos) -> Self {
        Self {
            bytes: [0; MAX_BYTES_IN],
            byte_count: 0,
            out: LinkedOutput::default(),
            due: InertialDue::default(),
            timing: Timing::default(),
            shift: 0,
            last_woke: begin,
            begin: begin as f64 * 1e-9,
            now: begin as f64 * 1e-9,
            took_off: None,
            killed: None,
            starting: false,
            refused: None,
            pose_seen: false,
            gone: false,
            gone_since: None,
            no_pose: Record::default().input.poses[0],
        }
    }
}
