//! A turn that the gyro shows and the rotors did not make: a blow, or a change of the gyro's bias.
//!
//! A blow turns the vehicle, and the poses show that turn. If they do not show it, the gyro is wrong. Poses that repeat
//! themselves are another case: they hide turns that the rotors make.
//!
//! A push hides a change of the bias, but not its leap: a torque changes the rate over many samples, a bias may change between two.

use crate::{types::Vector3, vehicle::Vehicle};

/// Time constant of the unexplained rate, s. A torque that lasts longer is an error of the model.
const FADES: f64 = 0.7;
/// Time constant of its largest value, s, if that can be a change of the bias.
const REMEMBERED: f64 = 12.0;
/// A smaller leap of the gyro between two samples, rad/s, is noise; and so is one that is smaller than the usual leap multiplied by
/// this.
const LEAP: (f64, f64) = (0.05, 15.0);
/// Time constant of the usual leap, s.
const USUAL: f64 = 1.0;
/// Smallest and largest change of a gyro's bias, rad/s. Noise causes smaller ones; a hand or a wall causes larger
/// ones.
pub(super) const BIAS: (f64, f64) = (0.03, 0.35);
/// The angle between gyro and poses is at most this time, s, multiplied by the change of the bias.
const LONGEST: f64 = 10.0;
/// A smaller angle than this between gyro and poses, rad, is not used.
pub(super) const LEAST: f64 = 0.01;
/// A component that is less than this part of the angle is not used.
const MINOR: f64 = 0.4;

/// The angular rate that the rotors do not explain, rad/s, IMU axes: now, and its largest recent value about each axis. The largest
/// recent leap of the gyro about each axis, rad/s.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GyroDoubt {
    offset_r: Vector3,
    rate_i: Vector3,
    largest_i: Vector3,
    leap_i: Vector3,
    /// Mean of all leaps, rad/s.
    usual_i: Vector3,
    /// The last reading, rad/s, if none is missing since then; and the last two differences of readings divided by their time, rad/s^2.
    gyro_i: Option<Vector3>,
    turns_i: [Vector3; 2],
    /// Time between the last two readings, s.
    between: f64,
}

impl GyroDoubt {
    /// Takes the external torque at the centre of mass, N m, robot axes, over `dt` s.
    pub(super) fn feel(&mut self, torque_r: &Vector3, vehicle: &Vehicle, dt: f64) {
        let sudden_r = torque_r - self.offset_r;
        self.offset_r += sudden_r * (dt / FADES);
        let turn_i = vehicle.imu().rotation_r.transpose() * (vehicle.inertia_inverse() * sudden_r);
        self.rate_i = self.rate_i * (1.0 - dt / FADES) + turn_i * dt;
        for (largest, rate) in self.largest_i.iter_mut().zip(&self.rate_i) {
            let fades = if *largest > BIAS.1 { FADES } else { REMEMBERED };
            *largest = rate.abs().max(*largest * (1.0 - dt / fades));
        }
    }

    /// Takes a reading of the gyro `dt` s after the last one, rad/s, IMU axes.
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
            let faded = self.leap_i[k] * (1.0 - dt / REMEMBERED);
            let least = LEAP.0.max(LEAP.1 * self.usual_i[k]);
            self.leap_i[k] = if leap > least && leap < BIAS.1 { leap.max(faded) } else { faded };
            self.usual_i[k] += (leap.min(BIAS.1) - self.usual_i[k]) * (dt / USUAL).min(1.0);
        }
        (self.turns_i, self.between) = ([at_i, turn_i], dt);
    }

    /// The vehicle is at rest: what leapt before is in its bias.
    pub(super) fn rests(&mut self) {
        self.leap_i = Vector3::zeros();
    }

    /// Readings are missing.
    pub(super) fn miss(&mut self) {
        self.gyro_i = None;
    }

    /// Whether it explains the angle between the attitude by the gyro and that of the poses, rad, IMU axes.
    pub(super) fn explains(&self, apart_i: &Vector3) -> bool {
        let least = LEAST.max(MINOR * apart_i.norm());
        apart_i.norm() > LEAST
            && (0..3).all(|k| {
                let (rate, leap, angle) = (self.largest_i[k], self.leap_i[k], apart_i[k].abs());
                let of_a_bias = rate > BIAS.0 && rate < BIAS.1 && angle < LONGEST * rate;
                angle < least || of_a_bias || leap > LEAP.0 && angle < LONGEST * leap
            })
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
            let mut doubt = GyroDoubt::default();
            for (k, x) in noise.iter().enumerate() {
                doubt.read(&Vector3::new(size * x, 0.0, 0.0), DT);
                if k == 500 {
                    doubt.rests();
                }
            }
            prop_assert!(!doubt.explains(&Vector3::new(0.1, 0.0, 0.0)));
        }

        /// What the rate did while readings were missing is no leap.
        #[test]
        fn a_gap_is_no_leap(turn in -0.3..0.3_f64) {
            let mut doubt = GyroDoubt::default();
            for k in 0..100 {
                if k == 50 {
                    doubt.miss();
                }
                doubt.read(&Vector3::new(if k < 50 { 0.0 } else { turn }, 0.0, 0.0), DT);
            }
            prop_assert!(!doubt.explains(&Vector3::new(0.1, 0.0, 0.0)));
        }

        /// The leap of a bias is found whatever turns the vehicle; a torque that begins at once is none.
        #[test]
        fn a_torque_hides_no_leap(
            leap in 0.06..0.3_f64,
            torque_rate in -50.0..50.0_f64,
            axis in 0..3_usize,
            begins in 5..40_usize,
        ) {
            let mut doubt = GyroDoubt::default();
            let mut gyro_i = Vector3::zeros();
            let apart_i = Vector3::ith(axis, 0.1);
            for k in 0..50 {
                gyro_i[axis] += if k >= begins { torque_rate * DT } else { 0.0 };
                doubt.read(&gyro_i, DT);
            }
            prop_assert!(!doubt.explains(&apart_i));
            for k in 0..50 {
                gyro_i[axis] += torque_rate * DT + if k == begins { leap } else { 0.0 };
                doubt.read(&gyro_i, DT);
            }
            prop_assert!(doubt.explains(&apart_i) && !doubt.explains(&Vector3::ith((axis + 1) % 3, 0.1)));
        }
    }
}
