//! Rotations on which poses insist.
//!
//! If the gyro is wrong (its scale, its range), the rotation of the state drifts from that of every pose in the same
//! direction. No noise of poses explains this: noises differ from pose to pose. If poses were weighed down for it, the
//! state would lose them for good. Therefore three poses whose differences have the same direction show an error of the state: its
//! rotation is loosened until the innovation is at the gate. Their positions must not surprise, or by no more than gravity in the
//! wrong direction explains. And the vehicle must turn fast enough: the drift of a gyro that is wrong by a share grows with the
//! rate. Poses of a body that is turned on the vehicle, or of swapped markers, are not the drift of a gyro.

use super::{
    Estimator,
    params::ImuPose,
    trust::{REFUSALS, Said},
    weighing::{DOUBT, innovation, to_gate, turn},
};
use crate::{GRAVITY, ukf::Innovation};
use libm::sqrt;

/// A larger difference does not come from a drift over three poses, rad.
const LARGEST: f64 = 0.35;
/// A wrong gyro is off by at most this many times what it reads.
const WRONG: f64 = 3.0;
/// What the noise of poses adds to the difference, in deviations.
const NOISY: f64 = 5.0;
/// Largest scale of the rotation's variances, of the state and of a pose whose rotation says nothing.
const MOST: f64 = 1e6;

/// Number of poses before that must say the same.
const BEFORE: usize = 2;
/// Longest time between poses that is allowed for, s.
const LONGEST: f64 = 0.1;

impl Estimator {
    /// Corrects the head with a pose if its rotation surprises as that of the two poses before, and its position does not, or by
    /// no more than gravity in the wrong direction explains. `period` is the time since the pose before, s.
    pub(super) fn follows_rotation(
        &mut self,
        measured: &ImuPose,
        whole: &Innovation<6>,
        said: &Said,
        period: f64,
    ) -> bool {
        let (gate, nis, turned) = (self.derived.gate_pose, whole.squared(6), turn(&whole.residual));
        let modelled = self.head.kept_bias.is_some();
        if modelled || nis <= gate || turned > LARGEST {
            return false;
        }
        // Noise that is larger than configured has the same direction by chance sometimes.
        let noisy = nis <= gate * self.head.trust.level();
        let before = if noisy { REFUSALS } else { BEFORE };
        if !self.head.trust.insists(said, before, self.noises()) {
            return false;
        }
        let time = (before + 1) as f64 * period.min(LONGEST);
        let (gyro, ..) =
            self.samples.interval(self.head.next_sample.min(self.samples.end().saturating_sub(1)));
        if turned > WRONG * gyro.norm() * time + NOISY * self.params.rotation_noise {
            return false;
        }
        // Where samples are missing, poses of another body look like the drift of a gyro.
        let (now, accepted) = (self.head.applied, self.head.trust.accepted);
        let span = DOUBT + (now - accepted).max(0.0);
        if self.samples.doubt(self.head.next_sample, now, span, span).is_some() {
            return false;
        }
        let alone = self.innovation(measured, (1.0, MOST));
        let placed = alone.is_some_and(|alone| alone.squared(6) <= gate);
        // The direction of gravity may have been wrong since somewhat earlier.
        let wrong = time + DOUBT;
        if !placed && said.position().norm() > 0.5 * GRAVITY * turned * wrong * wrong {
            return false;
        }
        let noise = self.params.pose_noise(measured, (1.0, 1.0));
        let loosened = |by: f64| {
            let mut state = self.head.state;
            if placed {
                state.loosen_rotation(sqrt(by));
            } else {
                state.loosen(sqrt(by));
            }
            state
        };
        let scale =
            to_gate(nis, gate, MOST, |by| innovation(&loosened(by), measured, &noise).map(|i| i.squared(6)));
        let corrected = scale.map(loosened).and_then(|mut state| {
            let passing = innovation(&state, measured, &noise)?;
            state.apply(&passing);
            Some(state)
        });
        let Some(corrected) = corrected else { return false };
        self.head.state = corrected;
        true
    }
}
