//! The links between a flight and its vehicle.
//!
//! A link turns the bytes that a vehicle sends into [`Telemetry`], and the commands of the flight into bytes. It
//! holds everything between the two: the codec, the clock of each numbered stream, the gates on its samples, and the
//! conversation with the vehicle's board. The flight knows nothing of these.
//!
//! Each link has one folder. `docs/howto/link.md` says how to add a link: a folder, and one line in the `registry`
//! module.
//!
//! `no_std`, no allocation, no unsafe. The feature `board` adds the vehicle's end of each link, for simulated
//! vehicles; it allocates.
#![no_std]
#![forbid(unsafe_code)]

mod awaited;
#[cfg(feature = "board")]
pub mod board;
mod crc;
mod gate;
mod line_delay;
mod linked;
pub mod onboard;
mod outgoing;
pub mod px4;
mod registry;
mod sequence;
mod text;
pub mod tk3;
mod wire;

pub use awaited::{Awaited, InertialDue};
pub use gate::{Gate, GateCounters, GateParams, Verdict};
pub use line_delay::LineDelay;
pub use linked::{LinkedFlight, LinkedOutput, LinkedParams, WireInput};
pub use outgoing::{MAX_BYTES_OUT, Outgoing};
pub use registry::{Complaint, Link, LinkKind};
pub use sequence::{Arrival, SequenceClock, SequenceCounters};
pub use text::{Severity, Text};
pub use wire::{MAX_BYTES_IN, Wire};

#[cfg(doc)]
use core::convert::Infallible;
use core::fmt;
use tilthex_core::flight::{MotorCommand, Telemetry};

/// A time before every other time, s.
const LONG_AGO: f64 = -1e9;

/// Parameters of a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkParams {
    /// Period of the inertial stream, us.
    pub imu_period_us: u32,
    /// Period of the motor stream, us.
    pub motor_period_us: u32,
    /// Period of the battery stream, us.
    pub battery_period_us: u32,
    /// Units of the IMU's counts; `None` uses the known units of the board.
    pub scales: Option<tk3::ImuScales>,
    /// Throttles for speeds, if the vehicle takes throttles.
    pub throttle: px4::ThrottleMap,
}

/// Lengths of a link's frames on the line, bytes. They show how much of the capacity of a serial line the streams
/// use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameLengths {
    /// An inertial sample.
    pub inertial: u16,
    /// One motor's sample.
    pub motor: u16,
    /// A battery's sample.
    pub battery: u16,
    /// A command to all motors.
    pub command: u16,
}

/// The host's end of a link to a vehicle.
///
/// Each tick of the loop first calls [`look`](Self::look) with bytes as they arrive, then [`receive`](Self::receive)
/// with all of them, then [`command`](Self::command). None of these waits, allocates or panics.
pub trait VehicleLink {
    /// Why this link is not ready, as a sentence for the operator; [`Infallible`] for a link without such sentences.
    type Complaint: Copy + fmt::Debug + fmt::Display + PartialEq;

    /// Looks at bytes of this tick that have just arrived, in their order, before [`receive`](Self::receive) takes
    /// them. Returns whether an inertial sample is expected, and whether it has arrived. The loop looks at the port
    /// again while an expected sample has not arrived.
    fn look(&mut self, bytes: &[u8]) -> InertialDue;

    /// Takes all bytes of a tick at `now` (s, the host's monotonic clock). The return value depends only on these
    /// bytes and times, so that a recorded flight can be repeated bit for bit.
    fn receive(&mut self, bytes: &[u8], now: f64) -> &Telemetry;

    /// The telemetry that the last [`receive`](Self::receive) returned.
    fn telemetry(&self) -> &Telemetry;

    /// A text that came with the last [`receive`](Self::receive).
    fn text(&self) -> Option<(Severity, Text)>;

    /// Writes a command to the motors, and every other message that the protocol needs at `now` (s).
    fn command(&mut self, command: &MotorCommand, now: f64, out: &mut Outgoing);

    /// Lengths of the link's frames on the line, bytes.
    fn frames(&self) -> FrameLengths;

    /// Whether the link has given up: no vehicle that it knows has answered.
    fn refused(&self) -> bool;

    /// Writes the messages that end the conversation: the streams stop. It neither stops nor starts motors.
    fn part(&mut self, out: &mut Outgoing);

    /// Why the link to a vehicle that has answered is not ready, if the link knows it.
    fn complaint(&self) -> Option<Self::Complaint> {
        None
    }
}

#[cfg(feature = "board")]
extern crate alloc;
#[cfg(test)]
extern crate std;

/// Adds one to a counter; the counter saturates.
fn bump(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}
