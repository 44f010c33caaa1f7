//! The vehicle's inertial stream: gives the frames times on the host's clock, and marks samples that are wrong.

use super::{Identity, ImuFrame, ImuScales};
use crate::{Arrival, Gate, GateCounters, GateParams, LineDelay, LinkParams, SequenceClock, Verdict};
use tilthex_core::{
    Error,
    clock_sync::ClockParams,
    flight::{Inertial, InertialTelemetry},
};

/// Counts of at least this magnitude are at the end of the IMU's range.
const FULL_SCALE: u16 = 32_760;
/// Largest change of an inertial reading from one sample to the next: rad/s, m/s^2.
const IMU_JUMP: (f64, f64) = (3.0, 40.0);
/// Number of samples that must agree with a jump, or with another length, before it is accepted.
const PATIENCE: u8 = 4;
/// Largest number of inertial samples in a row that are refused for their jumps, because an impact shakes the IMU.
const MOST_REFUSED: u8 = 2;

/// The stream.
#[derive(Clone, Debug)]
pub(super) struct ImuStream {
    scales: Option<ImuScales>,
    clock: SequenceClock,
    line: LineDelay,
    gate: Gate<6>,
    odd_lengths: u8,
    last_frame: Option<ImuFrame>,
    leapt: bool,
    shaken: bool,
}

impl ImuStream {
    /// The state before the first frame.
    ///
    /// # Errors
    /// If [`SequenceClock::new`] refuses the period.
    pub(super) fn new(params: &LinkParams) -> Result<Self, Error> {
        let period = f64::from(params.imu_period_us) * 1e-6;
        let (rate, force) = IMU_JUMP;
        let (max, jump) =
            ([100.0, 100.0, 100.0, 400.0, 400.0, 400.0], [rate, rate, rate, force, force, force]);
        let gate = GateParams { min: max.map(|x| -x), max, jump, patience: PATIENCE, longest: MOST_REFUSED };
        Ok(Self {
            scales: params.scales,
            clock: SequenceClock::new(period, ClockParams::default())?,
            line: LineDelay::default(),
            gate: Gate::new(gate)?,
            odd_lengths: 0,
            last_frame: None,
            leapt: false,
            shaken: false,
        })
    }

    /// Uses the units of a board, if none are configured. Returns whether units are known.
    pub(super) fn know(&mut self, identity: &Identity) -> bool {
        self.scales = self.scales.or(ImuScales::known(identity));
        self.scales.is_some()
    }

    /// The host reads at `now`, s: once before the frames that it gets.
    pub(super) fn read(&mut self, now: f64) {
        self.line.read(now);
    }

    /// Takes a frame that arrived at `now`, s, and writes the sample and the stream's state to `out`.
    pub(super) fn take(&mut self, frame: &ImuFrame, now: f64, out: &mut InertialTelemetry) {
        let Some(scales) = self.scales else { return };
        if self.clock.is_new_count(now) {
            self.line.begin_anew(now);
        }
        let (time, lost) = match self.clock.step(frame.sequence, now) {
            Arrival::New { time, lost, .. } => {
                out.line_delay = self.clock.made().map_or(0.0, |made| self.line.step(made, now));
                // After a time the clock takes the delay of a late line for the usual one.
                (time.min(now - out.line_delay), lost)
            }
            Arrival::Duplicate => return,
            Arrival::Suspect => (now, 1),
        };
        // If two bytes are lost, a frame with a temperature looks like one without it.
        let other_length = |last: ImuFrame| last.temperature.is_some() != frame.temperature.is_some();
        if self.last_frame.is_some_and(other_length) && self.odd_lengths < PATIENCE {
            self.odd_lengths += 1;
            out.refused_now = true;
            return;
        }
        self.odd_lengths = 0;
        let alike = |last: ImuFrame| last.accelerometer == frame.accelerometer && last.gyro == frame.gyro;
        out.note_reading(self.last_frame.replace(*frame).is_some_and(alike));
        let full = |x: &i16| x.unsigned_abs() >= FULL_SCALE;
        out.saturated = frame.accelerometer.iter().chain(&frame.gyro).any(full);
        if out.saturated {
            // The gate must not accept it: a flipped bit would bring the next sample back into the range.
            (self.shaken, self.leapt) = (true, false);
            self.gate.interrupt();
            return;
        }
        let (f, w) = scales.decode(frame);
        let verdict = self.gate.step(&[w.x, w.y, w.z, f.x, f.y, f.z], lost);
        // Two jumps in a row are not caused by a flipped bit.
        let leaps = verdict == Verdict::Jump;
        self.shaken |= leaps && self.leapt;
        self.leapt = leaps;
        out.refused_now |= verdict != Verdict::Pass;
        if out.frozen || verdict != Verdict::Pass {
            return;
        }
        out.push(now, Inertial { time, gyro_i: w, specific_force_i: f, shaken: self.shaken });
        self.shaken = false;
    }

    /// Samples that never arrived.
    #[must_use]
    pub(super) fn lost(&self) -> u32 {
        self.clock.counters().lost
    }

    /// What its gate has accepted and refused.
    #[must_use]
    pub(super) fn gate_counters(&self) -> GateCounters {
        self.gate.counters()
    }
}
