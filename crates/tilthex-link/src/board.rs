//! What the simulated flight boards have in common.

use alloc::vec::Vec;
use tilthex_core::{RotorVector, plant::ImuSample};

/// Microseconds since the board was powered.
pub type Micros = u64;

/// What the board's sensors see when a stream is due.
#[derive(Clone, Copy, Debug)]
pub struct Measurements {
    /// The IMU.
    pub imu: ImuSample,
    /// Rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
}

/// The board's end of a link, for a simulated vehicle. It runs on the time that it is told.
pub trait Board {
    /// Takes bytes from the host; answers go to `out`.
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

    /// Speeds that the motors drive their rotors to, Hz.
    fn commands(&self) -> RotorVector;

    /// When the first of the motors that then all spun was ordered to start.
    fn first_start(&self) -> Option<Micros>;

    /// How many commands to all motors have come.
    fn commands_received(&self) -> u64;

    /// How many inertial samples were written.
    fn samples_sent(&self) -> u64;
}
