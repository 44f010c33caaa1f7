//! The loop's deadlines: absolute times of one clock. The phase of the deadlines stays.
//!
//! A deadline that passes while a tick runs has its tick at once after it, so that the tick's own duration costs no period. Of
//! several deadlines that have passed, only the last has a tick; the others are skipped and counted.

use std::time::Duration;

pub use tilthex_core::types::Nanos;
pub use tilthex_mocap::net::{Clock, Monotonic};

/// One wake-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wake {
    /// Time at which the tick was due.
    pub deadline: Nanos,
    /// Time at which the tick began.
    pub woke: Nanos,
    /// Number of periods that were skipped before it.
    pub skipped: u64,
}

impl Wake {
    /// Time from the deadline to the start of the tick, ns.
    #[must_use]
    pub fn latency(&self) -> Nanos {
        self.woke.saturating_sub(self.deadline)
    }
}

/// Sleeps until the next deadline of a grid with a constant period.
#[derive(Clone, Copy, Debug)]
pub struct Sleeper {
    period: Nanos,
    next: Nanos,
    /// When the last tick began, and whether it began at once after the one before.
    woke: Nanos,
    at_once: bool,
}

impl Sleeper {
    /// Deadlines `first`, `first + period`, and so on. A period below 1 us counts as 1 us.
    #[must_use]
    pub fn new(period: Duration, first: Nanos) -> Self {
        Self { period: (period.as_nanos() as u64).max(1000), next: first, woke: 0, at_once: false }
    }

    /// Waits for the next deadline. If the last deadline that has passed came after the last tick began, its tick is due at
    /// once; not twice in a row, so that a loop whose ticks are too long leaves time to other threads. Safe in the loop.
    pub fn wait(&mut self, clock: &impl Clock) -> Wake {
        let passed = clock.now().checked_sub(self.next).map_or(0, |late| late / self.period + 1);
        let last = self.next + passed.saturating_sub(1) * self.period;
        self.at_once = passed > 0 && last > self.woke && !self.at_once;
        let skipped = passed - u64::from(self.at_once);
        let deadline = self.next + skipped * self.period;
        clock.sleep_until(deadline);
        self.next = deadline + self.period;
        self.woke = clock.now();
        Wake { deadline, woke: self.woke, skipped }
    }

    /// Moves all later deadlines by `ns`: later if it is positive, earlier if it is negative.
    pub fn shift(&mut self, ns: i64) {
        self.next = self.next.saturating_add_signed(ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::cell::Cell;

    /// A clock that the test moves.
    struct Virtual(Cell<Nanos>);

    impl Clock for Virtual {
        fn now(&self) -> Nanos {
            self.0.get()
        }
        fn sleep_until(&self, deadline: Nanos) {
            self.0.set(self.0.get().max(deadline));
        }
    }

    /// A clock of a computer that stands still from a time to another.
    struct Stalled {
        now: Cell<Nanos>,
        from: Nanos,
        end: Nanos,
    }

    impl Clock for Stalled {
        fn now(&self) -> Nanos {
            self.now.get()
        }
        fn sleep_until(&self, deadline: Nanos) {
            let now = self.now.get();
            let stands = (self.from..self.end).contains(&deadline.max(now))
                || (now < self.from && deadline >= self.from);
            self.now.set(if stands { self.end.max(deadline) } else { now.max(deadline) });
        }
    }

    const PERIOD: Nanos = 2_000_000;

    proptest! {
        #[test]
        fn deadlines_stay_on_the_grid_and_account_for_every_period(
            work in prop::collection::vec(0..7 * PERIOD, 1..200),
            first in 0..10 * PERIOD,
        ) {
            let clock = Virtual(Cell::new(first));
            let mut sleeper = Sleeper::new(Duration::from_nanos(PERIOD), first);
            let (mut next, mut began, mut at_once) = (first, 0, false);
            for w in work {
                // Each deadline that has passed is skipped, unless it is the last one and came after the last tick began.
                let mut expected = next;
                while expected <= clock.now() {
                    let last = expected + PERIOD > clock.now();
                    if last && expected > began && !at_once {
                        break;
                    }
                    expected += PERIOD;
                }
                at_once = expected <= clock.now();
                let wake = sleeper.wait(&clock);
                prop_assert_eq!(wake.deadline, expected);
                prop_assert_eq!(wake.skipped, (expected - next) / PERIOD);
                prop_assert_eq!(wake.woke, clock.now());
                prop_assert!(wake.woke >= wake.deadline && wake.latency() < PERIOD);
                (next, began) = (expected + PERIOD, wake.woke);
                clock.0.set(clock.0.get() + w);
            }
        }

        /// A computer that stands still costs a loop as many periods as a thread that only sleeps, whatever its ticks take.
        #[test]
        fn the_duration_of_ticks_costs_no_period(
            work in 0..PERIOD / 2, stall in 0..20 * PERIOD, from in 10 * PERIOD..11 * PERIOD,
        ) {
            let (mut skipped, end) = (0, from + stall);
            let clock = Stalled { now: Cell::new(0), from, end };
            let mut sleeper = Sleeper::new(Duration::from_nanos(PERIOD), PERIOD);
            while clock.now() < 50 * PERIOD {
                skipped += sleeper.wait(&clock).skipped;
                clock.sleep_until(clock.now() + work);
            }
            let passed = |until: Nanos| (until / PERIOD - (from - 1) / PERIOD).saturating_sub(1);
            // After a stall inside a tick, a deadline that passes in the tick at once after it is skipped.
            let inside = from % PERIOD < work && stall > 0;
            let until = if inside { end + work } else { end };
            prop_assert!((passed(end)..=passed(until)).contains(&skipped), "{from} to {end}: {skipped}");
        }

        #[test]
        fn a_shift_moves_every_later_deadline(shift in -(PERIOD as i64) + 1..PERIOD as i64) {
            let clock = Virtual(Cell::new(0));
            let mut sleeper = Sleeper::new(Duration::from_nanos(PERIOD), PERIOD);
            let before = sleeper.wait(&clock).deadline;
            sleeper.shift(shift);
            let after = sleeper.wait(&clock);
            prop_assert_eq!(after.deadline, before.saturating_add_signed(PERIOD as i64 + shift));
            prop_assert_eq!(sleeper.wait(&clock).deadline, after.deadline + PERIOD);
        }
    }

    #[test]
    fn the_monotonic_clock_never_wakes_early() {
        let mut sleeper = Sleeper::new(Duration::from_millis(1), Monotonic.now());
        for _ in 0..20 {
            let wake = sleeper.wait(&Monotonic);
            assert!(wake.woke >= wake.deadline);
        }
    }
}
