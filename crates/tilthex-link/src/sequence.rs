//! Times from sequence numbers. Frames carry no time, but they are numbered (u8, wrapping) and have a fixed period.

use crate::bump;
use tilthex_core::{
    clock_sync::{ClockEvent, ClockParams, ClockSync, Stamp},
    error::{Error, check_range},
};

/// The result for a numbered sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Arrival {
    /// A new sample.
    New {
        /// Time at which it was made, s, host's clock: not before the last sample, and not after its arrival.
        time: f64,
        /// Samples lost since the one before.
        lost: u32,
        /// The effect on the clock of the stream.
        event: ClockEvent,
    },
    /// The number of the last sample again; the sample is dropped.
    Duplicate,
    /// A number that fits neither the clock nor the numbers before and after it: probably a flipped bit. The sample may
    /// be good, but its time is not known.
    Suspect,
}

/// Counts of one stream; they saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SequenceCounters {
    /// New samples.
    pub new: u32,
    /// Samples that never arrived.
    pub lost: u32,
    /// Samples that came again.
    pub duplicates: u32,
    /// Samples with a suspect number.
    pub suspect: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Last {
    number: u8,
    count: u64,
    arrival: f64,
    time: f64,
    /// A suspect number. It is accepted if the next number follows it.
    candidate: Option<u8>,
}

/// The clock of one numbered stream.
///
/// ```
/// use tilthex_core::clock_sync::ClockParams;
/// use tilthex_link::{Arrival, SequenceClock};
///
/// let mut clock = SequenceClock::new(0.002, ClockParams::default())?;
/// clock.step(7, 10.0);
/// // Number 8 is lost; number 9 arrives two periods after number 7.
/// let Arrival::New { time, lost, .. } = clock.step(9, 10.004) else { panic!("a new sample") };
/// assert!(lost == 1 && (time - 10.004).abs() < 1e-9);
/// assert_eq!(clock.step(9, 10.0041), Arrival::Duplicate);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequenceClock {
    period: f64,
    clock: ClockSync,
    last: Option<Last>,
    counters: SequenceCounters,
}

impl SequenceClock {
    /// Number of periods of silence after which the numbers have no meaning, and the clock starts again.
    const SILENCE: f64 = 128.0;

    /// A stream with a period in s that has received no sample. Stamps may differ by four periods, or by the
    /// parameters' jump if that is larger.
    ///
    /// # Errors
    /// If the period is not within 10 us to 2.5 s, or [`ClockSync::new`] refuses the parameters.
    pub fn new(period: f64, params: ClockParams) -> Result<Self, Error> {
        check_range("stream period (s)", period, 1e-5, 2.5)?;
        let jump = params.jump.max(4.0 * period);
        let clock = ClockSync::new(ClockParams { jump, ..params })?;
        Ok(Self { period, clock, last: None, counters: SequenceCounters::default() })
    }

    /// Takes the number of a sample, and its arrival, s on the host's clock.
    pub fn step(&mut self, number: u8, arrival: f64) -> Arrival {
        let Some(last) = self.last else {
            let stamp = self.clock.step(0.0, arrival);
            return self.accept(number, 0, 0, arrival, stamp);
        };
        let advance = number.wrapping_sub(last.number);
        if self.is_new_count(arrival) {
            let count = last.count.saturating_add(u64::from(advance));
            let stamp = self.clock.restart(self.remote(count), arrival);
            return self.accept(number, count, 0, arrival, stamp);
        }
        if advance == 0 {
            bump(&mut self.counters.duplicates);
            return Arrival::Duplicate;
        }
        let samples = last.count.saturating_add(u64::from(advance));
        let follows = |before: u8| number == before.wrapping_add(1);
        if advance == 1 || self.in_time(samples, arrival) || last.candidate.is_some_and(follows) {
            let stamp = self.clock.step(self.remote(samples), arrival);
            self.accept(number, samples, u32::from(advance) - 1, arrival, stamp)
        } else {
            self.last = Some(Last { candidate: Some(number), ..last });
            bump(&mut self.counters.suspect);
            Arrival::Suspect
        }
    }

    /// Whether a sample that arrives at a time, s on the host's clock, ends a silence after which its number has no meaning.
    #[must_use]
    pub fn is_new_count(&self, arrival: f64) -> bool {
        self.last.is_some_and(|last| arrival - last.arrival > Self::SILENCE * self.period)
    }

    /// The time of the newest sample from its number, s from the first one.
    #[must_use]
    pub fn made(&self) -> Option<f64> {
        self.last.map(|last| self.remote(last.count))
    }

    /// Counts so far.
    #[must_use]
    pub fn counters(&self) -> SequenceCounters {
        self.counters
    }

    /// How often the clock of the stream has started again.
    #[must_use]
    pub fn resets(&self) -> u32 {
        self.clock.resets()
    }

    fn remote(&self, count: u64) -> f64 {
        count as f64 * self.period
    }

    /// Whether a sample can have been made by now, to within one period.
    fn in_time(&self, count: u64, arrival: f64) -> bool {
        let remote = self.remote(count);
        self.clock.offset(remote).is_some_and(|offset| remote + offset <= arrival + self.period)
    }

    fn accept(&mut self, number: u8, samples: u64, lost: u32, arrival: f64, stamp: Stamp) -> Arrival {
        let time = self.last.map_or(stamp.time, |last| stamp.time.max(last.time).min(arrival));
        self.last = Some(Last { number, count: samples, arrival, time, candidate: None });
        bump(&mut self.counters.new);
        self.counters.lost = self.counters.lost.saturating_add(lost);
        Arrival::New { time, lost, event: stamp.event }
    }
}
