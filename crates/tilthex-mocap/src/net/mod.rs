//! Motion capture over the network: clients, which give poses to the loop, and servers, which send the poses of a simulated
//! vehicle.
//!
//! Each of them runs in its own thread. A wait-free ring connects it with the loop.

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

/// Converts a time of the monotonic clock to seconds, the unit of the core.
fn seconds(time: Nanos) -> f64 {
    time as f64 * 1e-9
}

/// The present time of the monotonic clock, s.
fn now() -> f64 {
    seconds(Monotonic.now())
}
