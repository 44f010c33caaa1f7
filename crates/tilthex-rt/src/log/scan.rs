//! Reads a log once from begin to end, and reports what it holds, what is damaged and what is missing.

use std::collections::BTreeMap;

use mcap::records::op;

use super::{
    fields::{ChunkRecord, Fields, MAGIC, MessageRecord, RECORD_HEAD, kind_name},
    flight_log::{Attachments, CONFIG, METADATA, ON_BOARD, TAKE_OFF, TRAJECTORY},
    unpack::unpack,
};

/// Largest record, bytes. A larger length is damaged.
const MAX_RECORD: u64 = 256 << 20;
/// All chunks together unpack to at most this many times the file's size. Flights unpack to about 4 times.
const MAX_RATIO: u64 = 50;

/// A channel of a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Its topic.
    pub topic: String,
    /// The name of its messages' schema.
    pub schema: String,
    /// How they are encoded.
    pub encoding: String,
}

/// Where a log breaks off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// Bytes up to the last whole record.
    pub read: u64,
    /// Bytes of the file.
    pub size: u64,
    /// Whether only the index after the messages is missing.
    pub index_only: bool,
}

/// The result of one pass over a log.
#[derive(Clone, Debug, Default)]
pub(super) struct Scan {
    pub(super) attachments: Attachments,
    /// The program that wrote it.
    pub(super) library: String,
    pub(super) channels: BTreeMap<u16, Channel>,
    /// Times of the first and of the last message, ns.
    pub(super) times: Option<(u64, u64)>,
    pub(super) cut: Option<Cut>,
    /// End of the records of the data section.
    pub(super) end: usize,
    schemas: BTreeMap<u16, String>,
    /// Where the data section ended.
    data_end: Option<usize>,
    unpacked: u64,
}

/// Reads a log once.
///
/// # Errors
/// The part of a sentence that follows "the file": it is not an MCAP file, or where it is damaged.
pub(super) fn scan(bytes: &[u8]) -> Result<Scan, String> {
    let mut found = Scan::default();
    if !bytes.starts_with(MAGIC) {
        if !bytes.is_empty() && MAGIC.starts_with(bytes) {
            found.cut_at(0, bytes);
            return Ok(found);
        }
        return Err("is not an MCAP file: its first bytes are wrong".into());
    }
    // A log with the right end was not cut.
    let whole = bytes.len() > MAGIC.len() && bytes.ends_with(MAGIC);
    let mut at = MAGIC.len();
    loop {
        let rest = bytes.get(at..).unwrap_or_default();
        let damaged = |kind: &str, what: &str| Err(format!("is damaged at byte {at} ({kind}): {what}"));
        // If a computer loses its power, the file may end with zeros.
        if !whole && (rest.len() < RECORD_HEAD || rest.iter().all(|&byte| byte == 0)) {
            found.cut_at(at, bytes);
            return Ok(found);
        }
        let mut fields = Fields(rest);
        let (Some(kind), Some(length)) = (fields.u8(), fields.u64()) else {
            return damaged("no record", "the file ends before the log");
        };
        let Some(name) = kind_name(kind) else {
            return damaged("no record", &format!("there is no record of kind {kind}"));
        };
        if at == MAGIC.len() && kind != op::HEADER {
            return damaged(name, "expected the header of the file");
        }
        if length > rest.len().saturating_sub(RECORD_HEAD) as u64 {
            if whole || length > MAX_RECORD {
                return damaged(
                    name,
                    &format!("its length of {length} bytes goes beyond the end of the file"),
                );
            }
            found.cut_at(at, bytes);
            return Ok(found);
        }
        let end = at + RECORD_HEAD + length as usize;
        let body = Fields(bytes.get(at + RECORD_HEAD..end).unwrap_or_default());
        match found.take(kind, body, at, bytes) {
            Ok(()) => {}
            Err(what) => return damaged(name, &what),
        }
        at = end;
        if kind == op::FOOTER {
            return match bytes.get(at..).unwrap_or_default() {
                MAGIC => Ok(found),
                rest if rest.len() < MAGIC.len() && MAGIC.starts_with(rest) => {
                    found.cut_at(at, bytes);
                    Ok(found)
                }
                rest => Err(format!(
                    "is damaged at byte {at}: {} bytes follow its footer; expected the 8 bytes that end an MCAP file",
                    rest.len()
                )),
            };
        }
    }
}

impl Scan {
    fn cut_at(&mut self, at: usize, bytes: &[u8]) {
        let index_only = self.data_end.is_some();
        self.cut = Some(Cut { read: at as u64, size: bytes.len() as u64, index_only });
        if !index_only {
            self.end = at;
        }
    }

