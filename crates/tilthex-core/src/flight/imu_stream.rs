//! The vehicle's inertial stream: from frames to samples with times, and what is wrong with it.

use super::session::SessionParams;
use crate::{
    Error,
    clock_sync::ClockParams,
    link::{
        Arrival, Gate, GateCounters, GateParams, SequenceClock, Verdict,
        tk3::{Identity, ImuFrame, ImuScales},
    },
    types::Vector3,
};

/// Most inertial samples of one tick that are kept.
const MAX_SAMPLES: usize = 8;
/// So many readings in a row alike to the bit are no measurement.
const FROZEN: u32 = 25;
/// Counts from here on are the end of the IMU's range.
const FULL_SCALE: u16 = 32_760;
/// Largest change of an inertial reading from one sample to the next: rad/s, m/s^2.
const IMU_JUMP: (f64, f64) = (3.0, 40.0);
/// A jump, or another length, is believed after so many samples that agree with it.
const PATIENCE: u8 = 4;
/// No more inertial samples than these are refused in a row for their jumps: an impact shakes.
const MOST_REFUSED: u8 = 2;

/// An inertial sample in IMU coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertial {
    /// When it was taken, s, on the host's clock.
    pub time: f64,
    /// Angular velocity, rad/s.
    pub gyro_i: Vector3,
    /// Specific force, m/s^2.
    pub specific_force_i: Vector3,
    /// Whether readings before it went off the range, or leapt about.
    pub shaken: bool,
}

/// The stream.
#[derive(Clone, Debug)]
pub(super) struct ImuStream {
    scales: Option<ImuScales>,
    samples: [Inertial; MAX_SAMPLES],
    sample_count: usize,
    clock: SequenceClock,
    gate: Gate<6>,
    refused_now: bool,
    odd_lengths: u8,
    last_frame: Option<ImuFrame>,
    same_frames: u32,
    saturated: bool,
    leapt: bool,
    shaken: bool,
    heard: f64,
}

impl ImuStream {
    /// Before the first frame.
    ///
    /// # Errors
    /// A period that can not be.
    pub(super) fn new(params: &SessionParams) -> Result<Self, Error> {
        let period = f64::from(params.imu_period_us) * 1e-6;
        let (rate, force) = IMU_JUMP;
        let (max, jump) =
            ([100.0, 100.0, 100.0, 400.0, 400.0, 400.0], [rate, rate, rate, force, force, force]);
        let gate = GateParams { min: max.map(|x| -x), max, jump, patience: PATIENCE, longest: MOST_REFUSED };
        let zero = Vector3::zeros();
        Ok(Self {
            scales: params.scales,
            samples: [Inertial { time: 0.0, gyro_i: zero, specific_force_i: zero, shaken: false };
                MAX_SAMPLES],
            sample_count: 0,
            clock: SequenceClock::new(period, ClockParams::default())?,
            gate: Gate::new(gate)?,
            refused_now: false,
            odd_lengths: 0,
            last_frame: None,
            same_frames: 0,
            saturated: false,
            leapt: false,
            shaken: false,
            heard: -1e9,
        })
    }

    /// Forgets the last tick's samples.
    pub(super) fn begin_tick(&mut self) {
        self.sample_count = 0;
        self.refused_now = false;
    }

    /// Takes the units of a board, where none are configured. Whether there are any.
    pub(super) fn know(&mut self, identity: &Identity) -> bool {
        self.scales = self.scales.or(ImuScales::known(identity));
        self.scales.is_some()
    }

    /// Takes a frame that came at `now`.
    pub(super) fn take(&mut self, frame: &ImuFrame, now: f64) {
        let Some(scales) = self.scales else { return };
        let (time, lost) = match self.clock.step(frame.sequence, now) {
            Arrival::New { time, lost, .. } => (time, lost),
            Arrival::Duplicate => return,
            Arrival::Suspect => (now, 1),
        };
        // Two lost bytes make a frame with a temperature look like one without.
        let other_length = |last: ImuFrame| last.temperature.is_some() != frame.temperature.is_some();
        if self.last_frame.is_some_and(other_length) && self.odd_lengths < PATIENCE {
            self.odd_lengths += 1;
            self.refused_now = true;
            return;
        }
        self.odd_lengths = 0;
        let alike = |last: ImuFrame| last.accelerometer == frame.accelerometer && last.gyro == frame.gyro;
        let same = self.last_frame.replace(*frame).is_some_and(alike);
        self.same_frames = if same { self.same_frames.saturating_add(1) } else { 0 };
        let full = |x: &i16| x.unsigned_abs() >= FULL_SCALE;
        self.saturated = frame.accelerometer.iter().chain(&frame.gyro).any(full);
        if self.saturated {
            // The gate must not come to believe it: a flipped bit brings it back into the range.
            (self.shaken, self.leapt) = (true, false);
            self.gate.interrupt();
            return;
        }
        let (f, w) = scales.decode(frame);
        let verdict = self.gate.step(&[w.x, w.y, w.z, f.x, f.y, f.z], lost);
        // Twice in a row is no flipped bit.
        let leaps = verdict == Verdict::Jump;
        self.shaken |= leaps && self.leapt;
        self.leapt = leaps;
        self.refused_now |= verdict != Verdict::Pass;
        if self.frozen() || verdict != Verdict::Pass {
            return;
        }
        self.heard = now;
        if let Some(slot) = self.samples.get_mut(self.sample_count) {
            *slot = Inertial { time, gyro_i: w, specific_force_i: f, shaken: self.shaken };
            self.sample_count += 1;
        }
        self.shaken = false;
    }

    /// Samples of this tick, oldest first.
    #[must_use]
    pub(super) fn samples(&self) -> &[Inertial] {
        self.samples.get(..self.sample_count).unwrap_or(&[])
    }

    /// Age of the newest usable sample, s.
    #[must_use]
    pub(super) fn age(&self, now: f64) -> f64 {
        now - self.heard
    }

    /// Whether the IMU repeats itself to the bit.
    #[must_use]
    pub(super) fn frozen(&self) -> bool {
        self.same_frames >= FROZEN
    }

    /// Whether the newest sample is at the end of its range.
    #[must_use]
    pub(super) fn saturated(&self) -> bool {
        self.saturated
    }

    /// Whether a sample was refused in this tick.
    #[must_use]
    pub(super) fn refused_now(&self) -> bool {
        self.refused_now
    }

    /// Samples that never came.
    #[must_use]
    pub(super) fn lost(&self) -> u32 {
        self.clock.counters().lost
    }

    /// What its gate has passed and refused.
    #[must_use]
    pub(super) fn gate_counters(&self) -> GateCounters {
        self.gate.counters()
    }
}
