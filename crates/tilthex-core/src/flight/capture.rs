//! Poses that are false: exactly repeated, a tracker's default, or in contradiction to the IMU.
//!
//! A capture system may repeat the pose of a body that it has lost, with or without noise, and mark it as tracked.
//! Such poses agree with each other, and an estimator that follows them sees no contradiction until the vehicle is
//! fast. Therefore the motion of the last second is computed from the IMU alone, with biases that hardly follow the poses.

use super::{
    gyro_doubt::{BIAS, GyroDoubt, LEAST},
    probation::{LONG, Probation},
};
use crate::{
    Wrench,
    estimator::Estimator,
    so3,
    supervisor::limits::{
        CAPTURE_AGREES, CAPTURE_WINDOW, POSE_FROZEN, POSE_LOST, POSES_REFUSED, RECKONED_FIRST,
    },
    types::{Matrix3, PoseSample, Vector3},
    ukf::Navigation,
    vehicle::Vehicle,
};

/// A wrong accelerometer explains at least this part of a contradiction.
const PART: f64 = 0.4;
/// The sideways force that it shows is at most this part of the force along the contradiction.
const ACROSS: f64 = 0.6;

/// The gyro explains at most this many contradictions in a row.
const EXCUSED: u32 = 3;
/// The mean acceleration of a contradiction is taken over at least this time, s.
const SHORTEST: f64 = 0.1;
/// The computed attitude follows that of the estimate by this part from one window to the next.
const FOLLOWS: f64 = 0.05;
/// The biases follow those of the estimate by this part after each window in which poses and IMU agree: those at rest are not
/// exact, and change with the temperature.
const BIASES_FOLLOW: f64 = 0.25;
/// Largest drift of the IMU alone, m/s and m/s^2.
const DRIFT: (f64, f64) = (0.05, 0.1);
/// Time with poses that corrects the state after a blow, s: the samples show only a part of a blow.
const SETTLES: f64 = 0.3;
/// An estimate from before a gap is moved on for this time, s: the errors of the IMU grow.
const KEPT: f64 = 2.0;
/// If the time between two samples is longer than this, s, samples are missing.
const GAP: f64 = 0.01;
/// A difference of up to this many standard deviations (of the estimate and of the missing samples) is no contradiction.
const DEVIATIONS: f64 = 3.0;

/// A motion, computed from the IMU alone.
#[derive(Clone, Copy, Debug)]
struct Window {
    reckoned: Navigation,
    from_w: Vector3,
    time: f64,
    length: f64,
    /// How long the estimate went without a pose, s.
    without: f64,
    /// Variance of the velocity that the samples may have missed, (m/s)^2.
    missed: f64,
    /// Deviations of position and velocity at its begin, m and m/s.
    began: (f64, f64),
    /// Integral of the external force that the IMU shows with the biases of the window, N s, world.
    impulse_w: Vector3,
}

impl Window {
    /// A window that begins with a state, and uses the biases of another.
    fn from(state: &Navigation, rest: &Navigation, length: f64, began: (f64, f64)) -> Self {
        let (gyro_bias_i, accelerometer_bias_i) = (rest.gyro_bias_i, rest.accelerometer_bias_i);
        let reckoned = Navigation { gyro_bias_i, accelerometer_bias_i, ..*state };
        let from_w = state.position_w;
        Self {
            reckoned,
            from_w,
            time: 0.0,
            length,
            without: 0.0,
            missed: 0.0,
            began,
            impulse_w: Vector3::zeros(),
        }
    }

    /// Whether the accelerometer explains a contradiction. The rotors are the third source: a wrong accelerometer
    /// shows a force, N, world, that does not exist: now, or in the mean of the window if it is right again.
    fn shows_a_force(&self, state: &Navigation, force_w: &Vector3, vehicle: &Vehicle) -> bool {
        let off_velocity_w = state.velocity_w - self.reckoned.velocity_w;
        let time = self.time.max(SHORTEST);
        let needed_w = -vehicle.mass() * off_velocity_w / time;
        let explains = |force_w: &Vector3| {
            let along = force_w.dot(&needed_w) / needed_w.norm().max(f64::MIN_POSITIVE);
            let across = (force_w.norm_squared() - along * along).max(0.0);
            // A force that begins within the window is larger than its mean over the window.
            along > PART * needed_w.norm() && across < ACROSS * ACROSS * along * along
        };
        explains(force_w) || explains(&(self.impulse_w / time))
    }
}

