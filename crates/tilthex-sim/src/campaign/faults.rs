//! A fault of one flight: its kind, begin, duration and strength.

use tilthex_core::{Vector3, random::Random};

use super::kinds::Kind;

/// A fault of one flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Injection {
    /// Its kind.
    pub kind: Kind,
    /// When it begins, s after the flight's start.
    pub begin: f64,
    /// Its duration, s.
    pub duration: f64,
    /// Its strength, 0 to 1.
    pub strength: f64,
    /// The number that chooses the rotor, the axis or the direction.
    pub index: usize,
}

/// The duration of a fault that is there from power-on and stays, s.
const FOR_GOOD: f64 = 1e6;

impl Injection {
    /// Whether it acts at a time, s.
    pub(super) fn acts_at(&self, time: f64) -> bool {
        (self.begin..self.begin + self.duration).contains(&time)
    }

    /// A random fault for a vehicle with `rotors` rotors. Its kind is one of `kinds`, which holds at least one. It
    /// begins within `window` seconds; a built-in fault begins at power-on.
    pub fn random(random: &mut Random, kinds: &[Kind], window: f64, rotors: usize) -> Self {
        let kind = kinds[(random.bits() % kinds.len() as u64) as usize];
        let (begin, duration) = (window * random.uniform(), 0.02 + 3.0 * random.uniform() * random.uniform());
        let (begin, duration) = if kind.is_built_in() { (0.0, FOR_GOOD) } else { (begin, duration) };
        let strength = random.uniform();
        Self { kind, begin, duration, strength, index: (random.bits() % (6 * rotors as u64)) as usize }
    }

    /// A value between `low` and `high` that grows geometrically with the strength.
    pub(super) fn between(&self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.strength)
    }

    /// The index of the rotor that the fault changes, of `rotors` rotors.
    pub(super) fn rotor(&self, rotors: usize) -> usize {
        self.index % rotors
    }

    /// The sign of the fault: +1 or -1.
    pub(super) fn sign(&self) -> f64 {
        if (self.index / 3).is_multiple_of(2) { 1.0 } else { -1.0 }
    }

    /// A unit vector along one axis, in either direction.
    pub(super) fn direction(&self) -> Vector3 {
        let mut axis = Vector3::zeros();
        axis[self.index % 3] = self.sign();
        axis
    }
}
