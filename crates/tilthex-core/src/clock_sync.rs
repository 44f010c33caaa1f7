//! Passive one-way clock synchronisation: E. Olson, "A passive solution to the
//! sensor synchronization problem", IROS 2010.
//!
//! A message that a remote clock stamped with `p` arrives at `q` on ours:
//! `q - p` is the offset of the clocks plus a latency that is never negative.
//! So the smallest difference seen is the best one. It ages with the largest
//! drift of the clocks, which lets the estimate follow them:
//! `offset_i = min over 1 <= j <= i of (m_j + drift (p_i - p_j))`, kept as one number.
//! Here `m_j` is the larger of two differences in a row, `q_j - p_j` and the one
//! before: a single corrupt stamp cannot pull the clock. What remains in the
//! result is the smallest latency of the line.

use crate::error::{Error, check_range};

/// Parameters of a remote clock and its line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockParams {
    /// Largest relative drift between the clocks.
    pub drift: f64,
    /// A stamp that differs from the expected one by more, s, is suspect.
    pub jump: f64,
    /// If all stamps are suspect for this time, s, the remote clock was set to another time. (A host that was
    /// stopped also reads late stamps, but all of them at once.)
    pub patience: f64,
}

impl Default for ClockParams {
    /// Drift 1e-3, jump 20 ms, patience 0.25 s.
    fn default() -> Self {
        Self { drift: 1e-3, jump: 0.02, patience: 0.25 }
    }
}

/// The effect of a stamp on the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ClockEvent {
    /// The first one: taken as it is.
    #[default]
    First,
    /// As expected.
    Expected,
    /// Too early or too late; the clock did not move.
    Suspect,
    /// Stamps were suspect for too long: the clock restarts from this one.
    Reset,
}

/// A remote stamp on our clock.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stamp {
    /// When it was made, s; never after its arrival.
    pub time: f64,
    /// What it did to the clock.
    pub event: ClockEvent,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Anchor {
    /// Newest remote time.
    remote: f64,
    /// The offset there.
    offset: f64,
    /// The last difference seen.
    seen: f64,
    /// Whether the offset depends on a single stamp.
    alone: bool,
    /// Arrival of the first of the suspect stamps, while they last.
    suspect_since: Option<f64>,
}

/// The offset of one remote clock, in constant memory.
///
/// ```
/// use tilthex_core::clock_sync::{ClockParams, ClockSync};
///
/// let mut clock = ClockSync::new(ClockParams::default())?;
/// // The other clock is 5 s behind; stamps arrive 1 to 4 ms late. What stays is the smallest delay that two stamps in a
/// // row keep to: one stamp alone may be wrong.
/// for k in 0..1000_u32 {
///     let taken = 0.002 * f64::from(k);
///     let delay = 1e-3 * f64::from(1 + k % 4);
///     clock.step(taken, taken + 5.0 + delay);
/// }
/// let offset = clock.offset(2.0).expect("stamps came");
/// assert!((offset - 5.002).abs() < 2e-4);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockSync {
    params: ClockParams,
    anchor: Option<Anchor>,
    resets: u32,
}

impl ClockSync {
    /// A clock that has received no stamp.
    ///
    /// # Errors
    /// If the drift is not within 0 to 0.1, the jump not within 10 us to 10 s, or the patience not within 0 to 60 s.
    pub fn new(params: ClockParams) -> Result<Self, Error> {
        check_range("clock drift", params.drift, 0.0, 0.1)?;
        check_range("clock jump (s)", params.jump, 1e-5, 10.0)?;
        check_range("clock patience (s)", params.patience, 0.0, 60.0)?;
        Ok(Self { params, anchor: None, resets: 0 })
    }

    /// The offset, ours minus the remote clock, s, at a remote time, s; `None` before the first stamp.
    #[must_use]
    pub fn offset(&self, remote: f64) -> Option<f64> {
        self.anchor.map(|anchor| self.aged(&anchor, remote))
    }

    /// How often the clock has restarted.
    #[must_use]
    pub fn resets(&self) -> u32 {
        self.resets
    }

    /// Takes a stamp, s on the remote clock, that arrived at a time, s on ours.
    /// Stamps may overtake each other. A number that is not finite is suspect.
    pub fn step(&mut self, remote: f64, arrival: f64) -> Stamp {
        let seen = arrival - remote;
        if !seen.is_finite() {
            return Stamp { time: arrival, event: ClockEvent::Suspect };
        }
        let Some(anchor) = self.anchor else {
            self.start(remote, seen);
            return Stamp { time: arrival, event: ClockEvent::First };
        };
        let expected = self.aged(&anchor, remote);
        if (seen - expected).abs() <= self.params.jump {
            let pair = seen.max(anchor.seen);
            let offset = if anchor.alone { pair } else { expected.min(pair) };
            let newest = anchor.remote.max(remote);
            self.anchor = Some(Anchor { remote: newest, offset, seen, alone: false, suspect_since: None });
            return Stamp { time: (remote + offset).min(arrival), event: ClockEvent::Expected };
        }
        let since = anchor.suspect_since.unwrap_or(arrival);
        if arrival - since > self.params.patience {
            self.resets = self.resets.saturating_add(1);
            self.start(remote, seen);
            return Stamp { time: arrival, event: ClockEvent::Reset };
        }
        self.anchor = Some(Anchor { suspect_since: Some(since), ..anchor });
        Stamp { time: (remote + expected).min(arrival), event: ClockEvent::Suspect }
    }

    /// Restarts from a stamp that arrives now, as after a silence in which the remote clock may have been set.
    pub fn restart(&mut self, remote: f64, arrival: f64) -> Stamp {
        self.resets = self.resets.saturating_add(1);
        self.anchor = None;
        Stamp { event: ClockEvent::Reset, ..self.step(remote, arrival) }
    }

    fn start(&mut self, remote: f64, seen: f64) {
        self.anchor = Some(Anchor { remote, offset: seen, seen, alone: true, suspect_since: None });
    }

    fn aged(&self, anchor: &Anchor, remote: f64) -> f64 {
        anchor.offset + self.params.drift * (remote - anchor.remote).max(0.0)
    }
}
