//! The serial framing of DDS-XRCE (OMG DDS-XRCE 1.0, annex C): messages to bytes and back. Datagrams have no framing.
//!
//! `0x7e source destination length message crc`: the length and the CRC have 16 bits, low byte first. After the first
//! byte, 0x7e and 0x7d are sent as 0x7d followed by the byte with bit 5 changed. The CRC covers the message alone:
//! polynomial 0x8005, reflected bits, initial value 0.

use crate::{bump, crc::crc_with, outgoing::write_frame};

/// Longest message, bytes.
pub const MAX_MESSAGE: usize = 1280;
/// The agent's address on the line. The agent is tilthex.
pub const AGENT: u8 = 0;
/// The client's address on the line.
pub const CLIENT: u8 = 1;

const BEGIN: u8 = 0x7e;
const ESCAPE: u8 = 0x7d;
const CHANGED: u8 = 0x20;

/// Writes a message as a frame to `destination` and returns its length, bytes. Returns 0 if the frame does not fit or the
/// message is longer than [`MAX_MESSAGE`]; `out` then holds no complete frame. `2 * length + 13` bytes are always enough.
#[must_use = "the length says what to send"]
pub fn encode(source: u8, destination: u8, message: &[u8], out: &mut [u8]) -> usize {
    if message.len() > MAX_MESSAGE {
        return 0;
    }
    write_frame(out, |slots| {
        slots.put(BEGIN)?;
        let mut put = |byte: u8| {
            if byte == BEGIN || byte == ESCAPE {
                slots.put(ESCAPE)?;
                return slots.put(byte ^ CHANGED);
            }
            slots.put(byte)
        };
        put(source)?;
        put(destination)?;
        let mut crc = 0;
        (message.len() as u16).to_le_bytes().into_iter().try_for_each(&mut put)?;
        for &byte in message {
            crc = crc_with(crc, byte);
            put(byte)?;
        }
        crc.to_le_bytes().into_iter().try_for_each(&mut put)
    })
}

/// Frames that the decoder accepted and refused. The counts saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounters {
    /// Complete messages for this address.
    pub whole: u32,
    /// Frames that ended early because the next one began.
    pub cut: u32,
    /// Frames with a wrong CRC.
    pub wrong_crc: u32,
    /// Frames that announce more than [`MAX_MESSAGE`] bytes.
    pub overlong: u32,
    /// Frames for another address.
    pub elsewhere: u32,
    /// Bytes outside of any frame.
    pub stray_bytes: u32,
}

impl FrameCounters {
    /// Frames that were refused.
    #[must_use]
    pub fn refused(&self) -> u32 {
        [self.cut, self.wrong_crc, self.overlong].into_iter().fold(0, u32::saturating_add)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Outside,
    Source,
    Destination,
    LengthLow,
    LengthHigh,
    Message,
    CrcLow,
    CrcHigh,
}

/// Finds messages in a stream of bytes, one byte at a time.
#[derive(Clone, Debug)]
pub struct Decoder {
    address: u8,
    state: State,
    escaped: bool,
    bytes: [u8; MAX_MESSAGE],
    count: usize,
    length: usize,
    crc: u16,
    crc_low: u8,
    counters: FrameCounters,
}

impl Decoder {
    /// A decoder that accepts the frames for one address.
    #[must_use]
    pub fn new(address: u8) -> Self {
        Self {
            address,
            state: State::Outside,
            escaped: false,
            bytes: [0; MAX_MESSAGE],
            count: 0,
            length: 0,
            crc: 0,
            crc_low: 0,
            counters: FrameCounters::default(),
        }
    }

    /// Takes the next byte, and returns the message if the byte completes one.
    pub fn push(&mut self, byte: u8) -> Option<&[u8]> {
        if byte == BEGIN {
            if self.state != State::Outside {
                bump(&mut self.counters.cut);
            }
            (self.state, self.escaped) = (State::Source, false);
            return None;
        }
        if self.state == State::Outside {
            bump(&mut self.counters.stray_bytes);
            return None;
        }
        if byte == ESCAPE && !self.escaped {
            self.escaped = true;
            return None;
        }
        let byte = if core::mem::take(&mut self.escaped) { byte ^ CHANGED } else { byte };
        if self.advance(byte) { self.bytes.get(..self.length) } else { None }
    }

    /// Takes a byte of a frame. Returns whether it completes a message.
    fn advance(&mut self, byte: u8) -> bool {
        self.state = match self.state {
            State::Outside => State::Outside,
            State::Source => State::Destination,
            State::Destination if byte == self.address => State::LengthLow,
            State::Destination => {
                bump(&mut self.counters.elsewhere);
                State::Outside
            }
            State::LengthLow => {
                self.length = usize::from(byte);
                State::LengthHigh
            }
            State::LengthHigh => {
                self.length |= usize::from(byte) << 8;
                (self.count, self.crc) = (0, 0);
                if self.length > MAX_MESSAGE {
                    bump(&mut self.counters.overlong);
                    State::Outside
                } else if self.length == 0 {
                    State::CrcLow
                } else {
                    State::Message
                }
            }
            State::Message => {
                if let Some(slot) = self.bytes.get_mut(self.count) {
                    *slot = byte;
                }
                self.crc = crc_with(self.crc, byte);
                self.count += 1;
                if self.count < self.length { State::Message } else { State::CrcLow }
            }
            State::CrcLow => {
                self.crc_low = byte;
                State::CrcHigh
            }
            State::CrcHigh => {
                self.state = State::Outside;
                let right = u16::from_le_bytes([self.crc_low, byte]) == self.crc;
                bump(if right { &mut self.counters.whole } else { &mut self.counters.wrong_crc });
                return right;
            }
        };
        false
    }

    /// What was accepted and refused since the start.
    #[must_use]
    pub fn counters(&self) -> FrameCounters {
        self.counters
    }
}
