//! A toy: a text protocol. A message is a line of a letter, whole numbers and a checksum, for example `g 3*ba`.
//!
//! | from the host | numbers |
//! |---|---|
//! | `v` | none: asks for the version |
//! | `r` | periods of the inertial, motor and battery streams, us |
//! | `w` | speeds of all motors, mHz |
//! | `g`, `x` | a motor, from 0, that shall start, or stop |
//! | `k` | none: every motor shall stop |
//!
//! | from the vehicle | numbers |
//! |---|---|
//! | `v` | version |
//! | `i` | number of the sample (0 to 255), angular velocity, 1e-4 rad/s, specific force, mm/s^2 |
//! | `m` | motor, from 0, state (0 stands, 1 starts, 2 spins), speed, mHz, current, mA |
//! | `b` | voltage, mV |

#[cfg(feature = "board")]
pub mod board;
mod host;
mod line;

pub use host::Host;
pub use line::{Line, MAX_LINE, MAX_NUMBERS, Reader};

/// The version of the protocol.
pub const VERSION: i32 = 1;
