//! The fault campaign: many flights with random faults on virtual time, through the real codecs, estimator,
//! supervisor and controller.
//!
//! A flight fails on each of these: a panic; a byte that must not be sent; a reaction that the table of faults does
//! not list; a fly-away; a speed above the limit; motors that are stopped in the air; an end with success although
//! the vehicle is not where it believes it is.

mod acts;
mod capture;
mod disk;
mod faults;
mod judge;
mod kinds;
mod line;
mod part;
mod story;
mod summary;
mod vehicle;
pub mod world;

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};

use tilthex_core::random::Random;
use tilthex_link::{LinkKind, LinkedFlight, LinkedParams};

pub use faults::Injection;
pub use judge::Outcome;
pub use kinds::Kind;
pub use part::Part;
pub use summary::Summary;
pub use world::World;

use judge::Judge;
use story::Story;

use crate::{SimError, Simulation, SimulationParams};
use tilthex_config::{Config, TruthSection, VehicleSection};

/// Faults begin within this time from the start of the hover, s.
const WINDOW: f64 = 3.0;
/// Faults of flights from power-on begin within this time, s.
const WHOLE_WINDOW: f64 = 14.0;
/// A flight is ordered to land after this time on its mission, s.
const MISSION: f64 = 7.0;
/// The longest flight, s. After this time it counts as not ended.
const LONGEST: f64 = 45.0;
/// Ticks between the stop of the motors and the test whether the vehicle stands.
const SETTLING: usize = 1000;
/// Stack of a thread that flies, bytes. A world takes 150 kB and is moved by value.
const STACK: usize = 16 << 20;
/// One flight in this many is flown from power-on.
const WHOLE_EVERY: u64 = 4;

/// Flies one flight with its faults.
#[must_use]
pub fn fly(world: World, injections: Vec<Injection>, seed: u64) -> Outcome {
    fly_seen(world, injections, seed, &mut |_| ())
}

/// As [`fly`]; calls `see` with the world after every period.
fn fly_seen(mut world: World, injections: Vec<Injection>, seed: u64, see: &mut dyn FnMut(&World)) -> Outcome {
    world.inject(injections.clone(), seed);
    let mut judge = Judge::new(&world, injections);
    let begin = world.now();
    let mut on_mission_for = 0.0;
    while world.now() - begin < LONGEST && !world.linked.finished() {
        if world.tick(None) {
            judge.look(&world);
        }
        judge.watch(&world);
        see(&world);
        if world.linked.flight.on_mission() {
            on_mission_for += 0.002;
        }
        world.host.land |= on_mission_for > MISSION || world.now() - begin > LONGEST - 20.0;
        if judge.outcome.failure.is_some() || judge.done(&world) {
            break;
        }
    }
    judge.conclude(&world);
    // Legs that lose the last thrust give way a little.
    for _ in 0..SETTLING {
        world.tick(None);
        judge.watch(&world);
        see(&world);
    }
    judge.outcome.ended = !judge.flew || (world.linked.finished() && world.simulation.rests());
    judge.outcome.toppled = judge.outcome.ended && !world.simulation.stands();
    judge.outcome
}

/// A world at the moment at which its mission begins. All flights of a campaign share it.
///
/// # Errors
/// If a flight without faults does not reach its mission.
pub fn hover(config: &Config) -> Result<World, SimError> {
    rise(Fleet::new(config, &TruthSection::default())?.ground(1)?)
}

/// Flies until the mission begins.
fn rise(mut world: World) -> Result<World, SimError> {
    while !world.linked.flight.on_mission() {
        world.tick(None);
        if world.now() > 30.0 {
            let phase = world.linked.flight.supervisor().phase().name();
            return Err(SimError::flight(format!(
                "a flight without faults is still {phase} after 30 s; expected its mission by then"
            )));
        }
    }
    Ok(world)
}

/// The vehicles of a campaign: the model for all flights, or one that is drawn for each flight.
struct Fleet<'a> {
    params: LinkedParams,
    model: &'a VehicleSection,
    truth: &'a TruthSection,
}

