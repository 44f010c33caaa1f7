//! Motion capture on the wire. Both codecs read untrusted bytes: they never
//! allocate, never panic, and do no more work than the packet is long.

mod axis;
mod bytes;
pub mod natnet;
pub mod vrpn;

pub use axis::UpAxis;

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
