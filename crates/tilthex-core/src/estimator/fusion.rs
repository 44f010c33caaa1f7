//! Samples and poses into the filter: at their time, in order, a bounded number of steps a tick.

use super::{
    Estimator, Outcome, POSITION_LIMIT, PoseReport, Quality, STEPS_PER_TICK,
    history::{ImuEntry, PoseEntry},
    params::ImuPose,
    trust::Agreement,
};
use crate::{
    so3,
    types::{PoseSample, Vector3},
    ukf::{Innovation, Navigation, Ukf},
};
use libm::{fabs, sqrt};

/// Readings past these are no readings, rad/s and m/s^2.
const GYRO_LIMIT: f64 = 100.0;
const FORCE_LIMIT: f64 = 1e3;
/// An interval between samples above this is a gap, s.
const GAP: f64 = 0.02;

/// Past this a rotation contradicts the state because markers were swapped, rad.
const RIGHT_ANGLE: f64 = core::f64::consts::FRAC_PI_2;
/// So long after a sample that was not simply measured the state is doubtful, s.
const DOUBT: f64 = 0.1;
/// Share of a new pose in the running means.
const LATENCY_SHARE: f64 = 0.05;
const NIS_SHARE: f64 = 0.02;

impl Estimator {
    /// Takes an inertial sample: rate (rad/s) and specific force (m/s^2) in IMU
    /// coordinates at `time` (s). Between two samples the readings count as their mean.
    pub fn predict(&mut self, time: f64, gyro_i: &Vector3, specific_force_i: &Vector3) {
        self.predict_observed(time, gyro_i, specific_force_i, &mut |_| ());
    }

    /// [`predict`](Self::predict) with a sample that is not simply measured.
    pub fn predict_as(&mut self, quality: Quality, time: f64, gyro_i: &Vector3, specific_force_i: &Vector3) {
        self.take_sample(time, gyro_i, specific_force_i, quality, &mut |_| ());
    }

    /// [`predict`](Self::predict), with a report on every pose that is applied in its course.
    pub fn predict_observed(
        &mut self,
        time: f64,
        gyro_i: &Vector3,
        specific_force_i: &Vector3,
        observe: &mut impl FnMut(&PoseReport),
    ) {
        self.take_sample(time, gyro_i, specific_force_i, Quality::Measured, observe);
    }

    fn take_sample(
        &mut self,
        time: f64,
        gyro_i: &Vector3,
        specific_force_i: &Vector3,
        quality: Quality,
        observe: &mut impl FnMut(&PoseReport),
    ) {
        let last = self.samples.newest().map(|s| s.time);
        let sane = time.is_finite()
            && gyro_i.iter().all(|x| fabs(*x) <= GYRO_LIMIT)
            && specific_force_i.iter().all(|x| fabs(*x) <= FORCE_LIMIT)
            && last.is_none_or(|last| time > last);
        if !sane {
            count(&mut self.counts.imu_rejected);
            return;
        }
        let source_changed = self.is_modelled() != quality.is_modelled();
        self.samples.push(ImuEntry { time, gyro: *gyro_i, force: *specific_force_i, quality });
        self.rest.push(&self.params.rest, time, gyro_i, specific_force_i);
        let dt = last.map_or(0.0, |last| time - last);
        if dt > GAP {
            count(&mut self.counts.imu_gaps);
        }
        self.differentiate(gyro_i, if source_changed { 0.0 } else { dt });
        if !self.initialized || time <= self.head.time {
            return;
        }
        let (gyro, force, _) = self.samples.interval(self.samples.end() - 1);
        self.current_kept_bias.pass_mean(quality, &mut self.current);
        self.current = self.current.advance(&gyro, &force, dt.min(1.0));
        self.steps = STEPS_PER_TICK;
        self.work(time, observe);
    }

    /// Takes a pose of the captured body. It is applied at the time at which it was taken, as soon as the samples reach it.
    pub fn update_pose(&mut self, pose: &PoseSample) -> Outcome {
        self.update_pose_observed(pose, &mut |_| ())
    }

