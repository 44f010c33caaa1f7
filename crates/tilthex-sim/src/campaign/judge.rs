//! The outcome of one flight, and what counts as a failure.

use tilthex_core::{
    Vector3, Vector6,
    allocation::Allocator,
    flight::Record,
    so3,
    supervisor::{Fault, FaultSet, LIFT_OFF_FAULTS, Phase, Reaction, TABLE, limits::LIFT_OFF_TIME},
};
use tilthex_link::{
    board::Board,
    tk3::{self, HostMessage, Receiver},
};

use super::{Injection, World};

/// A vehicle that is farther than this from its start, horizontally or upwards, has flown away, m.
const FLY_AWAY: f64 = 3.0;
/// The same for a vehicle that cannot carry itself, because a rotor is lost, or a push is stronger than its rotors, m. While
/// it lasts, such a push alone carries the vehicle farther.
const THROWN: f64 = 4.0;
/// A vehicle that no command reaches for this time, s, is not controlled: its rotors hold their last speeds. If it turns over
/// meanwhile by more than this, deg, or so fast that its rotors cannot stop it before, it cannot carry itself.
const UNHEARD: (f64, f64) = (0.1, 60.0);
/// Rotors that cannot balance this many times a push have nothing left to stop the motion that the push has begun.
const SPARE: f64 = 1.1;
/// Largest allowed speed of a vehicle that can carry itself, m/s.
const FAST: f64 = 3.5;
/// Largest height above the start at which motors may be stopped, m.
const LOW: f64 = 0.1;
/// As [`LOW`], if the watch of the lift-off found a fault, m: there a stop of the motors is the safest end.
const LOW_AT_FIRST: f64 = 0.35;
/// Largest error of the estimated position of a flight that ends with success, m.
const BELIEF: f64 = 0.3;
/// A touch-down faster than this is hard, m/s.
pub(super) const HARD: f64 = 1.5;

/// The outcome of one flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Its faults.
    pub injections: Vec<Injection>,
    /// The strongest reaction of the supervisor.
    pub reaction: Reaction,
    /// Faults that the supervisor saw in flight.
    pub seen: FaultSet,
    /// Largest true distance of the tool from the reference while the vehicle flew or held, m.
    pub deviation: f64,
    /// Fastest touch-down, m/s.
    pub impact: f64,
    /// Whether its motors were off at the end, and it was at rest.
    pub ended: bool,
    /// Whether it came to rest in another attitude than on its feet.
    pub toppled: bool,
    /// What went wrong, if the flight failed.
    pub failure: Option<String>,
}

