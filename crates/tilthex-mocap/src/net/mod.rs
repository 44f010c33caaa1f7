//! Motion capture over the network: the client that gives the loop its poses,
//! and the servers with which a simulated vehicle shows its own.
//!
//! Each runs in a thread of its own. Between it and the loop is a wait-free ring.

mod client;
mod clock;
mod counters;
mod delivery;
mod error;
mod natnet_client;
mod natnet_line;
mod natnet_server;
mod source;
mod udp_client;
mod uri;
mod vrpn_client;
mod vrpn_server;

pub use client::Client;
pub use clock::{Clock, Monotonic};
pub use counters::Status;
pub use delivery::{LineParams, Publication};
pub use error::SourceError;
pub use natnet_server::{NatNetServer, NatNetServerParams};
pub use source::Protocol;
pub use uri::MocapUri;
pub use vrpn_server::{VrpnServer, VrpnServerParams};

use tilthex_core::types::Nanos;

/// A time of the monotonic clock in seconds, as the core counts.
fn seconds(time: Nanos) -> f64 {
    time as f64 * 1e-9
}

/// The monotonic clock's time now, s.
fn now() -> f64 {
    seconds(Monotonic.now())
}
