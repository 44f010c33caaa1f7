//! A fault of one flight: which, when, for how long, how bad.

use tilthex_core::{Vector3, random::Random};

use super::kinds::Kind;

/// A fault of one flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Injection {
    /// Which.
    pub kind: Kind,
    /// When it begins, s after the flight's start.
    pub begin: f64,
    /// For how long it lasts, s.
    pub duration: f64,
    /// How bad it is, 0 to 1.
    pub strength: f64,
    /// Which rotor, axis or direction it hits.
    pub index: usize,
}

/// The time of a fault that is there from power-on, and stays, s.
const FOR_GOOD: f64 = 1e6;

impl Injection {
    /// A random fault of one of some kinds, at least one, on a vehicle with `rotors` rotors. It begins within `window`
    /// seconds; a kind that is built in is there from the start.
    pub fn random(random: &mut Random, kinds: &[Kind], window: f64, rotors: usize) -> Self {
        let kind = kinds[(random.bits() % kinds.len() as u64) as usize];
        let (begin, duration) = (window * random.uniform(), 0.02 + 3.0 * random.uniform() * random.uniform());
        let (begin, duration) = if kind.is_built_in() { (0.0, FOR_GOOD) } else { (begin, duration) };
        let strength = random.uniform();
        Self { kind, begin, duration, strength, index: (random.bits() % (6 * rotors as u64)) as usize }
    }

    /// Between `low` and `high`, by its strength, in equal ratios.
    pub(super) fn between(&self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.strength)
    }

    /// The rotor that it hits, from 0, of `rotors`.
    pub(super) fn rotor(&self, rotors: usize) -> usize {
        self.index % rotors
    }

    /// +1 or -1.
    pub(super) fn sign(&self) -> f64 {
        if (self.index / 3).is_multiple_of(2) { 1.0 } else { -1.0 }
    }

    /// A unit vector along one axis, either way.
    pub(super) fn direction(&self) -> Vector3 {
        let mut axis = Vector3::zeros();
        axis[self.index % 3] = self.sign();
        axis
    }
}