    /// [`update_pose`](Self::update_pose), with a report on every pose that is applied in its course.
    pub fn update_pose_observed(
        &mut self,
        pose: &PoseSample,
        observe: &mut impl FnMut(&PoseReport),
    ) -> Outcome {
        let time = pose.time - self.params.latency;
        if !pose.tracking_valid
            || !pose.is_finite()
            || pose.position_w.amax() > POSITION_LIMIT
            || so3::rotation_defect(&pose.rotation_wr) > 1e-3
            || self.initialized && time - self.now() > self.params.history
        {
            count(&mut self.counts.invalid);
            return Outcome::Invalid;
        }
        if !self.initialized {
            return Outcome::Uninitialized;
        }
        self.measure_latency(pose.arrival - time);
        if self.poses.contains(time) || time == self.head.applied {
            count(&mut self.counts.duplicate);
            return Outcome::Duplicate;
        }
        let now = self.now();
        let oldest = self.samples.first_usable();
        if now - time > self.params.history
            || time < self.head.time && !self.checkpoints.restore(time, oldest, &mut self.head)
        {
            count(&mut self.counts.too_old);
            return Outcome::TooOld;
        }
        let entry =
            PoseEntry { time, position: pose.position_w, rotation: pose.rotation_wr, reported: false };
        let mut outcome = Outcome::Pending;
        self.enqueue(entry);
        self.work(now, &mut |report: &PoseReport| {
            if report.time == time {
                outcome = report.outcome;
            }
            observe(report);
        });
        outcome
    }

    fn enqueue(&mut self, entry: PoseEntry) {
        if self.poses.next(entry.time, f64::INFINITY).is_some() {
            count(&mut self.counts.disordered);
        }
        if let Some(gone) = self.poses.insert(entry) {
            if gone > self.head.applied {
                count(&mut self.counts.too_old);
            }
            self.checkpoints.forget_before(gone);
        }
    }

    fn measure_latency(&mut self, found: f64) {
        let found = found.max(0.0).min(self.params.history);
        if !self.has_latency {
            (self.has_latency, self.latency) = (true, found);
        }
        let off = found - self.latency;
        self.latency += LATENCY_SHARE * off;
        self.latency_deviation += LATENCY_SHARE * (fabs(off) - self.latency_deviation);
    }

    /// Time of the newest sample (or of the start, before any).
    pub(super) fn now(&self) -> f64 {
        self.samples
            .newest()
            .map_or(self.head.time, |s| if s.time > self.head.time { s.time } else { self.head.time })
    }

    /// Makes the steps that are due and allowed, and brings the output up to date once none is left.
    fn work(&mut self, now: f64, observe: &mut impl FnMut(&PoseReport)) {
        // Without poses the head follows at the distance at which the next ones are expected.
        let horizon = now - (self.latency + 4.0 * self.latency_deviation).min(0.5 * self.params.history);
        let mut due = true;
        while due && self.steps > 0 {
            due = self.step(now, horizon, observe);
            self.steps -= u32::from(due);
        }
        if !due && (self.stale || self.head.next_sample == self.samples.end()) {
            self.refresh();
        }
    }

    /// One step of the filter; false when none is due.
    fn step(&mut self, now: f64, horizon: f64, observe: &mut impl FnMut(&PoseReport)) -> bool {
        let next = (self.head.next_sample < self.samples.end())
            .then(|| self.samples.get(self.head.next_sample).time);
        match (self.poses.next(self.head.applied, now), next) {
            (Some((_, pose)), Some(_)) if self.head.time < pose.time => self.advance(pose.time),
            (Some((place, pose)), _) => {
                let report = self.apply(&pose);
                if !pose.reported {
                    self.poses.mark_reported(place);
                    self.note(&pose, &report);
                    observe(&report);
                }
            }
            // Whole samples only: no step is split where no pose is.
            (None, Some(sample)) if sample <= horizon => self.advance(sample),
            _ => return false,
        }
        true
    }

