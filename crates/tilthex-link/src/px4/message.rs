//! DDS-XRCE messages (OMG DDS-XRCE 1.0, chapter 8): a header, then submessages at multiples of four bytes. Both
//! directions: the client is the flight board, the agent is tilthex.

use super::cdr::{Reader, Writer};

/// A session whose messages carry no key of the client has a number from here on.
pub const WITHOUT_KEY: u8 = 0x80;
/// The stream of messages that belong to none.
pub const NO_STREAM: u8 = 0;
/// The first best-effort stream.
pub const BEST_EFFORT: u8 = 1;
/// The first reliable stream.
pub const RELIABLE: u8 = 0x80;

/// Bytes of a message's header, and of a submessage's.
pub(super) const HEADER: usize = 4;
const LITTLE_ENDIAN: u8 = 1;
/// The form of data: one sample without further information.
const FORMAT: u8 = 0x0e;

const COOKIE: [u8; 4] = *b"XRCE";
const VERSION: [u8; 2] = [1, 0];
const VENDOR: [u8; 2] = [1, 15];

/// The agent itself as an object.
pub const AGENT_OBJECT: ObjectId = ObjectId([0xff, 0xfd]);
/// The client itself as an object.
pub const CLIENT_OBJECT: ObjectId = ObjectId([0xff, 0xfe]);

/// An object of a client; its last four bits are its kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectId(pub [u8; 2]);

/// A request: its number, and the object that it is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Its number.
    pub number: [u8; 2],
    /// The object.
    pub object: ObjectId,
}

/// A time of the wire, from any origin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Time {
    /// Whole seconds.
    pub seconds: i32,
    /// Nanoseconds on top.
    pub nanoseconds: u32,
}

impl Time {
    /// A time in s from 0 on.
    #[must_use]
    pub fn of(seconds: f64) -> Self {
        let whole = seconds as i32;
        Self { seconds: whole, nanoseconds: (1e9 * (seconds - f64::from(whole))) as u32 }
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self { seconds: reader.i32()?, nanoseconds: reader.u32()? })
    }

    fn write(self, writer: &mut Writer<'_>) {
        writer.i32(self.seconds);
        writer.u32(self.nanoseconds);
    }
}

/// How a writer or reader names its topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TopicName<'a> {
    /// By an object that was created before.
    Object(ObjectId),
    /// By its name.
    Text(&'a [u8]),
}

/// What a client creates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entity<'a> {
    /// A topic with a name.
    Topic(&'a [u8]),
    /// What it sends data with.
    Writer(TopicName<'a>),
    /// What it receives data with.
    Reader(TopicName<'a>),
    /// Anything else: a participant, a publisher, a subscriber, a replier.
    Other,
}

#[cfg(feature = "board")]
const PARTICIPANT: u8 = 1;
const TOPIC: u8 = 2;
const DATA_WRITER: u8 = 5;
const DATA_READER: u8 = 6;
const AS_XML: u8 = 2;
const IN_BINARY: u8 = 3;

/// A submessage from the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FromClient<'a> {
    /// Begins a session.
    CreateClient {
        /// The number that the session's messages have from then on.
        session: u8,
    },
    /// Creates an object.
    Create(Request, Entity<'a>),
    /// Asks about an object; about the agent to know whether it is there.
    GetInfo(Request),
    /// Deletes an object; the client itself to end the session.
    Delete(Request),
    /// Data of a writer.
    WriteData(ObjectId, &'a [u8]),
    /// Wants data of a reader from now on.
    ReadData(Request),
    /// What it has received of a reliable stream.
    AckNack,
    /// What it has sent of a reliable stream.
    Heartbeat {
        /// The oldest message that is not acknowledged.
        first: u16,
        /// The newest message.
        last: u16,
        /// The stream.
        stream: u8,
    },
    /// Asks for the time.
    Timestamp(Time),
    /// Anything else.
    Other(u8),
}

/// A submessage from the agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FromAgent<'a> {
    /// The session has begun, if the status is 0.
    StatusAgent(u8),
    /// The end of a request; a status of 0 is success.
    Status(Request, u8),
    /// The agent is there; whether it knows the session.
    Info(Request, bool),
    /// Data for a reader.
    Data(Request, &'a [u8]),
    /// What it has received of a reliable stream.
    AckNack {
        /// The oldest message that has not come.
        first: u16,
        /// Bit `i` is set if message `first + i` is missing.
        missing: u16,
        /// The stream.
        stream: u8,
    },
    /// The agent's time, twice (it answers at once), and the time of the question.
    TimestampReply {
        /// The agent's time.
        now: Time,
        /// The client's.
        asked: Time,
    },
}

/// The head of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// The session, from [`WITHOUT_KEY`] on.
    pub session: u8,
    /// The stream.
    pub stream: u8,
    /// The number in its stream.
    pub sequence: u16,
}

/// A message as it came: its head, and its submessages.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    /// Its head.
    pub header: Header,
    bytes: &'a [u8],
}

impl<'a> Message<'a> {
    /// Reads the head; `None` for a message that is too short, or of a session with keys.
    #[must_use]
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        let mut reader = Reader::new(bytes);
        let header = Header { session: reader.u8()?, stream: reader.u8()?, sequence: reader.u16()? };
        (header.session >= WITHOUT_KEY).then_some(Self { header, bytes })
    }

    /// The submessages in their order, ended by the first that breaks off: number, flags, payload.
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

    /// The submessages as the agent reads them; `None` for one that is malformed.
    pub fn from_client(&self) -> impl Iterator<Item = Option<FromClient<'a>>> + use<'a> {
        self.submessages().map(|(id, flags, payload)| FromClient::parse(id, flags, payload))
    }

    /// The submessages as the client reads them; `None` for one that is malformed.
    pub fn from_agent(&self) -> impl Iterator<Item = Option<FromAgent<'a>>> + use<'a> {
        self.submessages().map(|(id, flags, payload)| FromAgent::parse(id, flags, payload))
    }
}

