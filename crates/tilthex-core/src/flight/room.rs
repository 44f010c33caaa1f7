//! Limits the motion of streamed set-points.

use crate::{so3, supervisor::limits::SETPOINT_STALE, trajectory::Limits, types::Setpoint};

/// Lever arm that turns a jump of the position into one of the rotation, m.
const JUMP_LEVER: f64 = 0.5;

/// The distance that streamed set-points may move at once. It grows at the largest rates, and each motion uses it up.
/// So the network may hold some set-points back and deliver them together, and the mean motion still has the largest
/// rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Room {
    /// Distance, m and rad.
    way: f64,
    turn: f64,
    /// Changes of the rates, m/s and rad/s.
    speed: f64,
    spin: f64,
}

impl Room {
    /// Full room, for the largest rates and the largest jump of the position, m.
    pub(super) fn full(rates: &Limits, jump: f64) -> Self {
        Self {
            way: jump,
            turn: jump / JUMP_LEVER,
            speed: rates.acceleration * SETPOINT_STALE,
            spin: rates.angular_acceleration * SETPOINT_STALE,
        }
    }

    /// Lets `dt` seconds pass.
    pub(super) fn fill(&mut self, rates: &Limits, jump: f64, dt: f64) {
        let full = Self::full(rates, jump);
        self.way = (self.way + rates.velocity * dt).min(full.way);
        self.turn = (self.turn + rates.angular_velocity * dt).min(full.turn);
        self.speed = (self.speed + rates.acceleration * dt).min(full.speed);
        self.spin = (self.spin + rates.angular_acceleration * dt).min(full.spin);
    }

    /// Subtracts the distance between two set-points from the room. If there is less room, returns false and
    /// subtracts nothing.
    pub(super) fn take(&mut self, from: &Setpoint, to: &Setpoint) -> bool {
        let left = Self {
            way: self.way - (to.position_w - from.position_w).norm(),
            turn: self.turn - so3::log(&(from.rotation_we.transpose() * to.rotation_we)).norm(),
            speed: self.speed - (to.velocity_w - from.velocity_w).norm(),
            spin: self.spin - (to.angular_velocity_w - from.angular_velocity_w).norm(),
        };
        let enough = [left.way, left.turn, left.speed, left.spin].iter().all(|left| *left >= 0.0);
        if enough {
            *self = left;
        }
        enough
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::{Matrix3, Vector3};
    use proptest::prelude::*;

    const RATES: Limits =
        Limits { velocity: 1.5, acceleration: 4.0, angular_velocity: 1.5, angular_acceleration: 6.0 };
    const JUMP: f64 = 0.05;

    proptest! {
        #[test]
        fn whatever_is_streamed_is_no_faster_than_it_may_be(steps in prop::collection::vec((-0.1..0.1_f64, -0.3..0.3_f64, -2.0..2.0_f64), 1..400)) {
            let mut room = Room::full(&RATES, JUMP);
            let mut last = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
            let (mut way, mut turn, mut change) = (0.0, 0.0, 0.0_f64);
            for (i, (step, angle, speed)) in steps.into_iter().enumerate() {
                let mut next = last;
                next.position_w.z += step;
                next.rotation_we *= so3::rot_x(angle);
                next.velocity_w.x = speed;
                if room.take(&last, &next) {
                    way += step.abs();
                    turn += angle.abs();
                    change += (next.velocity_w - last.velocity_w).norm();
                    last = next;
                }
                let time = i as f64 * 0.002 + 1e-9;
                prop_assert!(way <= JUMP + RATES.velocity * time);
                prop_assert!(turn <= JUMP / JUMP_LEVER + RATES.angular_velocity * time);
                prop_assert!(change <= RATES.acceleration * (SETPOINT_STALE + time));
                room.fill(&RATES, JUMP, 0.002);
            }
        }
    }

    #[test]
    fn a_stream_at_the_largest_rates_is_taken_though_the_network_bunches_it() {
        let mut room = Room::full(&RATES, JUMP);
        let mut last = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        for tick in 1..2000 {
            room.fill(&RATES, JUMP, 0.002);
            // 100 Hz, of which three come together.
            if tick % 15 == 0 {
                for late in [10, 5, 0] {
                    let mut next = last;
                    next.position_w.x = 0.95 * RATES.velocity * 0.002 * f64::from(tick - late);
                    assert!(room.take(&last, &next), "{tick}");
                    last = next;
                }
            }
        }
    }

    #[test]
    fn without_limits_everything_is_taken() {
        let none = f64::INFINITY;
        let rates =
            Limits { velocity: none, acceleration: none, angular_velocity: none, angular_acceleration: none };
        let mut room = Room::full(&rates, none);
        let here = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        let there = Setpoint::hold(Vector3::repeat(1e3), so3::rot_z(3.0));
        for _ in 0..3 {
            room.fill(&rates, none, 0.0);
            assert!(room.take(&here, &there));
        }
    }
}
