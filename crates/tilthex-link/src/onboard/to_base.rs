//! Messages from the vehicle to the base.

use super::{
    periods::Periods,
    record::{FlightPart, StatePart, ToolPart},
};
use crate::tk3::{Frame, Message, Refusal, VehicleMessage};

/// A message from the vehicle to the base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ToBase {
    /// A message of tk3.
    Tk3(VehicleMessage),
    /// The supervisor in a record.
    Flight(FlightPart),
    /// The state in a record.
    State(StatePart),
    /// The tool in a record.
    Tool(ToolPart),
    /// The periods of the streams.
    Periods(Periods),
}

impl ToBase {
    /// The message's frame.
    #[must_use]
    pub fn frame(&self) -> Frame {
        match self {
            Self::Tk3(message) => message.frame(),
            Self::Flight(part) => part.frame(),
            Self::State(part) => part.frame(),
            Self::Tool(part) => part.frame(),
            Self::Periods(periods) => periods.frame(),
        }
    }

    /// Writes the message, see [`Frame::encode`].
    #[must_use = "the length says what to send"]
    pub fn encode(&self, out: &mut [u8]) -> usize {
        self.frame().encode(out)
    }
}

impl Message for ToBase {
    fn parse(body: &[u8]) -> Result<Self, Refusal> {
        match body.first() {
            Some(b'F') => FlightPart::parse(body).map(Self::Flight),
            Some(b'S') => StatePart::parse(body).map(Self::State),
            Some(b'W') => ToolPart::parse(body).map(Self::Tool),
            Some(b'P') => Periods::parse(body).map(Self::Periods),
            _ => VehicleMessage::parse(body).map(Self::Tk3),
        }
    }
}
