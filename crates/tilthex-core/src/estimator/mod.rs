//! The state of the robot from inertial samples and late, disordered, at times wrong or missing poses.
//!
//! # How late poses are applied at their time
//! The filter stands at its *head*, at or behind the newest inertial sample; the
//! state at the newest sample is the head's mean carried on through the samples
//! between (cheap: no covariance). A pose moves the head to the time at which it was taken and corrects it there.
//! One that was taken before the head sends the head back to a checkpoint, from
//! which samples and poses are applied again, in order. So the result is that of poses without latency.
//!
//! # Bounded work
//! Between two samples at most [`STEPS_PER_TICK`] filter steps (predictions or
//! corrections) are made, whatever arrives, and at most 192 mean steps; a burst
//! of late poses is caught up with over the next ticks (at 500 Hz the whole
//! history, 0.3 s, in 21), while the output goes on from the samples.

mod gate;
mod health;
mod history;
mod params;
mod rest;

pub use health::{Counts, Health, Outcome, PoseReport, Status};
pub use params::EstimatorParams;
pub use rest::{RestParams, StartError};

use crate::{
    Error, so3,
    types::{Matrix3, PoseSample, RobotState, Vector3, is_finite3},
    ukf::{Covariance, InitialDeviation, Innovation, Navigation, ProcessNoise, Ukf, UkfState},
};
use history::{Checkpoints, ImuEntry, ImuHistory, PoseEntry, PoseQueue};
use libm::{fabs, sqrt};
use params::Derived;
use rest::RestDetector;

/// Most filter steps between two inertial samples.
pub const STEPS_PER_TICK: u32 = 8;

/// Readings past these are no readings: rad/s, m/s^2; and m for positions.
const GYRO_LIMIT: f64 = 100.0;
const FORCE_LIMIT: f64 = 1e3;
const POSITION_LIMIT: f64 = 1e4;
/// An interval between samples above this is a gap, s.
const GAP: f64 = 0.02;
/// The noise of what happens in a gap.
const GAP_NOISE: ProcessNoise =
    ProcessNoise { gyro: 1.0, accelerometer: 10.0, gyro_bias: 1e-4, accelerometer_bias: 1e-3 };

/// Deviations after a pose has been believed against the state: a jump of the
/// pose is no motion, so the velocity stays, but may have been what was wrong.
const REACQUIRED: InitialDeviation = InitialDeviation {
    position: 0.02,
    velocity: 0.3,
    rotation: 0.05,
    gyro_bias: 0.03,
    accelerometer_bias: 0.2,
};

/// Noise of the model that stands in for a missing IMU: the walk of the gyro's
/// bias is the angular acceleration that the model does not know.
const MODEL_NOISE: ProcessNoise =
    ProcessNoise { gyro: 0.05, accelerometer: 0.3, gyro_bias: 1.0, accelerometer_bias: 1e-3 };
/// Past this a rotation contradicts the state because markers were swapped, rad.
const RIGHT_ANGLE: f64 = core::f64::consts::FRAC_PI_2;
/// Share of a new pose in the running means.
const LATENCY_SHARE: f64 = 0.05;
const NIS_SHARE: f64 = 0.02;

/// The filter, where it stands.
#[derive(Clone, Copy, Debug)]
struct Head {
    state: UkfState,
    time: f64,
    /// Number of the first sample after `time`.
    next_sample: u64,
    /// Time of the last pose that was considered.
    applied: f64,
    /// Time of the first pose refused since one passed; infinite where none was.
    doubted: f64,
}

/// The estimator: parameters and state, of fixed size.
#[derive(Clone, Copy, Debug)]
pub struct Estimator {
    params: EstimatorParams,
    derived: Derived,
    filter: Ukf,
    gap_filter: Ukf,
    model_filter: Ukf,
    head: Head,
    initialized: bool,
    /// The mean at the newest sample.
    current: Navigation,
    /// Whether the head was corrected since `current` was taken from it.
    stale: bool,
    /// Filter steps left until the next sample.
    steps: u32,
    samples: ImuHistory,
    poses: PoseQueue,
    checkpoints: Checkpoints,
    rest: RestDetector,
    slow_rate_i: Vector3,
    angular_acceleration_i: Vector3,
    newest_pose: f64,
    newest_position: f64,
    latency: f64,
    latency_deviation: f64,
    has_latency: bool,
    nis: f64,
    nis_mean: f64,
    counts: Counts,
}

