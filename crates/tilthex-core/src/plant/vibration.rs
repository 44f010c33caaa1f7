//! Vibration of the IMU at the rotors' frequencies.

use crate::{
    types::{MAX_ROTORS, RotorVector, Vector3},
    vehicle::Vehicle,
};
use core::f64::consts::TAU;
use libm::{cos, floor, sin};

/// Angles of the rotors, turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    turns: [f64; MAX_ROTORS],
}

impl Default for Angles {
    fn default() -> Self {
        // The golden ratio distributes the initial angles of the rotors.
        Self { turns: core::array::from_fn(|i| i as f64 * 0.618_033_988_749_894_9 % 1.0) }
    }
}

impl Angles {
    /// Turns the rotors for a time at speeds in Hz.
    pub fn step(&mut self, speeds: &RotorVector, dt: f64) {
        for (turns, speed) in self.turns.iter_mut().zip(speeds.iter()) {
            *turns += speed * dt;
            *turns -= floor(*turns);
        }
    }

    /// Acceleration at the IMU, m/s^2, robot coordinates. The imbalance of each rotor rotates in the plane of its
    /// disc. Its amplitude is `at_100_hz` at 100 Hz and grows with the square of the speed (a centripetal force; ISO
    /// 21940-11, 5.1).
    #[must_use]
    pub fn acceleration(&self, vehicle: &Vehicle, speeds: &RotorVector, at_100_hz: f64) -> Vector3 {
        if at_100_hz == 0.0 {
            return Vector3::zeros();
        }
        vehicle.rotors().iter().zip(speeds.iter()).zip(self.turns.iter()).fold(
            Vector3::zeros(),
            |sum, ((rotor, w), turns)| {
                let part = w / 100.0;
                let (first, second) = disc(&rotor.axis_r);
                let angle = TAU * turns;
                sum + at_100_hz * part * part * (cos(angle) * first + sin(angle) * second)
            },
        )
    }
}

/// Two unit vectors that span the plane normal to an axis.
fn disc(axis: &Vector3) -> (Vector3, Vector3) {
    let side = if libm::fabs(axis.x) < 0.9 { Vector3::x() } else { Vector3::y() };
    let first = axis.cross(&side);
    let first = first / first.norm();
    (first, axis.cross(&first))
}
