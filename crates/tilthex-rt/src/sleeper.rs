//! The loop's deadlines: absolute times of one clock. A period that is missed is skipped and counted; the phase of the
//! deadlines stays.

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
}

impl Sleeper {
    /// Deadlines `first`, `first + period`, and so on. A period below 1 us counts as 1 us.
    #[must_use]
    pub fn new(period: Duration, first: Nanos) -> Self {
        Self { period: (period.as_nanos() as u64).max(1000), next: first }
    }

    /// Waits for the next deadline. If it has already passed, skips all periods whose deadlines have passed. Safe in the
    /// loop.
    pub fn wait(&mut self, clock: &impl Clock) -> Wake {
        let late = clock.now().saturating_sub(self.next);
        let skipped = late.div_ceil(self.period);
        let deadline = self.next + skipped * self.period;
        clock.sleep_until(deadline);
        self.next = deadline + self.period;
        Wake { deadline, woke: clock.now(), skipped }
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

    const PERIOD: Nanos = 2_000_000;

    proptest! {
        #[test]
        fn deadlines_stay_on_the_grid_and_account_for_every_period(
            work in prop::collection::vec(0..7 * PERIOD, 1..200),
            first in 0..10 * PERIOD,
        ) {
            let clock = Virtual(Cell::new(first));
            let mut sleeper = Sleeper::new(Duration::from_nanos(PERIOD), first);
            let (mut periods, mut last_start) = (0, None);
            for w in work {
                let wake = sleeper.wait(&clock);
                periods += wake.skipped;
                prop_assert_eq!(wake.deadline, first + periods * PERIOD);
                periods += 1;
                prop_assert!(wake.woke >= wake.deadline);
                if let Some(last) = last_start {
                    // A tick that is shorter than its period skips no period. A longer tick skips the periods that it took.
                    let taken: Nanos = last;
                    prop_assert_eq!(wake.skipped, taken.saturating_sub(PERIOD).div_ceil(PERIOD));
                }
                clock.0.set(clock.0.get() + w);
                last_start = Some(w);
            }
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