impl Estimator {
    /// An estimator that waits for [`initialize`](Self::initialize).
    ///
    /// # Errors
    /// [`Error`], which names the parameter that can not be.
    pub fn new(params: EstimatorParams) -> Result<Self, Error> {
        let derived = params.derive()?;
        let state = UkfState::new(Navigation::ORIGIN, &params.initial);
        Ok(Self {
            filter: Ukf::new(params.process)?,
            gap_filter: Ukf::new(GAP_NOISE)?,
            model_filter: Ukf::new(MODEL_NOISE)?,
            head: Head { state, time: 0.0, next_sample: 0, applied: 0.0, doubted: f64::INFINITY },
            initialized: false,
            current: Navigation::ORIGIN,
            stale: false,
            steps: STEPS_PER_TICK,
            samples: ImuHistory::EMPTY,
            poses: PoseQueue::EMPTY,
            checkpoints: Checkpoints::new(params.history),
            rest: RestDetector::EMPTY,
            slow_rate_i: Vector3::zeros(),
            angular_acceleration_i: Vector3::zeros(),
            newest_pose: 0.0,
            newest_position: 0.0,
            latency: 0.0,
            latency_deviation: 0.0,
            has_latency: false,
            nis: 0.0,
            nis_mean: 1.0,
            counts: Counts::default(),
            derived,
            params,
        })
    }

    /// Starts from a pose of the captured body at `time` (s), with the
    /// deviations of [`EstimatorParams::initial`], no velocity and no biases.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfRange`] or [`Error::NotRotation`], which name the argument.
    pub fn initialize(
        &mut self,
        time: f64,
        position_w: &Vector3,
        rotation_wc: &Matrix3,
    ) -> Result<(), Error> {
        let mean = self.start_mean(time, position_w, rotation_wc)?;
        let initial = self.params.initial;
        self.start(time, mean, &initial);
        Ok(())
    }

    /// Starts from a pose of the captured body of a vehicle that rests, with the biases that its IMU shows.
    ///
    /// # Errors
    /// [`StartError`]: the vehicle moves, was not watched for long enough, or feels gravity elsewhere than the pose has it.
    pub fn initialize_at_rest(
        &mut self,
        time: f64,
        position_w: &Vector3,
        rotation_wc: &Matrix3,
    ) -> Result<(), StartError> {
        let mut mean = self.start_mean(time, position_w, rotation_wc).map_err(StartError::Pose)?;
        let means = self.rest.means(&self.params.rest, &mean.rotation_wi)?;
        let up_i = mean.rotation_wi.transpose() * Vector3::z();
        mean.gyro_bias_i = means.gyro;
        mean.accelerometer_bias_i = means.force - crate::GRAVITY * up_i;
        // The pose's error in rotation shows as a bias of the accelerometer.
        let tilt = crate::GRAVITY * self.params.rotation_noise;
        let averaged = |deviation: f64| 1e-4 + deviation / sqrt(means.samples);
        let deviation = InitialDeviation {
            velocity: 0.01,
            gyro_bias: averaged(self.params.rest.gyro_deviation),
            accelerometer_bias: tilt + averaged(self.params.rest.accelerometer_deviation),
            ..self.params.initial
        };
        self.start(time, mean, &deviation);
        Ok(())
    }

    fn start_mean(
        &self,
        time: f64,
        position_w: &Vector3,
        rotation_wc: &Matrix3,
    ) -> Result<Navigation, Error> {
        crate::error::check_range("time", time, -1e12, 1e12)?;
        if !is_finite3(position_w) {
            return Err(Error::NotFinite { name: "position" });
        }
        crate::error::check_range("position", position_w.amax(), 0.0, POSITION_LIMIT)?;
        so3::check_rotation("rotation", rotation_wc)?;
        let pose = self.params.imu_pose(&self.derived, position_w, rotation_wc);
        Ok(Navigation { position_w: pose.position_w, rotation_wi: pose.rotation_wi, ..Navigation::ORIGIN })
    }

    fn start(&mut self, time: f64, mean: Navigation, deviation: &InitialDeviation) {
        self.head = Head {
            state: UkfState::new(mean, deviation),
            time,
            next_sample: self.samples.first_after(time),
            applied: time,
            doubted: f64::INFINITY,
        };
        self.initialized = true;
        self.poses.clear();
        self.checkpoints.clear();
        self.checkpoints.save(&self.head);
        (self.newest_pose, self.newest_position) = (time, time);
        self.nis_mean = 1.0;
        self.refresh();
    }

    /// Takes an inertial sample: rate (rad/s) and specific force (m/s^2) in IMU
    /// coordinates at `time` (s). Between two samples the readings count as their mean.
    pub fn predict(&mut self, time: f64, gyro_i: &Vector3, specific_force_i: &Vector3) {
        self.predict_observed(time, gyro_i, specific_force_i, &mut |_| ());
    }

