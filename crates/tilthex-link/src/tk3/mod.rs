//! tk3, the serial protocol of the Telekyb3 family of vehicles, in both directions: the host reads [`VehicleMessage`]s and
//! writes [`HostMessage`]s; a vehicle (or its simulator) reads [`HostMessage`]s and writes [`VehicleMessage`]s.
//!
//! A frame is `^ body $`. The body starts with the message's letter. There is neither a length nor a checksum, so that a
//! flipped bit inside a frame is not noticed. Every sample must therefore pass a [`crate::Gate`] before it is used.

#[cfg(feature = "board")]
pub mod board;
mod frame;
mod host;
mod host_message;
mod identity;
mod imu_stream;
mod receiver;
mod scales;
mod scan;
mod schedule;
mod speed;
mod vehicle_message;

pub use frame::{Decoder, Frame, FrameCounters, MAX_BODY, MAX_FRAME};
pub use host::Host;
pub use host_message::{HostMessage, MAX_THROTTLE, MotorValues, Stream};
pub use identity::{Board, Identity};
pub use receiver::{Counters, Message, Receiver, Refusal};
pub use scales::ImuScales;
pub use schedule::Schedule;
pub use speed::{LOWEST_SPEED, half_period, nearest_half_period, speed};
pub use vehicle_message::{ImuFrame, MotorFrame, MotorState, VehicleMessage};
