//! Chi-square thresholds.

use libm::{erf, exp, sqrt};

/// Probability that a chi-square variable with `freedom` = 3 or 6 degrees stays below `x`.
fn chi_square_cdf(x: f64, freedom: u32) -> f64 {
    let h = 0.5 * x;
    match freedom {
        3 => erf(sqrt(h)) - sqrt(4.0 * h / core::f64::consts::PI) * exp(-h),
        _ => 1.0 - exp(-h) * (1.0 + h + 0.5 * h * h),
    }
}

/// The value below which a chi-square variable with 3 or 6 degrees of freedom stays with `probability`; infinite for
/// 1.
pub(super) fn chi_square_quantile(probability: f64, freedom: u32) -> f64 {
    if probability >= 1.0 {
        return f64::INFINITY;
    }
    let (mut low, mut high) = (0.0, 200.0);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if chi_square_cdf(middle, freedom) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the tables.
    #[test]
    fn quantiles() {
        for (probability, freedom, expected) in [
            (0.95, 3, 7.814_727_903),
            (0.99, 6, 16.811_893_83),
            (0.999, 3, 16.266_236_20),
            (0.5, 6, 5.348_120_627),
        ] {
            let found = chi_square_quantile(probability, freedom);
            assert!((found - expected).abs() < 1e-8, "{probability} {freedom}: {found}");
        }
    }
}
