//! The rates of streams, measured before the motors start.

/// Time over which a rate is measured, s.
const WINDOW: f64 = 1.0;

/// The rate of one stream.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rate {
    expected: f64,
    since: Option<f64>,
    count: u32,
    found: Option<f64>,
}

impl Rate {
    /// The lowest accepted rate, as a part of the expected rate.
    const ENOUGH: f64 = 0.9;

    /// A stream with an expected period, us.
    pub(super) fn new(period_us: u32) -> Self {
        Self { expected: 1e6 / f64::from(period_us.max(1)), since: None, count: 0, found: None }
    }

    /// Counts a message.
    pub(super) fn count(&mut self) {
        self.count = self.count.saturating_add(1);
    }

    /// Measures the rate at the end of each [`WINDOW`]. Called at every tick.
    pub(super) fn step(&mut self, now: f64) {
        let since = *self.since.get_or_insert(now);
        if now - since >= WINDOW {
            self.found = Some(f64::from(self.count) / (now - since));
            (self.since, self.count) = (Some(now), 0);
        }
    }

    /// Begins the measurement again.
    pub(super) fn forget(&mut self) {
        (self.since, self.count, self.found) = (None, 0, None);
    }

    /// The rate in the last complete [`WINDOW`], Hz, and the expected rate, Hz.
    pub(super) fn found(&self) -> Option<(f64, f64)> {
        self.found.map(|found| (found, self.expected))
    }

    /// Whether the rate is known and too low.
    pub(super) fn is_slow(&self) -> bool {
        self.found.is_some_and(|found| found < Self::ENOUGH * self.expected)
    }

    /// Whether the rate is known and high enough.
    pub(super) fn is_enough(&self) -> bool {
        self.found.is_some() && !self.is_slow()
    }
}
