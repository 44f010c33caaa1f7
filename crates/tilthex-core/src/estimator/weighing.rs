//! The correction of the head by a pose: with full weight if the pose passes the gate, with a smaller weight if it is
//! surprising.
//!
//! A surprising pose has two explanations: the pose is noisier than configured, or the state is less certain than its
//! covariance says. The nearer explanation is taken: either the noise of the pose, or the deviations of position,
//! velocity and rotation are scaled until the innovation is at the gate. The deviations of the state are preferred after
//! a sample that was not simply measured, and if the pose before said the same. If neither scale is possible, the pose
//! contradicts the state, and nothing is applied.

use super::{
    Estimator, Outcome, PoseReport,
    history::{Doubt, PoseEntry},
    params::ImuPose,
    trust::{Agreement, Said},
};
use crate::{
    so3,
    types::Vector3,
    ukf::{Innovation, Navigation, UkfState},
};
use libm::sqrt;

/// A rotation that differs from the state by more than this contradicts it because markers were swapped, rad.
pub(super) const RIGHT_ANGLE: f64 = core::f64::consts::FRAC_PI_2;
/// The state is doubtful for this time after a sample that was not simply measured, s.
pub(super) const DOUBT: f64 = 0.1;
/// Largest scale of the variances of a surprising pose. A pose that needs a larger one contradicts the state.
const MOST_NOISE: f64 = 100.0;
/// Largest scale of the state's variances.
const MOST_DOUBT: f64 = 32.0;
/// Largest scale of the state's variances after a blow, or while a model replaces the IMU.
const MOST_DOUBT_SHAKEN: f64 = 1e4;
/// The error is in the state if its variances need a scale that is smaller than that of the pose by this factor.
const NEARER: f64 = 4.0;
/// Steps of the search for a scale; they bound the work.
const SEARCH_STEPS: u32 = 6;
/// The state may be wrong by this many standard deviations.
const DEVIATIONS: f64 = 3.0;
/// While samples are simply measured, the velocity may be wrong by this beyond its deviations, m/s.
const UNDOUBTED: f64 = 1.0;
/// A rotation that poses contradict may be wrong by this much for each second since the last pose that agreed, rad/s.
const TURN_RATE: f64 = 0.3;

/// A motion is like the one that a drift of the gyro explains if it differs by less than this share of it.
const LIKE: f64 = 0.5;
/// No blow throws a vehicle away faster than this, m/s.
const FASTEST: f64 = 5.0;

/// Scales of the variances of a measured position and rotation.
type Scales = (f64, f64);

/// The largest error of the state, m and m/s, that doubtful samples explain. Poses of another body, or of a displaced one,
/// agree with each other as well as right ones do, but the vehicle cannot be there.
#[derive(Clone, Copy, Debug)]
struct Missed {
    position: f64,
    velocity: f64,
}

impl Missed {
    fn explains(&self, agreement: &Agreement) -> bool {
        agreement.position.norm() < self.position + agreement.deviation.position
            && agreement.velocity.norm() < self.velocity + agreement.deviation.velocity
    }
}

impl Estimator {
    /// Corrects the head with a pose.
    pub(super) fn apply(&mut self, pose: &PoseEntry) -> PoseReport {
        let period = pose.time - core::mem::replace(&mut self.head.applied, pose.time);
        let measured = self.params.imu_pose(&self.derived, &pose.position, &pose.rotation);
        let own = self.head.trust.noise * self.head.trust.noise;
        let refused = report(pose.time, Outcome::Rejected, f64::INFINITY, None);
        let Some(whole) = self.innovation(&measured, (1.0, 1.0)) else {
            return refused;
        };
        let noisier = (own != 1.0).then(|| self.innovation(&measured, (own, own)));
        let trusted = match &noisier {
            None => &whole,
            Some(Some(noisier)) => noisier,
            Some(None) => return refused,
        };
        let surprise = trusted.squared(6);
        let nis = whole.squared(6);
        let gate = self.derived.gate_pose;
        let said = Said::new(pose.time - self.head.trust.accepted, &whole.residual);
        let follows = self.follows_rotation(&measured, &whole, &said, period);
        let (noises, next) = (self.noises(), self.head.next_sample);
        let doubtful = |since: f64| self.samples.doubt(next, pose.time, DOUBT.min(since), DOUBT).is_some();
        let outcome = if follows {
            self.head.trust.accept(pose.time, 1.0);
            self.head.trust.note(said);
            Outcome::Accepted
        } else if self.head.trust.contradicts_still(&said, noises, doubtful) {
            self.head.trust.weigh(said, noises);
            Outcome::Rejected
        } else if surprise <= gate || surprise <= gate * self.head.trust.level() {
            self.head.state.apply(trusted);
            self.head.trust.accept(pose.time, nis / 6.0);
            self.head.trust.note(said);
            Outcome::Accepted
        } else {
            self.surprised(pose, &measured, &whole, said, surprise)
        };
        if !follows && matches!(outcome, Outcome::Accepted | Outcome::Weighed) {
            self.head.trust.remember(surprise);
        }
        self.stale |= outcome != Outcome::Rejected;
        report(pose.time, outcome, nis, Some(&whole))
    }

