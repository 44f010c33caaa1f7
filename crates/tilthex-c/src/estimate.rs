//! The estimator.

use crate::{
    block::{TilthexEstimator, content, fill, read, write},
    numbers::{TilthexMeasured, matrix, require},
    status::{Complaint, TilthexMessage, TilthexStatus},
    vehicle::TilthexMounting,
};
use tilthex_core::{
    PoseSample, Vector3,
    estimator::{Estimator, EstimatorParams, Outcome, Status},
    types::is_finite3,
};

/// Parameters of the estimator. Those of the core that are not here have their defaults.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexEstimatorParams {
    /// White noise of the gyro, rad/s/sqrt(Hz).
    pub gyro_noise: f64,
    /// White noise of the accelerometer, m/s^2/sqrt(Hz).
    pub accelerometer_noise: f64,
    /// Random walk of the gyro's bias, rad/s/sqrt(s).
    pub gyro_bias_noise: f64,
    /// Random walk of the accelerometer's bias, m/s^2/sqrt(s).
    pub accelerometer_bias_noise: f64,
    /// Standard deviation of a captured position, m per axis.
    pub position_noise: f64,
    /// Standard deviation of a captured orientation, rad per axis.
    pub rotation_noise: f64,
    /// The inertial sensor.
    pub imu: TilthexMounting,
    /// The captured body.
    pub body: TilthexMounting,
    /// Constant latency that is subtracted from the time of every pose, s.
    pub latency: f64,
}

impl TilthexEstimatorParams {
    fn params(&self) -> EstimatorParams {
        let mut params = EstimatorParams {
            position_noise: self.position_noise,
            rotation_noise: self.rotation_noise,
            imu_position_r: self.imu.position_r.into(),
            imu_rotation_ri: matrix(&self.imu.rotation_r),
            body_position_r: self.body.position_r.into(),
            body_rotation_rc: matrix(&self.body.rotation_r),
            latency: self.latency,
            ..EstimatorParams::default()
        };
        params.process.gyro = self.gyro_noise;
        params.process.accelerometer = self.accelerometer_noise;
        params.process.gyro_bias = self.gyro_bias_noise;
        params.process.accelerometer_bias = self.accelerometer_bias_noise;
        params
    }
}

/// A captured pose.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexPose {
    /// When it was taken, s, on the clock of the inertial samples.
    pub time: f64,
    /// When it arrived, s, on that clock.
    pub arrival: f64,
    /// Position of the captured body, m, world.
    pub position_w: [f64; 3],
    /// Orientation of the captured body: maps its coordinates to world coordinates.
    pub rotation_wc: [[f64; 3]; 3],
}

/// What the estimator did with a pose.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TilthexOutcome {
    /// Position and rotation were applied.
    Accepted = 0,
    /// They were applied with a larger noise.
    Weighed = 1,
    /// Only the position was applied.
    PositionOnly = 2,
    /// Nothing was applied: it contradicts the state.
    Rejected = 3,
    /// It is applied in a later tick.
    Pending = 4,
    /// It is older than 0.3 s.
    TooOld = 5,
    /// A pose of the same time has arrived before.
    Duplicate = 6,
    /// Not finite, or not a rotation.
    Invalid = 7,
    /// No pose has started the estimator.
    Uninitialized = 8,
}

impl From<Outcome> for TilthexOutcome {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Accepted => Self::Accepted,
            Outcome::Weighed => Self::Weighed,
            Outcome::PositionOnly => Self::PositionOnly,
            Outcome::Rejected => Self::Rejected,
            Outcome::Pending => Self::Pending,
            Outcome::TooOld => Self::TooOld,
            Outcome::Duplicate => Self::Duplicate,
            Outcome::Invalid => Self::Invalid,
            Outcome::Uninitialized => Self::Uninitialized,
        }
    }
}

/// How far the state can be trusted.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexHealth {
    /// 0: not started; 1: tracking; 2: without poses for so long that it only follows the inertial samples; 3: lost.
    pub status: u32,
    /// Age of the newest pose whose position, at least, was accepted, s.
    pub position_age: f64,
    /// Root of the summed variances of the position, m.
    pub position_deviation: f64,
    /// The same for the velocity, m/s.
    pub velocity_deviation: f64,
    /// The same for the rotation, rad.
    pub rotation_deviation: f64,
}

