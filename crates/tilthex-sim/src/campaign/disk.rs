//! The log of a campaign's flight: the loop's own ring, and a disk that may stand still.

use rtrb::Consumer;
use tilthex_link::LinkedOutput;

use crate::feed::{Feed, Tick, Timing};

/// A ring that is emptied every tick, as long as the disk takes it.
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

/// What flights share is cloned; each has a log of its own.
impl Clone for Disk {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Disk {
    /// Records a tick, and writes what waits unless the disk stands still.
    pub(super) fn record(&mut self, out: &LinkedOutput, stands_still: bool) {
        self.feed.push(&Tick::new(out, Timing::default()));
        self.pushed += 1;
        while !stands_still && self.ticks.pop().is_ok() {
            self.written += 1;
        }
    }

    /// Whether every tick is written, waits to be, or was counted as dropped.
    pub(super) fn accounts_for_all(&self) -> bool {
        self.written + self.ticks.slots() as u64 + self.feed.dropped() == self.pushed
    }

    /// Ticks that were dropped.
    pub(super) fn dropped(&self) -> u64 {
        self.feed.dropped()
    }
}
