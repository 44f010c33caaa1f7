//! Throttles for commanded speeds: the vehicle's map, and a slow correction from the measured speeds.

use tilthex_core::{
    Error,
    error::check_range,
    filters::lag_fraction,
    flight::Motor,
    supervisor::limits::MOTORS_FRESH,
    types::{MAX_ROTORS, RotorVector},
};

/// Approximate rate at which a measured speed follows a commanded one, 1/s.
const FOLLOWS: f64 = 20.0;
/// Largest correction of a commanded speed, Hz.
const MOST: f64 = 20.0;
/// Longest time between two commands that the correction uses, s. A longer one is cut to this.
const LONGEST: f64 = 0.02;

/// The throttle for a rotor's speed: `c0 + c1 x + c2 x^2`, where `x` is the speed (Hz) times `(voltage / battery)^exponent`,
/// with the battery's voltage.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ThrottleMap {
    /// `c0` to `c2`, in 1, 1/Hz and 1/Hz^2. All are 0 if the map is not known.
    pub coefficients: [f64; 3],
    /// Battery voltage at which the map was measured, V; 0 if the speed at a throttle does not depend on the battery.
    pub voltage: f64,
    /// Power of the voltage with which the speed at a throttle grows; 1 if the speed is proportional to the voltage.
    pub exponent: f64,
    /// Rate at which the measured speeds correct the throttles, 1/s; 0 for no correction.
    pub correction: f64,
}

impl ThrottleMap {
    /// The throttle for a speed (Hz) at a battery voltage (V), limited to 0 to 1, and whether it was inside the limits.
    #[must_use]
    pub fn throttle(&self, speed: f64, battery: Option<f64>) -> (f64, bool) {
        let [c0, c1, c2] = self.coefficients;
        let scale = battery.filter(|volts| self.voltage > 0.0 && *volts > 0.5 * self.voltage);
        let x = speed * scale.map_or(1.0, |volts| libm::pow(self.voltage / volts, self.exponent));
        let throttle = c0 + x * (c1 + x * c2);
        // NaN would stop the motor.
        let finite = if throttle.is_nan() { 0.0 } else { throttle };
        (finite.clamp(0.0, 1.0), throttle > 0.0 && throttle < 1.0)
    }

    /// # Errors
    /// [`Error::OutOfRange`] for a number that is not finite or not plausible.
    pub(super) fn check(&self) -> Result<(), Error> {
        for coefficient in self.coefficients {
            check_range("throttle", coefficient, -10.0, 10.0)?;
        }
        check_range("throttle_voltage (V)", self.voltage, 0.0, 1000.0)?;
        check_range("throttle_exponent", self.exponent, 0.0, 3.0)?;
        check_range("throttle_correction (1/s)", self.correction, 0.0, 20.0)
    }
}

/// The throttles of all motors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Throttles {
    map: ThrottleMap,
    expected: RotorVector,
    correction: RotorVector,
    last: Option<f64>,
}

impl Throttles {
    pub(super) fn new(map: ThrottleMap) -> Self {
        let zero = RotorVector::zeros();
        Self { map, expected: zero, correction: zero, last: None }
    }

    /// Forgets the corrections: the motors have been stopped.
    pub(super) fn forget(&mut self) {
        *self = Self::new(self.map);
    }

    /// Throttles for commanded speeds, Hz, at `now`, s. The corrections change only if PX4 executes the commands
    /// (`obeyed`).
    pub(super) fn step(
        &mut self,
        commanded: &RotorVector,
        motors: &[Motor],
        battery: Option<f64>,
        now: f64,
        obeyed: bool,
    ) -> [f32; MAX_ROTORS] {
        let dt = self.last.replace(now).map_or(0.0, |last| (now - last).clamp(0.0, LONGEST));
        let follow = lag_fraction(FOLLOWS, dt);
        let mut throttles = [f32::NAN; MAX_ROTORS];
        let own = self.expected.iter_mut().zip(self.correction.iter_mut());
        for (((throttle, speed), (expected, correction)), motor) in
            throttles.iter_mut().zip(commanded.iter()).zip(own).zip(motors)
        {
            *expected += follow * (speed - *expected);
            let (wanted, free) = self.map.throttle(speed + *correction, battery);
            *throttle = wanted as f32;
            let learns = obeyed && free && motor.spinning && now - motor.heard < MOTORS_FRESH;
            if learns {
                let error = *expected - motor.speed;
                *correction = (*correction + self.map.correction * dt * error).clamp(-MOST, MOST);
            }
        }
        throttles
    }
}