fn request(reader: &mut Reader<'_>) -> Option<Request> {
    Some(Request { number: reader.array()?, object: ObjectId(reader.array()?) })
}

fn write_request(request: Request, writer: &mut Writer<'_>) {
    writer.bytes(&request.number);
    writer.bytes(&request.object.0);
}

/// The text between `<name>` and the next `<`.
fn name_in(xml: &[u8]) -> Option<&[u8]> {
    const TAG: &[u8; 6] = b"<name>";
    let begin = xml.windows(TAG.len()).position(|found| found == TAG)?;
    xml.get(begin..)?.get(TAG.len()..)?.split(|byte| *byte == b'<').next()
}

impl<'a> Entity<'a> {
    fn parse(reader: &mut Reader<'a>) -> Option<Self> {
        let (kind, form) = (reader.u8()?, reader.u8()?);
        let made = reader.sequence()?;
        let object = || Reader::new(made).array().map(|id| TopicName::Object(ObjectId(id)));
        let text = || name_in(made).map(TopicName::Text);
        match (kind, form) {
            (TOPIC, IN_BINARY) => Reader::new(made).string().map(Self::Topic),
            (TOPIC, AS_XML) => name_in(made).map(Self::Topic),
            (DATA_WRITER, IN_BINARY) => object().map(Self::Writer),
            (DATA_WRITER, AS_XML) => text().map(Self::Writer),
            (DATA_READER, IN_BINARY) => object().map(Self::Reader),
            (DATA_READER, AS_XML) => text().map(Self::Reader),
            _ => Some(Self::Other),
        }
    }

    /// The binary form; a topic that is named in text is written as XML.
    #[cfg(feature = "board")]
    fn write(&self, writer: &mut Writer<'_>) {
        let text = |kind, name: &[u8], writer: &mut Writer<'_>| {
            writer.bytes(&[kind, AS_XML]);
            let (before, after) = (b"<dds><topic><name>", b"</name></topic></dds>\0");
            writer.u32((before.len() + name.len() + after.len()) as u32);
            [before.as_slice(), name, after].into_iter().for_each(|part| writer.bytes(part));
        };
        match *self {
            Self::Topic(name) => {
                writer.bytes(&[TOPIC, IN_BINARY]);
                writer.align::<4>();
                // The name, that no type is referred to, and that none is named.
                writer.u32(name.len() as u32 + 7);
                writer.string(name);
                writer.bytes(&[0, 0]);
            }
            Self::Writer(TopicName::Object(topic)) => {
                writer.bytes(&[DATA_WRITER, IN_BINARY]);
                writer.sequence(&topic.0);
            }
            Self::Reader(TopicName::Object(topic)) => {
                writer.bytes(&[DATA_READER, IN_BINARY]);
                writer.sequence(&topic.0);
            }
            Self::Writer(TopicName::Text(name)) => text(DATA_WRITER, name, writer),
            Self::Reader(TopicName::Text(name)) => text(DATA_READER, name, writer),
            Self::Other => {
                writer.bytes(&[PARTICIPANT, 1]);
                writer.sequence(b"participant\0");
            }
        }
    }
}

impl<'a> FromClient<'a> {
    fn parse(id: u8, flags: u8, payload: &'a [u8]) -> Option<Self> {
        if flags & LITTLE_ENDIAN == 0 {
            return None;
        }
        let mut reader = Reader::new(payload);
        Some(match id {
            0 => {
                let (cookie, version) = (reader.array()?, reader.array::<2>()?);
                let (_vendor, _key) = (reader.array::<2>()?, reader.array::<4>()?);
                let known = cookie == COOKIE && version.first() == VERSION.first();
                Self::CreateClient { session: reader.u8().filter(|_| known)? }
            }
            1 => Self::Create(request(&mut reader)?, Entity::parse(&mut reader)?),
            2 => Self::GetInfo(request(&mut reader)?),
            3 => Self::Delete(request(&mut reader)?),
            7 if flags & FORMAT == 0 => Self::WriteData(request(&mut reader)?.object, reader.rest()),
            8 => Self::ReadData(request(&mut reader)?),
            10 => Self::AckNack,
            11 => Self::Heartbeat { first: reader.u16()?, last: reader.u16()?, stream: reader.u8()? },
            14 => Self::Timestamp(Time::read(&mut reader)?),
            _ => Self::Other(id),
        })
    }

