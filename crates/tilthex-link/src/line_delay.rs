//! The delay of a line: how much later than usual its numbered samples arrive.

use tilthex_core::supervisor::limits::LINE_LATE;

/// A line that is later than usual by `LINE_LATE` for this time, s, is late.
const LATE_FOR: f64 = 0.05;
/// A line whose delay differs from the usual one by less than this, s, for [`FINE_FOR`] is no longer late.
const FINE: f64 = 0.006;
/// See [`FINE`], s.
const FINE_FOR: f64 = 0.5;
/// A larger difference, s, means that the numbers have started again. It says nothing about the line.
const NUMBERED_ANEW: f64 = 0.25;
/// Time constant, s, with which the usual delay follows later arrivals. It follows because the two clocks drift apart.
const SLOWLY: f64 = 0.3;
/// Time constant, s, with which the usual delay follows earlier arrivals.
const QUICKLY: f64 = 0.02;

/// Compares arrival times with the times that follow from the sample numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LineDelay {
    /// Usual difference between the arrival and the sample's own time, s, and the last arrival, s.
    usual: Option<(f64, f64)>,
    /// The time since which the line has looked different from its present state, s.
    since: Option<f64>,
    late: bool,
    delay: f64,
}

impl LineDelay {
    /// Takes the time of a sample from its number, s from the first one, and its arrival, s. Returns the delay of the
    /// line beyond the usual one, s; 0 if the line is not late.
    pub fn step(&mut self, made: f64, arrival: f64) -> f64 {
        let found = arrival - made;
        let Some((usual, last)) = self.usual else {
            self.usual = Some((found, arrival));
            return 0.0;
        };
        let excess = found - usual;
        if !(-NUMBERED_ANEW..=NUMBERED_ANEW).contains(&excess) {
            *self = Self { usual: Some((found, arrival)), ..Self::default() };
            return 0.0;
        }
        let (differs, long) =
            if self.late { (excess < FINE, FINE_FOR) } else { (excess > LINE_LATE, LATE_FOR) };
        self.since = if differs { self.since.or(Some(arrival)) } else { None };
        if self.since.is_some_and(|since| arrival - since > long) {
            (self.late, self.since) = (!self.late, None);
        }
        self.delay = if self.late { excess.max(0.0) } else { 0.0 };
        // A late sample does not change the usual delay. A host that was stopped reads many samples at once.
        let passed = (arrival - last).max(0.0);
        let constant = if excess > 0.0 { SLOWLY } else { QUICKLY };
        let share = if self.late && excess > 0.0 { 0.0 } else { (passed / constant).min(1.0) };
        self.usual = Some((usual + share * excess, arrival));
        self.delay
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Delays that are seen while samples of 2 ms come late by `late(k)`, s.
    fn run(late: impl Fn(u32) -> f64) -> std::vec::Vec<f64> {
        let mut line = LineDelay::default();
        (0..5000).map(|k| line.step(f64::from(k) * 2e-3, 7.0 + f64::from(k) * 2e-3 + late(k))).collect()
    }

    #[test]
    fn a_step_is_seen_and_stays_seen_until_it_ends() {
        let seen = run(|k| if (1000..4000).contains(&k) { 0.04 } else { 1e-3 * f64::from(k % 3) });
        assert!(seen[..1000].iter().all(|d| *d == 0.0));
        assert!(seen[1100..4000].iter().all(|d| (0.025..0.041).contains(d)), "{:?}", &seen[1100..1110]);
        assert!(seen[4600..].iter().all(|d| *d == 0.0));
    }

    #[test]
    fn drift_jitter_and_a_host_that_was_held_up_are_no_late_line() {
        assert!(run(|k| 0.02 * 2e-3 * f64::from(k)).iter().all(|d| *d == 0.0));
        assert!(run(|k| 8e-3 * f64::from(k * 7919 % 11) / 11.0).iter().all(|d| *d == 0.0));
        let held_up = |k: u32| if (1000..1100).contains(&k) { 2e-3 * f64::from(1100 - k) } else { 0.0 };
        assert!(run(held_up).iter().all(|d| *d == 0.0));
    }
}
