//! The objects that a client creates, described in binary form or as XML.

#[cfg(feature = "board")]
use super::cdr::Writer;
use super::{cdr::Reader, message::ObjectId};

/// How a writer or reader names its topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TopicName<'a> {
    /// By the object of the topic, which was created before.
    Object(ObjectId),
    /// By its name.
    Text(&'a [u8]),
}

/// An object that a client creates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entity<'a> {
    /// A topic with a name.
    Topic(&'a [u8]),
    /// The object with which the client sends data.
    Writer(TopicName<'a>),
    /// The object with which the client receives data.
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

/// The text between `<name>` and the next `<`.
fn name_in(xml: &[u8]) -> Option<&[u8]> {
    const TAG: &[u8; 6] = b"<name>";
    let begin = xml.windows(TAG.len()).position(|found| found == TAG)?;
    xml.get(begin..)?.get(TAG.len()..)?.split(|byte| *byte == b'<').next()
}

impl<'a> Entity<'a> {
    pub(super) fn parse(reader: &mut Reader<'a>) -> Option<Self> {
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

    /// Writes the binary form. A writer or reader that names its topic in text is written as XML.
    #[cfg(feature = "board")]
    pub(super) fn write(&self, writer: &mut Writer<'_>) {
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
                // The name, then two flags: no reference to a type follows, and no name of a type.
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
