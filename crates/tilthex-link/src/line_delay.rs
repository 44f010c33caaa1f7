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

/// A host that reads nothing for longer than this, s, stands still. Samples that have waited for it are read for at most the second, s,
/// and say nothing about the line.
const STANDS: (f64, f64) = (0.05, 0.05);

/// A line is late by at most this, s, where it delays what has waited.
const LONGEST: f64 = 0.1;

/// After a silence of more than this, s, nothing is known about the line. A board restarts in less.
const FORGOTTEN: f64 = 2.0;

/// Compares arrival times with the times that follow from the sample numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LineDelay {
    /// Usual difference between the arrival and the sample's own time, s, and the last arrival, s.
    usual: Option<(f64, f64)>,
    /// The time since which the line has looked different from its present state, s.
    since: Option<f64>,
    /// When the host read last, s.
    read: Option<f64>,
    /// When the host last went on after it had stood still, s, and for how long it had, s.
    stood: Option<(f64, f64)>,
    late: bool,
    delay: f64,
}

impl LineDelay {
    /// The host reads, at a time, s: once before the samples that it gets.
    pub fn read(&mut self, now: f64) {
        let passed = self.read.replace(now).map_or(0.0, |last| now - last);
        if passed > STANDS.0 {
            self.stood = Some((now, passed));
        }
    }

    /// The numbers of the samples have no meaning after a silence that ends at `now`, s: the board may have restarted. The line
    /// is as late as it was, until a change is seen; after a long silence nothing is known. If the host itself stood still, the
    /// numbers go on, and nothing is forgotten.
    pub fn begin_anew(&mut self, now: f64) {
        if self.stood.is_some_and(|(end, _)| self.read == Some(end)) {
            return;
        }
        if self.usual.is_some_and(|(_, last)| now - last > FORGOTTEN) {
            (self.late, self.delay) = (false, 0.0);
        }
        (self.usual, self.since) = (None, None);
    }

    /// Takes the time of a sample from its number, s from the first one, and its arrival, s. Returns the delay of the
    /// line beyond the usual one, s; 0 if the line is not late.
    pub fn step(&mut self, made: f64, arrival: f64) -> f64 {
        let found = arrival - made;
        let Some((usual, last)) = self.usual else {
            self.usual = Some((found - self.delay, arrival));
            return self.delay;
        };
        let excess = found - usual;
        let passed = (arrival - last).max(0.0);
        let waited = |(end, length): (f64, f64)| arrival - end < STANDS.1 && excess < length + LONGEST;
        if excess > 0.0 && self.stood.is_some_and(waited) {
            self.usual = Some((usual, arrival));
            return self.delay;
        }
        if !(-NUMBERED_ANEW..=NUMBERED_ANEW).contains(&excess) {
            *self = Self { usual: Some((found, arrival)), read: self.read, ..Self::default() };
            return 0.0;
        }
        let (differs, long) =
            if self.late { (excess < FINE, FINE_FOR) } else { (excess > LINE_LATE, LATE_FOR) };
        self.since = if differs { self.since.or(Some(arrival)) } else { None };
        if self.since.is_some_and(|since| arrival - since > long) {
            (self.late, self.since) = (!self.late, None);
        }
        self.delay = if self.late { excess.max(0.0) } else { 0.0 };
        // A late sample, or one that looks late, does not change the usual delay. A host that was stopped reads many samples at
        // once.
        let constant = if excess > 0.0 { SLOWLY } else { QUICKLY };
        let holds = excess > 0.0 && (self.late || self.since.is_some());
        let share = if holds { 0.0 } else { (passed / constant).min(1.0) };
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

    /// A host that stands still hides neither the begin of a delay, nor is it one.
    #[test]
    fn a_delay_that_begins_while_the_host_stands_still_is_seen() {
        for (stands, late) in
            [(0.06, 0.04), (0.2, 0.04), (0.39, 0.038), (0.5, 0.02), (0.1, 0.0), (0.3, 0.0), (0.5, 0.0)]
        {
            let mut line = LineDelay::default();
            let goes_on = 9.0 + stands;
            let (mut seen, mut last) = (0.0_f64, 0.0);
            for k in 0..3000 {
                let made = f64::from(k) * 2e-3;
                let arrives = 7.0 + made + if made > 2.0 { late } else { 0.0 };
                let read = if arrives > 9.0 { arrives.max(goes_on) } else { arrives };
                if read > last {
                    line.read(read);
                    last = read;
                }
                seen = line.step(made, read);
                assert!(late > 0.0 || seen == 0.0, "{stands} {made} {seen}");
                assert!(
                    late == 0.0 || made < 2.2 + stands || (seen - late).abs() < 0.01,
                    "{stands} {made} {seen}"
                );
            }
            assert!((seen - late).abs() < 0.01);
        }
    }

    #[test]
    fn drift_jitter_and_a_host_that_was_held_up_are_no_late_line() {
        assert!(run(|k| 0.02 * 2e-3 * f64::from(k)).iter().all(|d| *d == 0.0));
        assert!(run(|k| 8e-3 * f64::from(k * 7919 % 11) / 11.0).iter().all(|d| *d == 0.0));
        let held_up = |k: u32| if (1000..1100).contains(&k) { 2e-3 * f64::from(1100 - k) } else { 0.0 };
        assert!(run(held_up).iter().all(|d| *d == 0.0));
    }
}
