//! Rotors that turn and do not lift: without its propeller, a rotor shows as an
//! external wrench that takes away what it should give.

use crate::{
    Vehicle,
    supervisor::limits::{THRUST_AFTER, THRUST_MISSING},
    types::{RotorVector, Vector6, Wrench},
};

/// Share of its wrench that a rotor without thrust lacks: less is a weak rotor, and more is something else.
const MISSING: core::ops::RangeInclusive<f64> = THRUST_MISSING..=1.3;
/// What a single rotor does not explain, as a part of the external wrench.
const UNEXPLAINED: f64 = 0.35;
/// External wrenches below this part of the weight say nothing.
const LEAST: f64 = 0.05;

/// The rotor that explains the external wrench, and those that did for long enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ThrustWatch {
    /// Length at which a torque counts as a force, m: the farthest rotor's distance.
    arm: f64,
    suspect: Option<usize>,
    since: f64,
    lost: u16,
}

impl ThrustWatch {
    /// Nothing suspected yet.
    pub(super) fn new(vehicle: &Vehicle) -> Self {
        let arm = vehicle.rotors().iter().map(|r| r.position_r.norm()).fold(1e-3, f64::max);
        Self { arm, suspect: None, since: 0.0, lost: 0 }
    }

    /// One tick in flight: speeds in Hz, the external wrench (force and torque in R, without bias).
    /// Bit `i` is set where rotor `i` (from 0) has lost its thrust; that is not taken back.
    pub(super) fn step(
        &mut self,
        vehicle: &Vehicle,
        speeds: &RotorVector,
        external_r: &Wrench,
        dt: f64,
    ) -> u16 {
        let suspect = suspect(vehicle, self.arm, speeds, external_r).filter(|i| self.lost >> i & 1 == 0);
        self.since = if suspect.is_some() && suspect == self.suspect { self.since + dt } else { 0.0 };
        self.suspect = suspect;
        if let Some(rotor) = suspect.filter(|_| self.since > THRUST_AFTER) {
            self.lost |= 1 << rotor;
        }
        self.lost
    }
}

/// The rotor whose missing thrust explains the external wrench.
fn suspect(vehicle: &Vehicle, arm: f64, speeds: &RotorVector, external_r: &Wrench) -> Option<usize> {
    let scaled = |w: &Vector6| Vector6::new(w[0], w[1], w[2], w[3] / arm, w[4] / arm, w[5] / arm);
    let found = scaled(&external_r.to_vector());
    let size = found.norm();
    if size < LEAST * vehicle.weight() {
        return None;
    }
    let columns = vehicle.allocation().as_slice().chunks_exact(6).zip(speeds.iter());
    let mut best: Option<(usize, f64)> = None;
    for (i, (column, speed)) in columns.take(vehicle.rotor_count()).enumerate() {
        let [a, b, c, d, e, f] = *column else { continue };
        let given = scaled(&(Vector6::new(a, b, c, d, e, f) * (speed * speed.abs())));
        let missing = -found.dot(&given) / given.norm_squared().max(1e-12);
        let unexplained = (found + given * missing).norm() / size;
        if MISSING.contains(&missing) && unexplained < best.map_or(UNEXPLAINED, |(_, least)| least) {
            best = Some((i, unexplained));
        }
    }
    best.map(|(i, _)| i)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::types::{Matrix3, Vector3};
    use proptest::prelude::*;

    fn vehicle() -> Vehicle {
        crate::vehicle::tests::tilt_hex()
    }

    #[test]
    fn a_rotor_without_thrust_is_found() {
        let vehicle = vehicle();
        let speeds = vehicle.hover_speeds(&Matrix3::identity());
        for rotor in 0..6 {
            for (kept, is_lost) in [(0.0, true), (0.3, true), (0.6, false), (1.0, false)] {
                let mut lacking = RotorVector::zeros();
                lacking[rotor] = speeds[rotor] * f64::sqrt(1.0 - kept);
                let external = Wrench::ZERO - vehicle.body_wrench(&lacking);
                let mut watch = ThrustWatch::new(&vehicle);
                let lost = (0..50).map(|_| watch.step(&vehicle, &speeds, &external, 0.002)).last();
                assert_eq!(lost, Some(if is_lost { 1 << rotor } else { 0 }), "{rotor} {kept}");
            }
        }
    }

    proptest! {
        /// What pushes the tool, or lifts the vehicle, is no rotor.
        #[test]
        fn contact_is_no_lost_thrust(f in prop::array::uniform3(-1.0..1.0f64), size in 0.1..15.0f64) {
            let vehicle = vehicle();
            let speeds = vehicle.hover_speeds(&Matrix3::identity());
            let force = Vector3::from(f).normalize() * size;
            let torque = vehicle.tool().position_r.cross(&force);
            prop_assert_eq!(suspect(&vehicle, 0.39, &speeds, &Wrench { force, torque }), None);
        }
    }
}
