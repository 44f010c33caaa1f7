//! Leaps of the inertial readings, which show that there was a blow.
//!
//! Between two samples the filter uses the mean of the readings, as if they followed a straight line. The deviation
//! of a sample from the line through the two samples before it, `x - 2 y + z`, happened at an unknown time between
//! the samples, so that the integral of the interval is wrong by a share of it. White noise leaps too, and so does
//! vibration, whose errors cancel. Therefore only the part of a leap beyond the usual leaps counts.

use super::{coarse::Coarse, history::ImuEntry};
use crate::{types::Vector3, ukf::ProcessNoise};

/// Largest square of a leap of white noise, divided by the variance of the noise: 6 for `x - 2 y + z`, times the
/// quantile of a chi-square variable with 3 degrees of freedom at 1 - 1e-5.
const OF_NOISE: f64 = 6.0 * 25.9;
/// Squares of leaps below this many times their mean are usual.
const OF_USUAL: f64 = 9.0;
/// Time constant of the mean square, s.
const MEMORY: f64 = 0.5;
/// Share of the square of a leap that the integral of an interval misses: of the rate and of the specific force.
const MISSED: [f64; 2] = [0.01, 0.002];
/// Share of the square of the last leap that a repeated reading misses: the board or the line has held a sample, and the motion
/// meanwhile was not measured.
const HELD: f64 = 0.5;
/// A leap whose square is beyond the usual by this much is a blow, (rad/s)^2 and (m/s^2)^2.
const BLOW: [f64; 2] = [9.0, 900.0];

/// Mean squares of the leaps, (rad/s)^2 and (m/s^2)^2.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaps([f64; 2]);

impl Leaps {
    pub(super) const NONE: Self = Self([0.0; 2]);

    /// Squares, beyond the usual, of the leap to readings `dt` s after `before`, which came after `earlier`; and whether they
    /// repeat those before. Then the leap is the one before: how far the motion may have gone on.
    pub(super) fn excess(
        &mut self,
        (before, earlier): (&ImuEntry, &ImuEntry),
        gyro_i: &Vector3,
        force_i: &Vector3,
        noise: &ProcessNoise,
        dt: f64,
    ) -> ([Coarse; 2], bool) {
        if *gyro_i == before.gyro && *force_i == before.force {
            return (before.leap, true);
        }
        let gyro = gyro_i - 2.0 * before.gyro + earlier.gyro;
        let force = force_i - 2.0 * before.force + earlier.force;
        let squares = [gyro.norm_squared(), force.norm_squared()];
        let densities = [noise.gyro, noise.accelerometer];
        let mut excess = [Coarse::ZERO; 2];
        for (((usual, square), density), out) in
            self.0.iter_mut().zip(squares).zip(densities).zip(&mut excess)
        {
            let limit = OF_NOISE * density * density / dt + OF_USUAL * *usual;
            *out = Coarse::new(square - limit);
            *usual += (dt / MEMORY).min(1.0) * (square.min(limit) - *usual);
        }
        (excess, false)
    }
}

/// Whether a leap beyond the usual is a blow. After a blow the error of the state may be larger than its covariance
/// says.
pub(super) fn is_blow(leap: [Coarse; 2]) -> bool {
    leap.iter().zip(BLOW).any(|(leap, blow)| leap.get() > blow)
}

/// Variances of rate and specific force over the interval before a sample that its readings miss, (rad/s)^2 and (m/s^2)^2.
fn missed(sample: &ImuEntry) -> [f64; 2] {
    let [gyro, force] = sample.leap.map(Coarse::get);
    let [of_gyro, of_force] = if sample.held { [HELD; 2] } else { MISSED };
    [of_gyro * gyro, of_force * force]
}

/// Variance of the velocity that the readings over an interval of `dt` s miss because of a leap, (m/s)^2.
pub(super) fn missed_velocity(sample: &ImuEntry, dt: f64) -> f64 {
    let [_, force] = missed(sample);
    force * dt * dt
}

/// The noise over an interval of `dt` s before this sample.
pub(super) fn roughened(noise: &ProcessNoise, sample: &ImuEntry, dt: f64) -> ProcessNoise {
    let [gyro, force] = missed(sample);
    let rougher = |density: f64, missed: f64| libm::sqrt(density * density + missed * dt);
    ProcessNoise {
        gyro: rougher(noise.gyro, gyro),
        accelerometer: rougher(noise.accelerometer, force),
        ..*noise
    }
}
