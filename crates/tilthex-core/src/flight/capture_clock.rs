//! Capture times that jump, because the clock of the capture system was set.
//!
//! The time from the capture of a pose to its arrival hardly changes. A pose may arrive late, but then the poses after it
//! arrive later than usual, too, and in their order. If poses claim to be older than one that arrived before them, or
//! younger than poses can be, their clock has jumped. Then the capture time of a pose is its arrival minus the usual delay.

use crate::{
    supervisor::limits::{CAPTURE_CLOCK, POSES_BACK},
    types::PoseSample,
};

/// Weight of a pose in the usual delay.
const WEIGHT: f64 = 0.02;

/// The usual delay of poses, and whether their clock has jumped.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CaptureClock {
    /// Mean time from capture to arrival, s.
    delay: Option<f64>,
    /// Latest capture time, s.
    latest: f64,
    /// Number of poses in a row that claim to be much older than usual, and older than the latest.
    back: u32,
    jumped: bool,
}

impl CaptureClock {
    /// Whether the clock has jumped since the take-off, and has not come back.
    pub(super) fn jumped(&self) -> bool {
        self.jumped
    }

    /// The pose with its capture time, in the order of arrival. Before the take-off all times are believed. The time of a pose
    /// that is not tracked says nothing.
    pub(super) fn timed(&mut self, pose: &PoseSample, in_flight: bool) -> PoseSample {
        let claimed = pose.arrival - pose.time;
        if !pose.is_finite() || !pose.tracking_valid {
            return *pose;
        }
        // On the ground another delay is the usual one from then on.
        let known = self.delay.filter(|delay| in_flight || (claimed - delay).abs() <= CAPTURE_CLOCK);
        let usual = known.unwrap_or(claimed);
        self.delay = Some(usual);
        let off = claimed - usual;
        if !in_flight || off.abs() <= CAPTURE_CLOCK {
            let before = if in_flight { self.latest } else { f64::NEG_INFINITY };
            *self = Self {
                delay: Some(usual + WEIGHT * off),
                latest: pose.time.max(before),
                back: 0,
                jumped: false,
            };
            return *pose;
        }
        self.back = if off > 0.0 && pose.time < self.latest { self.back.saturating_add(1) } else { 0 };
        self.jumped |= off < 0.0 || self.back >= POSES_BACK;
        if self.jumped { PoseSample { time: pose.arrival - usual, ..*pose } } else { *pose }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::{Matrix3, Vector3};
    use proptest::prelude::*;
    use std::vec::Vec;

    const DELAY: f64 = 0.012;

    fn pose(time: f64, arrival: f64) -> PoseSample {
        let (position_w, rotation_wr) = (Vector3::zeros(), Matrix3::identity());
        PoseSample { time, arrival, position_w, rotation_wr, tracking_valid: true }
    }

    /// A clock that has seen two seconds of poses; the time of the next one, s.
    fn flown() -> (CaptureClock, f64) {
        let mut clock = CaptureClock::default();
        for k in 0..200 {
            let time = 0.01 * f64::from(k);
            clock.timed(&pose(time, time + DELAY), k > 50);
        }
        (clock, 2.0)
    }

    proptest! {
        #[test]
        fn after_a_jump_of_the_clock_capture_times_are_right(
            jump in prop_oneof![-1.0f64..-0.06, 0.06f64..1.0], jitter in prop::collection::vec(-4e-3f64..4e-3, 100),
        ) {
            let (mut clock, begin) = flown();
            let mut wrong = 0;
            for (k, jitter) in (0..).zip(&jitter) {
                let time = begin + 0.01 * f64::from(k);
                let found = clock.timed(&pose(time + jump, time + DELAY + jitter), true).time;
                wrong += u32::from((found - time).abs() > 5e-3);
            }
            prop_assert!(clock.jumped() && wrong < POSES_BACK, "{wrong}");
            let time = begin + 2.0;
            clock.timed(&pose(time, time + DELAY), true);
            prop_assert!(!clock.jumped(), "the clock is right again");
        }

        #[test]
        fn times_on_the_ground_and_of_lost_bodies_do_not_count(wrong in -1e6f64..1e6) {
            let (mut clock, begin) = flown();
            clock.timed(&PoseSample { tracking_valid: false, ..pose(wrong, begin) }, true);
            prop_assert!(!clock.jumped());
            clock.timed(&pose(wrong, begin), false);
            clock.timed(&pose(begin, begin + DELAY), false);
            for k in 1..50 {
                let time = begin + 0.01 * f64::from(k);
                prop_assert!(clock.timed(&pose(time, time + DELAY), true).time == time && !clock.jumped());
            }
        }

        #[test]
        fn late_poses_keep_their_times(
            late in 0.0f64..0.5, swapped in prop::collection::vec(any::<bool>(), 50),
        ) {
            // The line stands still for a time; then the poses that have waited arrive together, some in exchanged order.
            let (mut clock, begin) = flown();
            let mut order: Vec<i32> = (0..100).collect();
            for (k, _) in (0..).zip(&swapped).filter(|(_, swapped)| **swapped) {
                order.swap(2 * k, 2 * k + 1);
            }
            for k in order {
                let time = begin + 0.01 * f64::from(k);
                let found = clock.timed(&pose(time, (time + DELAY).max(begin + late)), true).time;
                prop_assert!(found == time && !clock.jumped(), "{k}");
            }
        }
    }
}
