//! Inertial samples of PX4: gives the messages times on the host's clock, and marks samples that are wrong.

use super::topics::SensorCombined;
use crate::{Gate, GateCounters, GateParams, LineDelay, Verdict};
use tilthex_core::{
    Error, Vector3,
    clock_sync::{ClockParams, ClockSync},
    flight::{Inertial, InertialTelemetry},
};

/// Larger readings are impossible: rad/s, m/s^2.
const MOST: (f64, f64) = (100.0, 400.0);
/// A reading leaps if it differs from the last one by more than this: rad/s, m/s^2.
const LEAP: (f64, f64) = (3.0, 40.0);

/// Converts a vector from PX4's body axes (forward, right, down) to those of tilthex (forward, left, up).
pub(super) fn flu(frd: [f32; 3]) -> Vector3 {
    let [x, y, z] = frd.map(f64::from);
    Vector3::new(x, -y, -z)
}

/// The stream.
#[derive(Clone, Debug)]
pub(super) struct InertialStream {
    period: f64,
    clock: ClockSync,
    line: LineDelay,
    gate: Gate<6>,
    last: Option<SensorCombined>,
    leapt: bool,
    shaken: bool,
    lost: u32,
}

impl InertialStream {
    /// The state before the first sample. `period_us` is the period of the stream, us.
    ///
    /// # Errors
    /// Never: the limits of its gate are constant.
    pub(super) fn new(period_us: u32) -> Result<Self, Error> {
        let (rate, force) = MOST;
        let max = [rate, rate, rate, force, force, force];
        // The CRC already finds flipped bits, so that jumps need no limit.
        let gate =
            GateParams { min: max.map(|x| -x), max, jump: [f64::INFINITY; 6], patience: 0, longest: 0 };
        Ok(Self {
            period: 1e-6 * f64::from(period_us),
            clock: ClockSync::new(ClockParams::default())?,
            line: LineDelay::default(),
            gate: Gate::new(gate)?,
            last: None,
            leapt: false,
            shaken: false,
            lost: 0,
        })
    }

    /// The host reads at `now`, s: once before the samples that it gets.
    pub(super) fn read(&mut self, now: f64) {
        self.line.read(now);
    }

    /// Takes a sample that arrived at `now`, s, and writes it and the stream's state to `out`.
    pub(super) fn take(&mut self, sample: &SensorCombined, now: f64, out: &mut InertialTelemetry) {
        let remote = |sample: &SensorCombined| 1e-6 * sample.timestamp as f64;
        let made = remote(sample);
        let passed = self.last.map(|last| made - remote(&last));
        // The same sample again, or an older one. If the time goes back by more than 1 s, the vehicle's clock was set.
        if passed.is_some_and(|passed| (-1.0..=0.0).contains(&passed)) {
            return;
        }
        let gaps = passed.map_or(0.0, |passed| passed / self.period - 0.5);
        self.lost = self.lost.saturating_add(gaps.clamp(0.0, 1000.0) as u32);
        let stamp = self.clock.step(made, now);
        out.line_delay = self.line.step(made, now);
        let time = stamp.time.min(now - out.line_delay);
        let alike =
            |last: SensorCombined| last.gyro == sample.gyro && last.accelerometer == sample.accelerometer;
        let last = self.last.replace(*sample);
        out.note_reading(last.is_some_and(alike));
        out.saturated = sample.clipped;
        if out.saturated {
            (self.shaken, self.leapt) = (true, false);
            return;
        }
        let (gyro_i, specific_force_i) = (flu(sample.gyro), flu(sample.accelerometer));
        let (w, f) = (&gyro_i, &specific_force_i);
        let verdict = self.gate.step(&[w.x, w.y, w.z, f.x, f.y, f.z], 0);
        let leaps = last.is_some_and(|last| {
            (gyro_i - flu(last.gyro)).amax() > LEAP.0
                || (specific_force_i - flu(last.accelerometer)).amax() > LEAP.1
        });
        self.shaken |= leaps && self.leapt;
        self.leapt = leaps;
        out.refused_now |= verdict != Verdict::Pass;
        if out.frozen || verdict != Verdict::Pass {
            return;
        }
        out.push(now, Inertial { time, gyro_i, specific_force_i, shaken: self.shaken });
        self.shaken = false;
    }

    /// Samples that never arrived.
    pub(super) fn lost(&self) -> u32 {
        self.lost
    }

    /// What its gate has accepted and refused.
    pub(super) fn gate_counters(&self) -> GateCounters {
        self.gate.counters()
    }
}