impl Fleet<'_> {
    /// The vehicles of a configuration.
    fn new<'a>(config: &'a Config, truth: &'a TruthSection) -> Result<Fleet<'a>, SimError> {
        let params = config.linked_params(true).map_err(|e| SimError::refused(e.to_string()))?;
        if params.kind != LinkKind::Tk3 {
            let found = params.kind.name();
            return Err(SimError::refused(format!(
                "[link]: protocol is \"{found}\"; expected \"tk3\": the faults of a campaign are those of a board that speaks it"
            )));
        }
        Ok(Fleet { params, model: config.vehicle(), truth })
    }

    /// The vehicle of a seed, on the ground.
    fn ground(&self, seed: u64) -> Result<World, SimError> {
        let drawn = self.truth.draw(self.model, seed).map_err(|e| SimError::refused(e.to_string()))?;
        let linked = LinkedFlight::new(self.params, None).map_err(|e| SimError::refused(e.to_string()))?;
        Ok(World::new(Simulation::new(SimulationParams::of(&drawn)?), linked, seed))
    }

    /// The hover from which all flights begin, if they have the same vehicle.
    fn shared(&self) -> Result<Option<World>, SimError> {
        (*self.truth == TruthSection::default()).then(|| rise(self.ground(1)?)).transpose()
    }
}

/// Flies `count` flights with the seeds from `first` on, with faults of the given kinds, on all processors. If the
/// truth differs from the model, each flight has its own vehicle. After each flight, `told` gets the number of flights
/// that have ended.
///
/// # Errors
/// If the vehicle cannot reach its mission without faults.
pub fn run(
    config: &Config,
    truth: &TruthSection,
    kinds: &[Kind],
    count: u64,
    first: u64,
    told: &(dyn Fn(u64) + Sync),
) -> Result<Summary, SimError> {
    let fleet = Fleet::new(config, truth)?;
    fleet.ground(first)?;
    let hovering = fleet.shared()?;
    let (next, summary) = (AtomicU64::new(first), Mutex::new((0, Summary::default())));
    let worker = |hovering: Option<World>| {
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= first + count {
                return;
            }
            let outcome = one(&fleet, hovering.as_ref(), kinds, seed, &mut |_| ());
            let (ended, summary) = &mut *summary.lock().unwrap_or_else(PoisonError::into_inner);
            summary.add(seed, &outcome);
            *ended += 1;
            told(*ended);
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut threads_had = 0;
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let hovering = hovering.clone();
            let worker = &worker;
            // If a thread cannot be created, the other threads fly its flights.
            let spawned =
                std::thread::Builder::new().stack_size(STACK).spawn_scoped(scope, move || worker(hovering));
            threads_had += usize::from(spawned.is_ok());
        }
    });
    if threads_had == 0 {
        return Err(SimError::world(
            "no thread could be created for the flights; expected at least one: free some memory",
        ));
    }
    Ok(summary.into_inner().unwrap_or_else(PoisonError::into_inner).1)
}

/// Flies the flight of one seed again, and returns what happened in it.
///
/// # Errors
/// If the vehicle cannot reach its mission without faults.
pub fn again(
    config: &Config,
    truth: &TruthSection,
    kinds: &[Kind],
    seed: u64,
) -> Result<(Outcome, String), SimError> {
    let fleet = Fleet::new(config, truth)?;
    fleet.ground(seed)?;
    let mut story = Story::default();
    let outcome = one(&fleet, fleet.shared()?.as_ref(), kinds, seed, &mut |world| story.see(world));
    Ok((outcome, story.text()))
}

/// The flight of one seed.
fn one(
    fleet: &Fleet<'_>,
    hovering: Option<&World>,
    kinds: &[Kind],
    seed: u64,
    see: &mut dyn FnMut(&World),
) -> Outcome {
    let mut random = Random::new(seed);
    let rotors = fleet.params.flight.vehicle.rotor_count();
    let whole = seed.is_multiple_of(WHOLE_EVERY);
    let window = if whole { WHOLE_WINDOW } else { WINDOW };
    let count = 1 + (random.uniform() < 0.2) as usize;
    let injections: Vec<_> =
        (0..count).map(|_| Injection::random(&mut random, kinds, window, rotors)).collect();
    let whole = whole || injections.iter().any(|i| i.kind.is_built_in());
    let flown = catch_unwind(AssertUnwindSafe(|| -> Result<Outcome, SimError> {
        let world = match hovering {
            Some(shared) if !whole => shared.clone(),
            _ if whole => fleet.ground(seed)?,
            _ => rise(fleet.ground(seed)?)?,
        };
        Ok(fly_seen(world, injections.clone(), seed, see))
    }));
    let failed = |why: String| Outcome { failure: Some(why), ..Outcome::of(injections.clone()) };
    match flown {
        Ok(Ok(outcome)) => outcome,
        Ok(Err(refused)) => failed(format!("did not begin: {refused}")),
        Err(_) => failed("panicked".into()),
    }
}
