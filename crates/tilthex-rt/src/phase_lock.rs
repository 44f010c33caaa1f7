//! Keeps the tick just behind the arrival of the IMU's sample, so that the
//! command goes out in the tick in which its sample came in.
//!
//! The board has a clock of its own, and the loop waits on nothing but the
//! host's. So the loop looks at the port when it wakes; where the sample is not
//! there yet it looks again every [`LOOK`], [`MAX_LOOKS`] times at most. A
//! sample that was there at once lets the next tick come [`CREEP`] earlier; one
//! that was not lets it come one [`LOOK`] later. The tick so follows the
//! sample at a distance of at most a look, whatever the two clocks do, and one
//! late sample moves it by no more than that.

use crate::sleeper::Nanos;

/// Between two looks at the port, ns.
pub const LOOK: Nanos = 50_000;
/// Looks after the first, before the tick goes on without a sample.
pub const MAX_LOOKS: u32 = 10;
/// How much earlier the next tick comes while samples are there in time, ns.
const CREEP: i64 = 4_000;
/// Ticks without a sample after which the stream counts as off.
const PATIENCE: u32 = 10;

/// Sees whole IMU frames pass in the raw bytes, without decoding them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Scan {
    #[default]
    Elsewhere,
    Start,
    InImu,
}

/// The lock's memory.
#[derive(Clone, Copy, Debug, Default)]
pub struct PhaseLock {
    scan: Scan,
    found: bool,
    missed: u32,
    running: bool,
}

impl PhaseLock {
    /// Looks through bytes in the order they came.
    pub fn scan(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.scan = match (self.scan, byte) {
                (_, b'^') => Scan::Start,
                (Scan::Start, b'I') => Scan::InImu,
                (Scan::InImu, b'$') => {
                    self.found = true;
                    Scan::Elsewhere
                }
                (Scan::InImu, _) => Scan::InImu,
                _ => Scan::Elsewhere,
            };
        }
    }

    /// Whether another look at the port is worth while after `looks` of them.
    #[must_use]
    pub fn wants_look(&self, looks: u32) -> bool {
        self.running && !self.found && looks < MAX_LOOKS
    }

    /// Ends a tick that looked again `looks` times: whether it had a sample,
    /// and by how much the later deadlines move, ns.
    pub fn end_tick(&mut self, looks: u32) -> (bool, i64) {
        let found = std::mem::take(&mut self.found);
        self.missed = if found { 0 } else { self.missed.saturating_add(1) };
        let was_running = self.running;
        self.running = self.missed < PATIENCE && (found || self.running);
        let shift = match (was_running, found, looks) {
            (false, _, _) => 0,
            (true, true, 0) => -CREEP,
            (true, ..) => LOOK as i64,
        };
        (found, shift)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PERIOD: f64 = 2e6;

    /// Runs the lock against a board whose clock is off by `drift` and jitters
    /// by up to `jitter` ns; the age of each sample when it is taken, ns.
    fn ages(drift: f64, jitter: f64, phase: f64, ticks: usize) -> Vec<f64> {
        let mut lock = PhaseLock::default();
        let mut random = tilthex_core::random::Random::new(7);
        let mut deadline = 0.0;
        let mut arrivals =
            (0..).map(|i| phase + f64::from(i) * PERIOD * (1.0 + drift) + jitter * random.uniform());
        let mut next = arrivals.next();
        let mut ages = Vec::new();
        for _ in 0..ticks {
            let (mut now, mut looks, mut newest) = (deadline, 0, None);
            loop {
                while next.is_some_and(|arrival| arrival <= now) {
                    newest = next;
                    lock.scan(b"^I..............$");
                    next = arrivals.next();
                }
                if !lock.wants_look(looks) {
                    break;
                }
                now += LOOK as f64;
                looks += 1;
            }
            let (found, shift) = lock.end_tick(looks);
            assert_eq!(found, newest.is_some());
            ages.extend(newest.map(|arrival| now - arrival));
            deadline += PERIOD + shift as f64;
        }
        ages
    }

    proptest! {
        #[test]
        fn whatever_the_phase_and_the_drift_samples_are_taken_young(
            drift in -3e-4..3e-4f64, jitter in 0.0..4e4f64, phase in 0.0..PERIOD,
        ) {
            let ages = ages(drift, jitter, phase, 3000);
            let settled = &ages[1000..];
            prop_assert!(settled.len() >= 1990, "no sample is left for a later tick: {}", settled.len());
            let limit = LOOK as f64 + jitter + 20_000.0;
            let old = settled.iter().filter(|age| **age > limit).count();
            prop_assert!(old == 0, "{old} samples waited longer than {limit} ns");
        }

        #[test]
        fn frames_cut_anywhere_are_found_once(cut in 0usize..20) {
            let bytes = b"^M2345$^I12345678901$^M";
            let mut lock = PhaseLock::default();
            lock.scan(&bytes[..cut]);
            lock.scan(&bytes[cut..]);
            prop_assert!(lock.end_tick(0).0);
            lock.scan(b"2345$");
            prop_assert!(!lock.end_tick(0).0);
        }
    }

    #[test]
    fn a_silent_stream_is_not_waited_for() {
        let mut lock = PhaseLock::default();
        assert!(!lock.wants_look(0), "none has come yet");
        lock.scan(b"^I$");
        lock.end_tick(0);
        assert!(lock.wants_look(0) && !lock.wants_look(MAX_LOOKS));
        for _ in 0..PATIENCE {
            lock.end_tick(MAX_LOOKS);
        }
        assert!(!lock.wants_look(0));
    }
}
