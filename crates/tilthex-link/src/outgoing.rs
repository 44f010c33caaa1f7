//! Bytes on their way to the vehicle.

/// Largest number of bytes that a tick sends.
pub const MAX_BYTES_OUT: usize = 384;

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