    /// Reads a record that begins at the byte `at` of the file.
    fn take(&mut self, kind: u8, mut body: Fields<'_>, at: usize, bytes: &[u8]) -> Result<(), String> {
        let short = || String::from("its fields do not fit into it");
        if self.data_end.is_some()
            && matches!(kind, op::CHUNK | op::MESSAGE | op::ATTACHMENT | op::METADATA | op::DATA_END)
        {
            return Err("it is after the end of the data".into());
        }
        match kind {
            op::HEADER => {
                body.text().ok_or_else(short)?;
                self.library = body.text().ok_or_else(short)?.into();
            }
            op::SCHEMA | op::CHANNEL => self.declare(kind, body).ok_or_else(short)?,
            op::MESSAGE => self.message(body)?,
            op::CHUNK => {
                let chunk = ChunkRecord::read(body).ok_or_else(short)?;
                self.unpacked = self.unpacked.saturating_add(chunk.size);
                let most = (bytes.len() as u64).saturating_mul(MAX_RATIO);
                if self.unpacked > most {
                    return Err(format!(
                        "the chunks unpack to more than {MAX_RATIO} times the file; a flight does not"
                    ));
                }
                let unpacked = unpack(&chunk)?;
                let mut inner = Fields(&unpacked);
                while !inner.0.is_empty() {
                    let place = unpacked.len() - inner.0.len();
                    let within = |what: String| format!("at byte {place} of its unpacked data, {what}");
                    let (kind, body) =
                        inner.record().ok_or_else(|| within("a record does not end".into()))?;
                    match kind {
                        op::SCHEMA | op::CHANNEL => {
                            self.declare(kind, body).ok_or_else(|| within(short()))?;
                        }
                        op::MESSAGE => self.message(body).map_err(within)?,
                        _ => return Err(within(format!("a record of kind {kind} does not belong there"))),
                    }
                }
            }
            op::ATTACHMENT => self.attachment(body)?,
            op::METADATA => {
                let (name, texts) = body.text().zip(body.map()).ok_or_else(short)?;
                if name == METADATA {
                    self.attachments.take_off = texts.contains(&(TAKE_OFF, "true"));
                    self.attachments.on_board = texts.contains(&(ON_BOARD, "true"));
                }
            }
            op::DATA_END => {
                let sum = body.u32().ok_or_else(short)?;
                self.end = at;
                self.data_end = Some(at + RECORD_HEAD + 4);
                if sum != 0 && sum != crc32fast::hash(&bytes[..at]) {
                    return Err(format!(
                        "its checksum over the bytes from 0 to {at} does not match, though each chunk's does: a record \
                         between the chunks is changed"
                    ));
                }
            }
            op::FOOTER => {
                let begin = self.data_end.ok_or("no end of the data comes before it")?;
                let summary = body.u64().ok_or_else(short)?;
                body.u64().ok_or_else(short)?;
                let sum = body.u32().ok_or_else(short)?;
                if summary != 0 && summary != begin as u64 {
                    return Err(format!(
                        "it announces that the summary begins at byte {summary}, but it begins at {begin}"
                    ));
                }
                let covered = bytes.get(begin..at + RECORD_HEAD + 16).unwrap_or_default();
                if sum != 0 && sum != crc32fast::hash(covered) {
                    return Err(format!("the checksum of the summary, from byte {begin} on, does not match"));
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Reads a schema or a channel.
    fn declare(&mut self, kind: u8, mut body: Fields<'_>) -> Option<()> {
        let id = body.u16()?;
        if kind == op::SCHEMA {
            self.schemas.insert(id, body.text()?.into());
            return Some(());
        }
        let schema = self.schemas.get(&body.u16()?).cloned().unwrap_or_default();
        let (topic, encoding) = (body.text()?.into(), body.text()?.into());
        self.channels.insert(id, Channel { topic, schema, encoding });
        Some(())
    }

    fn message(&mut self, body: Fields<'_>) -> Result<(), String> {
        let message = MessageRecord::read(body).ok_or("a message is shorter than its header")?;
        if !self.channels.contains_key(&message.channel) {
            return Err(format!("a message is of channel {}, which is not declared", message.channel));
        }
        let time = message.log_time;
        let (first, last) = self.times.unwrap_or((time, time));
        self.times = Some((first.min(time), last.max(time)));
        Ok(())
    }

    fn attachment(&mut self, body: Fields<'_>) -> Result<(), String> {
        let covered = body.0.len().checked_sub(4).ok_or("it is too short")?;
        let mut fields = body;
        let mut read = || {
            fields.take(16)?;
            let (name, _, data) = (fields.text()?, fields.text()?, fields.long_bytes()?);
            Some((name, data, fields.u32()?))
        };
        let (name, data, sum) = read().ok_or("its fields do not fit into it")?;
        if sum != 0 && sum != crc32fast::hash(&body.0[..covered]) {
            return Err("its checksum does not match".into());
        }
        let text =
            || String::from_utf8(data.to_vec()).map_err(|_| format!("{} is not text", name.escape_debug()));
        match name {
            CONFIG => self.attachments.config = text()?,
            TRAJECTORY => self.attachments.trajectory = Some(text()?),
            _ => {}
        }
        Ok(())
    }
}
