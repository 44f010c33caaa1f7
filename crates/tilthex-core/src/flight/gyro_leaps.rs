//! Leaps of the gyro: changes of its reading from one sample to the next.
//!
//! A torque changes the rate over many samples. A leap between two samples, with a steady rate before and after it, is noise or a
//! change of the bias.

use super::gyro_doubt::{BIAS, REMEMBERED};
use crate::types::Vector3;

/// A smaller leap, rad/s, is noise.
const LEAST: f64 = 0.05;
/// A leap that is smaller than the mean of all leaps multiplied by this is noise, too.
const UNUSUAL: f64 = 15.0;
/// Time constant of this mean, s.
const USUAL: f64 = 1.0;

/// The largest recent leap about each axis, rad/s, IMU axes, and what is needed to find it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GyroLeaps {
    largest_i: Vector3,
    /// Mean of all leaps, rad/s.
    usual_i: Vector3,
    /// The last reading, rad/s. None if readings are missing since then.
    gyro_i: Option<Vector3>,
    /// The last two differences of readings divided by their time, rad/s^2.
    turns_i: [Vector3; 2],
    /// Time between the last two readings, s.
    between: f64,
}

impl GyroLeaps {
    /// Takes a reading `dt` s after the last one, rad/s, IMU axes.
    pub(super) fn read(&mut self, gyro_i: &Vector3, dt: f64) {
        let Some(last_i) = self.gyro_i.replace(*gyro_i) else {
            // What the rate did in a gap is no leap.
            (self.turns_i, self.between) = ([Vector3::zeros(); 2], 0.0);
            return;
        };
        let turn_i = (gyro_i - last_i) / dt.max(f64::MIN_POSITIVE);
        let [before_i, at_i] = self.turns_i;
        for k in 0..3 {
            let (low, high) = (before_i[k].min(turn_i[k]), before_i[k].max(turn_i[k]));
            let leap = (at_i[k] - at_i[k].max(low).min(high)).abs() * self.between;
            let faded = self.largest_i[k] * (1.0 - dt / REMEMBERED);
            let least = LEAST.max(UNUSUAL * self.usual_i[k]);
            self.largest_i[k] = if leap > least && leap < BIAS.1 { leap.max(faded) } else { faded };
            self.usual_i[k] += (leap.min(BIAS.1) - self.usual_i[k]) * (dt / USUAL).min(1.0);
        }
        (self.turns_i, self.between) = ([at_i, turn_i], dt);
    }

    /// Readings are missing.
    pub(super) fn miss(&mut self) {
        self.gyro_i = None;
    }

    /// Forgets the leaps until now.
    pub(super) fn forget(&mut self) {
        self.largest_i = Vector3::zeros();
    }

    /// The largest recent leap about each axis that can be a change of the bias, rad/s, IMU axes; 0 if there is none.
    pub(super) fn largest_i(&self) -> Vector3 {
        self.largest_i.map(|leap| if leap > LEAST { leap } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const DT: f64 = 0.002;

    proptest! {
        /// Noise is no leap, however large it is.
        #[test]
        fn noise_does_not_leap(noise in prop::collection::vec(-1.0..1.0_f64, 1000), size in 0.001..0.1_f64) {
            let mut leaps = GyroLeaps::default();
            for (k, x) in noise.iter().enumerate() {
                leaps.read(&Vector3::new(size * x, 0.0, 0.0), DT);
                if k == 500 {
                    leaps.forget();
                }
            }
            prop_assert_eq!(leaps.largest_i(), Vector3::zeros());
        }

        /// What the rate did while readings were missing is no leap.
        #[test]
        fn a_gap_is_no_leap(turn in -0.3..0.3_f64) {
            let mut leaps = GyroLeaps::default();
            for k in 0..100 {
                if k == 50 {
                    leaps.miss();
                }
                leaps.read(&Vector3::new(if k < 50 { 0.0 } else { turn }, 0.0, 0.0), DT);
            }
            prop_assert_eq!(leaps.largest_i(), Vector3::zeros());
        }

        /// A leap is found, with its size, whatever turns the vehicle; a torque that begins at once is none.
        #[test]
        fn a_torque_hides_no_leap(
            leap in 0.06..0.3_f64,
            torque_rate in -50.0..50.0_f64,
            axis in 0..3_usize,
            begins in 5..40_usize,
        ) {
            let mut leaps = GyroLeaps::default();
            let mut gyro_i = Vector3::zeros();
            for k in 0..50 {
                gyro_i[axis] += if k >= begins { torque_rate * DT } else { 0.0 };
                leaps.read(&gyro_i, DT);
            }
            prop_assert_eq!(leaps.largest_i(), Vector3::zeros());
            for k in 0..50 {
                gyro_i[axis] += torque_rate * DT + if k == begins { leap } else { 0.0 };
                leaps.read(&gyro_i, DT);
            }
            prop_assert!((leaps.largest_i() - Vector3::ith(axis, leap)).norm() < 0.01 * leap);
        }
    }
}
