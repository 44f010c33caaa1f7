//! The state of the robot from inertial samples and from poses, which may be late, out of order, wrong or missing.
//!
//! # How late poses are applied at their time
//! The filter has a *head*: the time up to which it has applied samples and poses, which is at or behind the newest
//! inertial sample. The state at the newest sample is the mean of the head, moved through the samples between them;
//! this is cheap, because it needs no covariance. A pose moves the head to the time at which it was taken, and
//! corrects it there. If a pose was taken before the head, the filter goes back to a checkpoint and applies samples
//! and poses again, in order. So the result equals that of poses without latency.
//!
//! # Bounded work
//! Between two samples the filter makes at most [`STEPS_PER_TICK`] steps (predictions or corrections), whatever
//! arrives, and moves the mean through at most 192 samples. After many late poses the filter needs several ticks to
//! apply all of them (21 ticks at 500 Hz for the whole history of 0.3 s). Meanwhile the output follows the samples.

mod coarse;
mod fusion;
mod gate;
mod health;
mod history;
mod insistent;
mod kept_bias;
mod leaps;
mod output;
mod params;
mod rest;
mod trust;
mod weighing;

pub use health::{Counts, Health, Outcome, PoseReport, Status};
pub use params::EstimatorParams;
pub use rest::{RestParams, StartError};

use crate::{
    Error, so3,
    types::{Matrix3, PoseSample, Vector3, is_finite3},
    ukf::{InitialDeviation, Navigation, ProcessNoise, Ukf, UkfState},
};
use history::{Checkpoints, ImuHistory, PoseQueue};
use kept_bias::KeptBias;
use leaps::Leaps;
use libm::sqrt;
use params::Derived;
use rest::RestDetector;
use trust::Trust;

/// Largest number of filter steps between two inertial samples.
pub const STEPS_PER_TICK: u32 = 8;

/// Positions above this are invalid, m.
const POSITION_LIMIT: f64 = 1e4;
/// Deviations of a state that nothing has measured while the vehicle may have fallen, m and m/s.
const UNFELT: (f64, f64) = (0.3, 2.0);
/// The noise of the motion in an impact, and in a gap of 1 s between samples.
const SHAKEN_NOISE: ProcessNoise =
    ProcessNoise { gyro: 1.0, accelerometer: 10.0, gyro_bias: 1e-4, accelerometer_bias: 1e-3 };
/// Noise of the model that replaces a missing IMU. The random walk of the gyro's bias stands for the angular
/// acceleration that the model does not know.
const MODEL_NOISE: ProcessNoise =
    ProcessNoise { gyro: 0.05, accelerometer: 0.3, gyro_bias: 1.0, accelerometer_bias: 1e-3 };

/// As [`MODEL_NOISE`], while poses agree with the model: no unknown torque turns the vehicle.
const CALM_NOISE: ProcessNoise = ProcessNoise { gyro_bias: 0.1, ..MODEL_NOISE };
/// The model is not calm for this time, s, after a pose whose normalised innovation squared is larger than the second.
const ROUGH: (f64, f64) = (0.7, 25.0);

/// Where an inertial sample comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quality {
    /// From the IMU.
    #[default]
    Measured,
    /// From the IMU, after readings that left its range or leapt: in an impact the readings are uncertain.
    Shaken,
    /// From a model of the vehicle, which replaces a missing sample. Its rate is not a measurement: poses correct it
    /// as they correct a bias.
    Modelled,
    /// From a model of the vehicle, while the readings leave the range of the IMU: in an impact the model is
    /// uncertain too.
    ModelledShaken,
}

impl Quality {
    /// Whether a model replaces the IMU.
    const fn is_modelled(self) -> bool {
        matches!(self, Self::Modelled | Self::ModelledShaken)
    }
}

/// The filter at its head.
#[derive(Clone, Copy, Debug)]
struct Head {
    state: UkfState,
    time: f64,
    /// Number of the first sample after `time`.
    next_sample: u64,
    /// Time of the last pose that was considered.
    applied: f64,
    trust: Trust,
    kept_bias: KeptBias,
}

