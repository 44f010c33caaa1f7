//! The whole tick, bytes in and bytes out: link, estimator, supervisor,
//! guidance, controller, command.
//!
//! It depends on nothing but its inputs: the real-time loop, the fault campaign
//! on virtual time and the replay of a log run this same code and get the same
//! result to the bit.

mod io;
mod record;

pub use io::{Command, HostFacts, MAX_BYTES_IN, MAX_BYTES_OUT, MAX_POSES, Route, TickInput, TickOutput};
pub use record::{LinkCounters, RawInput, Record};