/// Whether the capture system's poses can be true.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CaptureWatch {
    last: Option<(Vector3, Matrix3)>,
    /// When the last pose was first seen, s, and how often it was repeated.
    since: f64,
    repeats: u32,
    moves: bool,
    last_gyro_i: Vector3,
    frozen: bool,
    /// State and biases of the vehicle at rest; in flight the biases follow slowly.
    rest: Option<Navigation>,
    /// The gyro's bias at rest, rad/s, IMU axes. A bias that is farther from it than a bias can change was taught by false poses.
    still_i: Vector3,
    window: Option<Window>,
    /// The last estimate that nothing made doubtful, and this estimate moved on by the IMU alone since samples were missing: where
    /// false poses came with the gap, the estimate follows them. And the time since then, s.
    certain: Option<Navigation>,
    before: Option<(Navigation, f64)>,
    probation: Probation,
    /// Turns that the gyro showed and the rotors did not make.
    doubt: GyroDoubt,
    /// Time after a blow in which nothing is compared, s.
    settles: f64,
    /// Whether the gyro's bias has changed since the vehicle was at rest, and how many contradictions in a row this
    /// has explained.
    stepped: bool,
    excused: u32,
    lies: bool,
    /// Whether they have contradicted it sideways more than in height.
    aside: bool,
}

/// A contradiction: the state from the IMU alone, the estimate that follows the poses, and the begin of both, m,
/// world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Contradiction {
    pub(super) reckoned: Navigation,
    pub(super) estimate: Navigation,
    pub(super) from_w: Vector3,
}

/// The sensor that is wrong if poses and IMU contradict each other.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // made once in a contradiction; a box would allocate
pub(super) enum Verdict {
    /// The poses: none is used from then on. The flight goes on from a state that they have not changed.
    PosesLie(Contradiction, Navigation),
    /// The gyro: its bias is not known any more.
    GyroIsOff,
}

impl CaptureWatch {
    /// Whether poses are repeated exactly.
    pub(super) fn frozen(&self) -> bool {
        self.frozen
    }

    /// Whether poses contradict the IMU. From then on no pose is used.
    pub(super) fn lies(&self) -> bool {
        self.lies
    }

    /// Whether poses contradict the IMU sideways: a vertical motion does not show that they are true after all.
    pub(super) fn lies_aside(&self) -> bool {
        self.lies && self.aside
    }

    /// The poses were found to be those of this vehicle: they are used again, and biases of the IMU are learnt anew.
    pub(super) fn recognized(&mut self) {
        (self.lies, self.stepped, self.excused, self.before) = (false, true, 0, None);
        self.struck();
    }

    /// Whether a pose may be true: it is not an exact repetition while the IMU's readings change, and not a tracker's
    /// default. Poses that contradict the IMU may still be those of the vehicle.
    pub(super) fn admits(&mut self, pose: &PoseSample) -> bool {
        let this = (pose.position_w, pose.rotation_wr);
        // The rotation of a lost body may be exactly constant although its position has noise, or the other way
        // round.
        let same =
            self.last.is_some_and(|(position_w, rotation_wr)| position_w == this.0 || rotation_wr == this.1);
        if same {
            self.repeats = self.repeats.saturating_add(1);
        } else {
            (self.since, self.repeats, self.moves) = (pose.time, 0, false);
        }
        self.last = Some(this);
        self.frozen = self.moves && self.repeats >= POSES_REFUSED && pose.time - self.since > POSE_FROZEN;
        let default = this == (Vector3::zeros(), Matrix3::identity());
        !(self.frozen || default)
    }

    /// A model replaces the IMU of a vehicle in flight, which is never exactly at rest.
    pub(super) fn flies_unfelt(&mut self) {
        self.moves = true;
        self.doubt.miss();
    }

