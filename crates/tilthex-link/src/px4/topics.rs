//! The few topics of PX4 that the link uses, as `px4_msgs` 1.14 to 1.16 define them, in CDR. Angles in rad, speeds in
//! revolutions a minute where the name says so, vectors in FRD (forward, right, down).

use super::cdr::{Reader, Writer};

/// Motors of [`ActuatorMotors`].
pub const MOTORS: usize = 12;
/// The state of a vehicle whose motors may turn.
pub const ARMED: u8 = 2;
/// The mode in which PX4 takes motor commands from outside.
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

            /// Its name, as `dds_topics.yaml` has it.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$topic => $name,)+
                }
            }

            /// The type of its messages, likewise.
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
    /// What the motor controllers measure.
    EscStatus => "/fmu/out/esc_status", "EscStatus";
    /// The battery.
    BatteryStatus => "/fmu/out/battery_status", "BatteryStatus";
    /// Mode, and whether motors may turn.
    VehicleStatus => "/fmu/out/vehicle_status", "VehicleStatus";
    /// Throttles.
    ActuatorMotors => "/fmu/in/actuator_motors", "ActuatorMotors";
    /// That throttles come from outside.
    OffboardControlMode => "/fmu/in/offboard_control_mode", "OffboardControlMode";
    /// Changes of the mode; arming.
    VehicleCommand => "/fmu/in/vehicle_command", "VehicleCommand";
}

impl Topic {
    /// How many there are.
    pub const COUNT: usize = Self::ALL.len();

    /// Whether PX4 takes it; otherwise PX4 sends it.
    #[must_use]
    pub const fn is_taken(self) -> bool {
        matches!(self, Self::ActuatorMotors | Self::OffboardControlMode | Self::VehicleCommand)
    }

    /// The topic with a name in DDS: `rt`, perhaps a name of the vehicle, its own name, and perhaps `_v` and the version
    /// of its messages.
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

    /// Reads it; `None` for data that is none.
    fn read(data: &[u8]) -> Option<Self>;

    /// Writes it and returns its length, bytes; 0 if it does not fit.
    fn write(&self, out: &mut [u8]) -> usize;
}

fn three(reader: &mut Reader<'_>) -> Option<[f32; 3]> {
    Some([reader.f32()?, reader.f32()?, reader.f32()?])
}

/// An inertial sample: means over the periods before its time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorCombined {
    /// Its time, us.
    pub timestamp: u64,
    /// Angular velocity, rad/s, FRD.
    pub gyro: [f32; 3],
    /// Specific force, m/s^2, FRD.
    pub accelerometer: [f32; 3],
    /// Whether a reading of the two was at the end of its range.
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

/// The battery.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BatteryStatus {
    /// Its time, us.
    pub timestamp: u64,
    /// Whether there is one.
    pub connected: bool,
    /// Voltage, V; 0 where it is not known.
    pub voltage: f32,
}

impl TopicMessage for BatteryStatus {
    const TOPIC: Topic = Topic::BatteryStatus;

    /// Before the voltage, later versions have a byte for the number of the battery. Its place is the same: the voltage is
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

/// Mode, and whether motors may turn.
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

    /// What follows the mode differs from version to version, and is not read.
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

    /// Its times are 0: then PX4 takes those of its arrival.
    fn write(&self, out: &mut [u8]) -> usize {
        let mut writer = Writer::new(out);
        writer.u64(0);
        writer.u64(0);
        writer.u16(0);
        self.control.into_iter().for_each(|throttle| writer.f32(throttle));
        writer.length().unwrap_or(0)
    }
}

/// That throttles come from outside: PX4's offboard mode lasts while this comes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OffboardControlMode {
    /// Whether they are throttles, and nothing of PX4's control laws stands between.
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
    /// Take the offboard mode.
    Offboard,
    /// Let motors turn.
    Arm,
    /// Stop all motors, in the air too: when to stop them is tilthex's decision.
    Disarm,
    /// Another one, by its number.
    Other(u32),
}

impl VehicleCommand {
    const SET_MODE: u32 = 176;
    const ARM_DISARM: u32 = 400;
    /// Of the mode: custom, offboard.
    const CUSTOM_OFFBOARD: (f32, f32) = (1.0, 6.0);
    /// Whatever PX4 thinks of it.
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
        // To system 1, component 1, from the same; not confirmed; from outside.
        writer.bytes(&[1, 1, 1]);
        writer.u16(1);
        writer.bytes(&[0, 1]);
        writer.length().unwrap_or(0)
    }
}
