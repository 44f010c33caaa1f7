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
}

impl StoppedWatch {
    /// Bit `i` is set if motor `i` (from 0) reports a stop, but its rotor lifts.
    pub(super) fn doubted(&self) -> u16 {
        self.doubted
    }

    /// One tick, with the motors that measure standstill, those that report a stop, and the rotors that still lift.
    /// Bit `i` of the result is set if motor `i` has stopped.
    pub(super) fn step(&mut self, measured: u16, own: u16, lifting: u16, dt: f64) -> u16 {
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
            } else if before <= STOPPED_AFTER && *since > STOPPED_AFTER && lifting & bit != 0 {
                self.doubted |= bit;
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
            |measured, own, lifting| (0..100).map(|_| watch.step(measured, own, lifting, 2e-3)).last();
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
}
