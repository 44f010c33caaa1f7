//! Text from the vehicle.

use core::fmt::{self, Write};

/// Up to 63 bytes of text. When it is displayed, everything that is not printable ASCII is escaped, because the text
/// goes to terminals and logs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Text {
    bytes: [u8; Self::MAX],
    length: usize,
}

impl Text {
    /// Longest text, bytes.
    pub const MAX: usize = 63;

    /// The text; bytes after the first [`Text::MAX`] are dropped.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Self {
        let mut text = Self { bytes: [0; Self::MAX], length: bytes.len().min(Self::MAX) };
        for (slot, &byte) in text.bytes.iter_mut().zip(bytes) {
            *slot = byte;
        }
        text
    }

    /// The parts one after the other; bytes after the first [`Text::MAX`] are dropped.
    #[must_use]
    pub fn of(parts: &[&str]) -> Self {
        let mut text = Self::new(b"");
        let bytes = parts.iter().flat_map(|part| part.bytes());
        for (slot, byte) in text.bytes.iter_mut().zip(bytes) {
            *slot = byte;
            text.length += 1;
        }
        text
    }

    /// The bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or(&[])
    }
}

impl fmt::Display for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_bytes().iter().try_for_each(|&byte| match byte {
            b' '..=b'~' => f.write_char(char::from(byte)),
            _ => write!(f, "\\x{byte:02x}"),
        })
    }
}

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{self}\"")
    }
}

/// How serious a text is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// For information.
    Note,
    /// A warning.
    Warning,
    /// An error.
    Error,
}