    /// The innovation of a pose of the IMU, with the configured variances multiplied by these scales.
    pub(super) fn innovation(&self, measured: &ImuPose, scales: Scales) -> Option<Innovation<6>> {
        innovation(&self.head.state, measured, &self.params.pose_noise(measured, scales))
    }

    /// Takes a corrected state, unless this changes the velocity by `most` m/s or more.
    fn take(&mut self, corrected: UkfState, most: f64) -> bool {
        let slow = (corrected.mean.velocity_w - self.head.state.mean.velocity_w).norm() < most;
        if slow {
            self.head.state = corrected;
        }
        slow
    }

    /// Largest error of the velocity while samples are simply measured, m/s.
    fn undoubted(&self) -> f64 {
        let [_, velocity, _] = self.head.state.deviations();
        UNDOUBTED + DEVIATIONS * velocity
    }

    /// Corrects with a pose outside of the gate.
    fn surprised(
        &mut self,
        pose: &PoseEntry,
        measured: &ImuPose,
        whole: &Innovation<6>,
        said: Said,
        surprise: f64,
    ) -> Outcome {
        // After a model, an impact or a gap the state is so uncertain that poses decide.
        let since = pose.time - self.head.trust.accepted;
        let doubt = self.samples.doubt(self.head.next_sample, pose.time, DOUBT + since, since);
        let far = said.position().norm();
        // Poses that were impossible when they began do not become possible with time.
        let possible = far < self.farthest(since) && !self.head.trust.contradicts();
        let blown = doubt.is_some_and(|doubt| doubt.shaken) && possible;
        let missed = doubt.map(|doubt| self.missed(&doubt, since)).filter(|m| possible && m.position > far);
        let doubtful = missed.is_some();
        let gate = self.derived.gate_pose * self.head.trust.level();
        let repeated = self.head.trust.repeats(&said, self.noises());
        if turn(&whole.residual) > RIGHT_ANGLE && self.pass_position(pose) {
            return Outcome::PositionOnly;
        }
        let noise = self.noise_for(measured, surprise, gate);
        let most = if doubtful { MOST_DOUBT_SHAKEN } else { MOST_DOUBT };
        let doubt = self.doubt_for(measured, surprise, gate, most);
        let needed = noise.map_or(f64::INFINITY, |(position, rotation)| position.max(rotation));
        let doubt = doubt.filter(|doubt| repeated || doubtful || NEARER * doubt < needed);
        if doubt.is_some() && self.head.trust.contradicts() {
            // One pose alone would change the velocity too much. Several poses together show the velocity.
            let uncertain = Missed { position: f64::INFINITY, velocity: self.undoubted() };
            return self.contradict(pose, measured, said, Some(uncertain));
        }
        if let Some(doubt) = doubt {
            let own = self.head.trust.noise * self.head.trust.noise;
            let noise = self.params.pose_noise(measured, (own, own));
            let mut state = self.head.state;
            state.loosen(sqrt(doubt));
            if let Some(passing) = innovation(&state, measured, &noise) {
                state.apply(&passing);
                if self.take(state, missed.map_or(self.undoubted(), |m| m.velocity)) {
                    self.head.trust.accept(pose.time, own);
                    return Outcome::Accepted;
                }
            }
        }
        if let Some(weighed) = noise.and_then(|scales| self.innovation(measured, scales)) {
            self.head.state.apply(&weighed);
            self.head.trust.weigh(said, self.noises());
            return Outcome::Weighed;
        }
        let outcome = self.contradict(pose, measured, said, missed);
        if !(doubtful || blown) && outcome == Outcome::Rejected {
            self.head.trust.contradict();
        }
        outcome
    }