/// Writes the default parameters: a good MEMS IMU and an optical capture system, both at the centre of mass.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_estimator_defaults(params: *mut TilthexEstimatorParams) -> TilthexStatus {
    let p = EstimatorParams::default();
    let centre = TilthexMounting::from(&tilthex_core::vehicle::Mounting::default());
    let defaults = TilthexEstimatorParams {
        gyro_noise: p.process.gyro,
        accelerometer_noise: p.process.accelerometer,
        gyro_bias_noise: p.process.gyro_bias,
        accelerometer_bias_noise: p.process.accelerometer_bias,
        position_noise: p.position_noise,
        rotation_noise: p.rotation_noise,
        imu: centre,
        body: centre,
        latency: p.latency,
    };
    // SAFETY: the pointer is null or valid.
    TilthexStatus::of(unsafe { write(params, defaults) })
}

/// Makes an estimator that waits for a start. `message` (may be null) gets the sentence of a refusal.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_estimator_init(
    estimator: *mut TilthexEstimator,
    params: *const TilthexEstimatorParams,
    message: *mut TilthexMessage,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    TilthexStatus::of(unsafe {
        let complaint = Complaint::to(message);
        read(params).and_then(|params| {
            let made = complaint.check(Estimator::new(params.params()))?;
            fill(estimator, &made)
        })
    })
}

/// Starts from a pose. If `at_rest` is not 0, the biases of the inertial sensor are found from the samples of the last
/// second, in which the vehicle must stand still; otherwise they begin at zero. `message` (may be null) gets the
/// sentence of a refusal.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_estimator_start(
    estimator: *mut TilthexEstimator,
    pose: *const TilthexPose,
    at_rest: u32,
    message: *mut TilthexMessage,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    let start = || unsafe {
        let complaint = Complaint::to(message);
        let (block, pose) = (content(estimator)?, read(pose)?);
        let (position_w, rotation_wc) = (Vector3::from(pose.position_w), matrix(&pose.rotation_wc));
        if at_rest == 0 {
            complaint.check(block.initialize(pose.time, &position_w, &rotation_wc))
        } else {
            complaint.check_start(block.initialize_at_rest(pose.time, &position_w, &rotation_wc))
        }
    };
    TilthexStatus::of(start())
}

/// Takes an inertial sample at `time` (s): rate (rad/s, `gyro_i[3]`) and specific force (m/s^2, `specific_force_i[3]`)
/// in the coordinates of the sensor.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_estimator_predict(
    estimator: *mut TilthexEstimator,
    time: f64,
    gyro_i: *const f64,
    specific_force_i: *const f64,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid, and the arrays have three numbers.
    let predict = || unsafe {
        let block = content(estimator)?;
        let gyro = Vector3::from(read(gyro_i.cast::<[f64; 3]>())?);
        let force = Vector3::from(read(specific_force_i.cast::<[f64; 3]>())?);
        require(time.is_finite() && is_finite3(&gyro) && is_finite3(&force), TilthexStatus::NotFinite)?;
        block.predict(time, &gyro, &force);
        Ok(())
    };
    TilthexStatus::of(predict())
}

/// Takes a pose, which may be late: it is applied at the time at which it was taken. `outcome` (may be null) gets what
/// was done with it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_estimator_update(
    estimator: *mut TilthexEstimator,
    pose: *const TilthexPose,
    outcome: *mut TilthexOutcome,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    let update = || unsafe {
        let (block, pose) = (content(estimator)?, read(pose)?);
        let found = block.update_pose(&PoseSample {
            time: pose.time,
            arrival: pose.arrival,
            position_w: pose.position_w.into(),
            rotation_wr: matrix(&pose.rotation_wc),
            tracking_valid: true,
        });
        if !outcome.is_null() {
            write(outcome, found.into())?;
        }
        Ok(())
    };
    TilthexStatus::of(update())
}

/// Writes the state of the centre of mass and the specific force there at the newest sample into `measured`, whose rotor
/// speeds stay, and how far they can be trusted into `health` (may be null).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_estimator_state(
    estimator: *mut TilthexEstimator,
    measured: *mut TilthexMeasured,
    health: *mut TilthexHealth,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    let state = || unsafe {
        let block = content(estimator)?;
        let mut found = read(measured)?;
        found.set(&block.robot_state(), &block.specific_force_r());
        write(measured, found)?;
        if !health.is_null() {
            let h = block.health();
            let status = match h.status {
                Status::Uninitialized => 0,
                Status::Tracking => 1,
                Status::Coasting => 2,
                Status::Lost => 3,
            };
            write(
                health,
                TilthexHealth {
                    status,
                    position_age: h.position_age,
                    position_deviation: h.position_deviation,
                    velocity_deviation: h.velocity_deviation,
                    rotation_deviation: h.rotation_deviation,
                },
            )?;
        }
        Ok(())
    };
    TilthexStatus::of(state())
}
