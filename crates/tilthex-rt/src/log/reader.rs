//! Reads a log back, also one whose end is missing.

use std::{collections::HashMap, io};

use mcap::{
    McapError,
    read::{LinearReader, MessageStream, Options},
    records::Record,
};

use super::flight_log::{Attachments, CONFIG, METADATA, TAKE_OFF, TRAJECTORY};

/// A log in memory.
#[derive(Debug)]
pub struct LogReader {
    bytes: Vec<u8>,
}

impl LogReader {
    /// A log from its bytes.
    #[must_use]
    pub fn new(bytes: Vec<u8>) -> Self {
        Self { bytes }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// The file's.
    pub fn open(path: &std::path::Path) -> io::Result<Self> {
        std::fs::read(path).map(Self::new)
    }

    /// What is attached.
    ///
    /// # Errors
    /// Where it is no log.
    pub fn attachments(&self) -> Result<Attachments, McapError> {
        let mut found = Attachments::default();
        let text = |data: &[u8]| String::from_utf8_lossy(data).into_owned();
        for record in LinearReader::new_with_options(&self.bytes, Options::IgnoreEndMagic.into())? {
            match record {
                Ok(Record::Attachment { header, data, .. }) if header.name == CONFIG => {
                    found.config = text(&data);
                }
                Ok(Record::Attachment { header, data, .. }) if header.name == TRAJECTORY => {
                    found.trajectory = Some(text(&data));
                }
                Ok(Record::Metadata(m)) if m.name == METADATA => {
                    found.take_off = m.metadata.get(TAKE_OFF).is_some_and(|value| value == "true");
                }
                Ok(_) => {}
                // The rest is missing: the program was killed.
                Err(_) => break,
            }
        }
        Ok(found)
    }

    /// Calls `each` with topic and bytes of every message, in the order of the
    /// file, up to where it ends or breaks off.
    ///
    /// # Errors
    /// Where it is no log.
    pub fn each(&self, mut each: impl FnMut(&str, &[u8])) -> Result<(), McapError> {
        for message in MessageStream::new_with_options(&self.bytes, Options::IgnoreEndMagic.into())? {
            let Ok(message) = message else { break };
            each(&message.channel.topic, &message.data);
        }
        Ok(())
    }

    /// How many messages each channel has.
    ///
    /// # Errors
    /// Where it is no log.
    pub fn counts(&self) -> Result<HashMap<String, u64>, McapError> {
        let mut counts = HashMap::new();
        self.each(|topic, _| *counts.entry(topic.to_string()).or_default() += 1)?;
        Ok(counts)
    }
}