/// The estimator: parameters and state, of fixed size.
///
/// ```
/// use tilthex_core::{
///     GRAVITY, Matrix3, PoseSample, Vector3,
///     estimator::{Estimator, EstimatorParams},
/// };
///
/// let mut estimator = Estimator::new(EstimatorParams::default())?;
/// let (place_w, level) = (Vector3::new(0.0, 0.0, 1.0), Matrix3::identity());
/// estimator.initialize(0.0, &place_w, &level)?;
/// // At rest: the IMU at 500 Hz, poses at 100 Hz that arrive 10 ms after they were taken.
/// for k in 1..1000 {
///     let time = 0.002 * f64::from(k);
///     estimator.predict(time, &Vector3::zeros(), &(GRAVITY * Vector3::z()));
///     if k % 5 == 0 {
///         let (position_w, rotation_wr) = (place_w, level);
///         let taken = time - 0.01;
///         let pose = PoseSample { time: taken, arrival: time, position_w, rotation_wr, tracking_valid: true };
///         estimator.update_pose(&pose);
///     }
/// }
/// assert!((estimator.robot_state().position_w - place_w).norm() < 1e-3);
/// assert!(estimator.robot_state().velocity_w.norm() < 1e-2);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Estimator {
    params: EstimatorParams,
    derived: Derived,
    filter: Ukf,
    head: Head,
    initialized: bool,
    /// The mean at the newest sample.
    current: Navigation,
    current_kept_bias: KeptBias,
    /// Whether the head was corrected after `current` was computed from it.
    stale: bool,
    /// Filter steps left until the next sample.
    steps: u32,
    samples: ImuHistory,
    poses: PoseQueue,
    checkpoints: Checkpoints,
    rest: RestDetector,
    leaps: Leaps,
    slow_rate_i: Vector3,
    angular_acceleration_i: Vector3,
    newest_pose: f64,
    newest_position: f64,
    latency: f64,
    latency_deviation: f64,
    has_latency: bool,
    nis: f64,
    nis_mean: f64,
    /// Until this time, s, poses have surprised.
    rough: f64,
    counts: Counts,
}

impl Estimator {
    /// An estimator that waits for [`initialize`](Self::initialize).
    ///
    /// # Errors
    /// [`Error`], which names the parameter that is not possible.
    pub fn new(params: EstimatorParams) -> Result<Self, Error> {
        let derived = params.derive()?;
        let state = UkfState::new(Navigation::ORIGIN, &params.initial);
        Ok(Self {
            filter: Ukf::new(params.process)?,
            head: Head {
                state,
                time: 0.0,
                next_sample: 0,
                applied: 0.0,
                trust: Trust::since(0.0),
                kept_bias: KeptBias::NONE,
            },
            initialized: false,
            current: Navigation::ORIGIN,
            current_kept_bias: KeptBias::NONE,
            stale: false,
            steps: STEPS_PER_TICK,
            samples: ImuHistory::EMPTY,
            poses: PoseQueue::EMPTY,
            checkpoints: Checkpoints::new(params.history),
            rest: RestDetector::EMPTY,
            leaps: Leaps::NONE,
            slow_rate_i: Vector3::zeros(),
            angular_acceleration_i: Vector3::zeros(),
            newest_pose: 0.0,
            newest_position: 0.0,
            latency: 0.0,
            latency_deviation: 0.0,
            has_latency: false,
            nis: 0.0,
            nis_mean: 1.0,
            rough: 0.0,
            counts: Counts::default(),
            derived,
            params,
        })
    }

