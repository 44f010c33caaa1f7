//! A small seeded generator for simulated sensors: the same numbers on every machine.

use crate::types::Vector3;
use core::f64::consts::TAU;
use libm::{log, sincos, sqrt};

/// SplitMix64 (Steele, Lea, Flood 2014) with normal variates by Box and Muller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Random {
    state: u64,
    spare: Option<f64>,
}

impl Random {
    /// A generator; each seed gives other numbers.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { state: seed, spare: None }
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in `[0, 1)`.
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Normal with mean 0 and deviation 1.
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = sqrt(-2.0 * log(1.0 - self.uniform()));
        let (sine, cosine) = sincos(TAU * self.uniform());
        self.spare = Some(radius * sine);
        radius * cosine
    }

    /// Normal with mean 0 and deviation `sigma`; a deviation of 0 draws no number.
    #[inline]
    pub fn noise(&mut self, sigma: f64) -> f64 {
        if sigma == 0.0 { 0.0 } else { sigma * self.normal() }
    }

    /// Three independent [`Self::noise`].
    pub fn normal3(&mut self, sigma: f64) -> Vector3 {
        Vector3::new(self.noise(sigma), self.noise(sigma), self.noise(sigma))
    }
}