    /// Takes what a model of the vehicle puts in the place of a missing
    /// sample. Its rate is no measurement: poses correct it, as a bias.
    pub fn predict_modelled(&mut self, time: f64, gyro_i: &Vector3, specific_force_i: &Vector3) {
        self.take_sample(time, gyro_i, specific_force_i, true, &mut |_| ());
    }

    /// [`predict`](Self::predict), with a report on every pose that is applied in its course.
    pub fn predict_observed(
        &mut self,
        time: f64,
        gyro_i: &Vector3,
        specific_force_i: &Vector3,
        observe: &mut impl FnMut(&PoseReport),
    ) {
        self.take_sample(time, gyro_i, specific_force_i, false, observe);
    }

    fn take_sample(
        &mut self,
        time: f64,
        gyro_i: &Vector3,
        specific_force_i: &Vector3,
        modelled: bool,
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
        self.samples.push(ImuEntry { time, gyro: *gyro_i, force: *specific_force_i, modelled });
        self.rest.push(&self.params.rest, time, gyro_i, specific_force_i);
        let dt = last.map_or(0.0, |last| time - last);
        if dt > GAP {
            count(&mut self.counts.imu_gaps);
        }
        self.differentiate(gyro_i, dt);
        if !self.initialized || time <= self.head.time {
            return;
        }
        let (gyro, force, _) = self.samples.interval(self.samples.end() - 1);
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
    fn now(&self) -> f64 {
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
        let head = &mut self.head;
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
    fn filter_over(&self, number: u64, length: f64) -> Ukf {
        match (self.samples.get(number).modelled, length > GAP) {
            (true, _) => self.model_filter,
            (false, true) => self.gap_filter,
            (false, false) => self.filter,
        }
    }

    /// Gates a pose and corrects the head with what passes.
    fn apply(&mut self, pose: &PoseEntry) -> PoseReport {
        let derived = &self.derived;
        let head = &mut self.head;
        head.applied = pose.time;
        let measured = self.params.imu_pose(derived, &pose.position, &pose.rotation);
        let whole = head.state.pose_innovation(&measured.position_w, &measured.rotation_wi, &measured.noise);
        let Some(whole) = whole else {
            return report(pose.time, Outcome::Rejected, f64::INFINITY, None);
        };
        let nis = whole.squared(6);
        if nis <= derived.gate_pose {
            head.state.apply(&whole);
            (head.doubted, self.stale) = (f64::INFINITY, true);
            return report(pose.time, Outcome::Accepted, nis, Some(&whole));
        }
        // Swapped markers turn the body, but leave it where it is: its position, with our own rotation.
        let arm_w = head.state.mean.rotation_wi * derived.arm_i;
        let [_, _, rotation] = head.state.deviations();
        let arm_noise = rotation * rotation * arm_w.norm_squared();
        let variance = self.params.position_noise * self.params.position_noise + arm_noise;
        let alone = head.state.position_innovation(&(pose.position - arm_w), variance);
        let outcome = match alone {
            Some(alone) if alone.squared(3) <= derived.gate_position => {
                head.state.apply(&alone);
                (head.doubted, self.stale) = (f64::INFINITY, true);
                Outcome::PositionOnly
            }
            _ => {
                head.doubted = head.doubted.min(pose.time);
                if pose.time - head.doubted > self.params.reacquire_after {
                    head.state.restart(&measured.position_w, &measured.rotation_wi, &REACQUIRED);
                    (head.doubted, self.stale) = (f64::INFINITY, true);
                    Outcome::Accepted
                } else {
                    Outcome::Rejected
                }
            }
        };
        report(pose.time, outcome, nis, Some(&whole))
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
        let [_, _, _, x, y, z] = report.innovation;
        if report.outcome != Outcome::Accepted && x * x + y * y + z * z > RIGHT_ANGLE * RIGHT_ANGLE {
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
    fn refresh(&mut self) {
        let (mut mean, mut time) = (self.head.state.mean, self.head.time);
        for number in self.head.next_sample..self.samples.end() {
            let (gyro, force, _) = self.samples.interval(number);
            let end = self.samples.get(number).time;
            mean = mean.advance(&gyro, &force, (end - time).clamp(0.0, 1.0));
            time = end;
        }
        self.current = mean;
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

    /// Whether a pose has started the estimator.
    #[must_use]
    pub fn is_initialized(&self) -> bool {
        self.initialized
    }

    /// The constant latency that is taken off every pose's time, s.
    #[must_use]
    pub fn latency(&self) -> f64 {
        self.params.latency
    }

    /// Time of the newest sample, s.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.now()
    }

    /// Pose and twist of the centre of mass at the newest sample.
    #[must_use]
    pub fn robot_state(&self) -> RobotState {
        let p = &self.params;
        let rotation_wr = self.current.rotation_wi * p.imu_rotation_ri.transpose();
        let angular_velocity_r = p.imu_rotation_ri * self.rate_i();
        RobotState {
            position_w: self.current.position_w - rotation_wr * p.imu_position_r,
            velocity_w: self.current.velocity_w - rotation_wr * angular_velocity_r.cross(&p.imu_position_r),
            rotation_wr,
            angular_velocity_r,
        }
    }

    /// Rate at the newest sample without its bias.
    fn rate_i(&self) -> Vector3 {
        self.samples.newest().map_or(Vector3::zeros(), |s| s.gyro - self.current.gyro_bias_i)
    }

    /// Specific force at the centre of mass at the newest sample, m/s^2, robot
    /// coordinates, without the bias and without what the lever arm adds.
    #[must_use]
    pub fn specific_force_r(&self) -> Vector3 {
        let p = &self.params;
        let force =
            self.samples.newest().map_or(Vector3::zeros(), |s| s.force - self.current.accelerometer_bias_i);
        let omega = p.imu_rotation_ri * self.rate_i();
        let alpha = p.imu_rotation_ri * self.angular_acceleration_i;
        let arm = p.imu_position_r;
        p.imu_rotation_ri * force - alpha.cross(&arm) - omega.cross(&omega.cross(&arm))
    }

    /// Bias of the gyro, rad/s, IMU coordinates.
    #[must_use]
    pub fn gyro_bias(&self) -> Vector3 {
        self.current.gyro_bias_i
    }

    /// Bias of the accelerometer, m/s^2, IMU coordinates.
    #[must_use]
    pub fn accelerometer_bias(&self) -> Vector3 {
        self.current.accelerometer_bias_i
    }

    /// Covariance at the newest sample of (position (W) and velocity (W) of the
    /// centre of mass, rotation (W), gyro bias, accelerometer bias).
    ///
    /// With late poses this carries the filter through the samples since the last one: up to 192
    /// predictions. Not for every tick; [`health`](Self::health) is.
    #[must_use]
    pub fn covariance(&self) -> Covariance {
        let mut copy = self.head;
        let mut state = copy.state;
        for number in copy.next_sample..self.samples.end() {
            let (gyro, force, length) = self.samples.interval(number);
            let end = self.samples.get(number).time;
            let filter = self.filter_over(number, length);
            if end > copy.time {
                filter.predict(&mut state, &gyro, &force, (end - copy.time).min(1.0));
                copy.time = end;
            }
        }
        self.at_centre_of_mass(&state.covariance())
    }

    /// From the IMU to the centre of mass.
    fn at_centre_of_mass(&self, covariance: &Covariance) -> Covariance {
        let p = &self.params;
        if p.imu_position_r == Vector3::zeros() {
            return *covariance;
        }
        let rotation_wr = self.current.rotation_wi * p.imu_rotation_ri.transpose();
        let omega = p.imu_rotation_ri * self.rate_i();
        let mut map = Covariance::identity();
        map.fixed_view_mut::<3, 3>(0, 6).copy_from(&so3::hat(&(rotation_wr * p.imu_position_r)));
        map.fixed_view_mut::<3, 3>(3, 6)
            .copy_from(&so3::hat(&(rotation_wr * omega.cross(&p.imu_position_r))));
        map.fixed_view_mut::<3, 3>(3, 9)
            .copy_from(&(-rotation_wr * so3::hat(&p.imu_position_r) * p.imu_rotation_ri));
        map * covariance * map.transpose()
    }

    /// The health of the estimate.
    #[must_use]
    pub fn health(&self) -> Health {
        let now = self.now();
        let [position_deviation, velocity_deviation, rotation_deviation] = self.head.state.deviations();
        let pose_age = now - self.newest_pose;
        let status = if !self.initialized {
            Status::Uninitialized
        } else if position_deviation > self.params.lost_position
            || rotation_deviation > self.params.lost_rotation
        {
            Status::Lost
        } else if pose_age > self.params.coast_after {
            Status::Coasting
        } else {
            Status::Tracking
        };
        Health {
            status,
            pose_age,
            position_age: now - self.newest_position,
            latency: self.latency,
            latency_deviation: self.latency_deviation,
            nis: self.nis,
            nis_mean: self.nis_mean,
            position_deviation,
            velocity_deviation,
            rotation_deviation,
            lag: now - self.head.time,
            at_rest: self.rest.at_rest(),
            recoveries: self.head.state.recoveries(),
            counts: self.counts,
        }
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

fn report(time: f64, outcome: Outcome, nis: f64, innovation: Option<&Innovation<6>>) -> PoseReport {
    let (innovation, deviation) = innovation.map_or(([0.0; 6], [0.0; 6]), |i| (i.residual, i.deviation));
    PoseReport { time, outcome, nis, innovation, deviation }
}
