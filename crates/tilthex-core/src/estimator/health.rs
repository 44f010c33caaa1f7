//! What the supervisor and the log want to know about the estimate.

/// How far the state can be trusted, by the limits of the supervisor's faults "pose lost" and "estimate uncertain".
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Status {
    /// No pose has started it.
    #[default]
    Uninitialized,
    /// Poses come and pass.
    Tracking,
    /// The newest pose whose position was applied is older than `POSE_LOST`: the IMU alone carries the state.
    Coasting,
    /// The covariance is past `POSITION_DEVIATION` or `VELOCITY_DEVIATION`.
    Lost,
}

impl Status {
    /// What it is called in logs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Uninitialized => "uninitialized",
            Self::Tracking => "tracking",
            Self::Coasting => "coasting",
            Self::Lost => "lost",
        }
    }
}

/// What became of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Position and rotation were applied.
    Accepted,
    /// It surprises: position and rotation were applied as those of a noisier pose.
    Weighed,
    /// The rotation contradicts the state (swapped markers), the position does not: it alone was applied.
    PositionOnly,
    /// So far off that neither the state nor the pose can be so wrong: nothing was applied.
    Rejected,
    /// Its time has not come, or the work of this tick is used up: it waits.
    Pending,
    /// Older than the history.
    TooOld,
    /// A pose of the same time is there already.
    Duplicate,
    /// Not finite, not a rotation, or marked so by the capture system.
    Invalid,
    /// No pose has started the estimator yet.
    Uninitialized,
}

impl Outcome {
    /// What it is called in logs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Weighed => "weighed",
            Self::PositionOnly => "position only",
            Self::Rejected => "rejected",
            Self::Pending => "pending",
            Self::TooOld => "too old",
            Self::Duplicate => "duplicate",
            Self::Invalid => "invalid",
            Self::Uninitialized => "uninitialized",
        }
    }
}

/// What the application of one pose showed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseReport {
    /// When it was taken, s.
    pub time: f64,
    /// What became of it.
    pub outcome: Outcome,
    /// Normalised innovation squared, chi-square with 6 degrees of freedom.
    pub nis: f64,
    /// Innovation of the IMU's pose: position (m, W), rotation (rad, W).
    pub innovation: [f64; 6],
    /// Its predicted standard deviations, m and rad.
    pub deviation: [f64; 6],
}

/// Poses and samples by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Poses applied whole.
    pub accepted: u32,
    /// Poses beyond the gate, applied as those of noisier ones.
    pub weighed: u32,
    /// Poses of which only the position was applied.
    pub position_only: u32,
    /// Poses that contradict the state, of which nothing was applied.
    pub rejected: u32,
    /// Of the two before, those turned by more than 90 degrees.
    pub flipped: u32,
    /// Poses that came after a later one had been applied, and made the filter go back.
    pub disordered: u32,
    /// Poses older than the history, or pushed out of it unapplied.
    pub too_old: u32,
    /// Poses of a time that was there already.
    pub duplicate: u32,
    /// Poses not finite, not rotations, or marked invalid.
    pub invalid: u32,
    /// Inertial samples not finite, out of range or out of order.
    pub imu_rejected: u32,
    /// Intervals between inertial samples above 20 ms.
    pub imu_gaps: u32,
}

/// The health of the estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Health {
    /// How far the state can be trusted.
    pub status: Status,
    /// Age of the newest accepted pose, s.
    pub pose_age: f64,
    /// Age of the newest pose whose position, at least, was accepted, s.
    pub position_age: f64,
    /// Mean time from capture to arrival, s.
    pub latency: f64,
    /// Its mean absolute deviation, s.
    pub latency_deviation: f64,
    /// Normalised innovation squared of the newest pose over its 6 degrees of freedom.
    pub nis: f64,
    /// Its mean over the last 50 poses or so, each counted at the gate at most: 1 when model and measurement agree.
    pub nis_mean: f64,
    /// Root of the summed variances of the position, m, at the time up to which poses are applied.
    pub position_deviation: f64,
    /// Likewise of the velocity, m/s.
    pub velocity_deviation: f64,
    /// Likewise of the rotation, rad.
    pub rotation_deviation: f64,
    /// Time by which the covariance, and a late pose's work, lag the newest sample, s.
    pub lag: f64,
    /// Whether the IMU's last whole window (1 s by default) was one of rest.
    pub at_rest: bool,
    /// Failed factorisations that were mended.
    pub recoveries: u32,
    /// Poses and samples by what became of them.
    pub counts: Counts,
}
