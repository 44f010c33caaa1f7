//! Reads a log: a complete log, or all that exists of a log that breaks off. A damaged log is refused.

use std::{collections::BTreeMap, fs::File, io::Read, path::Path};

use mcap::records::op;

use super::{
    fields::{ChunkRecord, Fields, MAGIC, MessageRecord},
    flight_log::Attachments,
    scan::{Channel, Cut, Scan, scan},
    unpack::unpack,
};

/// A log in memory that was checked and is not damaged.
#[derive(Debug)]
pub struct LogReader {
    bytes: Vec<u8>,
    found: Scan,
}

impl LogReader {
    /// Checks the bytes of a log.
    ///
    /// # Errors
    /// The part of a sentence that follows "the file": it is not an MCAP file, is damaged (and where), or is not a log of a
    /// flight.
    pub fn new(bytes: Vec<u8>) -> Result<Self, String> {
        let found = scan(&bytes)?;
        if found.attachments.config.is_empty() {
            return Err(match found.cut {
                Some(Cut { size, .. }) if found.times.is_none() => {
                    format!(
                        "breaks off after {size} bytes, before the configuration at the start of a log: nothing can be read"
                    )
                }
                _ => format!(
                    "is an MCAP file, written by \"{}\", but not a log of tilthex-rt: no configuration (config.toml) is attached",
                    found.library.escape_debug()
                ),
            });
        }
        Ok(Self { bytes, found })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// Errors of [`Self::new`], or why the file cannot be read.
    pub fn open(path: &Path) -> Result<Self, String> {
        let read = || {
            let mut bytes = Vec::new();
            tilthex_config::files::open(path).and_then(|mut file: File| file.read_to_end(&mut bytes))?;
            Ok(bytes)
        };
        let bytes = read().map_err(|e: std::io::Error| format!("cannot be read: {e}"))?;
        Self::new(bytes)
    }

    /// Its attachments.
    #[must_use]
    pub fn attachments(&self) -> &Attachments {
        &self.found.attachments
    }

    /// Its channels, by their numbers.
    #[must_use]
    pub fn channels(&self) -> &BTreeMap<u16, Channel> {
        &self.found.channels
    }

    /// Where it breaks off; `None` for a complete log.
    #[must_use]
    pub fn cut(&self) -> Option<Cut> {
        self.found.cut
    }

    /// A sentence that says what is missing, if the log breaks off; `None` for a complete log.
    #[must_use]
    pub fn missing(&self) -> Option<String> {
        let cut = self.found.cut?;
        let left_out = match cut.size - cut.read {
            0 => String::new(),
            rest => format!(", and its last {rest} bytes are part of a record and are not read"),
        };
        let seconds = self.found.times.map_or(0.0, |(first, last)| (last - first) as f64 * 1e-9);
        Some(if cut.index_only {
            format!("the log breaks off in its index at byte {}: no message is missing{left_out}", cut.read)
        } else {
            format!(
                "the log breaks off {seconds:.3} s after its first message, at byte {} of {}: the rest is missing (0.5 s at \
                 most if the program was killed){left_out}",
                cut.read, cut.size
            )
        })
    }

    /// Calls `each` with the channel and the bytes of every message, in the order of the file, until the log ends or breaks
    /// off.
    pub fn each(&self, mut each: impl FnMut(&Channel, &[u8])) {
        let mut give = |body: Fields<'_>| {
            if let Some(message) = MessageRecord::read(body)
                && let Some(channel) = self.found.channels.get(&message.channel)
            {
                each(channel, message.data);
            }
        };
        let mut rest = Fields(self.bytes.get(MAGIC.len()..self.found.end).unwrap_or_default());
        while let Some((kind, body)) = rest.record() {
            match kind {
                op::MESSAGE => give(body),
                // It is not damaged: the first pass would have refused it.
                op::CHUNK => {
                    let unpacked = ChunkRecord::read(body).and_then(|chunk| unpack(&chunk).ok());
                    let mut inner = Fields(unpacked.as_deref().unwrap_or_default());
                    while let Some((kind, body)) = inner.record() {
                        if kind == op::MESSAGE {
                            give(body);
                        }
                    }
                }
                _ => {}
            }
        }
    }
}
