//! What one flight came to, and what must not happen in any.

use tilthex_core::{
    Vector3,
    flight::Record,
    supervisor::{Fault, FaultSet, LIFT_OFF_FAULTS, Phase, Reaction, TABLE, limits::LIFT_OFF_TIME},
};
use tilthex_link::tk3::{self, HostMessage, Receiver};

use super::{Injection, World};

/// Farther from its start, horizontally or upwards, a vehicle has flown away, m.
const FLY_AWAY: f64 = 3.0;
/// Faster than this, no vehicle that can carry itself may fly, m/s.
const FAST: f64 = 3.5;
/// Higher than this over its start, motors are not stopped, m.
const LOW: f64 = 0.1;
/// The same where the watch on the lift-off found a fault, m: a stop there is the gentle end.
const LOW_AT_FIRST: f64 = 0.35;
/// A vehicle that ends well is where it believes it is, m.
const BELIEF: f64 = 0.3;
/// A touch-down faster than this is hard, m/s.
pub(super) const HARD: f64 = 1.5;

/// What one flight came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// What was done to it.
    pub injections: Vec<Injection>,
    /// The worst that the supervisor did.
    pub reaction: Reaction,
    /// Faults that it saw in flight.
    pub seen: FaultSet,
    /// Largest true distance from the reference while it flew or held, m.
    pub deviation: f64,
    /// Fastest touch-down, m/s.
    pub impact: f64,
    /// Its motors were off at the end, and it lay still.
    pub ended: bool,
    /// It came to rest otherwise than on its feet.
    pub toppled: bool,
    /// What must not have happened.
    pub failure: Option<String>,
}

impl Outcome {
    /// Of a flight that nothing is known of yet.
    pub(super) fn of(injections: Vec<Injection>) -> Self {
        Self {
            injections,
            reaction: Reaction::Note,
            seen: FaultSet::NONE,
            deviation: 0.0,
            impact: 0.0,
            ended: false,
            toppled: false,
            failure: None,
        }
    }
}

/// Follows one flight.
pub(super) struct Judge {
    pub(super) outcome: Outcome,
    receiver: Receiver<HostMessage>,
    start: Vector3,
    limits: (f64, f64),
    rotors: usize,
    /// It was in the air.
    pub(super) flew: bool,
    /// When it took off, s.
    took_off: Option<f64>,
    falling: f64,
}

impl Judge {
    /// Of a world before its first tick.
    pub(super) fn new(world: &World, injections: Vec<Injection>) -> Self {
        let vehicle = world.simulation.vehicle();
        let rotors = vehicle.rotors();
        let limits = rotors
            .iter()
            .fold((f64::MAX, 0.0_f64), |(low, high), r| (low.min(r.min_speed), high.max(r.max_speed)));
        Self {
            outcome: Outcome::of(injections),
            receiver: Receiver::default(),
            start: world.simulation.truth().robot.position_w,
            limits,
            rotors: rotors.len(),
            flew: false,
            took_off: None,
            falling: 0.0,
        }
    }

    fn fail(&mut self, world: &World, what: impl std::fmt::Display) {
        self.outcome.failure.get_or_insert_with(|| format!("{:.3} s: {what}", world.now()));
    }

