//! Framing: bytes to bodies and back.

use crate::{bump, outgoing::write_frame};

/// Longest body, bytes, the message's letter included.
pub const MAX_BODY: usize = 64;
/// Longest frame on the wire, bytes: every byte of the body escaped, and the two marks.
pub const MAX_FRAME: usize = 2 * MAX_BODY + 2;

const START: u8 = b'^';
const END: u8 = b'$';
const ABORT: u8 = b'!';
const ESCAPE: u8 = b'\\';

const fn is_special(byte: u8) -> bool {
    matches!(byte, START | END | ABORT | ESCAPE)
}

/// The body of a frame: 0 to 64 bytes, unescaped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    bytes: [u8; MAX_BODY],
    length: usize,
}

impl Frame {
    pub(crate) const fn empty() -> Self {
        Self { bytes: [0; MAX_BODY], length: 0 }
    }

    /// A body from its bytes; `None` when there are more than [`MAX_BODY`] or none at all.
    #[must_use]
    pub fn new(body: &[u8]) -> Option<Self> {
        let mut frame = Self::empty();
        (!body.is_empty() && body.iter().all(|&byte| frame.push(byte))).then_some(frame)
    }

    /// The body, from its letter on.
    #[must_use]
    pub fn body(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or(&[])
    }

    /// Adds a byte; returns whether there was room for it.
    pub(crate) fn push(&mut self, byte: u8) -> bool {
        match self.bytes.get_mut(self.length) {
            Some(slot) => {
                *slot = byte;
                self.length += 1;
                true
            }
            None => false,
        }
    }

    /// Appends bytes. Bytes after [`MAX_BODY`] are dropped; no message of this module is that long.
    pub(crate) fn extend(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.push(byte);
        }
    }

    /// Writes the frame with its marks and escapes, and returns its length, bytes. If the frame does not fit, returns
    /// 0, and `out` holds no complete frame. [`MAX_FRAME`] bytes are always enough.
    #[must_use = "the length says what to send"]
    pub fn encode(&self, out: &mut [u8]) -> usize {
        write_frame(out, |slots| {
            slots.put(START)?;
            for &byte in self.body() {
                if is_special(byte) {
                    slots.put(ESCAPE)?;
                    slots.put(!byte)?;
                } else {
                    slots.put(byte)?;
                }
            }
            slots.put(END)
        })
    }
}

/// Counts of accepted and refused frames. The counts saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounters {
    /// Complete frames.
    pub whole: u32,
    /// Frames cut by the start of the next one.
    pub cut: u32,
    /// Frames that their sender aborted.
    pub aborted: u32,
    /// Frames longer than [`MAX_BODY`].
    pub overlong: u32,
    /// Frames with an escape before a byte that is never escaped.
    pub bad_escape: u32,
    /// Frames without a letter.
    pub empty: u32,
    /// Bytes outside of any frame.
    pub stray_bytes: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Outside,
    Body,
    Escaped,
}

/// Finds frames in a stream of bytes, one byte at a time.
#[derive(Clone, Debug)]
pub struct Decoder {
    state: State,
    frame: Frame,
    counters: FrameCounters,
}

impl Default for Decoder {
    fn default() -> Self {
        Self { state: State::Outside, frame: Frame::empty(), counters: FrameCounters::default() }
    }
}

impl Decoder {
    /// Takes the next byte. Returns the frame if the byte completes one.
    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        match (self.state, byte) {
            // The start mark and the abort mark are never data: they have their meaning even after an escape.
            (state, START) => {
                if state != State::Outside {
                    bump(&mut self.counters.cut);
                }
                self.frame = Frame::empty();
                self.state = State::Body;
            }
            (State::Outside, _) => bump(&mut self.counters.stray_bytes),
            (_, ABORT) => {
                bump(&mut self.counters.aborted);
                self.state = State::Outside;
            }
            (State::Body, END) => {
                self.state = State::Outside;
                if self.frame.body().is_empty() {
                    bump(&mut self.counters.empty);
                } else {
                    bump(&mut self.counters.whole);
                    return Some(self.frame);
                }
            }
            (State::Body, ESCAPE) => self.state = State::Escaped,
            (State::Body, _) => self.store(byte),
            (State::Escaped, _) if is_special(!byte) => {
                self.state = State::Body;
                self.store(!byte);
            }
            (State::Escaped, _) => {
                bump(&mut self.counters.bad_escape);
                self.state = State::Outside;
            }
        }
        None
    }

    /// Counts of accepted and refused frames.
    #[must_use]
    pub fn counters(&self) -> FrameCounters {
        self.counters
    }

    fn store(&mut self, byte: u8) {
        if !self.frame.push(byte) {
            bump(&mut self.counters.overlong);
            self.state = State::Outside;
        }
    }
}
