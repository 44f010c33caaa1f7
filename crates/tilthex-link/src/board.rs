//! What the simulated flight boards have in common.

use alloc::vec::Vec;
use tilthex_core::{
    RotorVector,
    plant::{Battery, ImuSample},
};

use crate::LinkParams;
pub use crate::registry::LinkBoard;

/// Microseconds since the board was powered.
pub type Micros = u64;

/// What a registered board is made from. `new` of a board takes this, or parameters of its own that are
/// `From<BoardParams>`.
#[derive(Clone, Copy, Debug)]
pub struct BoardParams {
    /// Its battery at the start.
    pub battery: Battery,
    /// The parameters of the host's end: the throttles of its motors, the periods of its streams.
    pub link: LinkParams,
}

/// What the board's sensors measure when a stream is due.
#[derive(Clone, Copy, Debug)]
pub struct Measurements {
    /// The IMU.
    pub imu: ImuSample,
    /// Rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
}

/// What a board records of its conversation with the host.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Noted {
    /// Time of the first order to start a motor, in the start in which all motors then spun.
    pub first_start: Option<Micros>,
    /// Number of commands to all motors that were received.
    pub commands_received: u64,
    /// Number of inertial samples that were written.
    pub samples_sent: u64,
}

/// The board's end of a link, for a simulated vehicle. Every call gives it the time.
pub trait Board {
    /// Takes bytes from the host. Appends answers to `out`.
    fn receive(&mut self, bytes: &[u8], now: Micros, out: &mut Vec<u8>);

    /// Lets `dt` seconds pass up to `now`. Samples that are due are measured by `measure` and written to `out`.
    fn advance(
        &mut self,
        now: Micros,
        dt: f64,
        true_speeds: &RotorVector,
        measure: impl FnOnce() -> Measurements,
        out: &mut Vec<u8>,
    );

    /// Speeds to which the motors drive their rotors, Hz.
    fn commands(&self) -> RotorVector;

    /// What it has recorded of the conversation since the start.
    fn noted(&self) -> Noted;
}
