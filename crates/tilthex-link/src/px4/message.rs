//! DDS-XRCE messages of both directions (OMG DDS-XRCE 1.0, chapter 8): a header, then submessages at multiples of four
//! bytes. The client is the flight board, the agent is tilthex.

use super::{
    cdr::{Reader, Writer},
    submessages::{FromAgent, FromClient, LITTLE_ENDIAN},
};

/// The lowest number of a session whose messages do not carry the client's key.
pub const WITHOUT_KEY: u8 = 0x80;
/// The stream number of messages that belong to no stream.
pub const NO_STREAM: u8 = 0;
/// The first best-effort stream.
pub const BEST_EFFORT: u8 = 1;
/// The first reliable stream.
pub const RELIABLE: u8 = 0x80;

/// Bytes of a message's header; a submessage's header has the same length.
pub(super) const HEADER: usize = 4;

/// The object that stands for the agent itself.
pub const AGENT_OBJECT: ObjectId = ObjectId([0xff, 0xfd]);
/// The object that stands for the client itself.
pub const CLIENT_OBJECT: ObjectId = ObjectId([0xff, 0xfe]);

/// The identifier of a client's object. Its last four bits are the object's kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectId(pub [u8; 2]);

/// A request: its number, and the object that it concerns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Its number.
    pub number: [u8; 2],
    /// The object.
    pub object: ObjectId,
}

/// A time as the protocol sends it. Its origin is arbitrary.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Time {
    /// Whole seconds.
    pub seconds: i32,
    /// Nanoseconds to be added.
    pub nanoseconds: u32,
}

impl Time {
    /// Converts a time in s, at least 0.
    #[must_use]
    pub fn of(seconds: f64) -> Self {
        let whole = seconds as i32;
        Self { seconds: whole, nanoseconds: (1e9 * (seconds - f64::from(whole))) as u32 }
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self { seconds: reader.i32()?, nanoseconds: reader.u32()? })
    }

    pub(super) fn write(self, writer: &mut Writer<'_>) {
        writer.i32(self.seconds);
        writer.u32(self.nanoseconds);
    }
}

/// The header of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// The session, at least [`WITHOUT_KEY`].
    pub session: u8,
    /// The stream.
    pub stream: u8,
    /// The message's number in its stream.
    pub sequence: u16,
}

/// A received message: its header and its submessages.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    /// Its header.
    pub header: Header,
    bytes: &'a [u8],
}

impl<'a> Message<'a> {
    /// Reads the header. `None` if the message is too short, or its session uses keys.
    #[must_use]
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        let mut reader = Reader::new(bytes);
        let header = Header { session: reader.u8()?, stream: reader.u8()?, sequence: reader.u16()? };
        (header.session >= WITHOUT_KEY).then_some(Self { header, bytes })
    }

    /// The submessages in their order: number, flags, payload. Ends before the first that is not complete.
    pub fn submessages(&self) -> impl Iterator<Item = (u8, u8, &'a [u8])> + use<'a> {
        let mut reader = Reader::new(self.bytes);
        let mut at_header = reader.slice(HEADER).is_some();
        core::iter::from_fn(move || {
            if !core::mem::take(&mut at_header) {
                return None;
            }
            reader.align::<4>();
            let (id, flags) = (reader.u8()?, reader.u8()?);
            let length = reader.u16()?;
            let payload = reader.slice(usize::from(length))?;
            at_header = true;
            Some((id, flags, payload))
        })
    }

    /// The submessages as the agent reads them; `None` for a malformed one.
    pub fn from_client(&self) -> impl Iterator<Item = Option<FromClient<'a>>> + use<'a> {
        self.submessages().map(|(id, flags, payload)| FromClient::parse(id, flags, payload))
    }

    /// The submessages as the client reads them; `None` for a malformed one.
    pub fn from_agent(&self) -> impl Iterator<Item = Option<FromAgent<'a>>> + use<'a> {
        self.submessages().map(|(id, flags, payload)| FromAgent::parse(id, flags, payload))
    }
}

/// A message that is being written.
#[derive(Clone, Copy, Debug)]
pub struct Draft<const N: usize> {
    bytes: [u8; N],
    length: usize,
}

impl<const N: usize> Draft<N> {
    /// A message without a submessage.
    #[must_use]
    pub fn new(header: Header) -> Self {
        let mut bytes = [0; N];
        let [low, high] = header.sequence.to_le_bytes();
        let head = [header.session, header.stream, low, high];
        bytes.iter_mut().zip(head).for_each(|(slot, byte)| *slot = byte);
        Self { bytes, length: HEADER }
    }

    /// Appends a submessage of the agent. Returns whether it fitted.
    pub fn agent(&mut self, submessage: &FromAgent<'_>) -> bool {
        self.append(|writer| submessage.write(writer))
    }

    /// Appends a submessage of the client. Returns whether it fitted.
    #[cfg(feature = "board")]
    pub fn client(&mut self, submessage: &FromClient<'_>) -> bool {
        self.append(|writer| submessage.write(writer))
    }

    /// Whether it has no submessage.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.length <= HEADER
    }

    /// The message.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or(&[])
    }

    fn append(&mut self, write: impl FnOnce(&mut Writer<'_>) -> u8) -> bool {
        let begin = self.length.wrapping_add(3) & !3;
        let Some((head, payload)) =
            self.bytes.get_mut(begin..).and_then(|free| free.split_at_mut_checked(HEADER))
        else {
            return false;
        };
        let mut writer = Writer::new(payload);
        let id = write(&mut writer);
        let Some(length) = writer.length() else { return false };
        let [low, high] = (length as u16).to_le_bytes();
        head.iter_mut().zip([id, LITTLE_ENDIAN, low, high]).for_each(|(slot, byte)| *slot = byte);
        // The padding may still hold bytes of a submessage that did not fit.
        if let Some(gap) = self.bytes.get_mut(self.length..begin) {
            gap.fill(0);
        }
        self.length = begin.wrapping_add(HEADER).wrapping_add(length);
        true
    }
}
