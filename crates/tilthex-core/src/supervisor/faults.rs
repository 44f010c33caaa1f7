//! The table of every fault: how it is seen, after what time, what is done.
//!
//! `docs/faults.md` is this table; a test compares the two.

/// What is done about a fault, mildest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reaction {
    /// Counted and logged; a substitute stands in where one is named.
    Note,
    /// On the ground: motors do not start, or stop. Not a reaction in flight.
    Refuse,
    /// The mission's clock slows to a stop; it goes on when the fault is gone.
    Hold,
    /// Straight down from where it is, level, then stop. Is not taken back.
    Land,
    /// Attitude hold and descent on IMU and model; back to [`Reaction::Land`] when the position returns.
    Descend,
}

/// A fault. The discriminant is its bit in a [`FaultSet`] and its index in [`TABLE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)] // each is described by its row of the table
pub enum Fault {
    ImuLate,
    ImuSilent,
    ImuFrozen,
    ImuSaturated,
    ImuOutOfRange,
    MotorsStale,
    MotorsSilent,
    MotorEmergency,
    MotorNotSpinning,
    MotorWrongSpeed,
    CommandNotFollowed,
    ThrustLost,
    RotorLost,
    BatteryLow,
    BatteryCritical,
    PoseLate,
    PoseLost,
    PoseLostLong,
    PoseLostForGood,
    PoseJumping,
    EstimateInconsistent,
    EstimateUncertain,
    TrackingError,
    Tilt,
    Speed,
    Excursion,
    WrenchLimit,
    SetpointStale,
    SetpointJump,
    SetpointInfeasible,
    Overrun,
    OverrunLong,
    LinkGarbage,
    Reboot,
    LinkLost,
    LogLost,
    NotFinite,
    StartTimeout,
    Operator,
}

/// One row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Which fault.
    pub fault: Fault,
    /// Its name in logs and messages.
    pub name: &'static str,
    /// How it is seen.
    pub detection: &'static str,
    /// For how long the condition must hold, s.
    pub after: f64,
    /// For how long it must be gone to count as over, s.
    pub over: f64,
    /// What is done before take-off.
    pub on_ground: Reaction,
    /// What is done in flight.
    pub in_flight: Reaction,
    /// What stands in meanwhile, and how it is mended.
    pub remark: &'static str,
}

use Reaction::{Descend, Hold, Land, Note, Refuse};

