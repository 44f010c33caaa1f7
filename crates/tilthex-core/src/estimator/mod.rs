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

mod coarse;
mod fusion;
mod gate;
mod health;
mod history;
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
    types::{Matrix3, Vector3, is_finite3},
    ukf::{InitialDeviation, Navigation, ProcessNoise, Ukf, UkfState},
};
use history::{Checkpoints, ImuHistory, PoseQueue};
use kept_bias::KeptBias;
use leaps::Leaps;
use libm::sqrt;
use params::Derived;
use rest::RestDetector;
use trust::Trust;

/// Most filter steps between two inertial samples.
pub const STEPS_PER_TICK: u32 = 8;

/// Positions past this are no positions, m.
const POSITION_LIMIT: f64 = 1e4;
/// The noise of what happens in a gap.
const GAP_NOISE: ProcessNoise =
    ProcessNoise { gyro: 1.0, accelerometer: 10.0, gyro_bias: 1e-4, accelerometer_bias: 1e-3 };
/// Noise of the model that stands in for a missing IMU: the walk of the gyro's
/// bias is the angular acceleration that the model does not know.
const MODEL_NOISE: ProcessNoise =
    ProcessNoise { gyro: 0.05, accelerometer: 0.3, gyro_bias: 1.0, accelerometer_bias: 1e-3 };

/// Where an inertial sample comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quality {
    /// From the IMU.
    #[default]
    Measured,
    /// From the IMU, after readings that went off its range or leapt about: an impact, of which little is known.
    Shaken,
    /// From a model of the vehicle, in the place of a missing sample. Its rate is no measurement:
    /// poses correct it, as a bias.
    Modelled,
    /// Likewise, while the readings go off the IMU's range: an impact, of which the model knows little too.
    ModelledShaken,
}

impl Quality {
    /// Whether a model stands in for the IMU.
    const fn is_modelled(self) -> bool {
        matches!(self, Self::Modelled | Self::ModelledShaken)
    }
}

/// The filter, where it stands.
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
    gap_filter: Ukf,
    model_filter: Ukf,
    head: Head,
    initialized: bool,
    /// The mean at the newest sample.
    current: Navigation,
    current_kept_bias: KeptBias,
    /// Whether the head was corrected since `current` was taken from it.
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
    counts: Counts,
}

impl Estimator {
    /// An estimator that waits for [`initialize`](Self::initialize).
    ///
    /// # Errors
    /// [`Error`], which names the parameter that cannot be.
    pub fn new(params: EstimatorParams) -> Result<Self, Error> {
        let derived = params.derive()?;
        let state = UkfState::new(Navigation::ORIGIN, &params.initial);
        Ok(Self {
            filter: Ukf::new(params.process)?,
            gap_filter: Ukf::new(GAP_NOISE)?,
            model_filter: Ukf::new(MODEL_NOISE)?,
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

    /// Goes on from the present state, with a gyro whose bias may have changed by up to `change` rad/s.
    pub(crate) fn doubt_gyro(&mut self, change: f64) {
        let known = self.head.state.axis_deviations();
        let rotation = known.rotation.max(self.params.initial.rotation);
        let deviation = InitialDeviation { rotation, gyro_bias: change, ..known };
        self.go_on(self.navigation(), &deviation);
    }

    /// Goes on from a state that was reckoned without poses.
    pub(crate) fn go_on_from(&mut self, mean: Navigation) {
        self.go_on(mean, &InitialDeviation { position: 0.1, velocity: 0.15, ..self.params.initial });
    }

    fn go_on(&mut self, mean: Navigation, deviation: &InitialDeviation) {
        let newest = (self.newest_pose, self.newest_position);
        self.start(self.now(), mean, deviation);
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

    fn start(&mut self, time: f64, mean: Navigation, deviation: &InitialDeviation) {
        self.head = Head {
            state: UkfState::new(mean, deviation),
            time,
            next_sample: self.samples.first_after(time),
            applied: time,
            trust: Trust::since(time),
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
