//! The log of a campaign's flight: the ring of the real loop, and a disk that can stand still.

use rtrb::Consumer;
use tilthex_link::LinkedOutput;

use crate::feed::{Feed, Tick, Timing};

/// A ring that is emptied in every tick while the disk does not stand still.
#[derive(Debug)]
pub(super) struct Disk {
    feed: Feed,
    ticks: Consumer<Tick>,
    pushed: u64,
    written: u64,
}

impl Default for Disk {
    fn default() -> Self {
        let (feed, ticks) = Feed::ring();
        Self { feed, ticks, pushed: 0, written: 0 }
    }
}

/// A clone gets its own empty log: flights that start from a shared world do not share a log.
impl Clone for Disk {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Disk {
    /// Records a tick, and empties the ring unless the disk stands still.
    pub(super) fn record(&mut self, out: &LinkedOutput, stands_still: bool) {
        self.feed.push(&Tick::new(out, Timing::default()));
        self.pushed += 1;
        while !stands_still && self.ticks.pop().is_ok() {
            self.written += 1;
        }
    }

    /// Whether every tick is written, waits in the ring, or was counted as dropped.
    pub(super) fn accounts_for_all(&self) -> bool {
        self.written + self.ticks.slots() as u64 + self.feed.dropped() == self.pushed
    }

    /// How many ticks were dropped.
    pub(super) fn dropped(&self) -> u64 {
        self.feed.dropped()
    }
}
