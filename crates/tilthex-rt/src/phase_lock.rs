//! Keeps the tick just behind the arrival of the IMU's sample, so that the
//! command goes out in the tick in which its sample came in.
//!
//! The board has a clock of its own, and the loop waits on nothing but the
//! host's. So the loop looks at the port when it wakes; where the sample is not
//! there yet it looks again every [`LOOK`], [`MAX_LOOKS`] times at most. A
//! sample that was there at once lets the next tick come `CREEP` earlier; one
//! that was not lets it come one [`LOOK`] later. The tick so follows the
//! sample at a distance of at most a look, whatever the two clocks do, and one
//! late sample moves it by no more than that.

use crate::sleeper::Nanos;
use tilthex_link::InertialDue;

/// Between two looks at the port, ns.
pub const LOOK: Nanos = 50_000;
/// Looks after the first, before the tick goes on without a sample.
pub const MAX_LOOKS: u32 = 10;
/// How much earlier the next tick comes while samples are there in time, ns.
const CREEP: i64 = 4_000;

/// Whether another look at the port is worth while after `looks` of them.
#[must_use]
pub fn wants_look(due: InertialDue, looks: u32) -> bool {
    due.is_awaited() && looks < MAX_LOOKS
}

/// By how much the deadlines after a tick move that looked again `looks` times, ns.
#[must_use]
pub fn shift(due: InertialDue, looks: u32) -> i64 {
    match (due.expected, due.arrived, looks) {
        (false, _, _) => 0,
        (true, true, 0) => -CREEP,
        (true, ..) => LOOK as i64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use tilthex_link::Awaited;

    const PERIOD: f64 = 2e6;

    /// Runs the lock against a board whose clock is off by `drift` and jitters
    /// by up to `jitter` ns; the age of each sample when it is taken, ns.
    fn ages(drift: f64, jitter: f64, phase: f64, ticks: usize) -> Vec<f64> {
        let mut awaited = Awaited::default();
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
                    awaited.arrive();
                    next = arrivals.next();
                }
                if !wants_look(awaited.due(), looks) {
                    break;
                }
                now += LOOK as f64;
                looks += 1;
            }
            let due = awaited.due();
            awaited.end_tick();
            assert_eq!(due.arrived, newest.is_some());
            ages.extend(newest.map(|arrival| now - arrival));
            deadline += PERIOD + shift(due, looks) as f64;
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
    }

    #[test]
    fn a_silent_stream_is_not_waited_for() {
        let mut awaited = Awaited::default();
        assert!(!wants_look(awaited.due(), 0), "none has come yet");
        awaited.arrive();
        awaited.end_tick();
        assert!(wants_look(awaited.due(), 0) && !wants_look(awaited.due(), MAX_LOOKS));
        for _ in 0..10 {
            awaited.end_tick();
        }
        assert!(!wants_look(awaited.due(), 0));
    }
}
