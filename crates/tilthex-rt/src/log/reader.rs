//! Reads a log back: all of a whole one, all that is there of one that breaks off, nothing of a damaged one.

use std::{collections::BTreeMap, fs::File, io::Read, path::Path};

use mcap::records::op;

use super::{
    fields::{ChunkRecord, Fields, MAGIC, MessageRecord},
    flight_log::Attachments,
    scan::{Channel, Cut, Scan, scan},
    unpack::unpack,
};

/// A log in memory, found sound.
#[derive(Debug)]
pub struct LogReader {
    bytes: Vec<u8>,
    found: Scan,
}

impl LogReader {
    /// A log from its bytes.
    ///
    /// # Errors
    /// What follows "the file" in a sentence: is no MCAP file, is damaged and where, is no log of a flight.
    pub fn new(bytes: Vec<u8>) -> Result<Self, String> {
        let found = scan(&bytes)?;
        if found.attachments.config.is_empty() {
            return Err(match found.cut {
                Some(Cut { size, .. }) if found.times.is_none() => {
                    format!(
                        "breaks off after {size} bytes, before the configuration that a log begins with: nothing can be read"
                    )
                }
                _ => format!(
                    "is an MCAP file, written by \"{}\", but no log of tilthex-rt: no configuration (config.toml) is attached",
                    found.library.escape_debug()
                ),
            });
        }
        Ok(Self { bytes, found })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// As [`Self::new`], or why the file cannot be read.
    pub fn open(path: &Path) -> Result<Self, String> {
        let read = || {
            let mut bytes = Vec::new();
            tilthex_config::files::open(path).and_then(|mut file: File| file.read_to_end(&mut bytes))?;
            Ok(bytes)
        };
        let bytes = read().map_err(|e: std::io::Error| format!("cannot be read: {e}"))?;
        Self::new(bytes)
    }

    /// What is attached.
    #[must_use]
    pub fn attachments(&self) -> &Attachments {
        &self.found.attachments
    }

    /// Its channels by their number.
    #[must_use]
    pub fn channels(&self) -> &BTreeMap<u16, Channel> {
        &self.found.channels
    }

    /// Where it breaks off; `None` for a whole log.
    #[must_use]
    pub fn cut(&self) -> Option<Cut> {
        self.found.cut
    }

    /// What is missing of a log that breaks off, as a sentence; `None` for a whole log.
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
                "the log breaks off {seconds:.3} s after its first message, at byte {} of {}: what came later is missing (0.5 \
                 s at most where the program was killed){left_out}",
                cut.read, cut.size
            )
        })
    }

    /// Calls `each` with channel and bytes of every message, in the order of the file, up to where it ends or breaks off.
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
                // Sound, or the first pass had refused it.
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
