//! The clock of the other end: microseconds in 32 bits, which wrap after 71 minutes.

use tilthex_core::{
    Error,
    clock_sync::{ClockParams, ClockSync},
};

/// The clock of the other end of the line on ours, from the times in its messages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemoteClock {
    sync: ClockSync,
    /// The newest time, us, and the time since the first one, s.
    last: Option<(u32, f64)>,
}

impl RemoteClock {
    /// A clock that has sent no time.
    ///
    /// # Errors
    /// None with the parameters that it uses.
    pub fn new() -> Result<Self, Error> {
        Ok(Self { sync: ClockSync::new(ClockParams::default())?, last: None })
    }

    /// The time, s on our clock, at which a message was sent that arrives at `arrival`. What remains in it is the smallest
    /// delay of the line.
    pub fn sent(&mut self, micros: u32, arrival: f64) -> f64 {
        let remote = self.last.map_or(0.0, |(last, remote)| {
            // A time that is a little older than the last one is no wrap.
            remote + 1e-6 * f64::from(micros.wrapping_sub(last) as i32)
        });
        self.last = Some((micros, remote));
        self.sync.step(remote, arrival).time
    }
}

/// A time of our clock, s, as a message carries it.
#[must_use]
pub(super) fn micros(time: f64) -> u32 {
    // The cast to 64 bits saturates; the one to 32 bits wraps.
    (time * 1e6) as u64 as u32
}