    /// The vehicle is at rest: the readings of its IMU are biases.
    pub(super) fn rests(&mut self, state: &Navigation) {
        (self.rest, self.window, self.settles, self.stepped) = (Some(*state), None, 0.0, false);
        (self.certain, self.before) = (None, None);
        self.still_i = state.gyro_bias_i;
        self.doubt.rests();
    }

    /// Whether a pose of the IMU is near the place before samples were missing, or turns as the gyro shows; at a time, s.
    pub(super) fn continues(&mut self, pose: &PoseSample, now: f64) -> bool {
        self.before.is_none_or(|(before, _)| self.probation.admits(pose, &before, now))
    }

    /// Takes an inertial sample at `time`, s, over the `dt` s before it, rad/s and m/s^2, IMU axes; `missed` is the variance of the
    /// velocity that it may miss, (m/s)^2, or none after a blow.
    pub(super) fn feel(
        &mut self,
        gyro_i: &Vector3,
        specific_force_i: &Vector3,
        missed: Option<f64>,
        (time, dt): (f64, f64),
    ) {
        self.moves |= *gyro_i != self.last_gyro_i;
        self.last_gyro_i = *gyro_i;
        let bias_i = self.before.map_or_else(Vector3::zeros, |(before, _)| before.gyro_bias_i);
        self.probation.feel(&(gyro_i - bias_i), time, dt);
        if missed.is_none() {
            self.before = None;
        } else if dt >= LONG {
            self.before = self.before.or(self.certain.take().map(|certain| (certain, 0.0)));
        }
        self.before = self
            .before
            .filter(|(_, since)| *since < KEPT)
            .map(|(before, since)| (before.advance(gyro_i, specific_force_i, dt), since + dt));
        let Some(missed) = missed.filter(|_| dt < GAP) else {
            self.struck();
            self.doubt.miss();
            return;
        };
        self.doubt.read(gyro_i, dt);
        if let Some(window) = &mut self.window {
            window.missed += missed;
            window.reckoned = window.reckoned.advance(gyro_i, specific_force_i, dt);
            window.time += dt;
        }
    }

    /// A blow, or invalid readings of the IMU: the state can be wrong until poses have corrected it.
    pub(super) fn struck(&mut self) {
        (self.window, self.settles, self.certain) = (None, SETTLES, None);
    }

    /// Once a tick of `dt` s: poses correct the state after a blow. Without poses nothing corrects it.
    pub(super) fn settle(&mut self, pose_age: f64, dt: f64) {
        if pose_age < POSE_LOST {
            self.settles = (self.settles - dt).max(0.0);
        }
    }

