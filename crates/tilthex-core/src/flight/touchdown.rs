//! Whether the ground carries the vehicle that descends.

use crate::types::Vector3;

/// The part of its weight that must be carried.
const SHARE: f64 = 0.3;
/// A vehicle that stands neither rises nor sinks faster than this, m/s, for so long, s.
const STILL: (f64, f64) = (0.3, 0.2);
/// A force that is felt carries after so long, s, however the vehicle moves; one that has toppled, or comes down
/// without a rotor, bounces about.
const FELT: (f64, f64) = (0.5, 0.1);

/// What tells of the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seen {
    /// What the rotors' thrust lacks to the weight, N.
    pub(super) missing: f64,
    /// External force by the accelerometer, N, world; none where it is not to be had.
    pub(super) observed_w: Option<Vector3>,
    /// Speed upwards, m/s.
    pub(super) velocity: f64,
    /// Whether the vehicle has tilted beyond its limit: then the estimate's up may be wrong too.
    pub(super) toppled: bool,
    /// Whether it comes down without a rotor that it takes to hover.
    pub(super) adrift: bool,
}

/// For how long each sign of the ground has been there, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Touchdown {
    still: f64,
    felt: f64,
}

impl Touchdown {
    /// One tick. Two signs, of which either will do, since each fails in its own way: rotors that do not carry a
    /// vehicle that stays at its height (no accelerometer needed), and a force that is felt (no position needed).
    pub(super) fn step(&mut self, seen: &Seen, weight: f64, dt: f64) -> bool {
        let (slow, time) = STILL;
        let stands = seen.missing > SHARE * weight && seen.velocity.abs() < slow;
        self.still = if stands { self.still + dt } else { 0.0 };
        let carried = |force: Vector3| if seen.toppled { force.norm() } else { force.z };
        let feels = seen.observed_w.is_some_and(|force| carried(force) > SHARE * weight);
        self.felt = (self.felt + if feels { dt } else { -dt }).max(0.0);
        let (steady, bouncing) = FELT;
        self.still > time || self.felt > if seen.toppled || seen.adrift { bouncing } else { steady }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AIR: Seen = Seen {
        missing: 0.0,
        observed_w: Some(Vector3::new(0.0, 0.0, 0.0)),
        velocity: 0.1,
        toppled: false,
        adrift: false,
    };

    /// The time until the ground is believed in, ms.
    fn time(seen: &Seen) -> Option<u32> {
        let mut touchdown = Touchdown::default();
        (1..1000).find(|_| touchdown.step(seen, 20.0, 1e-3 + 1e-9))
    }

    #[test]
    fn either_sign_will_do() {
        assert_eq!(time(&AIR), None);
        assert_eq!(time(&Seen { missing: 10.0, observed_w: None, ..AIR }), Some(200));
        assert_eq!(time(&Seen { missing: 10.0, observed_w: None, velocity: 1.0, ..AIR }), None);
        let up = Some(Vector3::new(0.0, 0.0, 10.0));
        assert_eq!(time(&Seen { observed_w: up, velocity: 3.0, ..AIR }), Some(500));
        let aside = Some(Vector3::new(10.0, 0.0, 0.0));
        assert_eq!(time(&Seen { observed_w: aside, ..AIR }), None);
        assert_eq!(time(&Seen { observed_w: aside, toppled: true, velocity: 3.0, ..AIR }), Some(100));
    }
}
