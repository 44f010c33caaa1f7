//! The largest part of the horizontal force for which a turn is allowed.

use crate::types::Vector3;

/// Steps of the horizontal force.
pub(super) const STEPS: u16 = 1 << 12;

/// A turn, and how much larger it could be, rad; negative if it is larger than allowed.
#[derive(Clone, Copy)]
pub(super) struct Trial {
    pub turn: Vector3,
    pub room: f64,
}

/// The largest step up to `most` whose turn is allowed, and this turn. That of step 0, which is known, is allowed. The
/// `first` step is tried, then the zero of the line through the last two trials, if it is between what is known to be
/// allowed and not, otherwise the middle.
pub(super) fn search(
    first: u16,
    most: u16,
    none: Trial,
    mut trial: impl FnMut(u16) -> Option<Trial>,
) -> (Vector3, u16) {
    /// Number of trials after which only the middle is tried.
    const LINES: u32 = 8;
    let (mut best, mut low, mut high) = (none.turn, 0, most + 1);
    let mut before = (0.0, none.room);
    if most == 0 {
        return (best, low);
    }
    let mut next = first.max(1).min(most);
    let mut trials = 0;
    loop {
        let found = trial(next);
        match found {
            Some(Trial { turn, room }) if room >= 0.0 => (best, low) = (turn, next),
            _ => high = next,
        }
        if high - low <= 1 {
            return (best, low);
        }
        trials += 1;
        let mut zero = f64::NAN;
        if let Some(Trial { room, .. }) = found {
            let at = f64::from(next);
            zero = at + room * (at - before.0) / (before.1 - room);
            before = (at, room);
        }
        // The zero may be in the step after `low`, and the last step may be allowed.
        let between = zero >= f64::from(low) && (zero < f64::from(high) || high > most);
        next = if between && trials < LINES {
            (zero.min(f64::from(most)) as u16).max(low + 1).min(high - 1)
        } else {
            low + (high - low) / 2
        };
    }
}