    #[cfg(feature = "board")]
    fn write(&self, writer: &mut Writer<'_>) -> u8 {
        let numbered = |object| Request { number: [0, 0], object };
        match *self {
            Self::CreateClient { session } => {
                writer.bytes(&COOKIE);
                writer.bytes(&VERSION);
                writer.bytes(&VENDOR);
                writer.bytes(&[0, 0, 0, 1, session, 0]);
                writer.u16(512);
                0
            }
            Self::Create(request, entity) => {
                write_request(request, writer);
                entity.write(writer);
                // The participant that it belongs to.
                writer.bytes(&[0x00, 0x11]);
                1
            }
            Self::GetInfo(request) => {
                write_request(request, writer);
                writer.u32(2);
                2
            }
            Self::Delete(request) => {
                write_request(request, writer);
                3
            }
            Self::WriteData(object, data) => {
                write_request(numbered(object), writer);
                writer.bytes(data);
                7
            }
            Self::ReadData(request) => {
                write_request(request, writer);
                // To the best-effort stream, one sample each, no filter, without end.
                writer.bytes(&[BEST_EFFORT, 0, 0, 1]);
                [u16::MAX, 0, 0, 0].into_iter().for_each(|number| writer.u16(number));
                8
            }
            Self::AckNack => {
                writer.bytes(&[0; 5]);
                10
            }
            Self::Heartbeat { first, last, stream } => {
                writer.u16(first);
                writer.u16(last);
                writer.u8(stream);
                11
            }
            Self::Timestamp(time) => {
                time.write(writer);
                14
            }
            Self::Other(id) => id,
        }
    }
}

impl<'a> FromAgent<'a> {
    fn parse(id: u8, flags: u8, payload: &'a [u8]) -> Option<Self> {
        if flags & LITTLE_ENDIAN == 0 {
            return None;
        }
        let mut reader = Reader::new(payload);
        match id {
            4 => reader.u8().map(Self::StatusAgent),
            5 => Some(Self::Status(request(&mut reader)?, reader.u8()?)),
            6 => Some(Self::Info(request(&mut reader)?, reader.array::<2>()?.last() == Some(&1))),
            9 if flags & FORMAT == 0 => Some(Self::Data(request(&mut reader)?, reader.rest())),
            10 => {
                let (first, missing) = (reader.u16()?, u16::from_be_bytes(reader.array()?));
                Some(Self::AckNack { first, missing, stream: reader.u8()? })
            }
            15 => {
                let (now, _) = (Time::read(&mut reader)?, Time::read(&mut reader)?);
                Some(Self::TimestampReply { now, asked: Time::read(&mut reader)? })
            }
            _ => None,
        }
    }

    fn write(&self, writer: &mut Writer<'_>) -> u8 {
        match *self {
            Self::StatusAgent(status) => {
                writer.bytes(&[status, 0]);
                writer.bytes(&COOKIE);
                writer.bytes(&VERSION);
                writer.bytes(&VENDOR);
                writer.bytes(&[0]);
                4
            }
            Self::Status(request, status) => {
                write_request(request, writer);
                writer.bytes(&[status, 0]);
                5
            }
            Self::Info(request, active) => {
                write_request(request, writer);
                // Success; no configuration; the agent's activity: it is available, at no further address.
                writer.bytes(&[0, u8::from(active), 0, 1, 13]);
                writer.u16(1);
                writer.u32(0);
                6
            }
            Self::Data(request, data) => {
                write_request(request, writer);
                writer.bytes(data);
                9
            }
            Self::AckNack { first, missing, stream } => {
                writer.u16(first);
                writer.bytes(&missing.to_be_bytes());
                writer.u8(stream);
                10
            }
            Self::TimestampReply { now, asked } => {
                [now, now, asked].into_iter().for_each(|time| time.write(writer));
                15
            }
        }
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

    /// Appends a submessage of the agent; whether it fitted.
    pub fn agent(&mut self, submessage: &FromAgent<'_>) -> bool {
        self.append(|writer| submessage.write(writer))
    }

    /// Appends a submessage of the client; whether it fitted.
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
        // The gap to the multiple of four may hold bytes of a submessage that did not fit.
        if let Some(gap) = self.bytes.get_mut(self.length..begin) {
            gap.fill(0);
        }
        self.length = begin.wrapping_add(HEADER).wrapping_add(length);
        true
    }
}
