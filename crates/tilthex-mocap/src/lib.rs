//! Motion capture on the wire. Both codecs read untrusted bytes: they never
//! allocate, never panic, and do no more work than the packet is long.

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

/// How poses are read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClientParams {
    /// The axis that points up in what the capture system sends.
    pub up_axis: UpAxis,
    /// Age of a pose when it leaves the system, s, where the system does not
    /// tell: VRPN, and NatNet cameras without exposure times.
    pub latency: f64,
}

/// Bytes that are not what the protocol says.
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
