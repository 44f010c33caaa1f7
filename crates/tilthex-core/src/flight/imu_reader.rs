//! Inertial samples out of a recorded link, as the flight took them.

use super::{
    imu_stream::Inertial,
    session::{Session, SessionParams},
};
use crate::Error;

/// Decodes what the vehicle sent: clock recovery and gates included, nothing sent back.
#[derive(Clone, Debug)]
pub struct ImuReader(Session);

impl ImuReader {
    /// Before the first byte.
    ///
    /// # Errors
    /// A stream period that can not be.
    pub fn new(params: SessionParams, rotor_count: usize) -> Result<Self, Error> {
        Session::new(params, rotor_count).map(Self)
    }

    /// The samples in the bytes that came in one tick, at `now` (s).
    pub fn read(&mut self, bytes: &[u8], now: f64) -> &[Inertial] {
        self.0.receive(bytes, now);
        self.0.imu().samples()
    }
}