    /// Moves the head to the next sample, or to `goal` if that comes first.
    fn advance(&mut self, goal: f64) {
        let next = self.head.next_sample;
        let sample = self.samples.get(next).time;
        let (gyro, force, length) = self.samples.interval(next);
        let filter = self.filter_over(next, length);
        let quality = self.samples.get(next).quality;
        let head = &mut self.head;
        head.pass_bias(quality);
        let until = if sample <= goal { sample } else { goal };
        let dt = until - head.time;
        if dt > 0.0 {
            filter.predict(&mut head.state, &gyro, &force, dt.min(1.0));
            head.time = until;
            self.checkpoints.save(head);
        }
        if sample <= goal {
            head.next_sample += 1;
        }
    }

    /// The filter for the interval of a length before a sample.
    pub(super) fn filter_over(&self, number: u64, length: f64) -> Ukf {
        match self.samples.get(number).quality {
            Quality::Modelled => self.model_filter,
            Quality::Measured if length <= GAP => self.filter,
            Quality::Measured | Quality::Shaken | Quality::ModelledShaken => self.gap_filter,
        }
    }

    /// Gates a pose and corrects the head with what passes.
    fn apply(&mut self, pose: &PoseEntry) -> PoseReport {
        self.head.applied = pose.time;
        let measured = self.params.imu_pose(&self.derived, &pose.position, &pose.rotation);
        let Some(whole) = self.innovation(&measured, 1.0) else {
            return report(pose.time, Outcome::Rejected, f64::INFINITY, None);
        };
        let nis = whole.squared(6);
        // Neither a model nor an impact has much to say against poses.
        let doubtful = self.samples.doubtful(self.head.next_sample, DOUBT);
        let outcome = if self.pass(pose.time, &measured, nis) {
            Outcome::Accepted
        } else if (!doubtful || turn(&whole.residual) > RIGHT_ANGLE) && self.pass_position(pose) {
            Outcome::PositionOnly
        } else {
            self.contradict(pose.time, &measured, &whole, doubtful)
        };
        self.stale |= outcome != Outcome::Rejected;
        report(pose.time, outcome, nis, Some(&whole))
    }

    /// What a pose of the IMU tells beyond the head, `noise` times as noisy as configured.
    fn innovation(&self, measured: &ImuPose, noise: f64) -> Option<Innovation<6>> {
        let noise = measured.noise.scaled(noise);
        self.head.state.pose_innovation(&measured.position_w, &measured.rotation_wi, &noise)
    }

    /// Applies a pose that passes the gate, as noisy as poses have lately been.
    fn pass(&mut self, time: f64, measured: &ImuPose, nis: f64) -> bool {
        let trusted = self.innovation(measured, self.head.trust.noise);
        let Some(passing) = trusted.filter(|i| i.squared(6) <= self.derived.gate_pose) else { return false };
        self.head.state.apply(&passing);
        self.head.trust.accept(time, nis / 6.0);
        true
    }

    /// Swapped markers turn the body, but leave it where it is: its position, with our own rotation.
    fn pass_position(&mut self, pose: &PoseEntry) -> bool {
        let head = &mut self.head;
        let arm_w = head.state.mean.rotation_wi * self.derived.arm_i;
        let [_, _, rotation] = head.state.deviations();
        let noise = head.trust.noise * self.params.position_noise;
        let variance = noise * noise + rotation * rotation * arm_w.norm_squared();
        let alone = head.state.position_innovation(&(pose.position - arm_w), variance);
        let Some(passing) = alone.filter(|i| i.squared(3) <= self.derived.gate_position) else {
            return false;
        };
        head.state.apply(&passing);
        // Its rotation tells nothing of the noise.
        head.trust.accept(pose.time, head.trust.noise * head.trust.noise);
        true
    }

