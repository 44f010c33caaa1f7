//! CDR (OMG DDSI-RTPS, XCDR1), low byte first. Each number begins at a multiple of its size from the start of the data.

/// Reads numbers one after the other. Returns `None` after the end of the data.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

/// Defines the functions that read and write a number.
macro_rules! numbers {
    ($($name:ident: $number:ty,)+) => {
        impl Reader<'_> {
            $(
                pub(super) fn $name(&mut self) -> Option<$number> {
                    const SIZE: usize = size_of::<$number>();
                    self.align::<SIZE>();
                    self.array().map(<$number>::from_le_bytes)
                }
            )+
        }

        impl Writer<'_> {
            $(
                pub(super) fn $name(&mut self, number: $number) {
                    const SIZE: usize = size_of::<$number>();
                    self.align::<SIZE>();
                    self.bytes(&number.to_le_bytes());
                }
            )+
        }
    };
}

numbers! {
    u8: u8,
    u16: u16,
    u32: u32,
    u64: u64,
    i32: i32,
    f32: f32,
    f64: f64,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// Skips to a multiple of `SIZE`, a power of two.
    pub(super) fn align<const SIZE: usize>(&mut self) {
        self.at = self.at.wrapping_add(SIZE - 1) & !(SIZE - 1);
    }

    /// The next `N` bytes, not aligned.
    pub(super) fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let found = *self.bytes.get(self.at..)?.first_chunk()?;
        self.at = self.at.wrapping_add(N);
        Some(found)
    }

    /// The next `length` bytes.
    pub(super) fn slice(&mut self, length: usize) -> Option<&'a [u8]> {
        let (found, _) = self.bytes.get(self.at..)?.split_at_checked(length)?;
        self.at = self.at.wrapping_add(length);
        Some(found)
    }

    /// A sequence of bytes: first their number (u32), then the bytes.
    pub(super) fn sequence(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.slice(usize::try_from(length).ok()?)
    }

    /// A string: a sequence that ends with 0. The 0 is not returned.
    pub(super) fn string(&mut self) -> Option<&'a [u8]> {
        match self.sequence()?.split_last()? {
            (0, text) => Some(text),
            _ => None,
        }
    }

    /// The bytes that have not been read.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or(&[])
    }
}

/// Writes numbers one after the other into a buffer.
#[derive(Debug)]
pub(super) struct Writer<'a> {
    out: &'a mut [u8],
    at: usize,
    fits: bool,
}

impl<'a> Writer<'a> {
    pub(super) fn new(out: &'a mut [u8]) -> Self {
        Self { out, at: 0, fits: true }
    }

    /// Pads with zeros to a multiple of `SIZE`, a power of two.
    pub(super) fn align<const SIZE: usize>(&mut self) {
        while self.fits && self.at & (SIZE - 1) != 0 {
            self.bytes(&[0]);
        }
    }

    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        let end = self.at.wrapping_add(bytes.len());
        match self.out.get_mut(self.at..end) {
            Some(slots) if slots.len() == bytes.len() => {
                slots.iter_mut().zip(bytes).for_each(|(slot, byte)| *slot = *byte);
                self.at = end;
            }
            _ => self.fits = false,
        }
    }

    /// A sequence of bytes: first their number (u32), then the bytes.
    #[cfg(feature = "board")]
    pub(super) fn sequence(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.bytes(bytes);
    }

    /// A string, with 0 at its end.
    #[cfg(feature = "board")]
    pub(super) fn string(&mut self, text: &[u8]) {
        self.u32(text.len() as u32 + 1);
        self.bytes(text);
        self.bytes(&[0]);
    }

    /// Number of bytes that were written; `None` if they did not all fit.
    pub(super) fn length(&self) -> Option<usize> {
        self.fits.then_some(self.at)
    }
}
