//! The trajectory's limits, continuity and derivatives.

#![allow(clippy::unwrap_used)]

mod common;

use common::{rotation, vector, wrench};
use proptest::prelude::*;
use tilthex_core::{
    force_axes::ForceAxes,
    so3,
    trajectory::{Limits, Trajectory, Waypoint},
};

fn waypoint() -> impl Strategy<Value = Waypoint> {
    (vector(1.0), rotation(), wrench(2.0, 0.5), 0.0..3.0f64, 0.0..1.0f64).prop_map(
        |(position_w, rotation_we, wrench_w, duration, hold)| Waypoint {
            position_w,
            rotation_we,
            wrench_w,
            force_axes: ForceAxes::NONE,
            duration,
            hold,
        },
    )
}

const LIMITS: Limits =
    Limits { velocity: 0.5, acceleration: 0.8, angular_velocity: 0.7, angular_acceleration: 1.1 };

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn rates_stay_within_limits_and_are_derivatives(
        start in waypoint(), way in prop::collection::vec(waypoint(), 1..6), at in 0.0..1.0f64,
    ) {
        let trajectory = Trajectory::new(start, &way, &LIMITS).unwrap();
        let t = at * trajectory.duration();
        let h = 1e-5;
        let (a, s, b) = (trajectory.sample(t - h), trajectory.sample(t), trajectory.sample(t + h));
        let near = 1e-9;
        prop_assert!(s.velocity_w.norm() <= LIMITS.velocity + near);
        prop_assert!(s.acceleration_w.norm() <= LIMITS.acceleration + near);
        prop_assert!(s.angular_velocity_w.norm() <= LIMITS.angular_velocity + near);
        prop_assert!(s.angular_acceleration_w.norm() <= LIMITS.angular_acceleration + near);
        // Continuity of the acceleration bounds these differences, across way-points too.
        prop_assert!(((b.position_w - a.position_w) / (2.0 * h) - s.velocity_w).amax() < 1e-4);
        let omega = so3::log(&(b.rotation_we * a.rotation_we.transpose())) / (2.0 * h);
        prop_assert!((omega - s.angular_velocity_w).amax() < 1e-4);
        prop_assert!(((b.velocity_w - a.velocity_w) / (2.0 * h) - s.acceleration_w).amax() < 1e-2);
        prop_assert!(so3::rotation_defect(&s.rotation_we) < 1e-12);
    }

    #[test]
    fn it_ends_at_its_last_waypoint(start in waypoint(), way in prop::collection::vec(waypoint(), 1..6)) {
        let trajectory = Trajectory::new(start, &way, &LIMITS).unwrap();
        let (end, last) = (trajectory.sample(trajectory.duration() + 1.0), way.last().unwrap());
        prop_assert_eq!(end.position_w, last.position_w);
        prop_assert_eq!(end.wrench_w, last.wrench_w);
        prop_assert_eq!(trajectory.sample(-1.0).position_w, start.position_w);
        prop_assert!(trajectory.sample(f64::NAN).is_finite());
    }
}
