//! Counters of a client. Every thread can read them at any time.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// Counters of a client, and the latency of its poses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    /// Number of poses that were put into the ring.
    pub poses: u32,
    /// Number of frames in which the body was not tracked.
    pub untracked: u32,
    /// Number of frames that never arrived, computed from their numbers.
    pub lost: u32,
    /// Number of packets and messages that are malformed, and of poses that are not valid.
    pub refused: u32,
    /// Number of poses that were lost because the ring was full.
    pub dropped: u32,
    /// Number of times that the clock of the capture system was set to another time.
    pub clock_resets: u32,
    /// Number of times that the server was silent and the client asked it again.
    pub silences: u32,
    /// Age of the poses when they arrive, s, smoothed over about 100 of them; 0 before the first.
    pub latency: f64,
}

/// The shared side of [`Status`].
#[derive(Debug, Default)]
pub(super) struct Counters {
    pub(super) poses: AtomicU32,
    pub(super) untracked: AtomicU32,
    pub(super) lost: AtomicU32,
    pub(super) refused: AtomicU32,
    pub(super) dropped: AtomicU32,
    pub(super) clock_resets: AtomicU32,
    pub(super) silences: AtomicU32,
    /// Bits of an `f64`.
    latency: AtomicU64,
}

/// Adds to a counter.
pub(super) fn add(counter: &AtomicU32, more: u32) {
    counter.fetch_add(more, Relaxed);
}

impl Counters {
    pub(super) fn status(&self) -> Status {
        Status {
            poses: self.poses.load(Relaxed),
            untracked: self.untracked.load(Relaxed),
            lost: self.lost.load(Relaxed),
            refused: self.refused.load(Relaxed),
            dropped: self.dropped.load(Relaxed),
            clock_resets: self.clock_resets.load(Relaxed),
            silences: self.silences.load(Relaxed),
            latency: f64::from_bits(self.latency.load(Relaxed)),
        }
    }

    /// Adds the age of one pose, s, to the smoothed latency. Only the client's thread writes it.
    pub(super) fn age(&self, age: f64) {
        let mean = f64::from_bits(self.latency.load(Relaxed));
        let mean = if mean == 0.0 { age } else { mean + 0.01 * (age - mean) };
        self.latency.store(mean.to_bits(), Relaxed);
    }
}
