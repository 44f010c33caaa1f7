//! Writes an MCAP file of protobuf messages with a schema for every channel. The file can be read up to its last flush, even
//! if the program is killed.

use std::{collections::BTreeMap, io::Write};

use mcap::{Attachment, Compression, McapError, WriteOptions, records::MessageHeader, write::NoSeek};

/// A channel of a [`LogWriter`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Topic(u16);

/// Whether a log has an index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Index {
    /// With an index: for files, in which programs search.
    Written,
    /// Without an index: for memory, which is read as a whole. A third smaller.
    LeftOut,
}

impl Index {
    /// Largest chunk before it is written, bytes.
    const fn chunk(self) -> u64 {
        match self {
            // Each chunk has an index that stays in memory until the end, so that there must be few chunks.
            Self::Written => 512 * 1024,
            // LZ4 finds repetitions within this distance.
            Self::LeftOut => 64 * 1024,
        }
    }
}

/// Writes a log.
pub struct LogWriter<W: Write> {
    writer: mcap::Writer<NoSeek<W>>,
    sequences: BTreeMap<u16, u32>,
    buffer: Vec<u8>,
}

impl<W: Write> LogWriter<W> {
    /// Begins a log.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn new(file: W, index: Index) -> Result<Self, McapError> {
        let indexed = index == Index::Written;
        let options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(index.chunk()))
            .emit_message_indexes(indexed)
            .emit_summary_records(indexed)
            .library(concat!("tilthex ", env!("CARGO_PKG_VERSION")))
            // A chunk is composed in memory and written at once, so that a killed program leaves no incomplete chunk.
            .disable_seeking(true);
        let writer = options.create(NoSeek::new(file))?;
        Ok(Self { writer, sequences: BTreeMap::new(), buffer: Vec::with_capacity(4096) })
    }

    /// Adds a channel for messages of one kind. `schema` is the full name of their schema, `descriptors` a serialised
    /// `FileDescriptorSet` that holds it.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn topic(&mut self, topic: &str, schema: &str, descriptors: &[u8]) -> Result<Topic, McapError> {
        let schema = self.writer.add_schema(schema, "protobuf", descriptors)?;
        let id = self.writer.add_channel(schema, topic, "protobuf", &BTreeMap::new())?;
        self.sequences.insert(id, 0);
        Ok(Topic(id))
    }

    /// Appends a message with the time `time`, ns since 1970. `encode` writes the message to the buffer.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn put(
        &mut self,
        topic: Topic,
        time: u64,
        encode: impl FnOnce(&mut Vec<u8>),
    ) -> Result<(), McapError> {
        self.buffer.clear();
        encode(&mut self.buffer);
        let sequence = self.sequences.entry(topic.0).or_default();
        let header =
            MessageHeader { channel_id: topic.0, sequence: *sequence, log_time: time, publish_time: time };
        *sequence = sequence.wrapping_add(1);
        self.writer.write_to_known_channel(&header, &self.buffer)
    }

    /// Attaches a file.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn attach(&mut self, name: &str, media_type: &str, data: &[u8], time: u64) -> Result<(), McapError> {
        self.writer.attach(&Attachment {
            log_time: time,
            create_time: time,
            name: name.into(),
            media_type: media_type.into(),
            data: data.into(),
        })
    }

    /// Adds a table of names and texts.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) -> Result<(), McapError> {
        self.writer.write_metadata(&mcap::records::Metadata { name: name.into(), metadata })
    }

    /// Writes all data that are still in memory. They can be read from now on.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn flush(&mut self) -> Result<(), McapError> {
        self.writer.flush()
    }

    /// Ends the log with its index.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn finish(mut self) -> Result<W, McapError> {
        self.writer.finish()?;
        Ok(self.writer.into_inner().into_inner())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcap::{MessageStream, read::Options};
    use proptest::prelude::*;
    use std::{cell::RefCell, rc::Rc};

    /// A file whose length can be read while it is written.
    #[derive(Clone, Default)]
    struct Shared(Rc<RefCell<Vec<u8>>>);

    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.borrow_mut().write(bytes)
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn what_is_written_is_read_back_with_schema_and_times() {
        let mut log = LogWriter::new(Vec::new(), Index::Written).expect("begins");
        let topic = log.topic("/v", "tilthex.Vector3", b"schema").expect("added");
        log.attach("config.toml", "application/toml", b"[vehicle]\n", 1).expect("attached");
        let sent = b"any bytes".to_vec();
        for i in 0..3 {
            log.put(topic, 100 + i, |out| out.extend(&sent)).expect("written");
        }
        let bytes = log.finish().expect("ends");
        let read: Vec<_> = MessageStream::new(&bytes).expect("a log").map(|m| m.expect("whole")).collect();
        assert_eq!(read.len(), 3);
        for (i, message) in (0..).zip(&read) {
            assert_eq!((message.publish_time, message.log_time), (100 + i, 100 + i));
            assert_eq!(message.sequence, i as u32);
            let schema = message.channel.schema.as_ref().expect("a schema");
            assert_eq!((&*schema.name, &*schema.encoding), ("tilthex.Vector3", "protobuf"));
            assert_eq!((&*schema.data, &*message.data), (&b"schema"[..], &*sent));
        }
        let summary = mcap::Summary::read(&bytes).expect("readable").expect("there");
        assert_eq!(summary.attachment_indexes[0].name, "config.toml");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn a_file_cut_anywhere_keeps_what_was_flushed(
            groups in prop::collection::vec(1..40u64, 1..8), rest in 0..40u64, cut in 0.0..1.0f64,
        ) {
            let file = Shared::default();
            let mut log = LogWriter::new(file.clone(), Index::Written).expect("begins");
            let topic = log.topic("/flight", "tilthex.Flight", &[]).expect("added");
            let mut tick = 0;
            // (length of the file, messages that must be readable in it)
            let mut flushed = vec![];
            for count in groups {
                for _ in 0..count {
                    log.put(topic, tick, |out| out.extend(tick.to_le_bytes())).expect("written");
                    tick += 1;
                }
                log.flush().expect("flushed");
                flushed.push((file.0.borrow().len(), tick));
            }
            for _ in 0..rest {
                log.put(topic, tick, |out| out.extend(tick.to_le_bytes())).expect("written");
                tick += 1;
            }
            log.finish().expect("ends");
            let bytes = file.0.take();
            let first = flushed[0].0;
            let length = first + (cut * (bytes.len() - first) as f64) as usize;
            let expected = flushed.iter().filter(|(end, _)| *end <= length).map(|f| f.1).max().unwrap_or(0);
            let found = MessageStream::new_with_options(&bytes[..length], Options::IgnoreEndMagic.into())
                .expect("a log")
                .take_while(Result::is_ok)
                .count() as u64;
            prop_assert!(found >= expected, "{found} of {expected}");
        }
    }
}
