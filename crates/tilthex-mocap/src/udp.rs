//! Poses in UDP packets, for a source that speaks neither NatNet nor VRPN.
//!
//! A packet has 80 bytes, little-endian, followed by the body's name in UTF-8 (1 to 64 bytes):
//!
//! | offset | type | |
//! |---|---|---|
//! | 0 | 8 bytes | `tilthex1` |
//! | 8 | u32 | number of the packet, which grows by one |
//! | 12 | u32 | bit 0 is set if the body is tracked |
//! | 16 | f64 | time at which the pose was taken, s, on any clock that does not jump |
//! | 24 | 3 x f64 | position, m; any value if the body is not tracked |
//! | 48 | 4 x f64 | orientation, unit quaternion (within 1 %), scalar last; any value if the body is not tracked |

use crate::{Malformed, bytes::Reader};

/// The port on which packets are received if the address names none.
pub const PORT: u16 = 7411;
/// Longest packet, bytes.
pub const MAX_LENGTH: usize = HEAD + MAX_NAME;
const MAGIC: [u8; 8] = *b"tilthex1";
const HEAD: usize = 80;
const MAX_NAME: usize = 64;
const SEEN: u32 = 1;

/// One pose of one body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePacket<'a> {
    /// Grows by one with each packet; wraps around.
    pub number: u32,
    /// Whether the body is tracked.
    pub tracking_valid: bool,
    /// Time at which the pose was taken, s, on the sender's clock.
    pub time: f64,
    /// Position, m.
    pub position: [f64; 3],
    /// Orientation, scalar last.
    pub quaternion_xyzw: [f64; 4],
    /// The body's name, UTF-8.
    pub body: &'a [u8],
}

impl<'a> PosePacket<'a> {
    /// Reads a packet.
    ///
    /// # Errors
    /// The part that does not have the form above.
    pub fn parse(packet: &'a [u8]) -> Result<Self, Malformed> {
        let mut reader = Reader::new(packet);
        if reader.array() != Some(MAGIC) {
            return Err(Malformed("mark"));
        }
        let number = reader.u32().ok_or(Malformed("number"))?;
        let flags = reader.u32().ok_or(Malformed("flags"))?;
        let mut numbers = [0.0; 8];
        for number in &mut numbers {
            *number = reader.f64().ok_or(Malformed("size"))?;
        }
        let [time, x, y, z, qx, qy, qz, qw] = numbers;
        let seen = flags & SEEN != 0;
        // A body that is not tracked has no pose; its numbers have no meaning.
        if !time.is_finite() || (seen && numbers.iter().any(|number| !number.is_finite())) {
            return Err(Malformed("time or pose (a number that is not finite)"));
        }
        let body = reader.rest();
        if body.is_empty() || body.len() > MAX_NAME {
            return Err(Malformed("name"));
        }
        Ok(Self {
            number,
            tracking_valid: seen,
            time,
            position: [x, y, z],
            quaternion_xyzw: [qx, qy, qz, qw],
            body,
        })
    }

    /// Writes the packet and returns its length, bytes. A name longer than 64 bytes is cut.
    pub fn encode(&self, packet: &mut [u8; MAX_LENGTH]) -> usize {
        let [x, y, z] = self.position;
        let [qx, qy, qz, qw] = self.quaternion_xyzw;
        let words = MAGIC
            .into_iter()
            .chain(self.number.to_le_bytes())
            .chain(u32::from(self.tracking_valid).to_le_bytes())
            .chain([self.time, x, y, z, qx, qy, qz, qw].into_iter().flat_map(f64::to_le_bytes))
            .chain(self.body.iter().take(MAX_NAME).copied());
        packet.iter_mut().zip(words).map(|(to, from)| *to = from).count()
    }
}
