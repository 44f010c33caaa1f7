//! What other threads tell the loop past its ring: read in every tick, behind nothing.

use std::sync::{
    Arc,
    atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
};

use crate::sleeper::Nanos;

/// Flags that any thread may set and none takes back.
#[derive(Clone, Debug, Default)]
pub struct Flags {
    /// A signal asks to land, or to end where nothing flies.
    pub interrupted: Arc<AtomicBool>,
    land: Arc<AtomicBool>,
    kill: Arc<AtomicBool>,
    /// Time of the operator's last message; 0 while no operator's orders are flown.
    heard: Arc<AtomicU64>,
}

impl Flags {
    /// The operator orders to land.
    pub fn land(&self) {
        self.land.store(true, Relaxed);
    }

    /// The operator orders to stop the motors at once.
    pub fn kill(&self) {
        self.kill.store(true, Relaxed);
    }

    /// The operator, whose orders are flown, was heard at a monotonic time.
    pub fn hear(&self, now: Nanos) {
        self.heard.store(now.max(1), Relaxed);
    }

    /// Whether anybody asks to land.
    #[must_use]
    pub fn lands(&self) -> bool {
        self.interrupted.load(Relaxed) || self.land.load(Relaxed)
    }

    /// Whether the motors shall stop at once.
    #[must_use]
    pub fn kills(&self) -> bool {
        self.kill.load(Relaxed)
    }

    /// Whether orders are flown of an operator who was heard last more than `patience` before `now`.
    #[must_use]
    pub fn operator_silent(&self, now: Nanos, patience: Nanos) -> bool {
        match self.heard.load(Relaxed) {
            0 => false,
            heard => now.saturating_sub(heard) > patience,
        }
    }

    /// Whether an operator's orders are flown, who must be heard.
    #[must_use]
    pub fn has_operator(&self) -> bool {
        self.heard.load(Relaxed) != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_operator_who_was_heard_can_be_silent() {
        let flags = Flags::default();
        assert!(!flags.operator_silent(1_000, 100));
        flags.hear(1_000);
        assert!(!flags.operator_silent(1_100, 100));
        assert!(flags.operator_silent(1_101, 100));
        // A clock that is read before the store is no silence.
        assert!(!flags.operator_silent(900, 100));
    }

    #[test]
    fn clones_are_the_same_flags() {
        let flags = Flags::default();
        flags.clone().kill();
        flags.clone().land();
        assert!(flags.kills() && flags.lands());
    }
}