    /// A pose that did not pass: where those before it did not either, they may be noisier
    /// than configured, or right.
    fn contradict(
        &mut self,
        time: f64,
        measured: &ImuPose,
        innovation: &Innovation<6>,
        doubtful: bool,
    ) -> Outcome {
        let noise = (self.params.position_noise, self.params.rotation_noise);
        let trust = &mut self.head.trust;
        let long = doubtful || time - trust.accepted > self.params.reacquire_after;
        let modelled = self.head.kept_bias.is_some();
        let agreement = trust.refuse(time, &innovation.residual, noise, modelled);
        let Some(agreement) = agreement.filter(Agreement::is_credible) else { return Outcome::Rejected };
        if agreement.noise > trust.noise {
            trust.noise = agreement.noise;
            if self.pass(time, measured, agreement.noise * agreement.noise) {
                return Outcome::Accepted;
            }
        }
        if !long {
            return Outcome::Rejected;
        }
        let before = self.head.state.mean;
        let mean = Navigation {
            position_w: before.position_w + agreement.position,
            velocity_w: before.velocity_w + agreement.velocity,
            rotation_wi: so3::exp(&agreement.rotation) * before.rotation_wi,
            // Where a model stands in, it is the model's rate that is off.
            gyro_bias_i: before.gyro_bias_i - before.rotation_wi.transpose() * agreement.rate,
            ..before
        };
        self.head.state.restart(mean, &agreement.deviation);
        self.head.trust.accept(time, agreement.noise * agreement.noise);
        Outcome::Accepted
    }

    /// Counts the outcome of a pose's first application.
    fn note(&mut self, pose: &PoseEntry, report: &PoseReport) {
        self.nis = report.nis / 6.0;
        let bounded = report.nis.min(self.derived.gate_pose) / 6.0;
        self.nis_mean += NIS_SHARE * (bounded - self.nis_mean);
        let counts = &mut self.counts;
        match report.outcome {
            Outcome::Accepted => count(&mut counts.accepted),
            Outcome::PositionOnly => count(&mut counts.position_only),
            _ => count(&mut counts.rejected),
        }
        if report.outcome != Outcome::Accepted && turn(&report.innovation) > RIGHT_ANGLE {
            count(&mut counts.flipped);
        }
        if report.outcome == Outcome::Accepted && pose.time > self.newest_pose {
            self.newest_pose = pose.time;
        }
        if report.outcome != Outcome::Rejected && pose.time > self.newest_position {
            self.newest_position = pose.time;
        }
    }

    /// Carries the head's mean on to the newest sample.
    pub(super) fn refresh(&mut self) {
        let (mut mean, mut time, mut kept_bias) = (self.head.state.mean, self.head.time, self.head.kept_bias);
        for number in self.head.next_sample..self.samples.end() {
            let (gyro, force, _) = self.samples.interval(number);
            let ImuEntry { time: end, quality, .. } = *self.samples.get(number);
            kept_bias.pass_mean(quality, &mut mean);
            mean = mean.advance(&gyro, &force, (end - time).clamp(0.0, 1.0));
            time = end;
        }
        (self.current, self.current_kept_bias) = (mean, kept_bias);
        self.stale = false;
    }

    /// Low-passed derivative of the rate.
    fn differentiate(&mut self, gyro_i: &Vector3, dt: f64) {
        let rate = core::f64::consts::TAU * self.params.angular_acceleration_hz;
        if dt == 0.0 || dt > GAP {
            self.slow_rate_i = *gyro_i;
        }
        let off = gyro_i - self.slow_rate_i;
        self.angular_acceleration_i = rate * off;
        self.slow_rate_i += crate::filters::lag_fraction(rate, dt) * off;
    }
}

/// Angle of an innovation's rotation, rad.
fn turn([_, _, _, x, y, z]: &[f64; 6]) -> f64 {
    sqrt(x * x + y * y + z * z)
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

fn report(time: f64, outcome: Outcome, nis: f64, innovation: Option<&Innovation<6>>) -> PoseReport {
    let (innovation, deviation) = innovation.map_or(([0.0; 6], [0.0; 6]), |i| (i.residual, i.deviation));
    PoseReport { time, outcome, nis, innovation, deviation }
}
