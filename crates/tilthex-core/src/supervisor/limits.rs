//! The numbers of the faults: each is used by the flight's conditions and shown in the table.

/// Without inertial samples for longer than this the model replaces them, s.
pub const IMU_LATE: f64 = 6e-3;
/// Without inertial samples for longer than this the IMU is silent, s.
pub const IMU_SILENT: f64 = 0.05;
/// This many equal inertial readings in a row are not measurements.
pub const IMU_FROZEN: u32 = 25;
/// A rate that returns from the end of the gyro's range is believed if it is nearer than this to that of the model, rad/s. A gyro
/// that stays at the end of its range differs by the whole range.
pub const RETURNS_NEAR: f64 = 10.0;
/// A line whose samples arrive later than usual by more than this is late, s.
pub const LINE_LATE: f64 = 0.009;
/// Streams that are silent for longer than this are requested again, s.
pub const STREAM_SILENT: f64 = 0.5;
/// A motor's measurement that is older than this is stale, s.
pub const MOTORS_STALE: f64 = 0.1;
/// A motor's measurement that is older than this, about a rotor's time constant, is replaced by the model, s.
pub const MOTORS_FRESH: f64 = 0.03;
/// A motor's measurement that is older than this is silent, s.
pub const MOTORS_SILENT: f64 = 1.0;
/// A motor whose speed differs from the lagged command by this does not follow, Hz.
pub const WRONG_SPEED: f64 = 12.0;
/// A motor slower than this part of the lagged command has stopped.
pub const STOPPED: f64 = 0.5;
/// The smallest share of its wrench that a rotor without thrust lacks.
pub const THRUST_MISSING: f64 = 0.6;
/// A rotor must be suspected for this time before its trial, s.
pub const THRUST_AFTER: f64 = 0.06;
/// In each of two trials the rotor stands still for this time, s.
pub const THRUST_TRIAL: f64 = 0.12;
/// A motor that reports a stop is believed after this time, unless its rotor lifts, s.
pub const STOPPED_AFTER: f64 = 0.06;
/// Speed of the descent without a rotor that a hover needs, m/s.
pub const ADRIFT_SPEED: f64 = 1.0;
/// A pose that is exactly repeated for longer than this is not a pose, s.
pub const POSE_FROZEN: f64 = 0.1;
/// The motion by the IMU alone is compared with that of the poses over this time, s.
pub const CAPTURE_WINDOW: f64 = 1.0;
/// Duration of the first comparison after take-off, s.
pub const RECKONED_FIRST: f64 = 2.0;
/// Both motions agree within this, m and m/s.
pub const CAPTURE_AGREES: (f64, f64) = (0.12, 0.25);
/// Up to this height above the ground the motors are stopped if a lift-off goes wrong, m.
pub const LIFT_OFF: f64 = 0.3;
/// A lift-off is watched for this long at the most, s.
pub const LIFT_OFF_TIME: f64 = 3.0;
/// During the lift-off the attitude of a correct vehicle changes by less than this, degrees.
pub const LIFT_OFF_TILT: f64 = 9.0;
/// During the lift-off a correct vehicle moves aside by less than this, m.
pub const LIFT_OFF_ASIDE: f64 = 0.1;
/// Poses that are older by this than their times say are a fault of a lift-off, s.
pub const CAPTURE_LATE: f64 = 0.04;
/// If the delay of a pose, by its capture time, differs from the usual one by more than this, its capture time may be wrong, s.
pub const CAPTURE_CLOCK: f64 = 0.05;
/// This many late poses in a row that claim to be older than one before them show that the clock has jumped.
pub const POSES_BACK: u32 = 3;
/// A pose that is older than this is late, s.
pub const POSE_LATE: f64 = 0.05;
/// Without a usable pose for longer than this the pose is lost, s.
pub const POSE_LOST: f64 = 0.1;
/// Without a usable pose for longer than this the vehicle lands, s.
pub const POSE_LOST_LONG: f64 = 0.5;
/// Without a usable pose for longer than this the horizontal position is given up, s.
pub const POSE_LOST_FOR_GOOD: f64 = 2.0;
/// This many refused poses in a row are a fault.
pub const POSES_REFUSED: u32 = 5;
/// Mean normalised innovation squared above which model and measurement disagree; 1 is agreement.
pub const INCONSISTENCY: f64 = 4.0;
/// Mean normalised innovation squared above which poses are compared with the motion, and below which no longer: an instability
/// that grows slowly must not be over before it is found.
pub const SUSPECTED: (f64, f64) = (1.5, 1.2);
/// Deviation of the position above which it is given up, m.
pub const POSITION_DEVIATION: f64 = 0.5;
/// Deviation of the velocity above which the speed is not known, m/s.
pub const VELOCITY_DEVIATION: f64 = 1.0;
/// A landing that comes no lower for this long fails, s.
pub const LANDING_STOPS: f64 = 8.0;
/// A landing that rises above its start by this fails, m.
pub const LANDING_RISES: f64 = 0.6;
/// A landing that moves aside from its start by this fails, m.
pub const LANDING_ASIDE: f64 = 1.0;
/// A landing this far beyond the geofence fails, m.
pub const FENCE_MARGIN: f64 = 0.5;
/// Without a usable pose for longer than [`POSE_LOST_LONG`] a descent becomes faster by the first of these, m/s^2, and at most by
/// the second, m/s: the error of its speed grows.
pub const UNSEEN_DESCENT: (f64, f64) = (0.5, 1.5);
/// Speed of a descent that is forced, m/s.
pub const FORCED_SPEED: f64 = 0.7;
/// A streamed set-point that is older than this is stale, s.
pub const SETPOINT_STALE: f64 = 0.2;
/// A vehicle that is held because its operator is silent lands after this long, s.
pub const OPERATOR_GONE_FOR_GOOD: f64 = 5.0;
/// A period of the loop that is longer than this is an overrun, s.
pub const OVERRUN: f64 = 0.01;
/// A period of the loop that is longer than this is a long overrun, s.
pub const OVERRUN_LONG: f64 = 0.1;
/// After this long without a command the vehicle takes its rotors to their lowest speeds, s.
pub const VEHICLE_WATCHDOG: f64 = 0.5;
/// After this long at their lowest speeds the vehicle stops its motors, s.
pub const VEHICLE_DISARMS: f64 = 10.0;
/// This share of refused frames is garbage.
pub const GARBAGE: f64 = 0.1;
/// A line that is silent for longer than this is lost, s.
pub const LINK_SILENT: f64 = 1.0;