    /// The scales of the pose's variances with which its innovation is at the gate. Only position or only rotation is
    /// scaled if the other one is not surprising. None if the scales would be too large.
    fn noise_for(&self, measured: &ImuPose, surprise: f64, gate: f64) -> Option<Scales> {
        let own = self.head.trust.noise * self.head.trust.noise;
        let most = own * MOST_NOISE;
        let alone = |scales: Scales| self.innovation(measured, scales).is_some_and(|i| i.squared(6) <= gate);
        let (place, turn) = match (alone((own, most)), alone((most, own))) {
            (true, _) => (own, most),
            (_, true) => (most, own),
            _ => (most, most),
        };
        let scales = |by: f64| (place.min(own * by), turn.min(own * by));
        let at = |by: f64| self.innovation(measured, scales(by)).map(|i| i.squared(6));
        to_gate(surprise, gate, MOST_NOISE, at).map(scales)
    }

    /// The scale of the state's variances with which the innovation of a pose is at the gate. None if it would be too
    /// large.
    fn doubt_for(&self, measured: &ImuPose, surprise: f64, gate: f64, most: f64) -> Option<f64> {
        let own = self.head.trust.noise * self.head.trust.noise;
        let noise = self.params.pose_noise(measured, (own, own));
        to_gate(surprise, gate, most, |by| {
            let mut state = self.head.state;
            state.loosen(sqrt(by));
            innovation(&state, measured, &noise).map(|i| i.squared(6))
        })
    }

    /// Configured deviations of position (m) and rotation (rad).
    pub(super) fn noises(&self) -> (f64, f64) {
        (self.params.position_noise, self.params.rotation_noise)
    }

    /// Swapped markers change the rotation of the body, but not its position: applies the position with the rotation
    /// of the state.
    fn pass_position(&mut self, pose: &PoseEntry) -> bool {
        let head = &mut self.head;
        let arm_w = head.state.mean.rotation_wi * self.derived.arm_i;
        let [_, _, rotation] = head.state.deviations();
        let noise = head.trust.noise * self.params.position_noise;
        let variance = noise * noise + rotation * rotation * arm_w.norm_squared();
        let alone = head.state.position_innovation(&(pose.position - arm_w), variance);
        let Some(passing) = alone.filter(|i| i.squared(3) <= self.derived.gate_position * head.trust.level())
        else {
            return false;
        };
        head.state.apply(&passing);
        true
    }

    /// Handles a pose that neither its noise nor the error of the state explains. If the poses before it did not fit
    /// either, they may be noisier than configured, or right.
    fn contradict(
        &mut self,
        pose: &PoseEntry,
        measured: &ImuPose,
        said: Said,
        missed: Option<Missed>,
    ) -> Outcome {
        let noises = self.noises();
        let trust = &mut self.head.trust;
        let modelled = self.head.kept_bias.is_some();
        let since = pose.time - trust.accepted;
        let lasting = since > self.params.reacquire_after;
        let agreement = trust.refuse(said, noises, modelled);
        let Some(mut agreement) = agreement.filter(Agreement::is_credible) else {
            return self.refused(pose);
        };
        let nis = agreement.noise * agreement.noise;
        if agreement.noise > trust.noise {
            trust.noise = agreement.noise;
            if let Some(passing) =
                self.innovation(measured, (nis, nis)).filter(|i| i.squared(6) <= self.derived.gate_pose)
            {
                self.head.state.apply(&passing);
                self.head.trust.accept(pose.time, nis);
                return Outcome::Accepted;
            }
        }
        let turned = agreement.rotation.norm();
        let possible = lasting && turned < RIGHT_ANGLE && turned < TURN_RATE * since;
        let explained = missed.is_some_and(|m| m.explains(&agreement));
        // An error of the IMU grows. A difference that poses have shown all the time is another error.
        let news = !explained && self.head.trust.is_news(since);
        let drifted = news && possible && !modelled && self.drifted(&agreement, since);
        if drifted {
            agreement.rate = agreement.rotation / since;
            agreement.deviation.gyro_bias = agreement.deviation.gyro_bias.max(turned / since);
        }
        if explained || drifted || possible && self.pass_position(pose) {
            self.believe(&agreement, modelled || drifted);
            self.head.trust.accept(pose.time, nis);
            return Outcome::Accepted;
        }
        self.refused(pose)
    }

