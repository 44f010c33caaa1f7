//! Statistics of a flight. The recorder collects them in constant memory.

use tilthex_core::{
    Vector3,
    allocation::Priority,
    supervisor::{FaultSet, Phase},
};

use tilthex_sim::{Truth, feed::Tick};

use crate::histogram::{Histogram, Quantiles};

/// Time over which the deflection of a steady push is averaged: its last part, s.
const SETTLED: f64 = 1.0;
/// A push counts as steady after this time, s.
const STEADY: f64 = 5.0;

/// Mean square and peak of a deviation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    sum: f64,
    count: u64,
    /// Largest.
    pub max: f64,
}

impl Deviation {
    fn add(&mut self, value: f64) {
        self.sum += value * value;
        self.count += 1;
        self.max = self.max.max(value);
    }

    /// Root mean square; zero without samples.
    #[must_use]
    pub fn rms(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.sum / self.count as f64).sqrt() }
    }
}

/// The displacement of the tool by a steady push.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deflection {
    /// The true push, N, world.
    pub force_w: Vector3,
    /// True tool position minus set-point, m: mean over the last second of the push.
    pub tool_w: Vector3,
}

/// The push that acts now.
#[derive(Clone, Copy, Debug)]
struct Steady {
    force_w: Vector3,
    since: f64,
    /// Mean deflection over the last [`SETTLED`] seconds, as an exponential window.
    mean_w: Vector3,
    updated: f64,
}

/// Statistics of a flight.
#[derive(Clone, Debug, Default)]
pub struct Statistics {
    /// Number of ticks.
    pub ticks: u64,
    /// Number of periods that were skipped.
    pub skipped: u64,
    /// Number of ticks with an inertial sample.
    pub with_imu: u64,
    /// From the deadline to the start of the tick.
    pub wake: Histogram,
    /// From the start of the tick to the end of its write.
    pub compute: Histogram,
    /// From the start of a tick to the start of the next one.
    pub period: Histogram,
    /// From the moment at which the inertial sample's bytes were found to the end of the command's write.
    pub imu_to_command: Histogram,
    /// Position error of the robot while it flies, m.
    pub tracking: Deviation,
    /// Estimated minus true tool force while contact moves the reference, N.
    pub force: Deviation,
    /// The last steady push.
    pub deflection: Option<Deflection>,
    /// Estimated latency of poses in flight, s.
    pub latency: Deviation,
    /// Time for which each part of the wanted wrench was the most important part that was given up, while the vehicle flew
    /// or held, s.
    pub given_up: Vec<(Priority, f64)>,
    /// Faults that occurred in flight.
    pub faults: FaultSet,
    /// Whether the vehicle has flown.
    pub flew: bool,
    /// The last text from the vehicle.
    pub last_text: Option<String>,
    truth: Option<Truth>,
    steady: Option<Steady>,
    landing_for: FaultSet,
}

impl Statistics {
    /// Adds a tick.
    pub fn tick(&mut self, tick: &Tick) {
        let (record, timing) = (&tick.record, &tick.timing);
        self.ticks += 1;
        self.skipped += timing.skipped;
        self.with_imu += u64::from(record.imu_samples > 0);
        self.wake.record(timing.wake_latency);
        self.compute.record(timing.compute);
        self.period.record(timing.period);
        if timing.imu_to_command > 0 {
            self.imu_to_command.record(timing.imu_to_command);
        }
        if let Some((_, text)) = tick.wire.text {
            self.last_text = Some(text.to_string());
        }
        self.flew |= record.phase.in_flight();
        if record.phase.in_flight() {
            self.faults.0 |= record.faults.0;
            self.latency.add(record.latency);
        }
        if matches!(record.phase, Phase::Flying | Phase::Holding) {
            self.give_up(record.given_up, record.dt);
        }
        let lands = matches!(record.phase, Phase::Landing | Phase::Emergency);
        if lands && self.landing_for.is_empty() {
            self.landing_for = record.faults;
        }
        if record.phase != Phase::Flying {
            return;
        }
        self.tracking.add(record.position_error_w.norm());
        let Some(truth) = self.truth.filter(|_| record.compliant) else { return };
        self.force.add((record.wrench_tool_w.force - truth.tool_wrench_w.force).norm());
        self.push(record.input.time, &truth, &(truth.tool_position_w - record.setpoint.position_w));
    }

    fn give_up(&mut self, part: Option<Priority>, seconds: f64) {
        let Some(part) = part else { return };
        match self.given_up.iter_mut().find(|(known, _)| *known == part) {
            Some((_, sum)) => *sum += seconds,
            None => self.given_up.push((part, seconds)),
        }
    }

    fn push(&mut self, now: f64, truth: &Truth, deflection_w: &Vector3) {
        let force_w = truth.tool_wrench_w.force;
        if force_w.norm() == 0.0 {
            self.steady = None;
            return;
        }
        let steady = match &mut self.steady {
            Some(steady) if steady.force_w == force_w => steady,
            other => other.insert(Steady { force_w, since: now, mean_w: *deflection_w, updated: now }),
        };
        let part = ((now - steady.updated) / (0.5 * SETTLED)).clamp(0.0, 1.0);
        steady.mean_w += (deflection_w - steady.mean_w) * part;
        steady.updated = now;
        if now - steady.since >= STEADY {
            self.deflection = Some(Deflection { force_w, tool_w: steady.mean_w });
        }
    }

    /// Keeps the true state of the simulated vehicle.
    pub fn truth(&mut self, truth: &Truth) {
        self.truth = Some(*truth);
    }

    /// Whether a fault ended the flight, not its operator.
    #[must_use]
    pub fn ended_by_fault(&self) -> bool {
        use tilthex_core::supervisor::{Fault, Reaction};
        self.landing_for.rows().any(|row| row.fault != Fault::Operator && row.in_flight >= Reaction::Land)
    }

    /// The quantiles of the four times, with their names.
    #[must_use]
    pub fn times(&self) -> [(&'static str, Quantiles); 4] {
        [
            ("wake-up after the deadline", self.wake.quantiles()),
            ("tick, to the end of its write", self.compute.quantiles()),
            ("between ticks", self.period.quantiles()),
            ("IMU bytes found to command out", self.imu_to_command.quantiles()),
        ]
    }
}
