//! Poses that return far from where the vehicle was before samples were missing: they are used only while they turn as the gyro
//! shows, because they may be those of another body.
//!
//! Where samples are missing the state is so uncertain that it would take any pose.

use crate::{
    ring::Ring,
    so3,
    types::{Matrix3, PoseSample, Vector3},
    ukf::Navigation,
};

/// After a longer interval without a sample, s, poses are compared with the state before it.
pub(super) const LONG: f64 = 0.02;
/// Poses within this, m and rad, are near.
const NEAR: (f64, f64) = (0.15, 0.2);
/// Far poses must turn as the gyro shows for this time, s; they may differ by the first of these, rad, and by the second for each
/// second, rad/s: noise and bias.
const TURNS: f64 = 0.15;
const DIFFERS: (f64, f64) = (0.012, 0.06);
/// How many turns are kept: of about 30 ms. Older poses are not compared.
const KEPT: usize = 16;

/// The turn by the gyro since samples were missing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probation {
    /// The last turns and their times, s: maps IMU axes to those at the first sample.
    turns: Ring<Option<(f64, Matrix3)>, KEPT>,
    /// Since when, s, poses have turned like this, and the rotation from the one to the other then.
    like: Option<(f64, Matrix3)>,
}

impl Default for Probation {
    fn default() -> Self {
        Self { turns: Ring::new(None), like: None }
    }
}

impl Probation {
    /// Takes a rate without bias, rad/s, IMU axes, for the `dt` s up to a time, s.
    pub(super) fn feel(&mut self, rate_i: &Vector3, time: f64, dt: f64) {
        if dt >= LONG {
            *self = Self::default();
        }
        let last = self.turns.iter().next().copied().flatten();
        let turn = last.map_or_else(Matrix3::identity, |(_, turn)| turn * so3::exp(&(rate_i * dt)));
        self.turns.push(Some((time, turn)));
    }

    /// Whether a pose of the IMU may be used; `before` is the state from before the gap, moved on to a time, s.
    pub(super) fn admits(&mut self, pose: &PoseSample, before: &Navigation, now: f64) -> bool {
        let turns_alike = self.turns_alike(pose);
        let expected_w = before.position_w - before.velocity_w * (now - pose.time);
        let turned = so3::angle(&(before.rotation_wi.transpose() * pose.rotation_wr));
        let (far, wide) = NEAR;
        (pose.position_w - expected_w).norm() < far && turned < wide || turns_alike
    }

    /// Whether poses have turned as the gyro shows for long enough.
    fn turns_alike(&mut self, pose: &PoseSample) -> bool {
        let Some((_, turn)) = self.turns.iter().flatten().find(|(time, _)| *time <= pose.time) else {
            return false;
        };
        let apart = pose.rotation_wr * turn.transpose();
        let (since, first) = *self.like.get_or_insert((pose.time, apart));
        let (noise, bias) = DIFFERS;
        let long = pose.time - since;
        if so3::angle(&(first.transpose() * apart)) > noise + bias * long {
            self.like = Some((pose.time, apart));
            return false;
        }
        long > TURNS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use proptest::prelude::*;

    proptest! {
        /// Far poses of the vehicle are used soon, those of a body that turns otherwise never, and near ones at once.
        #[test]
        fn far_poses_must_turn_as_the_gyro_shows(
            rate in -2.0..2.0_f64, other in 0.25..3.0_f64, away in 0.3..2.0_f64, seed in 0..99_u64
        ) {
            let mut random = Random::new(seed);
            let (mut own, mut others, mut near) = (Probation::default(), Probation::default(), Probation::default());
            let before = Navigation::ORIGIN;
            let (mut used, mut misused) = (f64::INFINITY, 0);
            own.feel(&Vector3::zeros(), 0.0, 0.3);
            for k in 1..300 {
                let time = 0.002 * f64::from(k);
                let rate_i = Vector3::new(rate, 0.3 * rate, -rate);
                for probation in [&mut own, &mut others, &mut near] {
                    probation.feel(&rate_i, time, 0.002);
                }
                if k % 5 == 0 {
                    let taken = time - 0.01;
                    let mut pose = |place: f64, rate_i: Vector3| PoseSample {
                        time: taken,
                        arrival: time,
                        position_w: Vector3::new(place, 0.0, 0.0),
                        rotation_wr: so3::exp(&(rate_i * taken)) * so3::exp(&random.normal3(1.5e-3)),
                        tracking_valid: true,
                    };
                    let (far, another) = (pose(away, rate_i), pose(away, rate_i + Vector3::new(0.0, 0.0, other)));
                    if own.admits(&far, &before, time) {
                        used = time.min(used);
                    }
                    misused += u32::from(others.admits(&another, &before, time));
                    let turned = so3::angle(&pose(0.0, rate_i).rotation_wr) > 0.15;
                    prop_assert!(turned || near.admits(&pose(0.0, rate_i), &before, time));
                }
            }
            prop_assert!(used < 0.3 && misused == 0, "{used} {misused}");
        }
    }
}