    /// Whether a wrong bias of the gyro for `since` seconds explains what poses say: the rotation of the state has drifted,
    /// therefore also the direction of gravity, and with it velocity and position.
    fn drifted(&self, agreement: &Agreement, since: f64) -> bool {
        let [position, velocity, _] = self.head.state.deviations().map(|d| DEVIATIONS * d);
        let drift_w = agreement.rotation.cross(&(crate::GRAVITY * Vector3::z()));
        let like = |found: &Vector3, drift: Vector3, deviation: f64| {
            (found - drift).norm() < LIKE * drift.norm() + deviation
        };
        like(&agreement.position, drift_w * (since * since / 6.0), position)
            && like(&agreement.velocity, drift_w * (since / 2.0), velocity)
    }

    /// The largest error of the position after a blow, m, `since` seconds after the last pose that agreed.
    fn farthest(&self, since: f64) -> f64 {
        let [position, ..] = self.head.state.deviations();
        (FASTEST + self.head.state.mean.velocity_w.norm()) * since + DEVIATIONS * position
    }

    /// The largest error of the state after doubtful samples, `since` seconds after the last pose that agreed.
    fn missed(&self, doubt: &Doubt, since: f64) -> Missed {
        let [position, velocity, _] = self.head.state.deviations().map(|d| DEVIATIONS * d);
        // If the vehicle has struck something, its velocity is reversed at most.
        let fast = velocity + 2.0 * self.head.state.mean.velocity_w.norm();
        Missed { position: doubt.position + fast * since + position, velocity: doubt.velocity + fast }
    }

    /// The position of a pose that contradicts the state may still be good.
    fn refused(&mut self, pose: &PoseEntry) -> Outcome {
        if self.pass_position(pose) { Outcome::PositionOnly } else { Outcome::Rejected }
    }

    /// Replaces the state by that of poses that agree with each other.
    fn believe(&mut self, agreement: &Agreement, wrong_rate: bool) {
        let state = &mut self.head.state;
        let before = state.mean;
        let mean = Navigation {
            position_w: before.position_w + agreement.position,
            velocity_w: before.velocity_w + agreement.velocity,
            rotation_wi: so3::exp(&agreement.rotation) * before.rotation_wi,
            ..before
        };
        state.restart(mean, &agreement.deviation);
        if wrong_rate {
            // The rate of the gyro, or of the model that replaces it, is wrong.
            state.set_gyro_bias(&crate::ukf::GyroBias {
                mean_i: before.gyro_bias_i - before.rotation_wi.transpose() * agreement.rate,
                deviation: agreement.deviation.gyro_bias,
            });
        }
    }
}

/// The scale of some variances with which an innovation is at the gate. `at` gives the innovation for a scale;
/// `surprise` is its value at 1. It never falls faster than the scale grows, so that no step goes too far.
pub(super) fn to_gate(surprise: f64, gate: f64, most: f64, at: impl Fn(f64) -> Option<f64>) -> Option<f64> {
    let (mut by, mut now) = (1.0, surprise);
    for _ in 0..SEARCH_STEPS {
        by *= now / gate;
        if by > most || by.is_nan() {
            return None;
        }
        now = at(by)?;
        if now < 1.05 * gate {
            return Some(by);
        }
    }
    None
}

pub(super) fn innovation(
    state: &UkfState,
    measured: &ImuPose,
    noise: &crate::ukf::PoseNoise,
) -> Option<Innovation<6>> {
    state.pose_innovation(&measured.position_w, &measured.rotation_wi, noise)
}

/// Angle of an innovation's rotation, rad.
pub(super) fn turn([_, _, _, x, y, z]: &[f64; 6]) -> f64 {
    Vector3::new(*x, *y, *z).norm()
}

fn report(time: f64, outcome: Outcome, nis: f64, innovation: Option<&Innovation<6>>) -> PoseReport {
    let (innovation, deviation) = innovation.map_or(([0.0; 6], [0.0; 6]), |i| (i.residual, i.deviation));
    PoseReport { time, outcome, nis, innovation, deviation }
}
