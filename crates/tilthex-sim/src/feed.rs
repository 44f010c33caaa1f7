//! What each tick of the loop gives to the log, and the wait-free ring that carries it to the recorder.

use std::sync::{
    Arc,
    atomic::{AtomicBool, AtomicU64, Ordering},
};

use rtrb::{Consumer, Producer, RingBuffer};
use tilthex_core::flight::Record;
use tilthex_link::{Complaint, LinkedOutput, Wire};

/// How many ticks the ring holds. If the disk stands still for longer than this, ticks are dropped.
const RING: usize = 512;

/// Timing of a tick. Times in ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timing {
    /// From the deadline to the start of the tick.
    pub wake_latency: u64,
    /// From the start of the tick to the end of the write.
    pub compute: u64,
    /// From the start of the last tick to the start of this one.
    pub period: u64,
    /// Whole periods skipped since the last tick that the recorder got.
    pub skipped: u64,
    /// From the moment at which the IMU's bytes were found to the end of the command's write; 0 if no bytes came.
    pub imu_to_command: u64,
    /// How often the loop looked at the port before the IMU's bytes were there.
    pub polls: u32,
    /// Writes of which the line took only a part, since the start of the flight.
    pub short_writes: u64,
}

/// What the loop hands to the recorder.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tick {
    /// The inputs and outputs of the flight.
    pub record: Record,
    /// The bytes of its link.
    pub wire: Wire,
    /// The timing of the tick.
    pub timing: Timing,
    /// Why the link is not ready, where it knows; for a person, not for the log.
    pub complaint: Option<Complaint>,
}

impl Tick {
    /// The tick that gave `out`.
    #[must_use]
    pub fn new(out: &LinkedOutput, timing: Timing) -> Self {
        Self { record: out.commanded.record, wire: out.wire, timing, complaint: None }
    }
}

/// How many ticks were lost, for the loop and the recorder.
#[derive(Debug, Default)]
pub struct Fate {
    /// Ticks that found the ring full.
    pub dropped: AtomicU64,
    /// Whether the log can no longer be written.
    pub lost: AtomicBool,
}

/// The loop's end of the ring.
#[derive(Debug)]
pub struct Feed {
    ring: Producer<Tick>,
    fate: Arc<Fate>,
    /// Periods that were skipped before ticks that found the ring full.
    skipped: u64,
}

impl Feed {
    /// A ring with its own counters, and the recorder's end of it.
    #[must_use]
    pub fn ring() -> (Self, Consumer<Tick>) {
        Self::of(Arc::default())
    }

    /// A ring whose losses are counted in `fate`, and the recorder's end of it.
    #[must_use]
    pub fn of(fate: Arc<Fate>) -> (Self, Consumer<Tick>) {
        let (ring, ticks) = RingBuffer::new(RING);
        (Self { ring, fate, skipped: 0 }, ticks)
    }

    /// How many ticks did not fit into the ring.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.fate.dropped.load(Ordering::Relaxed)
    }

    /// Puts a tick into the ring. If the ring is full, counts the tick as dropped, and adds the periods that were skipped
    /// before it to those of the next tick. Wait-free; safe in the loop.
    pub fn push(&mut self, tick: &Tick) {
        self.skipped += tick.timing.skipped;
        match self.ring.write_chunk_uninit(1) {
            Ok(chunk) => {
                let timing = Timing { skipped: std::mem::take(&mut self.skipped), ..tick.timing };
                chunk.fill_from_iter(std::iter::once(Tick { timing, ..*tick }));
            }
            Err(_) => {
                self.fate.dropped.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    /// Whether the log can no longer be written. Safe in the loop.
    #[must_use]
    pub fn log_lost(&self) -> bool {
        self.fate.lost.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_periods_before_a_dropped_tick_are_counted_with_the_next_one() {
        let (mut feed, mut ticks) = Feed::ring();
        let tick = |skipped| Tick { timing: Timing { skipped, ..Timing::default() }, ..Tick::default() };
        (0..RING + 3).for_each(|_| feed.push(&tick(2)));
        assert_eq!(feed.dropped(), 3);
        let before: u64 = std::iter::from_fn(|| ticks.pop().ok()).map(|tick| tick.timing.skipped).sum();
        assert_eq!(before, 2 * RING as u64);
        feed.push(&tick(1));
        feed.push(&tick(0));
        let after: Vec<_> = std::iter::from_fn(|| ticks.pop().ok()).map(|tick| tick.timing.skipped).collect();
        assert_eq!(after, [7, 0]);
    }
}