impl Outcome {
    /// The outcome before the flight.
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

/// Observes one flight, and decides whether it fails.
pub(super) struct Judge {
    pub(super) outcome: Outcome,
    receiver: Receiver<HostMessage>,
    start: Vector3,
    limits: (f64, f64),
    rotors: usize,
    allocator: Allocator,
    /// Speed and distance to which pushes alone that are stronger than the rotors have carried the vehicle, m/s and m.
    thrown: (f64, f64),
    /// Number of commands that the board has received, and for how long it has received none, s.
    heard: (u64, f64),
    /// Whether nothing could prevent that it turned over, because no command reached it.
    turned_over: bool,
    /// Time of the last look at the motion, s.
    looked: f64,
    /// Whether it was in the air.
    pub(super) flew: bool,
    /// When it took off, s.
    took_off: Option<f64>,
    falling: f64,
}

impl Judge {
    /// The judge of a world before its first tick.
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
            allocator: Allocator::new(vehicle),
            thrown: (0.0, 0.0),
            heard: (0, 0.0),
            turned_over: false,
            looked: 0.0,
            flew: false,
            took_off: None,
            falling: 0.0,
        }
    }

    fn fail(&mut self, world: &World, what: impl std::fmt::Display) {
        self.outcome.failure.get_or_insert_with(|| format!("{:.3} s: {what}", world.now()));
    }

    /// Checks the actions of the controller in a tick.
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
            self.fail(world, "sent bytes that are not a message");
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
            self.fail(
                world,
                format_args!(
                    "the phase is {}, which the table of faults does not list for these faults",
                    record.phase.name()
                ),
            );
        }
        let reaction = match record.phase {
            Phase::Holding => Reaction::Hold,
            Phase::Landing => Reaction::Land,
            Phase::Emergency => Reaction::Descend,
            Phase::Disarmed | Phase::Starting | Phase::Grounded | Phase::Flying => Reaction::Note,
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
                // A set-point is a whole number of microseconds, so that rounding increases the speed by up to 1 %.
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
                // Something may throw a vehicle that has not taken off yet.
                let aloft = self.flew && height > if at_first { LOW_AT_FIRST } else { LOW };
                if record.phase.in_flight() || aloft {
                    self.fail(world, format_args!("stopped motors {height:.2} m above the start"));
                }
            }
            HostMessage::Throttles(_) => self.fail(world, format_args!("sent {message:?}")),
            HostMessage::Identify
            | HostMessage::Rate { .. }
            | HostMessage::Start(_)
            | HostMessage::Beep(_) => {}
        }
    }

    /// Checks the motion of the vehicle.
    pub(super) fn watch(&mut self, world: &World) {
        let robot = world.simulation.truth().robot;
        let way = robot.position_w - self.start;
        let dt = world.now() - std::mem::replace(&mut self.looked, world.now());
        let commands = world.simulation.firmware().noted().commands_received;
        let unheard = if commands == self.heard.0 { self.heard.1 + dt } else { 0.0 };
        self.heard = (commands, unheard);
        self.turned_over |= unheard > UNHEARD.0 && self.flew && self.turns_over(world);
        if self.overwhelms(world) {
            let force = pushed_w(world).norm();
            self.thrown.0 += force / world.simulation.vehicle().mass() * dt;
            self.thrown.1 += self.thrown.0 * dt;
        }
        let carries_itself = self.thrown.1 == 0.0
            && !self.turned_over
            && !self.outcome.injections.iter().any(|i| i.kind.takes_lift());
        let far = if carries_itself { FLY_AWAY } else { THROWN + self.thrown.1 };
        if way.xy().norm() > far || way.z > FLY_AWAY || !robot.is_finite() {
            self.fail(world, format_args!("flew away to {:.2?}", robot.position_w.as_slice()));
        }
        let speed = robot.velocity_w.norm();
        if speed > FAST && carries_itself {
            self.fail(world, format_args!("flew at {speed:.1} m/s"));
        }
        let stands = world.simulation.stands();
        if stands && self.falling > HARD {
            self.outcome.impact = self.outcome.impact.max(self.falling);
        }
        self.falling = if stands { 0.0 } else { (-robot.velocity_w.z).max(0.9 * self.falling) };
    }

    /// Whether the vehicle is tilted by more than the angle of [`UNHEARD`], or will be, although its rotors brake it with the thrust
    /// of a hover.
    fn turns_over(&self, world: &World) -> bool {
        let vehicle = world.simulation.vehicle();
        let robot = world.simulation.truth().robot;
        let angle = UNHEARD.1.to_radians() - so3::tilt(&robot.rotation_wr);
        let to_r = robot.rotation_wr.transpose();
        let Some(axis_r) = (to_r * Vector3::z()).cross(&Vector3::z()).try_normalize(0.0) else {
            return false;
        };
        let rate = robot.angular_velocity_r.dot(&axis_r);
        if angle <= 0.0 || rate <= 0.0 {
            return angle <= 0.0;
        }
        let brakes = -axis_r * rate * rate / (2.0 * angle);
        let torque = vehicle.inertia() * brakes - world.simulation.disturbance().torque;
        let wrench = Vector6::from_iterator((Vector3::z() * vehicle.weight()).iter().chain(&torque).copied());
        self.allocator.allocate(&wrench).given_up.is_some()
    }

    /// Whether the rotors can balance [`SPARE`] times what pushes the vehicle now in no attitude: neither level, nor with
    /// their common thrust along the force that they need. A vehicle whose fault takes lift balances no push.
    fn overwhelms(&self, world: &World) -> bool {
        let vehicle = world.simulation.vehicle();
        let pushed_w = pushed_w(world);
        if pushed_w == Vector3::zeros() {
            return false;
        }
        let needed_w = Vector3::z() * vehicle.weight() - pushed_w * SPARE;
        let axis_w = Vector3::z().cross(&needed_w);
        let angle = axis_w.norm().atan2(needed_w.z);
        let tilted = axis_w.try_normalize(0.0).map_or(Vector3::zeros(), |axis_w| axis_w * angle);
        let at_tool_w = world.simulation.pressed_tool_w().force * SPARE;
        let at_body_r = world.simulation.disturbance().torque * SPARE;
        let balances = |rotation_wr| {
            let to_r = so3::exp(&rotation_wr).transpose();
            let torque = -vehicle.tool().position_r.cross(&(to_r * at_tool_w)) - at_body_r;
            let wrench = Vector6::from_iterator((to_r * needed_w).iter().chain(&torque).copied());
            self.allocator.allocate(&wrench).given_up.is_none()
        };
        let lifts = !world.injections.iter().any(|i| i.kind.takes_lift() && i.acts_at(world.now()));
        !lifts || !balances(Vector3::zeros()) && !balances(tilted)
    }

    /// Checks the end of the program: it may end with success only if the vehicle is where it believes it is.
    pub(super) fn conclude(&mut self, world: &World) {
        let supervisor = world.linked.flight.supervisor();
        if !world.linked.finished() || supervisor.ended_by().is_some() {
            return;
        }
        let believed = world.record().state.position_w;
        let off = (believed - world.simulation.truth().robot.position_w).norm();
        if off > BELIEF {
            self.fail(world, format_args!("ended with success {off:.2} m away from the estimated position"));
        }
    }

    /// Whether nothing more will happen: the vehicle is on the ground, and a fault has ended the flight.
    pub(super) fn done(&self, world: &World) -> bool {
        !self.flew
            && world.linked.flight.supervisor().ended_by().is_some()
            && !world.record().phase.in_flight()
    }
}

/// The force that pushes the vehicle, at its tool and at its body, N, world.
fn pushed_w(world: &World) -> Vector3 {
    world.simulation.pressed_tool_w().force + world.simulation.disturbance().force
}
