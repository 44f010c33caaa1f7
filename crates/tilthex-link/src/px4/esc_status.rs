//! The measurements of PX4's motor controllers: `px4_msgs::msg::EscStatus` of PX4 1.15 and 1.16.

use super::{
    cdr::{Reader, Writer},
    topics::{Topic, TopicMessage},
};

/// Number of motor controllers in [`EscStatus`].
pub const ESCS: usize = 8;
/// PX4's number of the output function "motor 1". Motor `n` has the number `FIRST_MOTOR + n - 1`.
pub const FIRST_MOTOR: u8 = 101;
/// The failure bit of a controller that cannot turn its motor.
pub const STUCK: u16 = 1 << 5;

/// The measurements of one motor controller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EscReport {
    /// Its time, us.
    pub timestamp: u64,
    /// Speed, revolutions per minute, negative in reverse.
    pub rpm: i32,
    /// Voltage, V.
    pub voltage: f32,
    /// Current, A.
    pub current: f32,
    /// The output function of its motor, counted from [`FIRST_MOTOR`]; 0 if the controller does not report it.
    pub function: u8,
    /// Failures, one bit for each kind.
    pub failures: u16,
}

/// The measurements of all motor controllers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EscStatus {
    /// Its time, us.
    pub timestamp: u64,
    /// Number of controllers.
    pub count: u8,
    /// Bit `i` is set if controller `i` answers.
    pub online: u8,
    /// The controllers.
    pub escs: [EscReport; ESCS],
}

impl EscStatus {
    /// The length of its data, bytes. Later versions of PX4 use another length.
    pub const LENGTH: usize = 331;
}

impl TopicMessage for EscStatus {
    const TOPIC: Topic = Topic::EscStatus;

    fn read(data: &[u8]) -> Option<Self> {
        // Some writers pad the data to a multiple of eight bytes.
        if !(Self::LENGTH..=Self::LENGTH.next_multiple_of(8)).contains(&data.len()) {
            return None;
        }
        let mut reader = Reader::new(data);
        let timestamp = reader.u64()?;
        let (_counter, count, _connection) = (reader.u16()?, reader.u8()?, reader.u8()?);
        let (online, _armed) = (reader.u8()?, reader.u8()?);
        let mut escs = [EscReport::default(); ESCS];
        for esc in &mut escs {
            esc.timestamp = reader.u64()?;
            reader.u32()?;
            (esc.rpm, esc.voltage, esc.current) = (reader.i32()?, reader.f32()?, reader.f32()?);
            reader.f32()?;
            reader.array::<3>()?;
            (esc.function, esc.failures) = (reader.u8()?, reader.u16()?);
            reader.u8()?;
        }
        Some(Self { timestamp, count, online, escs })
    }

    fn write(&self, out: &mut [u8]) -> usize {
        let mut writer = Writer::new(out);
        writer.u64(self.timestamp);
        writer.u16(0);
        writer.bytes(&[self.count, 5, self.online, self.online]);
        for (address, esc) in (1..).zip(&self.escs) {
            writer.u64(esc.timestamp);
            writer.u32(0);
            writer.i32(esc.rpm);
            writer.f32(esc.voltage);
            writer.f32(esc.current);
            writer.f32(25.0);
            writer.bytes(&[address, 0, 0, esc.function]);
            writer.u16(esc.failures);
            writer.bytes(&[0]);
        }
        writer.length().unwrap_or(0)
    }
}