    /// Starts from a pose of the captured body at `time` (s), with the deviations of [`EstimatorParams::initial`], at
    /// zero velocity and with zero biases.
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
        self.start(time, mean, &initial, Trust::since(time));
        Ok(())
    }

    /// Starts from a pose of the captured body of a vehicle at rest, with the biases that its IMU shows.
    ///
    /// # Errors
    /// [`StartError`]: the vehicle moves, was not observed for long enough, or the directions of gravity by
    /// accelerometer and pose differ.
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
        // An error of the pose's rotation looks like a bias of the accelerometer.
        let tilt = crate::GRAVITY * self.params.rotation_noise;
        let averaged = |deviation: f64| 1e-4 + deviation / sqrt(means.samples);
        let deviation = InitialDeviation {
            velocity: 0.01,
            gyro_bias: averaged(self.params.rest.gyro_deviation),
            accelerometer_bias: tilt + averaged(self.params.rest.accelerometer_deviation),
            ..self.params.initial
        };
        self.start(time, mean, &deviation, Trust::since(time));
        Ok(())
    }

    /// Continues from the present state, with a gyro whose bias may have changed by up to `change` rad/s.
    pub(crate) fn doubt_gyro(&mut self, change: f64) {
        let known = self.head.state.axis_deviations();
        let rotation = known.rotation.max(self.params.initial.rotation);
        let deviation = InitialDeviation { rotation, gyro_bias: change, ..known };
        self.go_on(self.navigation(), &deviation);
    }

    /// Continues from the present state, whose position and velocity followed false poses without a sample that shows the
    /// motion.
    pub(crate) fn doubt_motion(&mut self) {
        let known = self.head.state.axis_deviations();
        // While a model replaces the gyro, the gyro's bias is kept aside.
        let kept = (self.head.kept_bias, self.current_kept_bias);
        self.go_on(self.navigation(), &InitialDeviation { position: UNFELT.0, velocity: UNFELT.1, ..known });
        (self.head.kept_bias, self.current_kept_bias) = kept;
    }

    /// Something pushes the vehicle while a model replaces the IMU: its torque may change.
    pub(crate) fn expect_torques(&mut self) {
        self.rough = self.now() + ROUGH.0;
    }

    /// The pose of the IMU that follows from a captured one, at the time at which it was captured.
    pub(crate) fn pose_of_imu(&self, pose: &PoseSample) -> PoseSample {
        let imu = self.params.imu_pose(&self.derived, &pose.position_w, &pose.rotation_wr);
        let (time, position_w) = (pose.time - self.params.latency, imu.position_w);
        PoseSample { time, position_w, rotation_wr: imu.rotation_wi, ..*pose }
    }

    /// Rotation of the captured body, as the estimate has it: maps its coordinates to the world's.
    pub(crate) fn captured_rotation(&self) -> Matrix3 {
        self.current.rotation_wi * self.derived.rotation_ci.transpose()
    }

    /// Continues with a vehicle that is turned by a yaw, rad, about the world's vertical, because the captured body was found
    /// to be turned. Position and velocity stay.
    pub(crate) fn turn(&mut self, yaw: f64) {
        let before = self.navigation();
        let rotation_wi = so3::rot_z(yaw) * before.rotation_wi;
        let position_w = before.position_w + (before.rotation_wi - rotation_wi) * self.derived.arm_i;
        let deviation = self.head.state.axis_deviations();
        self.go_on(Navigation { position_w, rotation_wi, ..before }, &deviation);
    }

    /// Continues from the motion that poses of this vehicle show, which the state has refused; `unfelt` says whether the
    /// accelerometer does not show it.
    pub(crate) fn go_on_with(&mut self, mean: Navigation, unfelt: bool) {
        let known = self.head.state.axis_deviations();
        let kept = (self.head.kept_bias, self.current_kept_bias);
        let least = trust::REACQUIRED;
        let gyro_bias = if kept.0.is_some() { trust::MODELLED_RATE } else { least.gyro_bias };
        let accelerometer_bias = if unfelt { 1.0 } else { least.accelerometer_bias };
        let deviation = InitialDeviation {
            gyro_bias: known.gyro_bias.max(gyro_bias),
            accelerometer_bias: known.accelerometer_bias.max(accelerometer_bias),
            ..least
        };
        self.go_on(mean, &deviation);
        (self.head.kept_bias, self.current_kept_bias) = kept;
    }

    /// Continues from a state that was computed without poses.
    pub(crate) fn go_on_from(&mut self, mean: Navigation) {
        self.go_on(mean, &InitialDeviation { position: 0.1, velocity: 0.15, ..self.params.initial });
    }

    fn go_on(&mut self, mean: Navigation, deviation: &InitialDeviation) {
        let newest = (self.newest_pose, self.newest_position);
        let now = self.now();
        self.start(now, mean, deviation, self.head.trust.kept_since(now));
        (self.newest_pose, self.newest_position) = newest;
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
        let rotation_wc = so3::straightened(rotation_wc);
        so3::check_rotation("rotation", &rotation_wc)?;
        let pose = self.params.imu_pose(&self.derived, position_w, &rotation_wc);
        Ok(Navigation { position_w: pose.position_w, rotation_wi: pose.rotation_wi, ..Navigation::ORIGIN })
    }

    fn start(&mut self, time: f64, mean: Navigation, deviation: &InitialDeviation, trust: Trust) {
        self.head = Head {
            state: UkfState::new(mean, deviation),
            time,
            next_sample: self.samples.first_after(time),
            applied: time,
            trust,
            kept_bias: KeptBias::NONE,
        };
        self.initialized = true;
        self.poses.clear();
        self.checkpoints.clear();
        self.checkpoints.save(&self.head);
        (self.newest_pose, self.newest_position) = (time, time);
        self.nis_mean = 1.0;
        self.refresh();
    }
}
