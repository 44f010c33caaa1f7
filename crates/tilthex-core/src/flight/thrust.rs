//! The thrust of the rotors, found from the motion of the vehicle and not from the motors' telemetry.
//!
//! Rotors that turn and do not lift: a rotor without its propeller shows as an external wrench that cancels the wrench
//! which the rotor should give. A push near the end of its arm looks the same, so the rotor is tested: it is
//! stopped for a moment. The wrench of a lost propeller disappears with the speed; a push stays. Rotors whose telemetry
//! drops to zero while they still lift show as an external wrench that is equal to the one which the model lacks.

use crate::{
    Vehicle,
    supervisor::limits::{THRUST_AFTER, THRUST_MISSING, THRUST_TRIAL},
    types::{RotorVector, Vector6, Wrench},
};

/// Share of its wrench that a rotor without thrust lacks. A smaller share is a weak rotor; a larger one has another
/// cause.
const MISSING: core::ops::RangeInclusive<f64> = THRUST_MISSING..=1.3;
/// The part of the external wrench that a single rotor does not explain.
const UNEXPLAINED: f64 = 0.35;
/// External wrenches below this part of the weight are not used.
const LEAST: f64 = 0.05;
/// At the end of a trial, a push has kept this part of its wrench. A push that has fallen to this part is over.
const KEPT: f64 = 0.5;
const OVER: f64 = 0.3;
/// A rotor that has failed a trial is lost if it fails another one that begins within this time, s.
const AGAIN: f64 = 0.5;
/// A rotor whose motor reports a stop lifts if this part of its wrench is still there.
const LIFTS: f64 = 0.5;

/// A rotor (from 0), and the missing force along its wrench.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Case {
    rotor: usize,
    missing: f64,
    time: f64,
}

/// The rotor that explains the external wrench, and those that have explained it for long enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ThrustWatch {
    /// Length at which a torque counts as a force, m: the farthest rotor's distance.
    arm: f64,
    suspect: Option<usize>,
    since: f64,
    trial: Option<Case>,
    /// The rotor failed a trial, this long ago, s. A push that ended meanwhile looks the same.
    failed: Option<Case>,
    /// A push on this rotor's arm, which lasts.
    acquitted: Option<Case>,
    lost: u16,
}

impl ThrustWatch {
    /// A watch without a suspect.
    pub(super) fn new(vehicle: &Vehicle) -> Self {
        let arm = vehicle.rotors().iter().map(|r| r.position_r.norm()).fold(1e-3, f64::max);
        Self { arm, suspect: None, since: 0.0, trial: None, failed: None, acquitted: None, lost: 0 }
    }

    /// Bit `i` is set if rotor `i` (from 0) must stand still for a trial.
    pub(super) fn tried(&self) -> u16 {
        self.trial.map_or(0, |case| 1 << case.rotor)
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
        let along = |rotor: usize| missing(vehicle, self.arm, rotor, external_r);
        self.acquitted = self.acquitted.filter(|case| along(case.rotor) > OVER * case.missing);
        if let Some(mut case) = self.trial {
            case.time += dt;
            self.trial = Some(case).filter(|case| case.time < THRUST_TRIAL);
            if self.trial.is_none() && along(case.rotor) > KEPT * case.missing {
                self.acquitted = Some(case);
            } else if self.trial.is_none() && self.failed.take().is_some_and(|f| f.rotor == case.rotor) {
                self.lost |= 1 << case.rotor;
            } else if self.trial.is_none() {
                self.failed = Some(Case { time: 0.0, ..case });
            }
            return self.lost;
        }
        self.failed = self.failed.map(|case| Case { time: case.time + dt, ..case });
        self.failed = self.failed.filter(|case| case.time < AGAIN);
        let known = |rotor: &usize| {
            self.lost >> rotor & 1 == 1 || self.acquitted.is_some_and(|case| case.rotor == *rotor)
        };
        let suspect = suspect(vehicle, self.arm, speeds, external_r).filter(|rotor| !known(rotor));
        self.since = if suspect.is_some() && suspect == self.suspect { self.since + dt } else { 0.0 };
        self.suspect = suspect;
        if let Some(rotor) = suspect.filter(|_| self.since > THRUST_AFTER) {
            self.trial = Some(Case { rotor, missing: along(rotor), time: 0.0 });
            self.since = 0.0;
        }
        self.lost
    }

