//! The links between a flight and its vehicle.
//!
//! A link turns the bytes that a vehicle sends into [`Telemetry`], and what the
//! flight commands into bytes. It holds everything between the two: the codec,
//! the clock of each numbered stream, the gates on its samples, and the
//! conversation with the vehicle's board. The flight knows none of it.
//!
//! Each link has one folder; [`tk3`] is the first. `docs/howto/link.md` says how a
//! link is added: a folder, and its line in the `registry` module.
//!
//! `no_std`, no allocation, no unsafe. The feature `board` adds the other end of each link, for simulated vehicles, which allocates.
#![no_std]
#![forbid(unsafe_code)]

mod awaited;
mod gate;
mod line_delay;
mod linked;
mod outgoing;
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
pub use registry::{Link, LinkKind};
pub use sequence::{Arrival, SequenceClock, SequenceCounters};
pub use text::{Severity, Text};
pub use wire::{MAX_BYTES_IN, Wire};

use tilthex_core::flight::{MotorCommand, Telemetry};

/// Parameters of a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkParams {
    /// Period of the inertial stream, us.
    pub imu_period_us: u32,
    /// Period of the motor stream, us.
    pub motor_period_us: u32,
    /// Period of the battery stream, us.
    pub battery_period_us: u32,
    /// Units of the IMU's counts; `None` uses the units that are known for the board.
    pub scales: Option<tk3::ImuScales>,
}

/// Lengths of a link's frames on the line, bytes. They say how much of a serial line the streams use.
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
/// Each tick of the loop calls [`look`](Self::look) for bytes as they come, then
/// [`receive`](Self::receive) for all of them, then [`command`](Self::command).
/// None of them waits, allocates or panics.
pub trait VehicleLink {
    /// Looks at bytes of this tick that have just arrived, in their
    /// order, before [`receive`](Self::receive) takes them. Says whether an inertial
    /// sample is due, and whether it has arrived. The loop looks at the port
    /// again while a sample is due that has not arrived.
    fn look(&mut self, bytes: &[u8]) -> InertialDue;

    /// Takes all bytes of a tick at `now` (s, the host's monotonic clock). What
    /// it returns depends on these bytes and times alone, so that a recorded
    /// flight can be repeated bit for bit.
    fn receive(&mut self, bytes: &[u8], now: f64) -> &Telemetry;

    /// The telemetry that the last [`receive`](Self::receive) returned.
    fn telemetry(&self) -> &Telemetry;

    /// A text that came with the last [`receive`](Self::receive).
    fn text(&self) -> Option<(Severity, Text)>;

    /// Writes a command for the motors, and every other message that the protocol needs at `now` (s).
    fn command(&mut self, command: &MotorCommand, now: f64, out: &mut Outgoing);

    /// Lengths of its frames on the line, bytes.
    fn frames(&self) -> FrameLengths;

    /// Whether the link has given up: no vehicle that it knows has answered.
    fn refused(&self) -> bool;

    /// Writes the messages that end the conversation: the streams stop. It neither stops nor starts motors.
    fn part(&mut self, out: &mut Outgoing);
}

#[cfg(feature = "board")]
extern crate alloc;
#[cfg(test)]
extern crate std;

/// Counts one more; saturates.
fn bump(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}
