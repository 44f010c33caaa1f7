//! A turn that the gyro shows and the rotors did not make: a blow, or a change of the gyro's bias.
//!
//! A blow turns the vehicle, and the poses show that turn. If they do not show it, the gyro is wrong. Poses that repeat
//! themselves are another case: they hide turns that the rotors make.
//!
//! A push hides a change of the bias, but not its leap: a torque changes the rate over many samples, a bias may change between two.

use super::gyro_leaps::GyroLeaps;
use crate::{types::Vector3, vehicle::Vehicle};

/// Time constant of the unexplained rate, s. A torque that lasts longer is an error of the model.
const FADES: f64 = 0.7;
/// Time constant of its largest value, s, if that can be a change of the bias.
pub(super) const REMEMBERED: f64 = 12.0;
/// Smallest and largest change of a gyro's bias, rad/s. Noise causes smaller ones; a hand or a wall causes larger
/// ones.
pub(super) const BIAS: (f64, f64) = (0.03, 0.35);
/// The angle between gyro and poses is at most this time, s, multiplied by the change of the bias.
const LONGEST: f64 = 10.0;
/// A smaller angle than this between gyro and poses, rad, is not used.
pub(super) const LEAST: f64 = 0.01;
/// A component that is less than this part of the angle is not used.
const MINOR: f64 = 0.4;

/// The angular rate that the rotors do not explain, rad/s, IMU axes: now, and its largest recent value about each axis. And
/// the leaps of the gyro.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GyroDoubt {
    offset_r: Vector3,
    rate_i: Vector3,
    largest_i: Vector3,
    leaps: GyroLeaps,
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
        self.leaps.read(gyro_i, dt);
    }

    /// The vehicle is at rest: what leapt before is in its bias.
    pub(super) fn rests(&mut self) {
        self.leaps.forget();
    }

    /// Readings are missing.
    pub(super) fn miss(&mut self) {
        self.leaps.miss();
    }

    /// Whether it explains the angle between the attitude by the gyro and that of the poses, rad, IMU axes.
    pub(super) fn explains(&self, apart_i: &Vector3) -> bool {
        let least = LEAST.max(MINOR * apart_i.norm());
        let leap_i = self.leaps.largest_i();
        apart_i.norm() > LEAST
            && (0..3).all(|k| {
                let (rate, leap, angle) = (self.largest_i[k], leap_i[k], apart_i[k].abs());
                let of_a_bias = rate > BIAS.0 && rate < BIAS.1 && angle < LONGEST * rate;
                angle < least || of_a_bias || angle < LONGEST * leap
            })
    }
}
