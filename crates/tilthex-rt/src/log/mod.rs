//! The flight log: MCAP files that common viewers read, written by a thread
//! of its own.

pub mod messages;
mod writer;

pub use writer::{LogWriter, Stamp, Topic};
