//! Bytes on their way to the vehicle.

/// Largest number of bytes that a tick sends.
pub const MAX_BYTES_OUT: usize = 384;

/// Writes the bytes of a frame one after the other into a buffer.
#[derive(Debug)]
pub(crate) struct Slots<'a> {
    free: core::slice::IterMut<'a, u8>,
    length: usize,
}

impl Slots<'_> {
    /// Writes a byte; `None` if there is no room.
    pub(crate) fn put(&mut self, byte: u8) -> Option<()> {
        *self.free.next()? = byte;
        self.length += 1;
        Some(())
    }
}

/// Writes a frame into `out` with `write` and returns its length, bytes. If `write` returns `None`, returns 0, and `out`
/// holds no complete frame.
pub(crate) fn write_frame(out: &mut [u8], write: impl FnOnce(&mut Slots<'_>) -> Option<()>) -> usize {
    let mut slots = Slots { free: out.iter_mut(), length: 0 };
    if write(&mut slots).is_some() { slots.length } else { 0 }
}

/// The bytes of one tick: complete frames, in a buffer of fixed capacity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outgoing {
    buffer: [u8; MAX_BYTES_OUT],
    length: usize,
}

impl Default for Outgoing {
    fn default() -> Self {
        Self { buffer: [0; MAX_BYTES_OUT], length: 0 }
    }
}

impl Outgoing {
    /// The bytes to write.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.buffer.get(..self.length).unwrap_or(&[])
    }

    /// Removes all bytes.
    pub fn clear(&mut self) {
        self.length = 0;
    }

    /// Appends a frame. `encode` writes it and returns its length, bytes. A frame that does not fit is dropped.
    pub fn append(&mut self, encode: impl FnOnce(&mut [u8]) -> usize) {
        if let Some(free) = self.buffer.get_mut(self.length..) {
            self.length += encode(free);
        }
    }
}