const fn row(
    fault: Fault,
    name: &'static str,
    detection: &'static str,
    times: (f64, f64),
    reactions: (Reaction, Reaction),
    remark: &'static str,
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

/// Number of faults.
pub const COUNT: usize = 39;

/// Every fault, in the order of [`Fault`].
#[rustfmt::skip]
pub const TABLE: [Row; COUNT] = [
    row(Fault::ImuLate, "IMU late", "no inertial sample for 6 ms", (0.0, 0.1), (Note, Note), "the model predicts until the next sample"),
    row(Fault::ImuSilent, "IMU silent", "no inertial sample for 50 ms", (0.0, 0.5), (Refuse, Land), "the model stands in for the IMU; the stream is asked for again every 500 ms"),
    row(Fault::ImuFrozen, "IMU frozen", "25 inertial samples alike to the bit", (0.0, 0.5), (Refuse, Land), "the model stands in for the IMU"),
    row(Fault::ImuSaturated, "IMU saturated", "a reading at the end of its range", (0.05, 0.5), (Refuse, Land), "the sample is dropped and the model stands in; short shocks pass"),
    row(Fault::ImuOutOfRange, "IMU out of range", "a sample refused for its range or its jump from the last", (0.0, 0.1), (Note, Note), "the sample is dropped; many of them are an IMU that is silent"),
    row(Fault::MotorsStale, "motor data stale", "a motor's measurement older than 100 ms", (0.0, 0.5), (Note, Note), "the commanded speed through the rotor's lag stands in, as it does from 30 ms on"),
    row(Fault::MotorsSilent, "motor data silent", "a motor's measurement older than 1 s", (0.0, 0.5), (Refuse, Land), "as before; the stream is asked for again every 500 ms"),
    row(Fault::MotorEmergency, "motor emergency", "the emergency bit of a motor", (0.0, 0.5), (Refuse, Land), "the motor counts as lost"),
    row(Fault::MotorNotSpinning, "motor not spinning", "the spinning bit of a motor is off after the start, or it turns at less than half the lagged command", (0.02, 0.5), (Refuse, Land), "the motor counts as lost"),
    row(Fault::MotorWrongSpeed, "motor at a wrong speed", "a motor 12 Hz off the lagged command", (0.1, 0.5), (Refuse, Land), "it is driven faster by what is missing"),
    row(Fault::CommandNotFollowed, "command not followed", "half of the motors 12 Hz off the lagged command", (0.1, 0.5), (Refuse, Land), "the vehicle's own watchdog holds its lowest speed when commands stop reaching it"),
    row(Fault::ThrustLost, "thrust lost", "the external wrench takes away 60 % or more of what one rotor gives, for 60 ms", (0.0, 0.5), (Refuse, Land), "the motor counts as lost: its propeller is"),
    row(Fault::RotorLost, "rotor lost", "a lost motor without which the vehicle can not hover at rest", (0.0, 0.5), (Refuse, Descend), "yaw is given up; down at 1 m/s, before the spin that follows takes the rest; once it has toppled, or spins past the gyro's range, rotors at their lowest speeds"),
    row(Fault::BatteryLow, "battery low", "battery below the configured voltage", (1.0, 5.0), (Refuse, Land), "change the battery"),
    row(Fault::BatteryCritical, "battery critical", "battery below the configured critical voltage", (0.2, 5.0), (Refuse, Land), "change the battery"),
    row(Fault::PoseLate, "pose late", "newest pose older than 50 ms", (0.0, 0.2), (Note, Note), "the estimator goes on with the IMU"),
    row(Fault::PoseLost, "pose lost", "no usable pose for 0.1 s", (0.0, 0.2), (Refuse, Hold), "the estimator goes on with the IMU"),
    row(Fault::PoseLostLong, "pose lost for long", "no usable pose for 0.5 s", (0.0, 0.5), (Refuse, Land), "lands on IMU and model, on the pose when it returns"),
    row(Fault::PoseLostForGood, "pose lost for good", "no usable pose for 2 s", (0.0, 0.5), (Refuse, Descend), "horizontal position is given up"),
    row(Fault::PoseJumping, "pose jumping", "5 poses in a row refused by the gate", (0.0, 0.2), (Refuse, Hold), "refused poses do not count as poses"),
    row(Fault::EstimateInconsistent, "estimate inconsistent", "innovations larger than their covariance explains", (0.3, 0.5), (Refuse, Land), "check the noise and the mounting in the configuration"),
    row(Fault::EstimateUncertain, "estimate uncertain", "a deviation above 0.5 m of the position, or 1 m/s of the velocity, in the covariance", (0.05, 0.5), (Refuse, Descend), "horizontal position is given up"),
    row(Fault::TrackingError, "tracking error", "position or rotation error above its limit", (0.3, 0.5), (Note, Land), "a landing goes on from where the vehicle is; check mass, thrust coefficients and limits"),
    row(Fault::Tilt, "tilt", "tilt above its limit", (0.1, 0.5), (Refuse, Land), "while the IMU is silent or the rotors at their limits: lowest speeds, for thrust would only carry it away"),
    row(Fault::Speed, "speed", "speed above its limit", (0.1, 0.5), (Refuse, Land), ""),
    row(Fault::Excursion, "excursion", "the admittance filter at its excursion limit", (0.5, 0.2), (Note, Hold), "the tool is held back or pushed too far"),
    row(Fault::WrenchLimit, "external wrench", "estimated tool force or torque above its limit", (0.1, 0.5), (Note, Hold), ""),
    row(Fault::SetpointStale, "set-point stale", "a streamed set-point older than 0.2 s", (0.0, 0.0), (Note, Hold), "the last one is held"),
    row(Fault::SetpointJump, "set-point refused", "a set-point that is not finite, or jumps", (0.0, 0.2), (Note, Hold), "the last good one is held"),
    row(Fault::SetpointInfeasible, "set-point infeasible", "rotors at their limits", (0.5, 0.5), (Note, Hold), "slow the trajectory or tilt less"),
    row(Fault::Overrun, "loop overrun", "a period longer than 10 ms", (0.0, 0.1), (Note, Note), "whole periods are skipped; the measured time enters the laws"),
    row(Fault::OverrunLong, "long loop overrun", "a period longer than 100 ms", (0.0, 1.0), (Note, Hold), "the vehicle's watchdog took the rotors to their lowest speed after 500 ms"),
    row(Fault::LinkGarbage, "link garbage", "a tenth of the frames refused", (0.2, 0.5), (Refuse, Hold), "the model stands in for the motors; check cable, adapter and speed of the line"),
    row(Fault::Reboot, "reboot", "the board announces itself, or its streams begin again", (0.0, 1.0), (Refuse, Land), "rates are asked for and motors started again"),
    row(Fault::LinkLost, "link lost", "the port is gone, or silent for 1 s", (0.0, 1.0), (Refuse, Descend), "nothing reaches the vehicle; its watchdog holds the lowest speed after 500 ms and disarms 10 s later"),
    row(Fault::LogLost, "log lost", "the recorder reports that it can not write", (0.0, 1.0), (Note, Note), "the flight goes on without a log"),
    row(Fault::NotFinite, "not finite", "a controller output that is not a finite number", (0.0, 0.5), (Refuse, Land), "the last good command is sent again"),
    row(Fault::StartTimeout, "start timeout", "a motor does not spin 30 s after the first start command", (0.0, 0.0), (Refuse, Note), "see the vehicle's own messages"),
    row(Fault::Operator, "operator", "SIGINT, SIGTERM, SIGHUP, the end of the duration, or a land command", (0.0, 0.0), (Refuse, Land), ""),
];

/// A set of faults.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultSet(pub u64);

impl FaultSet {
    /// No fault.
    pub const NONE: Self = Self(0);

    /// Puts a fault in where `condition` holds.
    pub fn insert_if(&mut self, fault: Fault, condition: bool) {
        if condition {
            self.0 |= 1 << fault as u8;
        }
    }

    /// Whether the fault is in the set.
    #[must_use]
    pub fn contains(self, fault: Fault) -> bool {
        self.0 & (1 << fault as u8) != 0
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The rows of the faults in the set.
    pub fn rows(self) -> impl Iterator<Item = &'static Row> {
        TABLE.iter().filter(move |row| self.contains(row.fault))
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
