//! Messages from the base to the vehicle.

use super::{
    body::{FAR, Reader, Writer},
    clock::micros,
    order::Order,
};
use crate::tk3::{Frame, HostMessage, Message, Refusal};
use tilthex_core::{Matrix3, PoseSample, Vector3};

/// A captured pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseMessage {
    /// Number of the pose; wraps.
    pub number: u8,
    /// Whether the capture system tracks the body.
    pub tracking_valid: bool,
    /// When the message was sent, us, on the base's clock; wraps.
    pub sent: u32,
    /// How long before that the pose was taken, us.
    pub age: u32,
    /// Position of the body, m, world.
    pub position_w: Vector3,
    /// Its rotation: maps its coordinates to world coordinates.
    pub rotation_wr: Matrix3,
}

impl PoseMessage {
    /// The message of a pose that is sent at `now`, s.
    #[must_use]
    pub fn new(number: u8, pose: &PoseSample, now: f64) -> Self {
        Self {
            number,
            tracking_valid: pose.tracking_valid,
            sent: micros(now),
            // The cast saturates.
            age: ((now - pose.time) * 1e6) as u32,
            position_w: pose.position_w,
            rotation_wr: pose.rotation_wr,
        }
    }
}

/// A message from the base to the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ToVehicle {
    /// A message of tk3.
    Tk3(HostMessage),
    /// A captured pose.
    Pose(PoseMessage),
    /// An order and its number; wraps.
    Order(u8, Order),
    /// The base is there; its operator was last heard this long ago, ms.
    Heartbeat(u16),
    /// Set the period of the records, us; 0 turns them off.
    Records(u32),
}

impl ToVehicle {
    /// The message's frame.
    #[must_use]
    pub fn frame(&self) -> Frame {
        match self {
            Self::Tk3(message) => message.frame(),
            Self::Pose(pose) => Writer::new(b'p')
                .bytes(&[pose.number, pose.tracking_valid.into()])
                .bytes(&pose.sent.to_be_bytes())
                .bytes(&pose.age.to_be_bytes())
                .floats(&pose.position_w)
                .rotation(&pose.rotation_wr)
                .finish(),
            Self::Order(number, order) => order.write(Writer::new(b'o').bytes(&[*number])).finish(),
            Self::Heartbeat(silence) => Writer::new(b'h').bytes(&silence.to_be_bytes()).finish(),
            Self::Records(period) => Writer::new(b'r').bytes(&period.to_be_bytes()).finish(),
        }
    }

    /// Writes the message, see [`Frame::encode`].
    #[must_use = "the length says what to send"]
    pub fn encode(&self, out: &mut [u8]) -> usize {
        self.frame().encode(out)
    }
}

impl Message for ToVehicle {
    fn parse(body: &[u8]) -> Result<Self, Refusal> {
        match body.first() {
            Some(b'p') => {
                let mut from = Reader::new(body)?;
                let number = from.u8()?;
                let flag = from.u8()?;
                let pose = PoseMessage {
                    number,
                    tracking_valid: flag == 1,
                    sent: from.u32()?,
                    age: from.u32()?,
                    position_w: from.vector(FAR)?,
                    rotation_wr: from.rotation()?,
                };
                if flag > 1 {
                    return Err(from.out_of_range());
                }
                from.end(Self::Pose(pose))
            }
            Some(b'o') => {
                let mut from = Reader::new(body)?;
                let number = from.u8()?;
                let order = Order::read(&mut from)?;
                from.end(Self::Order(number, order))
            }
            Some(b'h') => {
                let mut from = Reader::new(body)?;
                let silence = from.u16()?;
                from.end(Self::Heartbeat(silence))
            }
            Some(b'r') => {
                let mut from = Reader::new(body)?;
                let period = from.u32()?;
                from.end(Self::Records(period))
            }
            _ => HostMessage::parse(body).map(Self::Tk3),
        }
    }
}
