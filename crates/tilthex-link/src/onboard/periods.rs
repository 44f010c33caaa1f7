//! The periods of the streams, as the vehicle tells them.

use core::fmt;

use super::body::{Reader, Writer};
use crate::tk3::{Frame, Refusal};

/// The periods of the vehicle's streams, us; 0 for a stream that is off. The messages that set them have no checksum, this
/// one has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Periods {
    /// The battery.
    pub battery: u32,
    /// The motors.
    pub motors: u32,
    /// The IMU.
    pub imu: u32,
    /// The records.
    pub records: u32,
}

impl fmt::Display for Periods {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { battery, motors, imu, records } = self;
        write!(f, "battery {battery} us, motors {motors} us, IMU {imu} us, records {records} us (0 for none)")
    }
}

impl Periods {
    pub(super) fn frame(&self) -> Frame {
        [self.battery, self.motors, self.imu, self.records]
            .iter()
            .fold(Writer::new(b'P'), |to, period| to.bytes(&period.to_be_bytes()))
            .finish()
    }

    pub(super) fn parse(body: &[u8]) -> Result<Self, Refusal> {
        let mut from = Reader::new(body)?;
        let (battery, motors, imu, records) = (from.u32()?, from.u32()?, from.u32()?, from.u32()?);
        from.end(Self { battery, motors, imu, records })
    }
}
