//! Whether a tick should wait a moment for an inertial sample.

/// After this many ticks without a sample the stream counts as off.
const PATIENCE: u32 = 10;

/// The inertial sample of a tick, by a look at its bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InertialDue {
    /// The stream runs, so that each tick should have a sample.
    pub expected: bool,
    /// A sample is among the bytes of this tick.
    pub arrived: bool,
}

impl InertialDue {
    /// Whether a sample is due that has not arrived.
    #[must_use]
    pub fn is_awaited(&self) -> bool {
        self.expected && !self.arrived
    }
}

/// Follows whether an inertial stream runs, tick by tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Awaited {
    due: InertialDue,
    missed: u32,
}

impl Awaited {
    /// A whole sample has arrived.
    pub fn arrive(&mut self) {
        self.due.arrived = true;
    }

    /// What is due in this tick.
    #[must_use]
    pub fn due(&self) -> InertialDue {
        self.due
    }

    /// Ends a tick.
    pub fn end_tick(&mut self) {
        let arrived = core::mem::take(&mut self.due.arrived);
        self.missed = if arrived { 0 } else { self.missed.saturating_add(1) };
        self.due.expected = self.missed < PATIENCE && (arrived || self.due.expected);
    }
}
