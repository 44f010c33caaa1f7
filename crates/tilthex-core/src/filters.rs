//! The low-pass and the dead zone between the observer and the admittance filter ("Practical Implementation" in the
//! paper; docs/laws.md).

use crate::{
    Error,
    error::check_range,
    types::{Vector3, Vector6},
};
use core::f64::consts::TAU;

/// A first-order low-pass on six numbers, discretised exactly for any period.
///
/// ```
/// use tilthex_core::{Vector6, filters::{LowPass, LowPassState}};
///
/// let filter = LowPass::new(1.0)?;
/// let (mut state, step) = (LowPassState::default(), Vector6::repeat(1.0));
/// // After one time constant, 1/(2 pi f), the output has come 63 % of the way.
/// let output = filter.step(&mut state, &step, 1.0 / std::f64::consts::TAU);
/// assert!((output[0] - 0.632).abs() < 1e-3);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LowPass {
    rate: f64,
}

/// The output of a [`LowPass`]; starts at zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LowPassState {
    /// The filtered value.
    pub output: Vector6,
}

impl LowPass {
    /// A low-pass with a cut-off frequency in Hz. With zero the output is the input.
    ///
    /// # Errors
    /// If the cut-off is negative or not finite.
    pub fn new(cut_off_hz: f64) -> Result<Self, Error> {
        check_range("low_pass_hz", cut_off_hz, 0.0, 1e6)?;
        Ok(Self { rate: TAU * cut_off_hz })
    }

    /// Filters one sample that was constant over the last `dt` seconds.
    #[inline]
    pub fn step(&self, state: &mut LowPassState, input: &Vector6, dt: f64) -> Vector6 {
        if self.rate == 0.0 {
            state.output = *input;
        } else {
            state.output += (input - state.output) * lag_fraction(self.rate, dt);
        }
        state.output
    }
}

/// The part of a step that a first-order lag of the given rate (1/s) has made after `dt`.
#[must_use]
pub fn lag_fraction(rate: f64, dt: f64) -> f64 {
    -libm::expm1(-rate * dt)
}

/// Shortens `v` by `threshold`; a vector that is not longer becomes zero. The result is continuous.
#[must_use]
#[inline]
pub fn dead_zone(v: &Vector3, threshold: f64) -> Vector3 {
    let norm = v.norm();
    if norm > threshold { v * (1.0 - threshold / norm) } else { Vector3::zeros() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn dead_zone_is_continuous_and_contracts(
            a in prop::array::uniform3(-2.0..2.0f64), d in prop::array::uniform3(-1e-6..1e-6f64),
            threshold in 0.0..1.0f64,
        ) {
            let (a, d) = (Vector3::from(a), Vector3::from(d));
            let (x, y) = (dead_zone(&a, threshold), dead_zone(&(a + d), threshold));
            prop_assert!((x - y).norm() <= d.norm() * (1.0 + 1e-9) + 1e-15);
            prop_assert!((x.norm() - (a.norm() - threshold).max(0.0)).abs() < 1e-12);
        }

        #[test]
        fn low_pass_does_not_depend_on_the_period(hz in 0.1..200.0f64, dt in 1e-4..1e-2f64, n in 1usize..20) {
            let filter = LowPass::new(hz).unwrap();
            let (mut once, mut often) = (LowPassState::default(), LowPassState::default());
            let input = Vector6::repeat(1.0);
            filter.step(&mut once, &input, dt * n as f64);
            for _ in 0..n {
                filter.step(&mut often, &input, dt);
            }
            prop_assert!((once.output - often.output).amax() < 1e-12);
        }
    }
}
