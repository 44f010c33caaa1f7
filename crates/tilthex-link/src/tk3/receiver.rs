//! Decodes bytes to messages, and counts all refusals.

use super::frame::{Decoder, FrameCounters};
use crate::bump;
use core::marker::PhantomData;

/// Why a whole frame is not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// No message starts with this letter.
    UnknownLetter(u8),
    /// The message with this letter has another length.
    WrongLength {
        /// The letter.
        letter: u8,
        /// The body's length, bytes.
        found: usize,
    },
    /// The message with this letter holds a number that the protocol does not allow.
    OutOfRange(u8),
    /// The message with this letter has a wrong checksum.
    WrongChecksum(u8),
}

/// One direction of the protocol.
pub trait Message: Sized {
    /// Reads a frame's body.
    ///
    /// # Errors
    /// The [`Refusal`], if the letter, the length or a number is not valid in this direction.
    fn parse(body: &[u8]) -> Result<Self, Refusal>;
}

/// Counts of messages and of refusals; they saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Counts of the framing.
    pub frames: FrameCounters,
    /// Number of messages.
    pub messages: u32,
    /// Frames with an unknown letter.
    pub unknown_letter: u32,
    /// Frames of the wrong length.
    pub wrong_length: u32,
    /// Frames with a number out of range.
    pub out_of_range: u32,
    /// Frames with a wrong checksum. The messages of tk3 have none.
    pub wrong_checksum: u32,
}

impl Counters {
    /// Frames that were refused for any reason; stray bytes are not frames.
    #[must_use]
    pub fn refused(&self) -> u32 {
        let f = &self.frames;
        [
            f.cut,
            f.aborted,
            f.overlong,
            f.bad_escape,
            f.empty,
            self.unknown_letter,
            self.wrong_length,
            self.out_of_range,
            self.wrong_checksum,
        ]
        .into_iter()
        .fold(0, u32::saturating_add)
    }
}

/// A [`Decoder`] and the parser of one direction behind it.
#[derive(Clone, Debug)]
pub struct Receiver<M> {
    decoder: Decoder,
    counters: Counters,
    direction: PhantomData<fn() -> M>,
}

impl<M> Default for Receiver<M> {
    fn default() -> Self {
        Self { decoder: Decoder::default(), counters: Counters::default(), direction: PhantomData }
    }
}

impl<M: Message> Receiver<M> {
    /// Takes the next byte, and returns the message if the byte completes one.
    pub fn push(&mut self, byte: u8) -> Option<M> {
        let frame = self.decoder.push(byte)?;
        match M::parse(frame.body()) {
            Ok(message) => {
                bump(&mut self.counters.messages);
                return Some(message);
            }
            Err(Refusal::UnknownLetter(_)) => bump(&mut self.counters.unknown_letter),
            Err(Refusal::WrongLength { .. }) => bump(&mut self.counters.wrong_length),
            Err(Refusal::OutOfRange(_)) => bump(&mut self.counters.out_of_range),
            Err(Refusal::WrongChecksum(_)) => bump(&mut self.counters.wrong_checksum),
        }
        None
    }

    /// Counts of messages and of refusals so far.
    #[must_use]
    pub fn counters(&self) -> Counters {
        Counters { frames: self.decoder.counters(), ..self.counters }
    }
}
