//! The submessages of both directions.

#[cfg(feature = "board")]
use super::message::BEST_EFFORT;
use super::{
    cdr::{Reader, Writer},
    entity::Entity,
    message::{ObjectId, Request, Time},
};

pub(super) const LITTLE_ENDIAN: u8 = 1;
/// The format of data: one sample without further information.
const FORMAT: u8 = 0x0e;

const COOKIE: [u8; 4] = *b"XRCE";
const VERSION: [u8; 2] = [1, 0];
const VENDOR: [u8; 2] = [1, 15];

/// A submessage from the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FromClient<'a> {
    /// Begins a session.
    CreateClient {
        /// The session's number, which all its messages carry.
        session: u8,
    },
    /// Creates an object.
    Create(Request, Entity<'a>),
    /// Asks about an object. A request about [`AGENT_OBJECT`](super::AGENT_OBJECT) finds out whether an agent exists.
    GetInfo(Request),
    /// Deletes an object. To delete [`CLIENT_OBJECT`](super::CLIENT_OBJECT) ends the session.
    Delete(Request),
    /// Data that a writer sends.
    WriteData(ObjectId, &'a [u8]),
    /// Asks for the data of a reader from now on.
    ReadData(Request),
    /// Says what the client has received of a reliable stream.
    AckNack,
    /// Says what the client has sent in a reliable stream.
    Heartbeat {
        /// The oldest message that is not acknowledged.
        first: u16,
        /// The newest message.
        last: u16,
        /// The stream.
        stream: u8,
    },
    /// Asks for the agent's time; holds the client's.
    Timestamp(Time),
    /// Anything else.
    Other(u8),
}

/// A submessage from the agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FromAgent<'a> {
    /// The session has begun, if the status is 0.
    StatusAgent(u8),
    /// The result of a request; a status of 0 is success.
    Status(Request, u8),
    /// The agent exists; the flag says whether it knows the session.
    Info(Request, bool),
    /// Data for a reader.
    Data(Request, &'a [u8]),
    /// Says what the agent has received of a reliable stream.
    AckNack {
        /// The oldest message that has not arrived.
        first: u16,
        /// Bit `i` is set if message `first + i` is missing.
        missing: u16,
        /// The stream.
        stream: u8,
    },
    /// The agent's time, and the client's time of the request. The message holds the agent's time twice, because it
    /// receives and answers at the same time.
    TimestampReply {
        /// The agent's time.
        now: Time,
        /// The client's time of the request.
        asked: Time,
    },
}

fn request(reader: &mut Reader<'_>) -> Option<Request> {
    Some(Request { number: reader.array()?, object: ObjectId(reader.array()?) })
}

fn write_request(request: Request, writer: &mut Writer<'_>) {
    writer.bytes(&request.number);
    writer.bytes(&request.object.0);
}

impl<'a> FromClient<'a> {
    pub(super) fn parse(id: u8, flags: u8, payload: &'a [u8]) -> Option<Self> {
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
    pub(super) fn write(&self, writer: &mut Writer<'_>) -> u8 {
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
                // The participant to which the object belongs.
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
                // Sent in the best-effort stream, one sample in each message, without a filter, without an end.
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
    pub(super) fn parse(id: u8, flags: u8, payload: &'a [u8]) -> Option<Self> {
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

    pub(super) fn write(&self, writer: &mut Writer<'_>) -> u8 {
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
                // Success. No configuration. The agent's activity: it is available, and has no further address.
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
