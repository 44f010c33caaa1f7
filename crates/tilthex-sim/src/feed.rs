//! What a tick of the loop leaves for the log, and the wait-free ring that takes it there.

use std::sync::{
    Arc,
    atomic::{AtomicBool, AtomicU64, Ordering},
};

use rtrb::{Consumer, Producer, RingBuffer};
use tilthex_core::flight::Record;
use tilthex_link::{LinkedOutput, Wire};

/// Ticks the ring holds: what a slow disk may cost before the first is lost.
const RING: usize = 512;

/// How punctual a tick was, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timing {
    /// Begin after the deadline.
    pub wake_latency: u64,
    /// Begin to the end of the write.
    pub compute: u64,
    /// Since the last begin.
    pub period: u64,
    /// Whole periods skipped before this tick.
    pub skipped: u64,
    /// The IMU's bytes found to the command written; 0 where none came.
    pub imu_to_command: u64,
    /// Looks at the port before the IMU's bytes were there.
    pub polls: u32,
    /// Writes that the line did not take whole, total.
    pub short_writes: u64,
}

/// What the loop hands to the recorder.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tick {
    /// What the flight took in and did.
    pub record: Record,
    /// The bytes of its link.
    pub wire: Wire,
    /// How punctual it was.
    pub timing: Timing,
}

impl Tick {
    /// The tick that gave `out`.
    #[must_use]
    pub fn new(out: &LinkedOutput, timing: Timing) -> Self {
        Self { record: out.commanded.record, wire: out.wire, timing }
    }
}

/// What became of the ticks, for whoever asks.
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
}

impl Feed {
    /// A ring by itself, and its far end.
    #[must_use]
    pub fn ring() -> (Self, Consumer<Tick>) {
        Self::of(Arc::default())
    }

    /// The same, whose losses are counted in `fate`.
    #[must_use]
    pub fn of(fate: Arc<Fate>) -> (Self, Consumer<Tick>) {
        let (ring, ticks) = RingBuffer::new(RING);
        (Self { ring, fate }, ticks)
    }

    /// Ticks that did not fit so far.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.fate.dropped.load(Ordering::Relaxed)
    }

    /// Hands a tick over, or counts it as dropped where the ring is full.
    /// Wait-free; safe in the loop.
    pub fn push(&mut self, tick: &Tick) {
        match self.ring.write_chunk_uninit(1) {
            Ok(chunk) => {
                chunk.fill_from_iter(std::iter::once(*tick));
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
