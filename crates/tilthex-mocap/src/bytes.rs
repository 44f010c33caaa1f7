//! Cursors over byte slices. A reader returns `None` after the end of the bytes; a writer that has no room writes nothing.

/// Reads from the beginning to the end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    pub(super) fn rest(self) -> &'a [u8] {
        self.0
    }

    pub(super) fn bytes(&mut self, length: usize) -> Option<&'a [u8]> {
        let (head, tail) = self.0.split_at_checked(length)?;
        self.0 = tail;
        Some(head)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, tail) = self.0.split_first_chunk::<N>()?;
        self.0 = tail;
        Some(*head)
    }

    /// The bytes before the next NUL. Skips the NUL too.
    pub(super) fn text(&mut self) -> Option<&'a [u8]> {
        let length = self.0.iter().position(|&byte| byte == 0)?;
        let text = self.bytes(length)?;
        self.bytes(1)?;
        Some(text)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn i32(&mut self) -> Option<i32> {
        self.array().map(i32::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    pub(super) fn f64(&mut self) -> Option<f64> {
        self.array().map(f64::from_le_bytes)
    }

    pub(super) fn f32s<const N: usize>(&mut self) -> Option<[f32; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f32::from_le_bytes(self.array()?);
        }
        Some(values)
    }

    /// A count; `None` if it is negative.
    pub(super) fn count(&mut self) -> Option<usize> {
        self.i32()?.try_into().ok()
    }

    /// Skips `count` items of `size` bytes.
    pub(super) fn skip(&mut self, count: usize, size: usize) -> Option<()> {
        self.bytes(count.checked_mul(size)?).map(|_| ())
    }
}

/// Writes from the beginning to the end. If anything does not fit, [`Self::finish`] returns 0.
#[derive(Debug)]
pub(super) struct Writer<'a> {
    out: &'a mut [u8],
    length: usize,
}

impl<'a> Writer<'a> {
    pub(super) fn new(out: &'a mut [u8]) -> Self {
        Self { out, length: 0 }
    }

    pub(super) fn put(&mut self, bytes: &[u8]) {
        let end = self.length.saturating_add(bytes.len());
        if let Some(slot) = self.out.get_mut(self.length..end) {
            slot.copy_from_slice(bytes);
        }
        self.length = end;
    }

    pub(super) fn zeros(&mut self, count: usize) {
        for _ in 0..count {
            self.put(&[0]);
        }
    }

    pub(super) fn i32(&mut self, value: i32) {
        self.put(&value.to_le_bytes());
    }

    pub(super) fn f32s(&mut self, values: &[f32]) {
        values.iter().for_each(|value| self.put(&value.to_le_bytes()));
    }

    /// Text in a field of `size` bytes, cut so that at least one NUL follows it.
    pub(super) fn field(&mut self, text: &[u8], size: usize) {
        let shown = text.get(..size.saturating_sub(1)).unwrap_or(text);
        self.put(shown);
        self.zeros(size - shown.len());
    }

    /// Number of bytes written; larger than the buffer if that was too short.
    pub(super) fn position(&self) -> usize {
        self.length
    }

    /// Overwrites bytes that were written before.
    pub(super) fn patch(&mut self, at: usize, bytes: &[u8]) {
        if let Some(slot) = self.out.get_mut(at..at.saturating_add(bytes.len())) {
            slot.copy_from_slice(bytes);
        }
    }

    /// The length, bytes; 0 if the buffer was too short.
    pub(super) fn finish(self) -> usize {
        if self.length <= self.out.len() { self.length } else { 0 }
    }
}
