//! The table of all faults: how each is detected, after what time, and the reaction.
//!
//! `docs/faults.md` is written from this table and from [`super::limits`]; a test compares the two.

use super::limits as l;
use core::fmt;

/// The reaction to a fault, mildest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reaction {
    /// Counted and logged; the remark of the fault says what replaces a missing value.
    Note,
    /// On the ground: motors do not start, or stop. Not a reaction in flight.
    Refuse,
    /// The mission's clock slows down and stops; it continues when the fault is over.
    Hold,
    /// Straight down from the reference, level, then a stop of the motors. The supervisor does not take it back.
    Land,
    /// Level attitude and descent with IMU and model; back to [`Reaction::Land`] when the position returns.
    Descend,
}

/// A fault. Its number is its bit in a [`FaultSet`], its index in [`TABLE`] and its number in logs:
/// new faults come at the end, and a number is never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)] // each is described by its row of the table
pub enum Fault {
    ImuLate = 0,
    ImuSilent = 1,
    ImuFrozen = 2,
    ImuSaturated = 3,
    ImuOutOfRange = 4,
    MotorsStale = 5,
    MotorsSilent = 6,
    MotorEmergency = 7,
    MotorNotSpinning = 8,
    MotorWrongSpeed = 9,
    CommandNotFollowed = 10,
    ThrustLost = 11,
    RotorLost = 12,
    BatteryLow = 13,
    BatteryCritical = 14,
    PoseLate = 15,
    PoseLost = 16,
    PoseLostLong = 17,
    PoseLostForGood = 18,
    PoseJumping = 19,
    EstimateInconsistent = 20,
    EstimateUncertain = 21,
    TrackingError = 22,
    Tilt = 23,
    Speed = 24,
    Excursion = 25,
    WrenchLimit = 26,
    SetpointStale = 27,
    SetpointJump = 28,
    SetpointInfeasible = 29,
    Overrun = 30,
    OverrunLong = 31,
    LinkGarbage = 32,
    Reboot = 33,
    LinkLost = 34,
    LogLost = 35,
    NotFinite = 36,
    StartTimeout = 37,
    Operator = 38,
    CalibrationRefused = 39,
    OperatorGone = 40,
    OperatorGoneForGood = 41,
    Geofence = 42,
    LandingFails = 43,
    BiasRefused = 44,
    LineLate = 45,
    MotorDataWrong = 46,
    PoseFrozen = 47,
    PoseContradicts = 48,
    MotorOrder = 49,
    CaptureAxes = 50,
    LiftOff = 51,
    MotorCheck = 52,
    CaptureMirrored = 53,
    CaptureLate = 54,
    CaptureClock = 55,
    ToolAstray = 56,
}

/// A sentence with numbers in it: each `{}` of the text stands for the next number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sentence {
    text: &'static str,
    numbers: &'static [f64],
}

impl Sentence {
    /// Whether the sentence is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.text.is_empty()
    }
}

impl fmt::Display for Sentence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut numbers = self.numbers.iter();
        for (i, part) in self.text.split("{}").enumerate() {
            if i > 0 {
                // Rounded for the reader: 0.006 s in milliseconds is 6, not 6.000000000000001.
                let number = numbers.next().copied().unwrap_or(f64::NAN);
                write!(f, "{}", libm::rint(number * 1e6) / 1e6)?;
            }
            f.write_str(part)?;
        }
        Ok(())
    }
}

/// One row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// The fault.
    pub fault: Fault,
    /// Its name in logs and messages.
    pub name: &'static str,
    /// How it is detected.
    pub detection: Sentence,
    /// For how long the condition must hold, s.
    pub after: f64,
    /// For how long the condition must be absent until the fault is over, s.
    pub over: f64,
    /// The reaction before take-off.
    pub on_ground: Reaction,
    /// The reaction in flight.
    pub in_flight: Reaction,
    /// What replaces a missing value, and how to remove the cause; may be empty.
    pub remark: Sentence,
}

use Reaction::{Descend, Hold, Land, Note, Refuse};

const fn row(
    fault: Fault,
    name: &'static str,
    detection: Sentence,
    times: (f64, f64),
    reactions: (Reaction, Reaction),
    remark: Sentence,
) -> Row {
    Row {
        fault,
        name,
        detection,
        after: times.0,
        over: times.1,
        on_ground: reactions.0,
        in_flight: reactions.1,
        remark,
    }
}

/// A sentence of a text and its numbers.
const fn s(text: &'static str, numbers: &'static [f64]) -> Sentence {
    Sentence { text, numbers }
}

