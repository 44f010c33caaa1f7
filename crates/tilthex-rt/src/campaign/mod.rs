//! The fault campaign: many random faulty flights on virtual time, through the
//! real codecs, estimator, supervisor and controller.
//!
//! A flight fails on a panic, on a byte that should not have been sent, on a
//! reaction that the table of faults does not list, and on a fly-away.

pub mod faults;
mod story;
pub mod world;

use std::{
    collections::BTreeMap,
    fmt::Write as _,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};

use tilthex_core::{
    flight::{Flight, FlightParams},
    link::tk3::{self, HostMessage, Receiver},
    random::Random,
    supervisor::{FaultSet, Phase, Reaction, TABLE},
};

pub use faults::{Injection, Kind};
use story::Story;
pub use world::World;

use crate::{
    Failure,
    config::Config,
    sim::{Simulation, SimulationParams},
};

/// Farther from its start, horizontally or upwards, a vehicle has flown away, m.
const FLY_AWAY: f64 = 3.0;
/// A touch-down faster than this is hard, m/s.
const HARD: f64 = 1.5;
/// Faults begin within this time of the hover, s.
const WINDOW: f64 = 3.0;
/// Faults of flights that are watched from power-on begin within this time, s.
const WHOLE_WINDOW: f64 = 14.0;
/// After this long on its mission a flight is asked to land, s.
const MISSION: f64 = 7.0;
/// A flight that has not ended by then is not watched any longer, s.
const LONGEST: f64 = 45.0;
/// Ticks after the motors' stop before it is said whether the vehicle stands.
const SETTLING: usize = 1000;
/// One flight in so many is flown from power-on.
const WHOLE_EVERY: u64 = 4;

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

/// Flies one flight with its faults.
#[must_use]
pub fn fly(world: World, injections: Vec<Injection>, seed: u64) -> Outcome {
    fly_seen(world, injections, seed, &mut |_| ())
}

/// [`fly`], and `see` looks at the world after every period.
fn fly_seen(mut world: World, injections: Vec<Injection>, seed: u64, see: &mut dyn FnMut(&World)) -> Outcome {
    world.inject(injections.clone(), seed);
    let mut judge = Judge::new(&world, injections);
    let begin = world.now();
    let mut on_mission_for = 0.0;
    while world.now() - begin < LONGEST && !world.flight.finished() {
        if world.tick(None) {
            judge.look(&world);
        }
        judge.watch(&world);
        see(&world);
        if world.flight.on_mission() {
            on_mission_for += 0.002;
        }
        world.host.land |= on_mission_for > MISSION || world.now() - begin > LONGEST - 20.0;
        if judge.outcome.failure.is_some() || judge.done(&world) {
            break;
        }
    }
    // Legs that lose the last thrust give way a little.
    for _ in 0..SETTLING {
        world.tick(None);
    }
    judge.outcome.ended = !judge.flew || (world.flight.finished() && world.simulation.rests());
    judge.outcome.toppled = judge.outcome.ended && !world.simulation.stands();
    judge.outcome
}

struct Judge {
    outcome: Outcome,
    receiver: Receiver<HostMessage>,
    start: tilthex_core::Vector3,
    limits: (f64, f64),
    rotors: usize,
    flew: bool,
    falling: f64,
}

impl Judge {
    fn new(world: &World, injections: Vec<Injection>) -> Self {
        let vehicle = world.simulation.vehicle();
        let rotors = vehicle.rotors();
        let limits = rotors
            .iter()
            .fold((f64::MAX, 0.0_f64), |(low, high), r| (low.min(r.min_speed), high.max(r.max_speed)));
        Self {
            outcome: Outcome {
                injections,
                reaction: Reaction::Note,
                seen: FaultSet::NONE,
                deviation: 0.0,
                impact: 0.0,
                ended: false,
                toppled: false,
                failure: None,
            },
            receiver: Receiver::default(),
            start: world.simulation.truth().robot.position_w,
            limits,
            rotors: rotors.len(),
            flew: false,
            falling: 0.0,
        }
    }

