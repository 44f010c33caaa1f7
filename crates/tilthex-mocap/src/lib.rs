//! Protocols of motion capture. The codecs read untrusted bytes: they never allocate and never panic, and their work is
//! limited by the length of the packet.

#![cfg_attr(not(feature = "net"), no_std)]
#![forbid(unsafe_code)]

mod axis;
mod bytes;
pub mod echo_clock;
pub mod natnet;
#[cfg(feature = "net")]
pub mod net;
pub mod udp;
pub mod vrpn;

pub use axis::UpAxis;

/// Settings of a client.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClientParams {
    /// The axis that points up in the capture system.
    pub up_axis: UpAxis,
    /// Age of a pose when it leaves the capture system, s, if the system does not send it: VRPN, and NatNet cameras
    /// without exposure times.
    pub latency: f64,
}

/// Bytes that do not follow the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed(
    /// The part that does not fit.
    pub &'static str,
);

impl core::fmt::Display for Malformed {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "the packet's {} is malformed", self.0)
    }
}

impl core::error::Error for Malformed {}
