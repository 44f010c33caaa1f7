//! Applies samples and poses to the filter: each at its time, in order, in a bounded number of steps per tick.

use super::{
    CALM_NOISE, Estimator, MODEL_NOISE, Outcome, POSITION_LIMIT, PoseReport, Quality, ROUGH, SHAKEN_NOISE,
    STEPS_PER_TICK,
    coarse::Coarse,
    history::{GAP, ImuEntry, PoseEntry},
    leaps::roughened,
    weighing::{RIGHT_ANGLE, turn},
};
use crate::{
    so3,
    types::{PoseSample, Vector3},
    ukf::{ProcessNoise, Ukf},
};
use libm::fabs;

/// Readings above these values are invalid, rad/s and m/s^2.
const GYRO_LIMIT: f64 = 100.0;
const FORCE_LIMIT: f64 = 1e3;

/// Weight of a new pose in the running means.
const LATENCY_SHARE: f64 = 0.05;
const NIS_SHARE: f64 = 0.02;
/// A pose may come later than expected by this, s: the filter does not go back because of a rounding error, or a little jitter.
const MARGIN: f64 = 1e-4;
/// Largest normalised innovation squared that counts in the mean, if there is no gate.
const MOST_NIS: f64 = 1e6;

impl Estimator {
    /// Takes an inertial sample: rate (rad/s) and specific force (m/s^2) in IMU coordinates at `time` (s). Between
    /// two samples the filter uses their mean.
    pub fn predict(&mut self, time: f64, gyro_i: &Vector3, specific_force_i: &Vector3) {
        self.predict_observed(time, gyro_i, specific_force_i, &mut |_| ());
    }

    /// As [`predict`](Self::predict), for a sample of another quality than measured.
    pub fn predict_as(&mut self, quality: Quality, time: f64, gyro_i: &Vector3, specific_force_i: &Vector3) {
        self.take_sample(time, gyro_i, specific_force_i, quality, &mut |_| ());
    }

    /// As [`predict`](Self::predict); reports every pose that is applied in the call.
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
        let (gyro_i, specific_force_i) = &self.corrected(quality, gyro_i, specific_force_i);
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
        let (leap, held) = self.leap(last.map_or(0.0, |last| time - last), gyro_i, specific_force_i, quality);
        self.samples.push(ImuEntry { time, gyro: *gyro_i, force: *specific_force_i, quality, leap, held });
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

    /// The rate and the specific force, each with its bias, that a sample's readings show: scale and misalignment are removed.
    /// A model has none.
    pub(crate) fn corrected(
        &self,
        quality: Quality,
        gyro_i: &Vector3,
        specific_force_i: &Vector3,
    ) -> (Vector3, Vector3) {
        if quality.is_modelled() {
            return (*gyro_i, *specific_force_i);
        }
        let p = &self.params;
        (p.gyro_matrix_i * gyro_i, p.accelerometer_matrix_i * specific_force_i)
    }

    /// The leap of a sample from the two before it, beyond the usual leaps, and whether it repeats the one before.
    fn leap(
        &mut self,
        dt: f64,
        gyro_i: &Vector3,
        force_i: &Vector3,
        quality: Quality,
    ) -> ([Coarse; 2], bool) {
        let before = self.samples.newest_two().filter(|(before, earlier)| {
            let modelled = [quality, before.quality, earlier.quality].iter().any(|q| q.is_modelled());
            !modelled && dt <= GAP
        });
        before.map_or(([Coarse::ZERO; 2], false), |before| {
            self.leaps.excess(before, gyro_i, force_i, &self.params.process, dt)
        })
    }

    /// Takes a pose of the captured body. The filter applies it at the time at which it was taken, as soon as samples
    /// up to that time exist.
    pub fn update_pose(&mut self, pose: &PoseSample) -> Outcome {
        self.update_pose_observed(pose, &mut |_| ())
    }