    /// Looks at what the controller did in a tick.
    pub(super) fn look(&mut self, world: &World) {
        let record = world.record();
        let in_flight = record.phase.in_flight();
        self.flew |= in_flight;
        if in_flight {
            self.took_off.get_or_insert(world.now());
            self.outcome.seen.0 |= record.faults.0;
        }
        for message in world.sent().iter().filter_map(|&byte| self.receiver.push(byte)).collect::<Vec<_>>() {
            self.check(world, &message, record);
        }
        if self.receiver.counters().refused() > 0 || self.receiver.counters().frames.stray_bytes > 0 {
            self.fail(world, "sent bytes that are no message");
        }
        if let Some(fault) = world.log_fault() {
            self.fail(world, fault);
        }
        let worst = record.faults.rows().map(|row| row.in_flight).max().unwrap_or(Reaction::Note);
        let ever = |reaction| {
            TABLE.iter().any(|row| self.outcome.seen.contains(row.fault) && row.in_flight >= reaction)
        };
        let listed = match record.phase {
            Phase::Holding => worst >= Reaction::Hold,
            Phase::Landing => ever(Reaction::Land),
            Phase::Emergency => worst >= Reaction::Descend,
            Phase::Flying => worst < Reaction::Hold,
            Phase::Disarmed | Phase::Starting | Phase::Grounded => true,
        };
        if !listed {
            self.fail(world, format_args!("{} is not what the table lists", record.phase.name()));
        }
        let reaction = match record.phase {
            Phase::Holding => Reaction::Hold,
            Phase::Landing => Reaction::Land,
            Phase::Emergency => Reaction::Descend,
            _ => Reaction::Note,
        };
        if !world.host.land {
            self.outcome.reaction = self.outcome.reaction.max(reaction);
        }
        if matches!(record.phase, Phase::Flying | Phase::Holding) {
            let tool = world.simulation.truth().tool_position_w;
            self.outcome.deviation = self.outcome.deviation.max((tool - record.reference.position_w).norm());
        }
    }

    fn check(&mut self, world: &World, message: &HostMessage, record: &Record) {
        match message {
            HostMessage::Speeds(values) => {
                let (low, high) = self.limits;
                // A set-point is a whole number of microseconds, which rounds the speed up by up to 1 %.
                let within = |&value: &i16| (0.99 * low..=1.03 * high).contains(&tk3::speed(value));
                if values.as_slice().len() != self.rotors || !values.as_slice().iter().all(within) {
                    self.fail(world, format_args!("sent {message:?}"));
                }
            }
            HostMessage::Stop(_) | HostMessage::StopAll => {
                let height = world.simulation.truth().robot.position_w.z - self.start.z;
                let known = |fault: Fault| record.faults.contains(fault);
                let at_first = self.took_off.is_some_and(|time| world.now() - time <= LIFT_OFF_TIME)
                    && (LIFT_OFF_FAULTS.into_iter().any(known) || known(Fault::PoseContradicts));
                if record.phase.in_flight() || height > if at_first { LOW_AT_FIRST } else { LOW } {
                    self.fail(world, format_args!("stopped motors {height:.2} m above the start"));
                }
            }
            HostMessage::Throttles(_) => self.fail(world, format_args!("sent {message:?}")),
            _ => {}
        }
    }

    /// Looks at what the vehicle did.
    pub(super) fn watch(&mut self, world: &World) {
        let robot = world.simulation.truth().robot;
        let way = robot.position_w - self.start;
        if way.xy().norm() > FLY_AWAY || way.z > FLY_AWAY || !robot.is_finite() {
            self.fail(world, format_args!("flew away to {:.2?}", robot.position_w.as_slice()));
        }
        let speed = robot.velocity_w.norm();
        if speed > FAST && !self.outcome.injections.iter().any(|i| i.kind.takes_lift()) {
            self.fail(world, format_args!("flew at {speed:.1} m/s"));
        }
        let stands = world.simulation.stands();
        if stands && self.falling > HARD {
            self.outcome.impact = self.outcome.impact.max(self.falling);
        }
        self.falling = if stands { 0.0 } else { (-robot.velocity_w.z).max(0.9 * self.falling) };
    }

    /// Looks at how the program would end: with success only where the vehicle is where it believes it is.
    pub(super) fn conclude(&mut self, world: &World) {
        let supervisor = world.linked.flight.supervisor();
        if !world.linked.finished() || supervisor.ended_by().is_some() {
            return;
        }
        let believed = world.record().state.position_w;
        let off = (believed - world.simulation.truth().robot.position_w).norm();
        if off > BELIEF {
            self.fail(world, format_args!("ended with success, {off:.2} m from where it believes it is"));
        }
    }

    /// Whether nothing more will happen: it lies on the ground and its host knows no more to do.
    pub(super) fn done(&self, world: &World) -> bool {
        !self.flew
            && world.linked.flight.supervisor().ended_by().is_some()
            && !world.record().phase.in_flight()
    }
}