/// The faults of a lift-off; each stops the motors just above the ground.
pub const LIFT_OFF_FAULTS: [Fault; 5] =
    [Fault::MotorOrder, Fault::CaptureAxes, Fault::CaptureMirrored, Fault::CaptureLate, Fault::LiftOff];

/// Number of faults.
pub const COUNT: usize = 57;

/// All faults, in the order of [`Fault`].
#[rustfmt::skip]
pub const TABLE: [Row; COUNT] = [
    row(Fault::ImuLate, "IMU late", s("no inertial sample, or none that is believed, for {} ms", &[1e3 * l::IMU_LATE]), (0.0, 0.1), (Note, Note), s("the model predicts until the next sample", &[])),
    row(Fault::ImuSilent, "IMU silent", s("no inertial sample, or none that is believed, for {} ms", &[1e3 * l::IMU_SILENT]), (0.0, 0.5), (Refuse, Land), s("the model replaces the IMU; the stream is requested again every {} ms", &[1e3 * l::STREAM_SILENT])),
    row(Fault::ImuFrozen, "IMU frozen", s("{} equal inertial samples in a row", &[l::IMU_FROZEN as f64]), (0.0, 0.5), (Refuse, Land), s("the model replaces the IMU", &[])),
    row(Fault::ImuSaturated, "IMU saturated", s("a reading at the end of its range, or one that has returned from there and differs by {} rad/s from the model", &[l::RETURNS_NEAR]), (0.05, 0.5), (Refuse, Land), s("the model replaces the sample; a short shock is not a fault", &[])),
    row(Fault::ImuOutOfRange, "IMU out of range", s("an inertial sample that is out of range, or too far from the one before it", &[]), (0.0, 0.1), (Note, Note), s("the sample is dropped; if many are dropped, the IMU counts as silent", &[])),
    row(Fault::MotorsStale, "motor data stale", s("a motor's measurement older than {} ms", &[1e3 * l::MOTORS_STALE]), (0.0, 0.5), (Note, Note), s("from {} ms on, the lagged command replaces the measured speed", &[1e3 * l::MOTORS_FRESH])),
    row(Fault::MotorsSilent, "motor data silent", s("a motor's measurement older than {} s", &[l::MOTORS_SILENT]), (0.0, 0.5), (Refuse, Land), s("the lagged command replaces the measured speed; the stream is requested again every {} ms", &[1e3 * l::STREAM_SILENT])),
    row(Fault::MotorEmergency, "motor emergency", s("the emergency bit of a motor", &[]), (0.0, 0.5), (Refuse, Land), s("the motor counts as lost", &[])),
    row(Fault::MotorNotSpinning, "motor not spinning", s("the spinning bit of a motor is off after the start, or it turns at less than {} times the lagged command for {} ms and its rotor does not lift; while a model replaces the IMU only what the motor itself reports counts", &[l::STOPPED, 1e3 * l::STOPPED_AFTER]), (0.02, 0.5), (Refuse, Land), s("the motor counts as lost", &[])),
    row(Fault::MotorWrongSpeed, "motor at a wrong speed", s("a motor {} Hz off the lagged command", &[l::WRONG_SPEED]), (0.1, 0.5), (Refuse, Land), s("its command is increased by the missing speed; the lagged command replaces a speed that the rotor cannot have reached since the one before", &[])),
    row(Fault::CommandNotFollowed, "command not followed", s("half of the motors {} Hz off the lagged command", &[l::WRONG_SPEED]), (0.1, 0.5), (Refuse, Land), s("if commands do not reach the vehicle, its own watchdog takes the rotors to their lowest speed", &[])),
    row(Fault::ThrustLost, "thrust lost", s("the external wrench cancels {} % or more of the wrench of one rotor for {} ms, and disappears when the rotor is stopped for {} ms, twice", &[1e2 * l::THRUST_MISSING, 1e3 * l::THRUST_AFTER, 1e3 * l::THRUST_TRIAL]), (0.0, 0.5), (Refuse, Land), s("the motor counts as lost, because its propeller is lost; a wrench that stays is a push", &[])),
    row(Fault::RotorLost, "rotor lost", s("a lost motor without which the vehicle cannot hover at rest", &[]), (0.0, 0.5), (Refuse, Descend), s("yaw is given up; the vehicle descends at {} m/s, before its spin becomes too fast; if it topples or spins beyond the gyro's range, its rotors turn at their lowest speeds", &[l::ADRIFT_SPEED])),
    row(Fault::BatteryLow, "battery low", s("battery voltage below `[supervisor] battery_low`", &[]), (1.0, 5.0), (Refuse, Land), s("change the battery", &[])),
    row(Fault::BatteryCritical, "battery critical", s("battery voltage below `[supervisor] battery_critical`", &[]), (0.2, 5.0), (Refuse, Land), s("change the battery", &[])),
    row(Fault::PoseLate, "pose late", s("newest pose older than {} ms", &[1e3 * l::POSE_LATE]), (0.0, 0.2), (Note, Note), s("the estimator goes on with the IMU", &[])),
    row(Fault::PoseLost, "pose lost", s("no usable pose for {} s", &[l::POSE_LOST]), (0.0, 0.2), (Refuse, Hold), s("the estimator goes on with the IMU", &[])),
    row(Fault::PoseLostLong, "pose lost for long", s("no usable pose for {} s", &[l::POSE_LOST_LONG]), (0.0, 0.5), (Refuse, Land), s("lands with IMU and model, and with poses if they return; without poses the descent becomes faster by {} m/s in a second, at most by {} m/s", &[l::UNSEEN_DESCENT.0, l::UNSEEN_DESCENT.1])),
    row(Fault::PoseLostForGood, "pose lost for good", s("no usable pose for {} s", &[l::POSE_LOST_FOR_GOOD]), (0.0, 0.5), (Refuse, Descend), s("horizontal position is given up", &[])),
    row(Fault::PoseJumping, "pose jumping", s("{} poses in a row refused by the gate", &[l::POSES_REFUSED as f64]), (0.0, 0.2), (Refuse, Hold), s("refused poses do not count as poses; if they accelerate as the vehicle does, the state is taken from them", &[])),
    row(Fault::EstimateInconsistent, "estimate inconsistent", s("mean normalised innovation squared above {}; it is 1 if the configured noises are right", &[l::INCONSISTENCY]), (0.3, 0.5), (Refuse, Land), s("check the noise and the mounting in the configuration", &[])),
    row(Fault::EstimateUncertain, "estimate uncertain", s("a standard deviation of the estimate above {} m (position) or {} m/s (velocity)", &[l::POSITION_DEVIATION, l::VELOCITY_DEVIATION]), (0.05, 0.5), (Refuse, Descend), s("horizontal position is given up", &[])),
    row(Fault::TrackingError, "tracking error", s("distance or rotation from the reference above `[supervisor] max_position_error` or `max_rotation_error_deg`", &[]), (0.3, 0.5), (Note, Land), s("a landing continues from the present pose; check mass, thrust coefficients and limits", &[])),
    row(Fault::Tilt, "tilt", s("tilt above `[supervisor] max_tilt_deg`", &[]), (0.1, 0.5), (Refuse, Land), s("if the IMU is silent and no pose shows the attitude, or the rotors are at their limits, the rotors turn at their lowest speeds, because thrust would carry the vehicle away", &[])),
    row(Fault::Speed, "speed", s("speed above `[supervisor] max_speed`", &[]), (0.1, 0.5), (Refuse, Land), s("", &[])),
    row(Fault::Excursion, "excursion", s("the reference as far from the set-point as `[admittance] max_translation` or `max_rotation_deg` allows", &[]), (0.5, 0.2), (Note, Hold), s("the tool is held back or pushed too far", &[])),
    row(Fault::WrenchLimit, "external wrench", s("estimated force or torque on the tool above `[supervisor] max_force` or `max_torque`", &[]), (0.1, 0.5), (Note, Hold), s("", &[])),
    row(Fault::SetpointStale, "set-point stale", s("a streamed set-point older than {} s", &[l::SETPOINT_STALE]), (0.0, 0.0), (Note, Hold), s("the last one is held", &[])),
    row(Fault::SetpointJump, "set-point refused", s("a set-point that is not finite, jumps, or is outside the geofence", &[]), (0.0, 0.2), (Note, Hold), s("the last good one is held", &[])),
    row(Fault::SetpointInfeasible, "set-point infeasible", s("rotors at their limits", &[]), (0.5, 0.5), (Note, Hold), s("slow the trajectory or tilt less", &[])),
    row(Fault::Overrun, "loop overrun", s("a period longer than {} ms", &[1e3 * l::OVERRUN]), (0.0, 0.1), (Note, Note), s("the loop skips whole periods; the control laws use the measured time", &[])),
    row(Fault::OverrunLong, "long loop overrun", s("a period longer than {} ms", &[1e3 * l::OVERRUN_LONG]), (0.0, 1.0), (Note, Hold), s("after {} ms without a command, the vehicle's own watchdog takes the rotors to their lowest speed", &[1e3 * l::VEHICLE_WATCHDOG])),
    row(Fault::LinkGarbage, "link garbage", s("{} % of the frames refused", &[1e2 * l::GARBAGE]), (0.2, 0.5), (Refuse, Hold), s("the model replaces the motors' data; check cable, adapter and speed of the line", &[])),
    row(Fault::Reboot, "reboot", s("the board announces itself without a request", &[]), (0.0, 1.0), (Refuse, Land), s("the streams are requested and the motors started again", &[])),
    row(Fault::LinkLost, "link lost", s("the port is gone, or silent for {} s", &[l::LINK_SILENT]), (0.0, 1.0), (Refuse, Descend), s("nothing reaches the vehicle; after {} ms its own watchdog takes the rotors to their lowest speed, and stops them {} s later", &[1e3 * l::VEHICLE_WATCHDOG, l::VEHICLE_DISARMS])),
    row(Fault::LogLost, "log lost", s("the recorder reports that it cannot write", &[]), (0.0, 1.0), (Note, Note), s("the flight goes on without a log", &[])),
    row(Fault::NotFinite, "not finite", s("a controller output that is not a finite number", &[]), (0.0, 0.5), (Refuse, Land), s("the last good command is sent again", &[])),
    row(Fault::StartTimeout, "start timeout", s("a motor does not spin `[supervisor] start_timeout` after the first start command", &[]), (0.0, 0.0), (Refuse, Note), s("see the vehicle's own messages", &[])),
    row(Fault::Operator, "operator", s("a signal that lands (loop.md), the end of the duration, or an order to land", &[]), (0.0, 0.0), (Refuse, Land), s("", &[])),
    row(Fault::CalibrationRefused, "calibration refused", s("the hovers of a calibration flight do not determine the model: something touched the vehicle, or it moved", &[]), (0.0, 0.0), (Note, Note), s("the configured model is kept; the mean wrench of the next hover is the bias", &[])),
    row(Fault::OperatorGone, "operator silent", s("no message from the operator whose orders are flown for `[supervisor] operator_timeout`", &[]), (0.0, 0.2), (Refuse, Hold), s("a line on the control socket from the client that holds the controls ends it", &[])),
    row(Fault::OperatorGoneForGood, "operator gone", s("the operator silent for another {} s", &[l::OPERATOR_GONE_FOR_GOOD]), (l::OPERATOR_GONE_FOR_GOOD, 0.5), (Refuse, Land), s("the vehicle does not wait for an operator who is gone", &[])),
    row(Fault::Geofence, "geofence", s("the vehicle outside `[supervisor] geofence` around its start, or higher than `geofence_height` above it; before the start, a route that leaves it", &[]), (0.1, 0.5), (Refuse, Land), s("plan the mission inside it, or widen it", &[])),
    row(Fault::LandingFails, "landing fails", s("a descent that comes no lower for {} s, rises by {} m, moves aside by {} m, leaves the geofence by {} m, exceeds the largest speed, or is stopped repeatedly by something that is not the ground", &[l::LANDING_STOPS, l::LANDING_RISES, l::LANDING_ASIDE, l::FENCE_MARGIN]), (0.0, 1.0), (Note, Descend), s("descends at {} m/s at its present place, with less and less thrust while it does not sink", &[l::FORCED_SPEED])),
    row(Fault::BiasRefused, "bias not learnt", s("in the hover from which the bias is learnt, the wrench is not small and steady, or the set-point moves", &[]), (0.0, 1.0), (Note, Note), s("the bias stays as it was; free the tool, let it rest, and order zero_bias", &[])),
    row(Fault::LineLate, "line late", s("inertial samples that come {} ms later than usual, by their sequence numbers", &[1e3 * l::LINE_LATE]), (0.2, 0.5), (Refuse, Land), s("slower control, which tolerates the delay; check the adapter, its driver and the load of the machine", &[])),
    row(Fault::MotorDataWrong, "motor data wrong", s("a motor that measures standstill for {} ms while its rotor lifts, or while a model replaces the IMU", &[1e3 * l::STOPPED_AFTER]), (1.0, 0.5), (Refuse, Land), s("the lagged command replaces the measured speed; check the motor's telemetry", &[])),
    row(Fault::PoseFrozen, "pose frozen", s("the same position or the same rotation, to the bit, for {} s, while the IMU's readings change", &[l::POSE_FROZEN]), (0.0, 0.2), (Refuse, Hold), s("it does not count as a pose; check that the body is tracked", &[])),
    row(Fault::PoseContradicts, "pose contradicts the IMU", s("poses and IMU {} m or {} m/s apart within {} s, and the rotors' thrust agrees with the IMU", &[l::CAPTURE_AGREES.0, l::CAPTURE_AGREES.1, l::CAPTURE_WINDOW]), (0.0, 1.0), (Refuse, Land), s("poses are not used until they accelerate as the vehicle does; lands with IMU and model; check that the tracked body is the vehicle's, and the latency of its poses", &[])),
    row(Fault::MotorOrder, "motor order", s("just after lift-off the vehicle turns by {} degrees, and not as the motors should turn it", &[l::LIFT_OFF_TILT]), (0.0, 1.0), (Refuse, Land), s("up to {} m above the ground its motors are stopped; check number, spin direction and propeller of each motor", &[l::LIFT_OFF])),
    row(Fault::CaptureAxes, "capture axes", s("between lift-off and the begin of the mission, or in a landing with a mean normalised innovation squared above {}, the captured body moves in another direction than the IMU measures; or just after lift-off, the estimate is inconsistent", &[l::SUSPECTED.0]), (0.0, 1.0), (Refuse, Land), s("up to {} m above the ground its motors are stopped; above it the yaw that was found is taken out of the poses; check the up axis of motion capture, that its axes are right-handed, and the yaw at which the body is defined", &[l::LIFT_OFF])),
    row(Fault::LiftOff, "lift-off", s("just after lift-off the vehicle leaves its place by {} m or its attitude by {} degrees", &[l::LIFT_OFF_ASIDE, l::LIFT_OFF_TILT]), (0.0, 1.0), (Refuse, Land), s("up to {} m above the ground its motors are stopped; check mass, thrust coefficients and what holds the vehicle", &[l::LIFT_OFF])),
    row(Fault::MotorCheck, "motor check", s("before the start, each motor is spun alone: one does not turn, not at its speed, or another turns in its place", &[]), (0.0, 0.0), (Refuse, Note), s("no motor is started; the message names the motor", &[])),
    row(Fault::CaptureMirrored, "capture mirrored", s("just after lift-off the captured body moves as the mirror image of what the IMU measures", &[]), (0.0, 1.0), (Refuse, Land), s("up to {} m above the ground its motors are stopped; check that motion capture streams right-handed axes", &[l::LIFT_OFF])),
    row(Fault::CaptureLate, "capture late", s("between lift-off and the begin of the mission, or in a landing with a mean normalised innovation squared above {}, the captured body moves {} ms or more later than the IMU measures", &[l::SUSPECTED.0, 1e3 * l::CAPTURE_LATE]), (0.0, 1.0), (Refuse, Land), s("up to {} m above the ground its motors are stopped; above it the delay that was found is subtracted from the times of the poses; set the `[estimator] latency` that tilthex calibrate finds", &[l::LIFT_OFF])),
    row(Fault::CaptureClock, "capture clock", s("in flight, poses claim a delay that differs by more than {} ms from the usual one: they are younger, or {} in a row are older than a pose before them", &[1e3 * l::CAPTURE_CLOCK, l::POSES_BACK as f64]), (0.0, 0.5), (Note, Note), s("until the delay is the usual one again, the capture time of a pose is its arrival minus the usual delay", &[])),
    row(Fault::ToolAstray, "tool astray", s("in the mission, the tool farther from its reference than `[supervisor] max_position_error`", &[]), (0.3, 0.5), (Note, Hold), s("the attitude yields or something holds the tool; the mission waits until the tool is back", &[])),
];

