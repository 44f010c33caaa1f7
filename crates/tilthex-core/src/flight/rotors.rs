//! The expected speeds of the rotors: a model that checks the measurements, and replaces those that are missing.

use super::{LONG_AGO, Motor};
use crate::{
    Vehicle,
    filters::lag_fraction,
    plant::Past,
    supervisor::limits::{MOTORS_FRESH, STOPPED, VEHICLE_WATCHDOG, WRONG_SPEED},
    types::{MAX_ROTORS, RotorVector},
};
use libm::fabs;

/// A rotor may be as much faster than its model.
const FASTER: f64 = 2.0;

/// The model can show whether a motor has stopped if the motor is faster than this, Hz.
const TELLS: f64 = 10.0;
/// Rate at which a motor's gain is learnt, 1/s, and the smallest gain that is compensated.
const GAIN: (f64, f64) = (10.0, 0.5);

/// Motors whose measured speeds are unlike the model's: bit `i` is that of motor `i` (from 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Unlike {
    /// It measures standstill. If half of the motors do, the commands do not arrive, and no bit is set.
    pub(super) stopped: u16,
    /// Its speed is far from the model's.
    pub(super) wrong: u16,
}

/// The commanded speeds after each rotor's lag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RotorModel {
    rate: f64,
    lowest: RotorVector,
    /// Largest speeds, Hz.
    highest: RotorVector,
    /// The last command that can have reached the vehicle, and for how long no command has.
    reached: RotorVector,
    unreached: f64,
    expected: RotorVector,
    /// Measured speeds divided by the model's, up to 1.
    gain: RotorVector,
    /// Whether the line is full of garbage, some of which looks like measurements because there is no checksum.
    garbled: bool,
    /// Bit `i` is set if the data of motor `i` (from 0) are not trusted.
    doubted: u16,
    /// Each rotor's last speed that it can have, Hz, and when it arrived, s.
    possible: [(f64, f64); MAX_ROTORS],
    /// Bit `i` is set if the newest speed of motor `i` (from 0) is one that its rotor cannot have.
    impossible: u16,
    /// How much older a measured speed is than a sample that arrives with it, s; 0 if speeds are taken as measured.
    age: f64,
    /// Past expected speeds; kept if speeds are brought to another time.
    past: Past,
}

impl RotorModel {
    /// Rotors at rest.
    #[must_use]
    pub(super) fn new(vehicle: &Vehicle, age: f64) -> Self {
        let constant = vehicle.rotor_time_constant();
        let zero = RotorVector::zeros();
        let (lowest, highest) = vehicle.speed_limits();
        let rate = if constant > 0.0 { 1.0 / constant } else { 1e4 };
        Self {
            rate,
            lowest,
            highest,
            reached: zero,
            unreached: 0.0,
            expected: zero,
            gain: RotorVector::repeat(1.0),
            garbled: false,
            doubted: 0,
            possible: [(0.0, LONG_AGO); MAX_ROTORS],
            impossible: 0,
            age,
            past: Past::default(),
        }
    }

    /// Rotors that already turn at the speeds of a command, Hz.
    pub(super) fn begin_at(&mut self, speeds: &RotorVector) {
        (self.reached, self.expected) = (*speeds, *speeds);
    }

    /// Moves by `dt` seconds with a command, Hz. Without a line no command reaches the vehicle.
    pub(super) fn step(&mut self, command: &RotorVector, line: bool, dt: f64) {
        if line {
            (self.reached, self.unreached) = (*command, 0.0);
        } else {
            self.unreached += dt;
            if self.unreached > VEHICLE_WATCHDOG {
                self.reached = self.reached.inf(&self.lowest);
            }
        }
        self.expected += (self.reached - self.expected) * lag_fraction(self.rate, dt);
        if self.age > 0.0 {
            self.past.push(&self.expected, dt);
        }
    }

    /// Sets whether the motors' measurements are garbled from now on; then none of them is used.
    pub(super) fn set_garbled(&mut self, garbled: bool) {
        self.garbled = garbled;
    }

    /// Sets the motors whose data are not trusted from now on.
    pub(super) fn set_doubted(&mut self, doubted: u16) {
        self.doubted = doubted;
    }