    /// As [`update_pose`](Self::update_pose); reports every pose that is applied in the call.
    pub fn update_pose_observed(
        &mut self,
        pose: &PoseSample,
        observe: &mut impl FnMut(&PoseReport),
    ) -> Outcome {
        let time = pose.time - self.params.latency;
        if !pose.tracking_valid
            || !pose.is_finite()
            || pose.position_w.amax() > POSITION_LIMIT
            || so3::rotation_defect(&pose.rotation_wr) > so3::NEAR_ROTATION
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
        let entry = PoseEntry {
            time,
            position: pose.position_w,
            rotation: so3::straightened(&pose.rotation_wr),
            reported: false,
        };
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

    /// Time of the newest sample; before the first sample, the time of the start.
    pub(super) fn now(&self) -> f64 {
        self.samples
            .newest()
            .map_or(self.head.time, |s| if s.time > self.head.time { s.time } else { self.head.time })
    }

    /// Makes the steps that are due and allowed. When no step is left, updates the output.
    fn work(&mut self, now: f64, observe: &mut impl FnMut(&PoseReport)) {
        // Without poses the head stays behind the newest sample by the time after which the next pose is expected.
        let expected = self.latency + 4.0 * self.latency_deviation + MARGIN;
        let horizon = now - expected.min(0.5 * self.params.history);
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
            // Without a pose, the filter moves by complete samples only.
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

    /// The filter for an interval of this length before a sample.
    pub(super) fn filter_over(&self, number: u64, length: f64) -> Ukf {
        match self.samples.get(number).quality {
            Quality::Modelled if self.samples.get(number).time > self.rough => Ukf::unchecked(CALM_NOISE),
            Quality::Modelled => Ukf::unchecked(MODEL_NOISE),
            Quality::Measured if length <= GAP => {
                let sample = self.samples.get(number);
                if sample.leap == [Coarse::ZERO; 2] {
                    self.filter
                } else {
                    Ukf::unchecked(roughened(&self.params.process, sample, length))
                }
            }
            Quality::Measured => Ukf::unchecked(over_gap(length)),
            Quality::Shaken | Quality::ModelledShaken => Ukf::unchecked(SHAKEN_NOISE),
        }
    }

    /// Counts the outcome of a pose when it is applied for the first time.
    fn note(&mut self, pose: &PoseEntry, report: &PoseReport) {
        self.nis = report.nis / 6.0;
        if report.nis > ROUGH.1 {
            self.rough = pose.time + ROUGH.0;
        }
        let bounded = report.nis.min(self.derived.gate_pose).min(MOST_NIS) / 6.0;
        self.nis_mean += NIS_SHARE * (bounded - self.nis_mean);
        let counts = &mut self.counts;
        match report.outcome {
            Outcome::Accepted => count(&mut counts.accepted),
            Outcome::Weighed => count(&mut counts.weighed),
            Outcome::PositionOnly => count(&mut counts.position_only),
            _ => count(&mut counts.rejected),
        }
        let whole = matches!(report.outcome, Outcome::Accepted | Outcome::Weighed);
        if !whole && turn(&report.innovation) > RIGHT_ANGLE {
            count(&mut counts.flipped);
        }
        if whole && pose.time > self.newest_pose {
            self.newest_pose = pose.time;
        }
        if report.outcome != Outcome::Rejected && pose.time > self.newest_position {
            self.newest_position = pose.time;
        }
    }

    /// Moves a copy of the head's mean to the newest sample.
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

/// The noise over a gap of a length, s. The acceleration of a gap is bounded, so that the deviation of the velocity grows
/// with the length; that of a white noise grows with its root.
fn over_gap(length: f64) -> ProcessNoise {
    let root = libm::sqrt(length.min(1.0));
    ProcessNoise {
        gyro: root * SHAKEN_NOISE.gyro,
        accelerometer: root * SHAKEN_NOISE.accelerometer,
        ..SHAKEN_NOISE
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The filter with these noises is made without a check.
    #[test]
    fn noises_of_shaken_and_modelled_samples_are_valid() {
        for noise in [MODEL_NOISE, CALM_NOISE, SHAKEN_NOISE, over_gap(0.02), over_gap(9.0)] {
            assert!(Ukf::new(noise).is_ok(), "{noise:?}");
        }
    }
}
