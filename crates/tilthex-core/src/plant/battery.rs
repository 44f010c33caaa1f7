//! The battery: a charge, a voltage that falls with the charge, and an internal resistance. Also the effect of a
//! falling voltage on rotors whose commands are throttles.

/// A lithium-polymer battery of four cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Battery {
    /// Charge when full, A s.
    pub capacity: f64,
    /// Charge left, A s.
    pub charge: f64,
    current: f64,
}

/// Open-circuit voltage when full, V.
const FULL: f64 = 16.8;
/// Open-circuit voltage when empty, V.
const EMPTY: f64 = 13.2;
/// Internal resistance, ohm.
const RESISTANCE: f64 = 0.015;
/// Current of a rotor at 100 Hz, A. The current grows with the third power of the speed.
const CURRENT_AT_100_HZ: f64 = 6.0;
/// Current of the electronics, A.
const IDLE: f64 = 0.5;

/// Current of one rotor at a speed in Hz, A.
#[must_use]
pub fn rotor_current(speed: f64) -> f64 {
    let part = libm::fabs(speed) / 100.0;
    CURRENT_AT_100_HZ * (part * part * part)
}

impl Battery {
    /// A full battery of 5 A h.
    pub const FULL: Self = Self { capacity: 18_000.0, charge: 18_000.0, current: IDLE };

    /// A battery with a capacity in A h, charged to a fraction of it (0 to 1).
    #[must_use]
    pub fn new(capacity_ah: f64, part: f64) -> Self {
        let capacity = 3600.0 * capacity_ah;
        Self { capacity, charge: part * capacity, current: IDLE }
    }

    /// Supplies the rotors for `dt` seconds.
    pub fn advance(&mut self, rotor_speeds: &[f64], dt: f64) {
        self.current = IDLE + rotor_speeds.iter().map(|&speed| rotor_current(speed)).sum::<f64>();
        self.charge = (self.charge - self.current * dt).max(0.0);
    }

    /// Fraction of a commanded speed that a throttle reaches. The speed of the motor is proportional to its voltage,
    /// so that the thrust falls with the square of `voltage / nominal`. 1 if `nominal` (V) is 0.
    #[must_use]
    pub fn speed_part(&self, nominal: f64) -> f64 {
        if nominal > 0.0 { (self.voltage() / nominal).max(0.0) } else { 1.0 }
    }

    /// Voltage at its terminals, V.
    #[must_use]
    pub fn voltage(&self) -> f64 {
        EMPTY + (FULL - EMPTY) * self.charge / self.capacity - RESISTANCE * self.current
    }
}
