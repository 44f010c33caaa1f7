//! The topics of PX4 that the link uses, as `px4_msgs` 1.15 and 1.16 define them, in CDR. Angles are in rad, vectors in FRD
//! (forward, right, down), and speeds in revolutions per minute if the name contains `rpm`.

use super::cdr::{Reader, Writer};

/// Number of motors in [`ActuatorMotors`].
pub const MOTORS: usize = 12;
/// PX4's arming state in which motors may turn.
pub const ARMED: u8 = 2;
/// The mode in which PX4 executes motor commands from outside.
pub const OFFBOARD: u8 = 14;

/// Makes [`Topic`] from a list of names.
macro_rules! topics {
    ($($(#[$doc:meta])* $topic:ident => $name:literal, $kind:literal;)+) => {
        /// A topic that the link uses.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Topic {
            $($(#[$doc])* $topic,)+
        }

        impl Topic {
            /// Every topic.
            pub const ALL: &[Self] = &[$(Self::$topic),+];

            /// Its name in PX4's `dds_topics.yaml`.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$topic => $name,)+
                }
            }

            /// The type of its messages in PX4's `dds_topics.yaml`.
            #[must_use]
            pub const fn kind(self) -> &'static str {
                match self {
                    $(Self::$topic => concat!("px4_msgs::msg::", $kind),)+
                }
            }
        }
    };
}

topics! {
    /// Inertial samples.
    SensorCombined => "/fmu/out/sensor_combined", "SensorCombined";
    /// The measurements of the motor controllers.
    EscStatus => "/fmu/out/esc_status", "EscStatus";
    /// The battery's voltage.
    BatteryStatus => "/fmu/out/battery_status", "BatteryStatus";
    /// The mode and the arming state.
    VehicleStatus => "/fmu/out/vehicle_status", "VehicleStatus";
    /// Throttles.
    ActuatorMotors => "/fmu/in/actuator_motors", "ActuatorMotors";
    /// Keeps the offboard mode active.
    OffboardControlMode => "/fmu/in/offboard_control_mode", "OffboardControlMode";
    /// Orders to change the mode, to arm and to disarm.
    VehicleCommand => "/fmu/in/vehicle_command", "VehicleCommand";
}

impl Topic {
    /// Number of topics.
    pub const COUNT: usize = Self::ALL.len();

    /// Whether PX4 subscribes to it; otherwise PX4 publishes it.
    #[must_use]
    pub const fn is_taken(self) -> bool {
        matches!(self, Self::ActuatorMotors | Self::OffboardControlMode | Self::VehicleCommand)
    }

    /// The topic with a DDS name. A DDS name is `rt`, the vehicle's name if it has one, the topic's name and, in some
    /// versions of PX4, `_v` with the version of the messages.
    #[must_use]
    pub fn named(dds: &[u8]) -> Option<Self> {
        let versioned = |rest: &[u8]| match rest {
            [] => true,
            [b'_', b'v', digits @ ..] => !digits.is_empty() && digits.iter().all(u8::is_ascii_digit),
            _ => false,
        };
        let begins =
            |topic: &Self, at: &[u8]| at.strip_prefix(topic.name().as_bytes()).is_some_and(versioned);
        let body = dds.strip_prefix(b"rt")?;
        let at = body.windows(b"/fmu/".len()).position(|found| found == b"/fmu/")?;
        let at = body.get(at..)?;
        Self::ALL.iter().copied().find(|topic| begins(topic, at))
    }
}

/// A message of a topic.
pub trait TopicMessage: Sized {
    /// Its topic.
    const TOPIC: Topic;

    /// Reads a message; `None` if the data is not one.
    fn read(data: &[u8]) -> Option<Self>;

    /// Writes the message and returns its length, bytes; 0 if it does not fit.
    fn write(&self, out: &mut [u8]) -> usize;
}

