//! The kinds of faults. Each has one row, which lists at least one thing that the fault changes.

use serde::{Deserialize, Serialize};

use super::{
    acts::Act::{self, *},
    capture, line, vehicle,
};

/// Declares the kinds: name, description, what it changes, and a special property.
macro_rules! kinds {
    ($( $name:ident, $text:literal, [$($act:expr),+] $(, $special:ident)?; )*) => {
        /// A kind of fault.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
        #[serde(rename_all = "kebab-case")]
        #[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
        pub enum Kind {
            $( #[doc = $text] $name, )*
        }

        impl Kind {
            /// All kinds.
            pub const ALL: &[Self] = &[$( Self::$name ),*];

            /// A description of the fault.
            #[must_use]
            pub fn text(self) -> &'static str {
                match self {
                    $( Self::$name => $text, )*
                }
            }

            /// What the fault changes.
            pub(super) fn acts(self) -> &'static [Act] {
                match self {
                    $( Self::$name => const { &[$($act),+] }, )*
                }
            }

            fn special(self) -> Special {
                match self {
                    $( Self::$name => special!($($special)?), )*
                }
            }
        }
    };
}

/// A special property of a kind.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Special {
    Nothing,
    TakesLift,
    BuiltIn,
}

macro_rules! special {
    () => {
        Special::Nothing
    };
    (takes_lift) => {
        Special::TakesLift
    };
    (built_in) => {
        Special::BuiltIn
    };
}

kinds! {
    BitFlips, "a bit of a byte in 20 to 2000 flipped, both ways", [Received(line::flip_bits), Sent(line::flip_bits)];
    FramesLost, "5 to 100 % of the vehicle's frames lost", [Received(line::lose)];
    FramesDuplicated, "5 to 100 % of the vehicle's frames twice", [Received(line::duplicate)];
    FramesReordered, "the vehicle's frames of a tick in another order", [Received(line::reorder)];
    FramesCut, "5 to 100 % of the vehicle's frames cut short", [Received(line::cut)];
    Garbage, "bursts of up to 300 random bytes", [Received(line::garbage)];
    LineLate, "the line both ways 5 to 60 ms late from one moment on", [Received(line::delay), Sent(line::delay)];
    Unplugged, "the port goes away", [Received(line::silence), Sent(line::silence), Host(|host, on| host.link_lost = on)], takes_lift;
    CommandsLost, "no command reaches the vehicle", [Sent(line::silence)], takes_lift;
    TelemetryZero, "a rotor whose measured speed is zero while it turns as before", [Received(line::zero_speed)];
    ImuFrozen, "the same inertial sample again and again", [Received(line::freeze_imu)];
    CaptureLost, "no pose for up to 3 s", [Pose(capture::lose)];
    CaptureFlips, "poses turned by 180 deg", [Pose(capture::flip)];
    CaptureJumps, "poses displaced by 0.05 to 2 m", [Pose(capture::jump)];
    CaptureClock, "capture times off by up to 1 s either way", [Pose(capture::shift_clock)];
    CaptureFrozen, "one pose again and again, with new times", [Pose(capture::freeze)];
    CaptureFrozenNoisy, "the same with 0.5 mm of noise", [Pose(capture::freeze_with_noise)];
    CaptureDefault, "poses of zeros and the identity, marked as valid", [Pose(capture::default_pose)];
    CaptureOtherBody, "the poses of another body, 0.3 to 2 m away, that moves by itself", [Pose(capture::other_body)];
    CaptureNoise, "poses 5 to 100 times as noisy", [vehicle::CAPTURE_NOISE];
    CaptureLatency, "poses 10 to 250 ms late, and stamped on arrival", [Pose(capture::stamp_on_arrival)], built_in;
    CaptureYawed, "a captured body that is turned by 20 to 180 deg about its vertical", [Pose(capture::yaw)], built_in;
    CaptureTilted, "a captured body that is tilted by 1 to 20 deg", [Pose(capture::tilt)], built_in;
    CaptureYUp, "a capture system whose y axis is up, taken for z", [Pose(capture::y_up)], built_in;
    MotorsExchanged, "two motors on each other's wires", [vehicle::MOTORS_EXCHANGED], built_in;
    SpinReversed, "a rotor that turns the other way, with the propeller for it", [vehicle::SPIN_REVERSED], built_in;
    ImuNoise, "inertial noise 3 to 30 times as large", [vehicle::IMU_NOISE];
    GyroBias, "a step of the gyroscope's bias up to 0.2 rad/s", [vehicle::GYRO_BIAS];
    AccelerometerBias, "a step of the accelerometer's bias up to 1 m/s^2", [vehicle::ACCELEROMETER_BIAS];
    ImuSaturated, "the gyroscope at the end of its range", [vehicle::IMU_SATURATED];
    RotorThrust, "a rotor with 0 to 80 % of its thrust", [vehicle::ROTOR_THRUST], takes_lift;
    RotorSlow, "a rotor at 40 to 90 % of the commanded speed", [vehicle::ROTOR_SLOW], takes_lift;
    RotorStuck, "a rotor that stands still", [vehicle::ROTOR_STUCK], takes_lift;
    MotorEmergency, "a motor that stops and shows its emergency bit", [vehicle::MOTOR_EMERGENCY], takes_lift;
    BatteryEmpty, "a battery that is suddenly almost empty", [vehicle::BATTERY_EMPTY];
    Reboot, "the flight board restarts", [vehicle::REBOOT];
    Push, "a push of 0.5 to 15 N on the tool", [vehicle::PUSH];
    PushOnArm, "a push of 0.5 to 6 N at the end of an arm", [vehicle::PUSH_ON_ARM];
    Gusts, "gusts of wind with a force of 0.5 to 5 N", [vehicle::GUSTS];
    DiskFull, "the log cannot be written", [Host(|host, on| host.log_lost |= on)];
    DiskSlow, "the log's disk stands still", [Disk];
    Stopped, "the program is stopped for 5 to 500 ms", [Stopped];
    StalledInTick, "a tick whose commands leave 5 to 200 ms after its inputs came", [Stalled];
}

impl Kind {
    /// Whether the vehicle may be unable to carry its weight. Then it may come down hard and away from its start, but
    /// no motor may be stopped in the air.
    #[must_use]
    pub fn takes_lift(self) -> bool {
        self.special() == Special::TakesLift
    }

    /// Whether the fault is there from power-on and stays, as wrong wiring or mounting does.
    #[must_use]
    pub fn is_built_in(self) -> bool {
        self.special() == Special::BuiltIn
    }
}
