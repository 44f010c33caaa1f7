//! Keeps the tick just after the arrival of the inertial sample, so that each tick sends the command for a sample that has
//! just arrived.
//!
//! The board has its own clock, and the loop waits only on the clock of the host. When the loop wakes, it looks at the port.
//! If the sample has not arrived, it looks again every [`LOOK`], up to [`LONGEST_WAIT`] after its deadline: a tick that woke
//! late waits for nothing. If the first look finds the sample, the next tick comes `CREEP` earlier; otherwise it comes one
//! [`LOOK`] later. The tick so follows the sample within one [`LOOK`], even if the two clocks drift, and one late sample moves
//! the tick by one [`LOOK`] only.

use crate::sleeper::Nanos;
use tilthex_link::InertialDue;

/// Time between two looks at the port, ns.
pub const LOOK: Nanos = 50_000;
/// Time from the deadline to the last look, ns. After it the tick continues without a sample.
pub const LONGEST_WAIT: Nanos = 10 * LOOK;
/// Time by which the next tick comes earlier if the first look found the sample, ns.
const CREEP: i64 = 4_000;

/// Whether to look at the port again, after a look that came `late` after the deadline, ns.
#[must_use]
pub fn wants_look(due: InertialDue, late: Nanos) -> bool {
    due.is_awaited() && late.saturating_add(LOOK) <= LONGEST_WAIT
}

/// Time by which all later deadlines move, ns, after a tick that looked again `looks` times.
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

    /// The age of each sample when it is read, ns. The board's clock has a relative drift `drift` and a jitter of up to
    /// `jitter` ns.
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
                if !wants_look(awaited.due(), Nanos::from(looks) * LOOK) {
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
    fn a_tick_that_woke_late_waits_for_nothing() {
        let mut awaited = Awaited::default();
        awaited.arrive();
        awaited.end_tick();
        assert!(wants_look(awaited.due(), LONGEST_WAIT - LOOK));
        for late in [LONGEST_WAIT - LOOK + 1, LONGEST_WAIT, 4 * LONGEST_WAIT, Nanos::MAX] {
            assert!(!wants_look(awaited.due(), late), "{late} ns");
        }
    }

    #[test]
    fn a_silent_stream_is_not_waited_for() {
        let mut awaited = Awaited::default();
        assert!(!wants_look(awaited.due(), 0), "none has come yet");
        awaited.arrive();
        awaited.end_tick();
        assert!(wants_look(awaited.due(), 0) && !wants_look(awaited.due(), LONGEST_WAIT));
        for _ in 0..10 {
            awaited.end_tick();
        }
        assert!(!wants_look(awaited.due(), 0));
    }
}
