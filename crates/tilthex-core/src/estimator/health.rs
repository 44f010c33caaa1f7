//! The health of the estimate, for the supervisor and the log.

/// How far the state can be trusted. The limits are those of the supervisor's faults "pose lost" and "estimate
/// uncertain".
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Status {
    /// No pose has started the estimator.
    #[default]
    Uninitialized,
    /// Poses arrive and are accepted.
    Tracking,
    /// The newest pose whose position was applied is older than `POSE_LOST`: the state rests on the IMU alone.
    Coasting,
    /// The covariance is above `POSITION_DEVIATION` or `VELOCITY_DEVIATION`.
    Lost,
}

impl Status {
    /// The name in logs.
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

/// The outcome of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Position and rotation were applied.
    Accepted,
    /// Outside of the gate: position and rotation were applied with a larger noise.
    Weighed,
    /// The rotation contradicts the state (swapped markers), but the position does not. Only the position was
    /// applied.
    PositionOnly,
    /// So far off that neither the noise of the pose nor the error of the state can explain it. Nothing was applied.
    Rejected,
    /// It waits: the samples have not reached its time, or the steps of this tick are used up.
    Pending,
    /// Older than the history.
    TooOld,
    /// A pose of the same time has arrived before.
    Duplicate,
    /// Not finite, not a rotation, or marked as invalid by the capture system.
    Invalid,
    /// No pose has started the estimator yet.
    Uninitialized,
}

impl Outcome {
    /// The name in logs.
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

/// The result of the application of one pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseReport {
    /// When it was taken, s.
    pub time: f64,
    /// The outcome.
    pub outcome: Outcome,
    /// Normalised innovation squared, chi-square with 6 degrees of freedom.
    pub nis: f64,
    /// Innovation of the IMU's pose: position (m, W), rotation (rad, W).
    pub innovation: [f64; 6],
    /// Its predicted standard deviations, m and rad.
    pub deviation: [f64; 6],
}

/// Counts of poses and samples by outcome.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Poses whose position and rotation were applied.
    pub accepted: u32,
    /// Poses outside of the gate, which were applied with a larger noise.
    pub weighed: u32,
    /// Poses of which only the position was applied.
    pub position_only: u32,
    /// Poses that contradict the state, of which nothing was applied.
    pub rejected: u32,
    /// Of `position_only` and `rejected`, those that are rotated by more than 90 degrees.
    pub flipped: u32,
    /// Poses that arrived after a later pose had been applied, and made the filter go back.
    pub disordered: u32,
    /// Poses older than the history, or removed from it before they were applied.
    pub too_old: u32,
    /// Poses whose time another pose has.
    pub duplicate: u32,
    /// Poses that are not finite, not rotations, or marked as invalid.
    pub invalid: u32,
    /// Inertial samples that are not finite, out of range or out of order.
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
    /// Mean of `nis` over about the last 50 poses, each limited to the gate: 1 if model and measurement agree.
    pub nis_mean: f64,
    /// Root of the summed variances of the position, m, at the time up to which poses have been applied.
    pub position_deviation: f64,
    /// The same for the velocity, m/s.
    pub velocity_deviation: f64,
    /// The same for the rotation, rad.
    pub rotation_deviation: f64,
    /// Time by which the head of the filter is behind the newest sample, s.
    pub lag: f64,
    /// Whether the vehicle was at rest in the last complete window of the IMU (1 s by default).
    pub at_rest: bool,
    /// Failed factorisations that were corrected.
    pub recoveries: u32,
    /// Counts of poses and samples by outcome.
    pub counts: Counts,
}
