//! Histograms of the loop's times, in constant memory.

use hdrhistogram::Histogram as Counts;

use crate::sleeper::Nanos;

/// Longest time that is distinguished; longer times count as this.
const LONGEST: Nanos = 60_000_000_000;

/// A histogram of times with a resolution of 1 %.
#[derive(Clone, Debug)]
pub struct Histogram(Counts<u32>);

/// Quantiles of a histogram, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Quantiles {
    /// Number of recorded times.
    pub count: u64,
    /// Half of the times are at most this.
    pub p50: Nanos,
    /// 99 % of the times are at most this.
    pub p99: Nanos,
    /// 99.9 % of the times are at most this.
    pub p999: Nanos,
    /// The longest time.
    pub max: Nanos,
}

impl Default for Histogram {
    fn default() -> Self {
        let bounds = Counts::new_with_bounds(1, LONGEST, 2);
        Self(bounds.unwrap_or_else(|_| unreachable!("the bounds are valid constants")))
    }
}

impl Histogram {
    /// Records one time. Safe in the loop: it neither allocates nor fails.
    pub fn record(&mut self, ns: Nanos) {
        self.0.saturating_record(ns);
    }

    /// The quantiles of all times until now.
    #[must_use]
    pub fn quantiles(&self) -> Quantiles {
        Quantiles {
            count: self.0.len(),
            p50: self.0.value_at_quantile(0.5),
            p99: self.0.value_at_quantile(0.99),
            p999: self.0.value_at_quantile(0.999),
            max: self.0.max(),
        }
    }
}

impl std::fmt::Display for Quantiles {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let us = |ns: Nanos| ns as f64 * 1e-3;
        write!(
            f,
            "p50 {:.1}  p99 {:.1}  p99.9 {:.1}  max {:.1} us",
            us(self.p50),
            us(self.p99),
            us(self.p999),
            us(self.max)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn quantiles_are_within_one_percent_of_the_sorted_sample(
            mut times in prop::collection::vec(1u64..1_000_000_000, 1..500),
        ) {
            let mut histogram = Histogram::default();
            for &t in &times {
                histogram.record(t);
            }
            times.sort_unstable();
            let exact = |q: f64| times[((q * times.len() as f64).ceil() as usize).clamp(1, times.len()) - 1];
            let found = histogram.quantiles();
            prop_assert_eq!(found.count, times.len() as u64);
            for (got, q) in [(found.p50, 0.5), (found.p99, 0.99), (found.p999, 0.999), (found.max, 1.0)] {
                let want = exact(q);
                prop_assert!(got >= want && got as f64 <= want as f64 * 1.01 + 1.0, "{} for {}", got, want);
            }
        }
    }

    #[test]
    fn beyond_the_range_counts_as_the_range() {
        let mut histogram = Histogram::default();
        histogram.record(u64::MAX);
        assert_eq!(histogram.quantiles().count, 1);
    }
}