    fn fail(&mut self, world: &World, what: impl std::fmt::Display) {
        self.outcome.failure.get_or_insert_with(|| format!("{:.3} s: {what}", world.now()));
    }

    /// Looks at what the controller did in a tick.
    fn look(&mut self, world: &World) {
        let record = world.record();
        let in_flight = record.phase.in_flight();
        self.flew |= in_flight;
        if in_flight {
            self.outcome.seen.0 |= record.faults.0;
        }
        for message in world.sent().iter().filter_map(|&byte| self.receiver.push(byte)).collect::<Vec<_>>() {
            self.check(world, &message, in_flight);
        }
        if self.receiver.counters().refused() > 0 || self.receiver.counters().frames.stray_bytes > 0 {
            self.fail(world, "sent bytes that are no message");
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

    fn check(&mut self, world: &World, message: &HostMessage, in_flight: bool) {
        match message {
            HostMessage::Speeds(values) => {
                let (low, high) = self.limits;
                // A set-point is a whole number of microseconds, which rounds the speed up by up to 1 %.
                let within = |&value: &i16| (0.99 * low..=1.03 * high).contains(&tk3::speed(value));
                if values.as_slice().len() != self.rotors || !values.as_slice().iter().all(within) {
                    self.fail(world, format_args!("sent {message:?}"));
                }
            }
            HostMessage::Stop(_) | HostMessage::StopAll if in_flight => {
                self.fail(world, "stopped motors in flight");
            }
            HostMessage::Throttles(_) => self.fail(world, format_args!("sent {message:?}")),
            _ => {}
        }
    }

    /// Looks at what the vehicle did.
    fn watch(&mut self, world: &World) {
        let robot = world.simulation.truth().robot;
        let way = robot.position_w - self.start;
        if way.xy().norm() > FLY_AWAY || way.z > FLY_AWAY || !robot.is_finite() {
            self.fail(world, format_args!("flew away to {:.2?}", robot.position_w.as_slice()));
        }
        let stands = world.simulation.stands();
        if stands && self.falling > HARD {
            self.outcome.impact = self.outcome.impact.max(self.falling);
        }
        self.falling = if stands { 0.0 } else { (-robot.velocity_w.z).max(0.9 * self.falling) };
    }

    /// Whether nothing more will happen: it lies on the ground and its host knows no more to do.
    fn done(&self, world: &World) -> bool {
        !self.flew && world.flight.supervisor().ended_by().is_some() && !world.record().phase.in_flight()
    }
}

/// Figures of a kind of fault.
#[derive(Clone, Debug, Default)]
struct Tally {
    flights: u64,
    reactions: [u64; 4],
    seen: BTreeMap<&'static str, u64>,
    deviation: f64,
    hard: u64,
    toppled: u64,
    not_ended: u64,
    failed: u64,
}

/// The figures of a campaign.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    tallies: BTreeMap<Kind, Tally>,
    failures: BTreeMap<u64, String>,
}

impl Summary {
    fn add(&mut self, seed: u64, outcome: &Outcome) {
        if let Some(failure) = &outcome.failure {
            let kinds: Vec<_> = outcome.injections.iter().map(|i| format!("{:?}", i.kind)).collect();
            self.failures.insert(seed, format!("{}: {failure}", kinds.join(" and ")));
        }
        for injection in &outcome.injections {
            let tally = self.tallies.entry(injection.kind).or_default();
            tally.flights += 1;
            let reaction = match outcome.reaction {
                Reaction::Note | Reaction::Refuse => 0,
                Reaction::Hold => 1,
                Reaction::Land => 2,
                Reaction::Descend => 3,
            };
            tally.reactions[reaction] += 1;
            for row in outcome.seen.rows() {
                *tally.seen.entry(row.name).or_default() += 1;
            }
            tally.deviation = tally.deviation.max(outcome.deviation);
            tally.hard += u64::from(outcome.impact > HARD);
            tally.toppled += u64::from(outcome.toppled);
            tally.not_ended += u64::from(!outcome.ended);
            tally.failed += u64::from(outcome.failure.is_some());
        }
    }

    /// What went wrong in the flights that failed, by their seeds.
    #[must_use]
    pub fn failures(&self) -> &BTreeMap<u64, String> {
        &self.failures
    }

