//! Flags with which other threads tell the loop what must not wait in a ring. The loop reads them in every tick.

use std::sync::{
    Arc,
    atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
};

use crate::sleeper::Nanos;

/// Flags that any thread can set, and that no thread clears.
#[derive(Clone, Debug, Default)]
pub struct Flags {
    /// A signal asks to land, or to end the program before the start.
    pub interrupted: Arc<AtomicBool>,
    land: Arc<AtomicBool>,
    kill: Arc<AtomicBool>,
    /// Time of the operator's last message; 0 while the vehicle does not fly an operator's orders.
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

    /// A message of the operator, whose orders the vehicle flies, arrived at a monotonic time.
    pub fn hear(&self, now: Nanos) {
        self.heard.store(now.max(1), Relaxed);
    }

    /// Whether a signal or the operator asks to land.
    #[must_use]
    pub fn lands(&self) -> bool {
        self.interrupted.load(Relaxed) || self.land.load(Relaxed)
    }

    /// Whether the motors must stop at once.
    #[must_use]
    pub fn kills(&self) -> bool {
        self.kill.load(Relaxed)
    }

    /// Whether the vehicle flies the orders of an operator whose last message is more than `patience` older than `now`.
    #[must_use]
    pub fn operator_silent(&self, now: Nanos, patience: Nanos) -> bool {
        self.operator_silence(now) > patience
    }

    /// Time from the operator's last message to `now`; 0 while the vehicle does not fly an operator's orders.
    #[must_use]
    pub fn operator_silence(&self, now: Nanos) -> Nanos {
        match self.heard.load(Relaxed) {
            0 => 0,
            heard => now.saturating_sub(heard),
        }
    }

    /// Whether the vehicle flies an operator's orders, so that the operator must send messages.
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
        // A clock that was read before the store does not count as silence.
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