fn three(reader: &mut Reader<'_>) -> Option<[f32; 3]> {
    Some([reader.f32()?, reader.f32()?, reader.f32()?])
}

/// An inertial sample. Its values are means over the period that ends at its time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorCombined {
    /// Its time, us.
    pub timestamp: u64,
    /// Angular velocity, rad/s, FRD.
    pub gyro: [f32; 3],
    /// Specific force, m/s^2, FRD.
    pub accelerometer: [f32; 3],
    /// Whether a reading of one of the two sensors was at the end of its range.
    pub clipped: bool,
}

impl TopicMessage for SensorCombined {
    const TOPIC: Topic = Topic::SensorCombined;

    fn read(data: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(data);
        let (timestamp, gyro) = (reader.u64()?, three(&mut reader)?);
        let (_gyro_period, _relative) = (reader.u32()?, reader.i32()?);
        let accelerometer = three(&mut reader)?;
        let (_period, of_accelerometer, of_gyro) = (reader.u32()?, reader.u8()?, reader.u8()?);
        Some(Self { timestamp, gyro, accelerometer, clipped: of_accelerometer | of_gyro != 0 })
    }

    fn write(&self, out: &mut [u8]) -> usize {
        let mut writer = Writer::new(out);
        writer.u64(self.timestamp);
        self.gyro.into_iter().for_each(|x| writer.f32(x));
        writer.u32(2000);
        writer.i32(0);
        self.accelerometer.into_iter().for_each(|x| writer.f32(x));
        writer.u32(2000);
        writer.bytes(&[u8::from(self.clipped), 0, 0, 0]);
        writer.length().unwrap_or(0)
    }
}

/// The battery's voltage.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BatteryStatus {
    /// Its time, us.
    pub timestamp: u64,
    /// Whether a battery is connected.
    pub connected: bool,
    /// Voltage, V; 0 if it is not known.
    pub voltage: f32,
}

impl TopicMessage for BatteryStatus {
    const TOPIC: Topic = Topic::BatteryStatus;

    /// Later versions have one byte more before the voltage, the battery's number. It does not move the voltage, which is
    /// aligned.
    fn read(data: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(data);
        let (timestamp, flags) = (reader.u64()?, reader.array::<2>()?);
        Some(Self { timestamp, connected: flags != [0, 0], voltage: reader.f32()? })
    }

    fn write(&self, out: &mut [u8]) -> usize {
        let mut writer = Writer::new(out);
        writer.u64(self.timestamp);
        writer.u8(u8::from(self.connected));
        writer.f32(self.voltage);
        writer.length().unwrap_or(0)
    }
}

/// The mode and the arming state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VehicleStatus {
    /// Its time, us.
    pub timestamp: u64,
    /// [`ARMED`], or another state.
    pub arming: u8,
    /// [`OFFBOARD`], or another mode.
    pub mode: u8,
}

impl TopicMessage for VehicleStatus {
    const TOPIC: Topic = Topic::VehicleStatus;

    /// The fields after the mode differ between versions and are not read.
    fn read(data: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(data);
        let (timestamp, _armed, _took_off) = (reader.u64()?, reader.u64()?, reader.u64()?);
        let [arming, _, _] = reader.array()?;
        reader.u64()?;
        let [_intended, mode] = reader.array()?;
        Some(Self { timestamp, arming, mode })
    }

    fn write(&self, out: &mut [u8]) -> usize {
        let mut writer = Writer::new(out);
        writer.u64(self.timestamp);
        writer.u64(0);
        writer.u64(0);
        writer.bytes(&[self.arming, 0, 0]);
        writer.u64(0);
        writer.bytes(&[self.mode, self.mode]);
        writer.length().unwrap_or(0)
    }
}

/// Throttles, 0 to 1; NaN stops a motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorMotors {
    /// One for each motor.
    pub control: [f32; MOTORS],
}

impl TopicMessage for ActuatorMotors {
    const TOPIC: Topic = Topic::ActuatorMotors;

