//! A small seeded generator for simulated sensors: the same numbers on every machine.

use crate::{so3::polynomial, types::Vector3};
use core::f64::consts::TAU;
use libm::sqrt;

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
        let [[first], [second]] = self.normals();
        self.spare = Some(second);
        first
    }

    /// Three independent normal numbers of deviation `sigma`.
    pub fn normal3(&mut self, sigma: f64) -> Vector3 {
        Vector3::new(self.normal(), self.normal(), self.normal()) * sigma
    }

    /// Pairs of independent normal numbers.
    #[inline]
    fn normals<const N: usize>(&mut self) -> [[f64; N]; 2] {
        let (mut radius, mut cosine, mut sine) = ([0.0; N], [0.0; N], [0.0; N]);
        for (above_0, turns) in radius.iter_mut().zip(&mut sine) {
            *above_0 = 1.0 - self.uniform();
            *turns = self.uniform();
        }
        logarithms(&mut radius);
        radius.iter_mut().for_each(|x| *x = sqrt(-2.0 * *x));
        for (cosine, sine) in cosine.iter_mut().zip(&mut sine) {
            [*cosine, *sine] = direction(*sine);
        }
        for ((radius, cosine), sine) in radius.iter().zip(&mut cosine).zip(&mut sine) {
            *cosine *= radius;
            *sine *= radius;
        }
        [cosine, sine]
    }
}

/// Pairs in a block of [`Normals`].
const BLOCK: usize = 8;

/// The numbers of [`Random::normal`], drawn in blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normals {
    random: Random,
    block: [f64; 2 * BLOCK],
    /// How many numbers of the block have been taken.
    taken: usize,
}

impl Normals {
    /// A generator; each seed gives other numbers.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { random: Random::new(seed), block: [0.0; 2 * BLOCK], taken: 2 * BLOCK }
    }

    /// Normal with mean 0 and deviation 1.
    #[inline]
    pub fn one(&mut self) -> f64 {
        let number = self.block.get(self.taken).copied().unwrap_or_else(|| self.refill());
        self.taken += 1;
        number
    }

    /// Three independent normal numbers of deviation `sigma`.
    #[inline]
    pub fn three(&mut self, sigma: f64) -> Vector3 {
        Vector3::new(self.one(), self.one(), self.one()) * sigma
    }

    /// The first number of a new block.
    #[cold]
    fn refill(&mut self) -> f64 {
        let [first, second] = self.random.normals::<BLOCK>();
        for (pair, normals) in self.block.chunks_exact_mut(2).zip(first.into_iter().zip(second)) {
            pair.copy_from_slice(&[normals.0, normals.1]);
        }
        self.taken = 0;
        let [number, ..] = self.block;
        number
    }
}

/// Replaces each number by its natural logarithm. It is not inlined because the compiler vectorises it if it is not.
#[inline(never)]
fn logarithms<const N: usize>(numbers: &mut [f64; N]) {
    numbers.iter_mut().for_each(|x| *x = ln(*x));
}

/// Natural logarithm of a normal positive number, without a branch: that of `1 + f`, between the roots of 1/2 and of 2, from the
/// series of the area tangent of `f / (2 + f)` (fdlibm, e_log.c).
#[inline]
fn ln(x: f64) -> f64 {
    const ONE: u64 = 1023 << 52;
    const ROOT: u64 = 0x3FE6_A09E_0000_0000;
    let bits = x.to_bits() + (ONE - ROOT);
    // The exponent in the last bits of 2^52.
    let exponent = f64::from_bits((bits >> 52) | 0x4330_0000_0000_0000) - (4_503_599_627_370_496.0 + 1023.0);
    let f = f64::from_bits((bits & (u64::MAX >> 12)) + ROOT) - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let series = polynomial(
        z,
        [
            6.666_666_666_666_735e-1,
            3.999_999_999_940_942e-1,
            2.857_142_874_366_239e-1,
            2.222_219_843_214_978_4e-1,
            1.818_357_216_161_805e-1,
            1.531_383_769_920_937_3e-1,
            1.479_819_860_511_658_6e-1,
        ],
    );
    let half_square = 0.5 * f * f;
    // ln 2 in two parts.
    let (high, low) = (6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10);
    s * (half_square + z * series) + exponent * low - half_square + f + exponent * high
}

/// Cosine and sine of an angle in turns, from 0 to 1, without a branch (polynomials of fdlibm, k_cos.c and k_sin.c).
#[inline]
fn direction(turns: f64) -> [f64; 2] {
    // The nearest quarter, in the last bits of 1.5 * 2^52.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let rounded = 4.0 * turns + ROUND;
    let quarter = rounded.to_bits();
    let angle = TAU * (turns - 0.25 * (rounded - ROUND));
    let z = angle * angle;
    let sine = polynomial(
        z,
        [
            -1.666_666_666_666_663_2e-1,
            8.333_333_333_322_49e-3,
            -1.984_126_982_985_795e-4,
            2.755_731_370_707_007e-6,
            -2.505_076_025_340_686_3e-8,
            1.589_690_995_211_55e-10,
        ],
    );
    let cosine = polynomial(
        z,
        [
            4.166_666_666_666_66e-2,
            -1.388_888_888_887_411e-3,
            2.480_158_728_947_673e-5,
            -2.755_731_435_139_066_3e-7,
            2.087_572_321_298_175e-9,
            -1.135_964_755_778_819_5e-11,
        ],
    );
    let sine = (angle + angle * z * sine).to_bits();
    let cosine = (1.0 - (0.5 * z - z * z * cosine)).to_bits();
    let odd = 0u64.wrapping_sub(quarter & 1);
    let negative = |quarter: u64| (quarter & 2) << 62;
    [
        f64::from_bits(((sine & odd) | (cosine & !odd)) ^ negative(quarter.wrapping_add(1))),
        f64::from_bits(((cosine & odd) | (sine & !odd)) ^ negative(quarter)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn logarithm_and_direction_are_exact_to_rounding(seed in any::<u64>(), small in 1u64..1 << 53) {
            let x = small as f64 / (1u64 << 53) as f64;
            prop_assert!((ln(x) - libm::log(x)).abs() <= 2.0 * f64::EPSILON * libm::log(x).abs(), "{x:e}");
            let turns = Random::new(seed).uniform();
            let (sine, cosine) = libm::sincos(TAU * turns);
            let [found_cosine, found_sine] = direction(turns);
            // The angle itself is rounded before the library's functions.
            prop_assert!((found_sine - sine).abs() < 1e-15 && (found_cosine - cosine).abs() < 1e-15, "{turns:e}");
        }

        #[test]
        fn blocks_hold_the_same_numbers(seed in any::<u64>()) {
            let (mut one_by_one, mut blocks) = (Random::new(seed), Normals::new(seed));
            for _ in 0..50 {
                prop_assert_eq!(one_by_one.normal(), blocks.one());
            }
        }
    }

    #[test]
    fn quarters_of_a_turn_are_exact() {
        for (turns, expected) in
            [(0.0, [1.0, 0.0]), (0.25, [0.0, 1.0]), (0.5, [-1.0, 0.0]), (0.75, [0.0, -1.0])]
        {
            assert_eq!(direction(turns), expected);
        }
        assert_eq!(ln(1.0), 0.0);
    }
}
