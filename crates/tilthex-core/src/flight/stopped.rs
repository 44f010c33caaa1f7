//! Motors that report a stop. They are believed unless their rotors still lift.

use crate::{supervisor::limits::STOPPED_AFTER, types::MAX_ROTORS};

/// A motor that turns as it should for this time, s, is trusted again.
const RESTORED: f64 = 0.2;

/// For how long each motor has reported a stop, and which motors are not trusted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct StoppedWatch {
    since: [f64; MAX_ROTORS],
    restored: [f64; MAX_ROTORS],
    doubted: u16,
    /// The motors that are not trusted although nothing showed that their rotors lift.
    unseen: u16,
}

impl StoppedWatch {
    /// Bit `i` is set if motor `i` (from 0) reports a stop, but its rotor lifts.
    pub(super) fn doubted(&self) -> u16 {
        self.doubted
    }

    /// One tick, with the motors that measure standstill, those that report a stop, and the rotors that still lift; `None` if
    /// nothing shows whether they do: then they are doubted, until something shows it.
    /// Bit `i` of the result is set if motor `i` has stopped.
    pub(super) fn step(&mut self, measured: u16, own: u16, lifting: Option<u16>, dt: f64) -> u16 {
        if lifting.is_some() && self.unseen != 0 {
            for (i, since) in self.since.iter_mut().enumerate().filter(|(i, _)| self.unseen >> i & 1 == 1) {
                *since = 0.0;
                self.doubted &= !(1 << i);
            }
            self.unseen = 0;
        }
        if measured == 0 && self.doubted == 0 {
            self.since = [0.0; MAX_ROTORS];
            return 0;
        }
        let mut stopped = 0;
        for (i, (since, restored)) in self.since.iter_mut().zip(&mut self.restored).enumerate() {
            let bit = 1 << i;
            if measured & bit == 0 {
                *restored += dt;
                *since = 0.0;
                if *restored > RESTORED {
                    self.doubted &= !bit;
                }
                continue;
            }
            *restored = 0.0;
            let before = *since;
            *since += dt;
            if own & bit != 0 {
                self.doubted &= !bit;
            } else if before <= STOPPED_AFTER
                && *since > STOPPED_AFTER
                && lifting.is_none_or(|lifting| lifting & bit != 0)
            {
                self.doubted |= bit;
                self.unseen |= if lifting.is_none() { bit } else { 0 };
            }
            if (own & bit != 0 || *since > STOPPED_AFTER) && self.doubted & bit == 0 {
                stopped |= bit;
            }
        }
        stopped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lifts_has_not_stopped_and_what_turns_again_is_believed() {
        let mut watch = StoppedWatch::default();
        let mut run =
            |measured, own, lifting| (0..100).map(|_| watch.step(measured, own, Some(lifting), 2e-3)).last();
        assert_eq!(run(0b10, 0, 0), Some(0b10));
        assert_eq!(run(0, 0, 0), Some(0));
        assert_eq!(run(0b10, 0, 0b10), Some(0));
        // The stop cannot be seen any more, because the model replaces the measurement.
        assert_eq!(run(0b10, 0, 0), Some(0));
        assert_eq!(run(0b10, 0b10, 0), Some(0b10));
        assert_eq!(run(0, 0, 0), Some(0));
        assert_eq!(run(0, 0, 0), Some(0));
        assert_eq!(run(0b10, 0, 0), Some(0b10));
    }

    #[test]
    fn a_stop_that_nothing_shows_is_judged_as_soon_as_something_does() {
        for (lifting, stopped) in [(0, 0b10), (0b10, 0)] {
            let mut watch = StoppedWatch::default();
            let mut run = |lifting| (0..100).map(|_| watch.step(0b10, 0, lifting, 2e-3)).last();
            assert_eq!(run(None), Some(0));
            assert_eq!(run(Some(lifting)), Some(stopped));
        }
        // What the motor itself says needs no IMU.
        let mut watch = StoppedWatch::default();
        assert_eq!(watch.step(0b10, 0b10, None, 2e-3), 0b10);
    }
}
