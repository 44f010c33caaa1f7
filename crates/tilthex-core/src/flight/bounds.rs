//! The bounds of the flight, and the progress of a landing, watched on the estimate from whatever sensors it comes.

use super::{fence::Fence, landing::ATTEMPTS};
use crate::{
    supervisor::{
        Phase,
        limits::{FENCE_MARGIN, LANDING_ASIDE, LANDING_RISES, LANDING_STOPS},
    },
    types::{RobotState, Vector3},
};

/// A descent makes progress if it falls below its lowest point by this much, m.
const PROGRESS: f64 = 0.05;

/// The progress of a descent.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Progress {
    from_w: Vector3,
    lowest: f64,
    stopped: f64,
    fails: bool,
}

/// The place of the start, and the descent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Bounds {
    start_w: Option<Vector3>,
    on_ground: bool,
    descent: Option<Progress>,
}

/// The bound that is crossed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Outside {
    /// The vehicle is outside the fence.
    pub(super) fence: bool,
    /// The landing makes no progress.
    pub(super) landing: bool,
}

impl Bounds {
    /// The flight begins at a position, on the ground or in the air.
    pub(super) fn begin(&mut self, start_w: &Vector3, on_ground: bool) {
        *self = Self { start_w: Some(*start_w), on_ground, descent: None };
    }

    /// Position at which the flight began, m, world.
    pub(super) fn start(&self) -> Option<Vector3> {
        self.start_w
    }

    /// Height above the ground on which the flight began, m; `None` if it began in the air.
    pub(super) fn height(&self, position_w: &Vector3) -> Option<f64> {
        self.start_w.filter(|_| self.on_ground).map(|start_w| position_w.z - start_w.z)
    }

    /// One tick. `fast` says whether the vehicle is faster than allowed; `attempts` is how often something has
    /// stopped its descent.
    pub(super) fn step(
        &mut self,
        fence: &Fence,
        phase: Phase,
        robot: &RobotState,
        (fast, attempts): (bool, u32),
        dt: f64,
    ) -> Outside {
        let Some(start_w) = self.start_w.filter(|_| phase.in_flight()) else { return Outside::default() };
        let beyond = fence.beyond(&start_w, &robot.position_w);
        if !matches!(phase, Phase::Landing | Phase::Emergency) {
            self.descent = None;
            return Outside { fence: beyond > 0.0, landing: false };
        }
        let height = robot.position_w.z;
        let fresh = Progress { from_w: robot.position_w, lowest: height, stopped: 0.0, fails: false };
        let descent = self.descent.get_or_insert(fresh);
        if height < descent.lowest - PROGRESS {
            (descent.lowest, descent.stopped) = (height, 0.0);
        }
        descent.stopped += dt;
        let away_w = robot.position_w - descent.from_w;
        // Without a position an emergency drifts; the drift alone is not a failure of the descent.
        let aside = phase == Phase::Landing && away_w.xy().norm() > LANDING_ASIDE;
        descent.fails |= descent.stopped > LANDING_STOPS
            || away_w.z > LANDING_RISES
            || aside
            || beyond > FENCE_MARGIN
            || fast
            || attempts >= ATTEMPTS;
        Outside { fence: beyond > 0.0, landing: descent.fails }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FENCE: Fence = Fence { sideways: 3.0, up: 3.0 };

    fn at(x: f64, y: f64, z: f64) -> RobotState {
        RobotState::at_rest(Vector3::new(x, y, z))
    }

    #[test]
    fn the_fence_is_a_box_around_the_start() {
        let mut bounds = Bounds::default();
        bounds.begin(&Vector3::new(5.0, 0.0, 1.0), true);
        let mut outside = |robot| bounds.step(&FENCE, Phase::Flying, &robot, (false, 0), 0.01).fence;
        assert!(!outside(at(7.9, -2.9, 3.9)) && !outside(at(5.0, 0.0, -9.0)));
        assert!(outside(at(8.1, 0.0, 2.0)) && outside(at(5.0, -3.1, 2.0)) && outside(at(5.0, 0.0, 4.1)));
    }

    #[test]
    fn a_landing_that_rises_runs_away_or_stops_fails_and_stays_failed() {
        let run = |way: &dyn Fn(f64) -> RobotState| {
            let mut bounds = Bounds::default();
            bounds.begin(&Vector3::zeros(), true);
            (0..2000).find(|k| {
                bounds.step(&FENCE, Phase::Landing, &way(f64::from(*k) * 0.01), (false, 0), 0.01).landing
            })
        };
        assert_eq!(run(&|t| at(0.0, 0.0, 1.0 - 0.25 * t)), None);
        assert!(run(&|t| at(0.0, 0.0, 1.0 + 0.25 * t)).is_some_and(|k| k < 300));
        assert!(run(&|t| at(t, 0.0, 1.0)).is_some_and(|k| k < 120));
        assert!(run(&|_| at(0.0, 0.0, 1.0)).is_some_and(|k| (700..1100).contains(&k)));
    }
}
