//! The real-time part of tilthex: the 500 Hz loop on the base PC, the simulated vehicle behind a pseudo-terminal, the
//! recorder, and the programs.
//!
//! The loop's thread never allocates, locks, logs or waits on anything but the clock. All other work is done in other
//! threads, which wait-free rings connect with the loop.

pub mod app;
pub mod carrier;
mod completion;
pub mod console;
pub mod control;
pub mod control_loop;
mod datagrams;
pub mod doctor;
pub mod failure;
pub mod flags;
pub mod histogram;
mod keys;
pub mod log;
mod output;
pub mod phase_lock;
pub mod port;
mod ports;
pub mod realtime;
pub mod recorder;
pub mod reference;
pub mod replay;
mod signals;
pub mod sim;
pub mod sim_app;
pub mod sleeper;
pub mod summary;
mod sys;
pub mod vehicle_uri;
pub mod waiting;

pub use failure::{Failure, Kind};