    /// Judges the newest speeds. No command changes a rotor's speed faster than its lag, so that equal wrong measurements are
    /// not believed, however many. The speed that the model expects is always possible; whether a rotor stands still is judged
    /// elsewhere.
    fn judge(&mut self, motors: &[Motor]) {
        let model = self.expected.as_slice().iter().zip(self.gain.as_slice());
        let limits = self.lowest.as_slice().iter().zip(self.highest.as_slice());
        let rotors = model.zip(limits).zip(&mut self.possible);
        for (i, (motor, (((expected, gain), (lowest, highest)), last))) in
            motors.iter().zip(rotors).enumerate()
        {
            let expected = expected * gain;
            let still = fabs(motor.speed) < STOPPED * fabs(expected);
            let near = fabs(motor.speed - expected) <= WRONG_SPEED;
            let reachable = |(speed, time): (f64, f64)| {
                let part = lag_fraction(FASTER * self.rate, motor.heard - time);
                let slowest = speed + (lowest.min(0.0) - speed) * part - WRONG_SPEED;
                let fastest = speed + (highest - speed) * part + WRONG_SPEED;
                (slowest..=fastest).contains(&motor.speed)
            };
            if still || near || reachable(*last) {
                *last = (motor.speed, motor.heard);
                self.impossible &= !(1 << i);
            } else {
                *last = (expected, motor.heard);
                self.impossible |= 1 << i;
            }
        }
    }

    /// The speeds that the model expects, Hz.
    pub(super) fn expected(&self) -> RotorVector {
        self.expected.component_mul(&self.gain)
    }

    fn is_measured(&self, motor: &Motor, now: f64) -> bool {
        !self.garbled && now - motor.heard <= MOTORS_FRESH
    }

    /// Learns by how much motors turn too slowly. `wrong_speeds` is the number of motors with wrong speeds; it is `None` while the
    /// motors have no such fault.
    pub(super) fn adapt(&mut self, motors: &[Motor], now: f64, wrong_speeds: Option<usize>, dt: f64) {
        let (rate, least) = GAIN;
        if self.garbled || wrong_speeds.is_none_or(|wrong| 2 * wrong >= motors.len()) {
            return;
        }
        let rotors = self.gain.iter_mut().zip(self.expected.iter()).zip(motors).enumerate();
        for (i, ((gain, expected), motor)) in rotors {
            let possible = self.impossible >> i & 1 == 0;
            if possible && now - motor.heard <= MOTORS_FRESH && fabs(*expected) > TELLS {
                *gain += (motor.speed / expected - *gain) * lag_fraction(rate, dt);
                *gain = gain.max(least).min(1.0);
            }
        }
    }

    /// Commands, Hz, with which motors that turn too slowly reach the wanted speeds.
    #[must_use]
    pub(super) fn made_up(&self, wanted: &RotorVector) -> RotorVector {
        wanted.component_div(&self.gain)
    }

    /// Measured speeds, Hz, at the time `at` of an inertial sample, s. The model replaces old and impossible ones.
    ///
    /// If their age is known, the change that the model expects between the two times is added.
    #[must_use]
    pub(super) fn speeds(&mut self, motors: &[Motor], now: f64, at: f64) -> RotorVector {
        self.judge(motors);
        let mut speeds = RotorVector::zeros();
        let model = self.expected.as_slice().iter().zip(self.gain.as_slice());
        let expected_at = |age: f64, i: usize| self.past.at(age).and_then(|w| w.get(i).copied());
        for (i, ((speed, (expected, gain)), motor)) in
            speeds.as_mut_slice().iter_mut().zip(model).zip(motors).enumerate()
        {
            let believed = (self.doubted | self.impossible) >> i & 1 == 0 && self.is_measured(motor, now);
            let changed = |(later, earlier): (f64, f64)| gain * (later - earlier);
            *speed = if believed {
                let since = || expected_at(now - at, i).zip(expected_at(now - motor.heard + self.age, i));
                motor.speed + if self.age > 0.0 { since().map_or(0.0, changed) } else { 0.0 }
            } else {
                expected * gain
            };
        }
        speeds
    }

