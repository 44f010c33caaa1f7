//! Readings that return from the end of the gyro's range.
//!
//! A gyro that is broken stays at the end of its range until the vehicle turns fast enough to bring its reading back. If these
//! readings were believed, the vehicle would be turned until they are zero. Therefore they must be near the rate of the model that
//! replaced them, which poses correct.

use super::{Flight, LONG_AGO};
use crate::{
    flight::{Inertial, InertialTelemetry},
    supervisor::{
        Fault,
        limits::{POSE_LOST, RETURNS_NEAR},
    },
};

/// Without poses nothing corrects the model: after this time readings are believed again, s.
const UNSEEN: f64 = 1.0;

/// Whether readings that have returned are believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Returning {
    refuses: bool,
    /// When the last reading that was believed arrived, s.
    believed: f64,
    /// Whether readings far from the model are believed, because nothing has corrected it.
    unseen: bool,
}

impl Default for Returning {
    fn default() -> Self {
        Self { refuses: false, believed: LONG_AGO, unseen: false }
    }
}

impl Returning {
    /// Whether the last reading was refused.
    pub(super) fn refuses(&self) -> bool {
        self.refuses
    }

    /// Age of the newest reading that was believed, s.
    pub(super) fn age(&self, inertial: &InertialTelemetry, now: f64) -> f64 {
        if self.refuses { now - self.believed } else { inertial.age(now) }
    }

    /// Whether a rate is believed, which arrived at `now`, s. `apart` is its distance from the rate of the model, rad/s; `broken` says
    /// whether readings were at the end of their range just before, for longer than a blow, and `seen` whether poses correct the
    /// model.
    fn admits(&mut self, apart: f64, broken: bool, seen: bool, now: f64) -> bool {
        let far = broken && (apart.is_nan() || apart > RETURNS_NEAR);
        self.unseen = far && !seen && (self.unseen || now - self.believed > UNSEEN);
        self.refuses = far && !self.unseen;
        if !self.refuses {
            self.believed = now;
        }
        !self.refuses
    }
}

impl Flight {
    /// Whether an inertial sample is believed, which arrived at `now`, s.
    pub(super) fn believes(&mut self, sample: &Inertial, now: f64) -> bool {
        let broken =
            self.supervisor.active().contains(Fault::ImuSaturated) && self.supervisor.phase().in_flight();
        if !broken {
            return self.returning.admits(0.0, false, true, now);
        }
        let rate_i = sample.gyro_i - self.estimator.own_gyro_bias();
        let rate_r = self.params.vehicle.imu().rotation_r * rate_i;
        let apart = (rate_r - self.estimator.robot_state().angular_velocity_r).norm();
        let seen = self.estimator.health().pose_age < POSE_LOST;
        self.returning.admits(apart, true, seen, now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Readings that return far from the model are refused for as long as poses show another rate; without poses for 1 s only.
        #[test]
        fn what_returns_far_from_the_model_is_refused(apart in 10.1..80.0_f64, near in 0.0..9.9_f64, ticks in 1..2000_u32) {
            let (mut seen, mut unseen) = (Returning::default(), Returning::default());
            for watch in [&mut seen, &mut unseen] {
                prop_assert!(watch.admits(apart, false, true, 0.0) && watch.admits(near, true, true, 0.0));
            }
            for k in 1..=ticks {
                let now = 0.002 * f64::from(k);
                prop_assert!(!seen.admits(apart, true, true, now));
                prop_assert_eq!(unseen.admits(apart, true, false, now), now > UNSEEN);
            }
            let now = 0.002 * f64::from(ticks);
            prop_assert!(seen.admits(near, true, true, now) && !unseen.admits(apart, true, true, now));
        }
    }
}
