//! The records of MCAP and their fields. The bytes are not trusted.

/// The bytes with which a log begins and ends.
pub(super) const MAGIC: &[u8] = mcap::MAGIC;
/// Length of the kind and the length of a record, bytes.
pub(super) const RECORD_HEAD: usize = 1 + 8;

/// Reads the fields of a record from its start. A field after the end of the record is `None`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    pub(super) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    pub(super) fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes that follow their length, which has 32 bits.
    pub(super) fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.take(usize::try_from(length).ok()?)
    }

    /// Bytes that follow their length, which has 64 bits.
    pub(super) fn long_bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.u64()?;
        self.take(usize::try_from(length).ok()?)
    }

    pub(super) fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?).ok()
    }

    /// A map of names and texts.
    pub(super) fn map(&mut self) -> Option<Vec<(&'a str, &'a str)>> {
        let mut inner = Fields(self.bytes()?);
        let mut found = Vec::new();
        while !inner.0.is_empty() {
            found.push((inner.text()?, inner.text()?));
        }
        Some(found)
    }

    /// The next record: its kind and its body.
    pub(super) fn record(&mut self) -> Option<(u8, Fields<'a>)> {
        let kind = self.u8()?;
        Some((kind, Self(self.long_bytes()?)))
    }
}

/// A message in a chunk.
#[derive(Clone, Copy, Debug)]
pub(super) struct MessageRecord<'a> {
    pub(super) channel: u16,
    pub(super) log_time: u64,
    pub(super) data: &'a [u8],
}

impl<'a> MessageRecord<'a> {
    pub(super) fn read(mut fields: Fields<'a>) -> Option<Self> {
        let channel = fields.u16()?;
        fields.u32()?;
        let log_time = fields.u64()?;
        fields.u64()?;
        Some(Self { channel, log_time, data: fields.0 })
    }
}

/// A packed chunk.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChunkRecord<'a> {
    pub(super) size: u64,
    pub(super) check_sum: u32,
    pub(super) compression: &'a str,
    pub(super) packed: &'a [u8],
}

impl<'a> ChunkRecord<'a> {
    pub(super) fn read(mut fields: Fields<'a>) -> Option<Self> {
        fields.take(16)?;
        let (size, check_sum, compression) = (fields.u64()?, fields.u32()?, fields.text()?);
        let packed = fields.long_bytes()?;
        fields.0.is_empty().then_some(Self { size, check_sum, compression, packed })
    }
}

/// The name of a record's kind; `None` if MCAP has no such kind.
pub(super) fn kind_name(kind: u8) -> Option<&'static str> {
    use mcap::records::op;
    Some(match kind {
        op::HEADER => "header",
        op::FOOTER => "footer",
        op::SCHEMA => "schema",
        op::CHANNEL => "channel",
        op::MESSAGE => "message",
        op::CHUNK => "chunk",
        op::MESSAGE_INDEX => "message index",
        op::CHUNK_INDEX => "chunk index",
        op::ATTACHMENT => "attachment",
        op::ATTACHMENT_INDEX => "attachment index",
        op::STATISTICS => "statistics",
        op::METADATA => "metadata",
        op::METADATA_INDEX => "metadata index",
        op::SUMMARY_OFFSET => "summary offset",
        op::DATA_END => "end of the data",
        _ => return None,
    })
}