/// A set of faults.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultSet(pub u64);

impl FaultSet {
    /// No fault.
    pub const NONE: Self = Self(0);

    /// Adds a fault if `condition` holds.
    pub fn insert_if(&mut self, fault: Fault, condition: bool) {
        if condition {
            self.0 |= 1 << fault as u8;
        }
    }

    /// Takes a fault out of the set.
    pub fn remove(&mut self, fault: Fault) {
        self.0 &= !(1 << fault as u8);
    }

    /// Whether the fault is in the set.
    #[must_use]
    pub fn contains(self, fault: Fault) -> bool {
        self.0 & (1 << fault as u8) != 0
    }

    /// Whether the set is empty.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The rows of the faults in the set.
    pub fn rows(self) -> impl Iterator<Item = &'static Row> {
        let mut left = self.0;
        core::iter::from_fn(move || {
            let row = TABLE.get(left.trailing_zeros() as usize)?;
            left &= left - 1;
            Some(row)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_in_the_order_of_the_enum() {
        for (i, row) in TABLE.iter().enumerate() {
            assert_eq!(row.fault as usize, i, "{}", row.name);
            assert_ne!(row.in_flight, Refuse, "{}: motors are not stopped in flight", row.name);
            assert!(!matches!(row.on_ground, Hold | Land | Descend), "{}: on the ground", row.name);
        }
    }
}
