//! Whether a tick should wait for an inertial sample.

/// After this many ticks without a sample the stream counts as switched off.
const PATIENCE: u32 = 10;

/// Whether this tick expects an inertial sample, and whether it is among its bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InertialDue {
    /// Whether the stream runs, so that each tick should have a sample.
    pub expected: bool,
    /// Whether a sample is among the bytes of this tick.
    pub arrived: bool,
}

impl InertialDue {
    /// Whether a sample is expected that has not arrived.
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
    /// Reports that a complete sample has arrived.
    pub fn arrive(&mut self) {
        self.due.arrived = true;
    }

    /// Whether a sample is expected in this tick, and whether it has arrived.
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
