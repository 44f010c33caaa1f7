//! Many simulated flights, with one worker thread per processor.

use super::{Prepared, Record, Scenario, World, fly};
use crate::Body;
use std::{
    ops::ControlFlow,
    sync::{
        atomic::{AtomicUsize, Ordering},
        mpsc::{self, RecvTimeoutError},
    },
    thread,
    time::Duration,
};
use tilthex_config::ConfigError;
use tilthex_core::supervisor::Phase;

/// Longest time until the caller is asked again whether to continue.
const ASKED: Duration = Duration::from_millis(100);

/// The figures of a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// Root mean square and largest length of the position error of the pose controller, m.
    pub position_error: (f64, f64),
    /// Largest norm of the rotation error of the pose controller.
    pub rotation_error: f64,
    /// Largest distance of the true tool from its set-point, m.
    pub tool_deviation: f64,
    /// Largest true force on the tool, N.
    pub tool_force: f64,
    /// Largest true tilt of the robot, rad.
    pub tilt: f64,
    /// Part of the ticks in which a rotor was at a limit.
    pub saturated: f64,
    /// The phase at the end.
    pub phase: Phase,
}

/// What the ticks of a flight have added up to.
struct Sums {
    ticks: u32,
    saturated: u32,
    /// Sum of the squares of the position error.
    position_error: f64,
    /// Largest squares of the position error, the rotation error, the tool's distance from its set-point, and the force on it.
    largest: [f64; 4],
    /// Cosine of the largest tilt.
    upright: f64,
    phase: Phase,
}

impl Sums {
    fn new() -> Self {
        let phase = Phase::default();
        Self { ticks: 0, saturated: 0, position_error: 0.0, largest: [0.0; 4], upright: 1.0, phase }
    }

    fn add(&mut self, world: &World) {
        let (state, flown) = (world.body.state(), &world.commanded.record);
        let (tool_w, _) = world.tool_pose();
        let squares = [
            flown.position_error_w.norm_squared(),
            flown.rotation_error_r.norm_squared(),
            (tool_w - flown.setpoint.position_w).norm_squared(),
            world.body.tool_wrench_w().force.norm_squared(),
        ];
        self.largest.iter_mut().zip(squares).for_each(|(largest, square)| *largest = largest.max(square));
        self.position_error += squares[0];
        self.upright = self.upright.min(state.robot.rotation_wr[(2, 2)]);
        self.saturated += u32::from(flown.saturated);
        self.phase = flown.phase;
        self.ticks += 1;
    }

    fn summary(&self) -> Summary {
        let ticks = f64::from(self.ticks.max(1));
        let [position_error, rotation_error, tool_deviation, tool_force] = self.largest.map(f64::sqrt);
        Summary {
            position_error: ((self.position_error / ticks).sqrt(), position_error),
            rotation_error,
            tool_deviation,
            tool_force,
            tilt: self.upright.max(-1.0).acos(),
            saturated: f64::from(self.saturated) / ticks,
            phase: self.phase,
        }
    }
}

/// One of many flights.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Its figures.
    pub summary: Summary,
    /// The recorded quantities.
    pub record: Record,
}

/// Simulates all scenarios in `workers` threads, and records the quantities of `wanted`. Each flight equals that of
/// [`run`](super::run). `progress` gets the number of flights that have ended, at least ten times a second. If it
/// breaks, no further flight begins, and the result is `None`.
///
/// # Errors
/// The first scenario that is refused, and why.
pub fn run_many(
    scenarios: &[Scenario<'_>],
    wanted: &[String],
    workers: usize,
    mut progress: impl FnMut(usize) -> ControlFlow<()>,
) -> Result<Option<Vec<Outcome>>, (usize, ConfigError)> {
    let next = AtomicUsize::new(0);
    let mut outcomes: Vec<Option<Outcome>> = vec![None; scenarios.len()];
    let (mut ended, mut refused) = (0, None);
    let broken = thread::scope(|scope| {
        let (sender, receiver) = mpsc::channel();
        for _ in 0..workers.clamp(1, scenarios.len().max(1)) {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || {
                let mut prepared = Prepared::default();
                while let Some((number, scenario)) = take(next, scenarios) {
                    let mut sums = Sums::new();
                    let wanted = |name: &str| wanted.iter().any(|w| w == name);
                    let flown = fly(scenario, &mut prepared, wanted, |world| sums.add(world));
                    let outcome = flown.map(|record| Outcome { summary: sums.summary(), record });
                    if sender.send((number, outcome)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        loop {
            match receiver.recv_timeout(ASKED) {
                Ok((number, Ok(outcome))) => {
                    outcomes[number] = Some(outcome);
                    ended += 1;
                }
                Ok((number, Err(why))) => {
                    if refused.as_ref().is_none_or(|(first, _)| number < *first) {
                        refused = Some((number, why));
                    }
                    next.store(scenarios.len(), Ordering::Relaxed);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return false,
            }
            if progress(ended).is_break() {
                next.store(scenarios.len(), Ordering::Relaxed);
                return true;
            }
        }
    });
    match refused {
        Some(refused) => Err(refused),
        None if broken => Ok(None),
        None => Ok(outcomes.into_iter().collect()),
    }
}

/// The next scenario that no worker has taken.
fn take<'s, 'c>(next: &AtomicUsize, scenarios: &'s [Scenario<'c>]) -> Option<(usize, &'s Scenario<'c>)> {
    let number = next.fetch_add(1, Ordering::Relaxed);
    scenarios.get(number).map(|scenario| (number, scenario))
}
