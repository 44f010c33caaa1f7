//! The submessages of both directions.

#[cfg(feature = "board")]
use super::message::BEST_EFFORT;
use super::{
    cdr::{Reader, Writer},
    entity::Entity,
    message::{ObjectId, Request, Time},
};

pub(super) const LITTLE_ENDIAN: u8 = 1;
/// The form of data: one sample without further information.
const FORMAT: u8 = 0x0e;

const COOKIE: [u8; 4] = *b"XRCE";
const VERSION: [u8; 2] = [1, 0];
const VENDOR: [u8; 2] = [1, 15];

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