    fn read(data: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(data);
        let (_timestamp, _sample, _reversible) = (reader.u64()?, reader.u64()?, reader.u16()?);
        let mut control = [0.0; MOTORS];
        for throttle in &mut control {
            *throttle = reader.f32()?;
        }
        Some(Self { control })
    }

    /// The times are written as 0: PX4 then uses the time of arrival.
    fn write(&self, out: &mut [u8]) -> usize {
        let mut writer = Writer::new(out);
        writer.u64(0);
        writer.u64(0);
        writer.u16(0);
        self.control.into_iter().for_each(|throttle| writer.f32(throttle));
        writer.length().unwrap_or(0)
    }
}

/// Tells PX4 that throttles come from outside. PX4 stays in its offboard mode only while this message arrives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OffboardControlMode {
    /// Whether the commands are throttles, which PX4 sends to the motors without its own control laws.
    pub direct_actuator: bool,
}

impl TopicMessage for OffboardControlMode {
    const TOPIC: Topic = Topic::OffboardControlMode;

    fn read(data: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(data);
        reader.u64()?;
        let flags = reader.array::<7>()?;
        Some(Self { direct_actuator: flags == [0, 0, 0, 0, 0, 0, 1] })
    }

    fn write(&self, out: &mut [u8]) -> usize {
        let mut writer = Writer::new(out);
        writer.u64(0);
        writer.bytes(&[0, 0, 0, 0, 0, 0, u8::from(self.direct_actuator)]);
        writer.length().unwrap_or(0)
    }
}

/// An order to the flight board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VehicleCommand {
    /// Change to the offboard mode.
    Offboard,
    /// Arm: motors may turn.
    Arm,
    /// Stop all motors, also in the air: tilthex decides when that is right.
    Disarm,
    /// Another order, by its number.
    Other(u32),
}

impl VehicleCommand {
    const SET_MODE: u32 = 176;
    const ARM_DISARM: u32 = 400;
    /// Parameters of the order: a custom mode, and the number of the offboard mode.
    const CUSTOM_OFFBOARD: (f32, f32) = (1.0, 6.0);
    /// Parameter with which PX4 obeys without its own checks.
    const FORCED: f32 = 21_196.0;

    fn parts(self) -> (u32, f32, f32) {
        let (custom, offboard) = Self::CUSTOM_OFFBOARD;
        match self {
            Self::Offboard => (Self::SET_MODE, custom, offboard),
            Self::Arm => (Self::ARM_DISARM, 1.0, 0.0),
            Self::Disarm => (Self::ARM_DISARM, 0.0, Self::FORCED),
            Self::Other(command) => (command, 0.0, 0.0),
        }
    }
}

impl TopicMessage for VehicleCommand {
    const TOPIC: Topic = Topic::VehicleCommand;

    fn read(data: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(data);
        reader.u64()?;
        let (first, second) = (reader.f32()?, reader.f32()?);
        let (_third, _fourth, _fifth, _sixth, _seventh) =
            (reader.f32()?, reader.f32()?, reader.f64()?, reader.f64()?, reader.f32()?);
        let found = (reader.u32()?, first, second);
        let known = [Self::Offboard, Self::Arm, Self::Disarm];
        Some(known.into_iter().find(|command| command.parts() == found).unwrap_or(Self::Other(found.0)))
    }

    fn write(&self, out: &mut [u8]) -> usize {
        let (command, first, second) = self.parts();
        let mut writer = Writer::new(out);
        writer.u64(0);
        [first, second, 0.0, 0.0].into_iter().for_each(|x| writer.f32(x));
        writer.f64(0.0);
        writer.f64(0.0);
        writer.f32(0.0);
        writer.u32(command);
        // To system 1, component 1, from the same; without confirmation; from outside.
        writer.bytes(&[1, 1, 1]);
        writer.u16(1);
        writer.bytes(&[0, 1]);
        writer.length().unwrap_or(0)
    }
}