    /// The table.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = String::from(
            "fault              flights  went on    held  landed  descended  worst error  hard  toppled  not ended  failed\n",
        );
        for (kind, t) in &self.tallies {
            let [on, held, landed, descended] = t.reactions;
            let _ = writeln!(
                text,
                "{:18} {:7}  {on:7} {held:7} {landed:7}  {descended:9}  {:9.3} m {:5}  {:7}  {:9}  {:6}",
                format!("{kind:?}"),
                t.flights,
                t.deviation,
                t.hard,
                t.toppled,
                t.not_ended,
                t.failed
            );
        }
        for (kind, t) in &self.tallies {
            let mut seen: Vec<_> = t.seen.iter().collect();
            seen.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
            let seen: Vec<_> = seen.iter().take(5).map(|(name, count)| format!("{name} {count}")).collect();
            let _ = writeln!(text, "{kind:?}, {}: seen as {}", kind.text(), seen.join(", "));
        }
        text
    }
}

/// A world at the moment its mission begins: the part that all flights share.
///
/// # Errors
/// Where even a flight without faults does not get that far.
pub fn hover(params: FlightParams) -> Result<World, Failure> {
    let mut world = ground(params, 1)?;
    while !world.flight.on_mission() {
        world.tick(None);
        if world.now() > 30.0 {
            let phase = world.flight.supervisor().phase().name();
            return Err(Failure::fault(format!("a flight without faults is still {phase} after 30 s")));
        }
    }
    Ok(world)
}

fn ground(params: FlightParams, seed: u64) -> Result<World, Failure> {
    let flight = Flight::new(params, None).map_err(|e| Failure::usage(e.to_string()))?;
    let mut simulated = SimulationParams::new(params.vehicle);
    simulated.seed = seed;
    Ok(World::new(Simulation::new(simulated), flight, seed))
}

/// Flies `count` flights with the seeds from `first` on, on every processor.
///
/// # Errors
/// Where the set-up can not fly even without faults.
pub fn run(config: &Config, count: u64, first: u64) -> Result<Summary, Failure> {
    let params = config.flight_params(true).map_err(|e| Failure::usage(e.to_string()))?;
    let hovering = hover(params)?;
    let (next, summary) = (AtomicU64::new(first), Mutex::new(Summary::default()));
    let worker = || {
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= first + count {
                return;
            }
            let outcome = one(params, &hovering, seed, &mut |_| ());
            summary.lock().unwrap_or_else(PoisonError::into_inner).add(seed, &outcome);
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(worker);
        }
    });
    Ok(summary.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Flies the flight of one seed again and tells its story.
///
/// # Errors
/// Where the set-up can not fly even without faults.
pub fn again(config: &Config, seed: u64) -> Result<(Outcome, String), Failure> {
    let params = config.flight_params(true).map_err(|e| Failure::usage(e.to_string()))?;
    let mut story = Story::default();
    let outcome = one(params, &hover(params)?, seed, &mut |world| story.see(world));
    Ok((outcome, story.text()))
}

/// The flight of one seed.
fn one(params: FlightParams, hovering: &World, seed: u64, see: &mut dyn FnMut(&World)) -> Outcome {
    let mut random = Random::new(seed);
    let whole = seed.is_multiple_of(WHOLE_EVERY);
    let window = if whole { WHOLE_WINDOW } else { WINDOW };
    let count = 1 + (random.uniform() < 0.2) as usize;
    let injections: Vec<_> = (0..count).map(|_| Injection::random(&mut random, window)).collect();
    let flown = catch_unwind(AssertUnwindSafe(|| {
        let world = if whole { ground(params, seed).ok()? } else { hovering.clone() };
        Some(fly_seen(world, injections.clone(), seed, see))
    }));
    flown.ok().flatten().unwrap_or_else(|| Outcome {
        injections,
        reaction: Reaction::Note,
        seen: FaultSet::NONE,
        deviation: 0.0,
        impact: 0.0,
        ended: false,
        toppled: false,
        failure: Some("panicked".into()),
    })
}
