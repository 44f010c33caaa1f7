//! A turn that the gyro shows and no rotor made: a blow, or a gyro whose bias has changed.
//!
//! A blow turns the vehicle, and poses show it too. Where they do not, it is the gyro that is off. It cannot be poses that
//! repeat themselves: the rotors make the turns that those hide.

use crate::{types::Vector3, vehicle::Vehicle};

/// An unexplained rate fades within this, s, and a torque that lasts longer is an offset of the model.
const FADES: f64 = 0.7;
/// Its largest value fades within this, s, where it may have been a bias.
const REMEMBERED: f64 = 4.0;
/// Changes of a gyro's bias are of this size, rad/s: noise makes less, a hand or a wall more.
const BIAS: (f64, f64) = (0.03, 0.35);
/// A bias is found within this, s.
const LONGEST: f64 = 10.0;
/// Rotations that are less apart than this, rad, tell nothing.
const LEAST: f64 = 0.01;
/// Nor does a component that is less than this part of the whole.
const MINOR: f64 = 0.4;
/// The rate beyond that which the rotors make, rad/s, IMU axes: now, and the largest of the last seconds about each axis.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GyroDoubt {
    offset_r: Vector3,
    rate_i: Vector3,
    largest_i: Vector3,
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

    /// Whether it explains how far the attitude by the gyro is from that of the poses, rad, IMU axes.
    pub(super) fn explains(&self, apart_i: &Vector3) -> bool {
        let least = LEAST.max(MINOR * apart_i.norm());
        apart_i.norm() > LEAST
            && self.largest_i.iter().zip(apart_i).all(|(&rate, angle)| {
                let of_a_bias = rate > BIAS.0 && rate < BIAS.1;
                angle.abs() < least || of_a_bias && angle.abs() < LONGEST * rate
            })
    }
}