    /// Number of the motors in [`Unlike::wrong`] whose data are trusted.
    #[must_use]
    pub(super) fn wrong_speeds(&self, wrong: u16) -> usize {
        (wrong & !self.doubted).count_ones() as usize
    }

    /// Rotor speeds, Hz, while a model replaces the IMU: a rotor that measures standstill counts as turning, unless its motor
    /// says that it has stopped. Without an IMU nothing shows whether it lifts, and a model that believes a false measurement
    /// turns the vehicle over within 0.1 s.
    #[must_use]
    pub(super) fn turning(&self, motors: &[Motor], speeds: &RotorVector) -> RotorVector {
        let (expected, mut turning) = (self.expected(), *speeds);
        for (i, motor) in motors.iter().enumerate().take(turning.len()) {
            if !motor.emergency && fabs(turning[i]) < STOPPED * fabs(expected[i]) {
                turning[i] = expected[i];
            }
        }
        turning
    }

    /// The motors whose measurements are unlike what the model expects.
    #[must_use]
    pub(super) fn unlike(&self, motors: &[Motor], now: f64) -> Unlike {
        let (mut stopped, mut wrong) = (0_u16, 0_u16);
        let model = self.expected.as_slice().iter().zip(self.gain.as_slice());
        for (i, (motor, (expected, gain))) in motors.iter().zip(model).enumerate() {
            let (speed, expected) = (motor.speed, expected * gain);
            let measured = self.is_measured(motor, now);
            let stands = fabs(expected) > TELLS && fabs(speed) < STOPPED * fabs(expected);
            stopped |= u16::from(measured & stands) << i;
            wrong |= u16::from(measured & (fabs(speed - expected) > WRONG_SPEED)) << i;
        }
        if 2 * stopped.count_ones() as usize >= motors.len() {
            stopped = 0;
        }
        Unlike { stopped, wrong }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::{examples, flight::Telemetry};
    use std::vec::Vec;

    /// The first rotor's speeds, Hz, that are used for these measurements, one each 2 ms; all rotors have turned at 60 Hz.
    fn used(measured: &[f64]) -> Vec<f64> {
        let vehicle = examples::tilt_hex().unwrap();
        let (hover, mut telemetry) = (RotorVector::repeat(60.0), Telemetry::new(6));
        let mut model = RotorModel::new(&vehicle, 0.0);
        model.begin_at(&hover);
        telemetry.hear_motors(0.0, &hover);
        let _ = model.speeds(telemetry.motors(), 0.0, 0.0);
        let mut found = Vec::new();
        for (k, speed) in (1..).zip(measured) {
            let now = 2e-3 * f64::from(k);
            model.step(&hover, true, 2e-3);
            let mut speeds = hover;
            speeds[0] = *speed;
            telemetry.hear_motors(now, &speeds);
            found.push(model.speeds(telemetry.motors(), now, now)[0]);
        }
        found
    }

    #[test]
    fn equal_speeds_that_a_rotor_cannot_reach_are_not_believed() {
        for wrong in [1000.0, 130.0, 90.0, -60.0, -1000.0, f64::NAN] {
            let speeds = used(&[wrong, wrong, wrong, wrong, wrong, 61.0]);
            assert_eq!(speeds, [60.0, 60.0, 60.0, 60.0, 60.0, 61.0], "{wrong}");
        }
        for wrong in [200.0, 100.0, -60.0] {
            assert!(used(&[wrong; 500]).iter().all(|speed| *speed == 60.0), "{wrong}");
        }
    }

    #[test]
    fn a_rotor_that_stops_or_follows_its_lag_is_believed() {
        // Whether it stands still, or its telemetry fails, is judged elsewhere.
        assert_eq!(used(&[0.0, 0.0, 0.0, 60.0]), [0.0, 0.0, 0.0, 60.0]);
        for goal in [16.0, 110.0] {
            let way: Vec<_> =
                (1..50).map(|k| 60.0 + (goal - 60.0) * lag_fraction(50.0, 2e-3 * f64::from(k))).collect();
            assert_eq!(used(&way), way, "a rotor that is faster than its model");
        }
    }
}