    /// Bit `i` is set if rotor `i` produces at least half of its wrench at these speeds, Hz, although the external
    /// wrench was computed with this rotor at rest.
    pub(super) fn lifting(&self, vehicle: &Vehicle, speeds: &RotorVector, external_r: &Wrench) -> u16 {
        let found = scaled(&external_r.to_vector(), self.arm);
        speeds.as_slice().iter().enumerate().take(vehicle.rotor_count()).fold(0, |set, (rotor, speed)| {
            let lifts = column(vehicle, self.arm, rotor)
                .is_some_and(|column| found.dot(&column) > LIFTS * column.norm_squared() * speed * speed);
            if lifts { set | 1 << rotor } else { set }
        })
    }
}

/// A wrench whose torques are expressed as forces at the arm.
fn scaled(w: &Vector6, arm: f64) -> Vector6 {
    let per_arm = 1.0 / arm;
    Vector6::new(w[0], w[1], w[2], w[3] * per_arm, w[4] * per_arm, w[5] * per_arm)
}

/// The scaled wrench of a rotor (from 0) for a squared speed of 1.
fn column(vehicle: &Vehicle, arm: f64, rotor: usize) -> Option<Vector6> {
    let column = vehicle.allocation().as_slice().chunks_exact(6).nth(rotor)?;
    let [a, b, c, d, e, f] = *column else { return None };
    Some(scaled(&Vector6::new(a, b, c, d, e, f), arm))
}

/// The part of an external wrench against the wrench of a rotor, N.
fn missing(vehicle: &Vehicle, arm: f64, rotor: usize, external_r: &Wrench) -> f64 {
    let Some(column) = column(vehicle, arm, rotor) else { return 0.0 };
    -scaled(&external_r.to_vector(), arm).dot(&column) / column.norm().max(1e-12)
}

/// The rotor whose missing thrust explains the external wrench.
fn suspect(vehicle: &Vehicle, arm: f64, speeds: &RotorVector, external_r: &Wrench) -> Option<usize> {
    let found = scaled(&external_r.to_vector(), arm);
    let size = found.norm();
    if size < LEAST * vehicle.weight() {
        return None;
    }
    let mut best: Option<(usize, f64)> = None;
    for (i, speed) in speeds.as_slice().iter().enumerate().take(vehicle.rotor_count()) {
        let Some(given) = column(vehicle, arm, i).map(|column| column * (speed * speed.abs())) else {
            continue;
        };
        let square = given.norm_squared().max(1e-12);
        // The part of the external wrench along this one is not larger than the external wrench.
        if size * size < MISSING.start() * MISSING.start() * square {
            continue;
        }
        let missing = -found.dot(&given) / square;
        if !MISSING.contains(&missing) {
            continue;
        }
        let unexplained = (found + given * missing).norm() / size;
        if unexplained < best.map_or(UNEXPLAINED, |(_, least)| least) {
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
                let lost = (0..200).map(|_| {
                    // A rotor on trial stands still, and then lacks no wrench.
                    let tried = watch.tried() != 0;
                    let external = if tried { Wrench::ZERO } else { external };
                    watch.step(&vehicle, &speeds, &external, 0.002)
                });
                assert_eq!(lost.last(), Some(if is_lost { 1 << rotor } else { 0 }), "{rotor} {kept}");
            }
        }
    }

    #[test]
    fn a_push_that_looks_like_a_lost_rotor_is_acquitted() {
        let vehicle = vehicle();
        let speeds = vehicle.hover_speeds(&Matrix3::identity());
        for rotor in 0..6 {
            let mut one = RotorVector::zeros();
            one[rotor] = speeds[rotor];
            let push = Wrench::ZERO - vehicle.body_wrench(&one);
            let mut watch = ThrustWatch::new(&vehicle);
            let mut tried = 0;
            for _ in 0..1000 {
                assert_eq!(watch.step(&vehicle, &speeds, &push, 0.002), 0);
                tried += u32::from(watch.tried() != 0);
            }
            assert!((1..100).contains(&tried), "{tried} ticks on trial");
        }
    }

    #[test]
    fn a_rotor_that_lifts_though_its_motor_says_nothing_is_told() {
        let vehicle = vehicle();
        let speeds = vehicle.hover_speeds(&Matrix3::identity());
        let watch = ThrustWatch::new(&vehicle);
        for rotor in 0..6 {
            let mut one = RotorVector::zeros();
            one[rotor] = speeds[rotor];
            let found = watch.lifting(&vehicle, &speeds, &vehicle.body_wrench(&one));
            assert_eq!(found >> rotor & 1, 1);
        }
        assert_eq!(watch.lifting(&vehicle, &speeds, &Wrench::ZERO), 0);
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