    /// Once a tick of `dt` s in flight: whether the estimate, which follows poses, contradicts the motion by the IMU.
    /// `external_r` is the external wrench that the IMU shows beyond the bias, robot axes.
    pub(super) fn contradicts(
        &mut self,
        estimator: &Estimator,
        external_r: &Wrench,
        vehicle: &Vehicle,
        dt: f64,
    ) -> Option<Verdict> {
        let mut rest = self.rest?;
        let state = estimator.navigation();
        if estimator.is_modelled() {
            self.struck();
        }
        let health = estimator.health();
        if self.settles > 0.0 {
            return None;
        }
        let (gyro_bias_i, accelerometer_bias_i) = (rest.gyro_bias_i, rest.accelerometer_bias_i);
        self.certain = Some(Navigation { gyro_bias_i, accelerometer_bias_i, ..state });
        let possible = (state.gyro_bias_i - self.still_i).norm() < BIAS.1;
        if self.stepped && possible && self.window.is_none_or(|window| window.time > window.length) {
            // The gyro's bias, as poses have shown it since then.
            rest.gyro_bias_i = state.gyro_bias_i;
            self.rest = Some(rest);
        }
        self.doubt.feel(&external_r.torque, vehicle, dt);
        let certain = (health.position_deviation, health.velocity_deviation);
        let fresh = Window::from(&state, &rest, CAPTURE_WINDOW, certain);
        let window = self.window.get_or_insert(fresh);
        window.without = window.without.max(health.position_age);
        // The force that the IMU shows beyond the rotors if the window's bias of the accelerometer is right.
        let learnt_i = state.accelerometer_bias_i - window.reckoned.accelerometer_bias_i;
        let force_i = vehicle.imu().rotation_r.transpose() * external_r.force + learnt_i * vehicle.mass();
        let force_w = state.rotation_wi * force_i;
        window.impulse_w += force_w * dt;
        let window = *window;
        // Without poses the errors of the IMU grow; true poses correct them.
        let drift = DRIFT.0 * window.without + DRIFT.1 * window.without * window.without;
        let missed = DEVIATIONS * (libm::sqrt(window.missed) + window.began.1);
        let slack = drift + missed * window.time + DEVIATIONS * (window.began.0 + certain.0);
        let slack_velocity = drift + missed + DEVIATIONS * certain.1;
        let off_w = state.position_w - window.reckoned.position_w;
        let off_velocity_w = state.velocity_w - window.reckoned.velocity_w;
        let (far, fast) = CAPTURE_AGREES;
        let contradicts = off_w.norm() > far + slack || off_velocity_w.norm() > fast + slack_velocity;
        if window.time > window.length {
            // The computed attitude follows the gyro, because the estimate may follow poses that are constant.
            let own = window.reckoned.rotation_wi;
            let apart = so3::log(&(own.transpose() * state.rotation_wi));
            let rotation_wi = own * so3::exp(&(FOLLOWS * apart));
            let reckoned = Navigation { rotation_wi, ..fresh.reckoned };
            self.window = Some(Window { reckoned, ..fresh });
            if !contradicts {
                (self.excused, self.before) = (0, None);
                let (gyro_bias_i, accelerometer_bias_i) = (state.gyro_bias_i, state.accelerometer_bias_i);
                rest.gyro_bias_i += BIASES_FOLLOW * (gyro_bias_i - rest.gyro_bias_i);
                rest.accelerometer_bias_i +=
                    BIASES_FOLLOW * (accelerometer_bias_i - rest.accelerometer_bias_i);
                self.rest = Some(rest);
            }
        }
        if !contradicts || self.lies {
            return None;
        }
        let apart_i = so3::log(&(state.rotation_wi.transpose() * window.reckoned.rotation_wi));
        self.window = None;
        if self.excused < EXCUSED && possible && self.gyro_is_off(&state, &apart_i) {
            (self.stepped, self.settles) = (true, SETTLES);
            self.excused = self.excused.saturating_add(1);
            return Some(Verdict::GyroIsOff);
        }
        if window.shows_a_force(&state, &force_w, vehicle) {
            return None;
        }
        (self.lies, self.aside) = (true, off_velocity_w.xy().norm() > off_velocity_w.z.abs());
        let found = Contradiction { reckoned: window.reckoned, estimate: state, from_w: window.from_w };
        Some(Verdict::PosesLie(found, self.before.take().map_or(window.reckoned, |(before, _)| before)))
    }

    /// Whether an error of the gyro explains that the attitude by the gyro is `apart_i` rad, IMU axes, away from that
    /// of the poses.
    fn gyro_is_off(&self, state: &Navigation, apart_i: &Vector3) -> bool {
        let learnt = self.rest.map_or(0.0, |rest| (state.gyro_bias_i - rest.gyro_bias_i).norm());
        // A bias that has changed once may change back, also just after a blow that hides it.
        let again = self.stepped && (LEAST..BIAS.1 * CAPTURE_WINDOW).contains(&apart_i.norm());
        learnt > BIAS.0 || again || self.doubt.explains(apart_i)
    }

    /// The vehicle takes off from rest: its first motion is computed in one window.
    pub(super) fn take_off(&mut self, state: &Navigation) {
        self.window = self.rest.map(|rest| Window::from(state, &rest, RECKONED_FIRST, (0.0, 0.0)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After a blow the watch waits for poses, also for slow ones, and no longer than they need.
    #[test]
    fn slow_poses_end_the_wait_after_a_blow() {
        let waits = |pose_age: f64| {
            let mut watch = CaptureWatch::default();
            watch.struck();
            (0..5000).find(|_| {
                watch.settle(pose_age, 0.002);
                watch.settles == 0.0
            })
        };
        assert_eq!(waits(0.07), waits(0.0));
        assert!(waits(0.0).is_some_and(|ticks| ticks >= 149) && waits(2.0 * POSE_LOST).is_none());
    }
}
