//! Lines of a letter and whole numbers.

/// Most numbers of a line.
pub(super) const NUMBERS: usize = 8;
/// Longest line, bytes.
const LINE: usize = 80;

/// Finds lines in bytes, wherever they are cut.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lines {
    bytes: [u8; LINE],
    length: usize,
}

impl Default for Lines {
    fn default() -> Self {
        Self { bytes: [0; LINE], length: 0 }
    }
}

impl Lines {
    /// Takes a byte; a message where a line ends with it, `Some(None)` where that line is none.
    pub(super) fn push(&mut self, byte: u8) -> Option<Option<Message>> {
        if byte == b'\n' {
            let length = core::mem::take(&mut self.length);
            return Some(self.bytes.get(..length).and_then(parse));
        }
        if let Some(slot) = self.bytes.get_mut(self.length) {
            *slot = byte;
        }
        // A line that is too long is none.
        self.length = (self.length + 1).min(LINE + 1);
        None
    }
}

/// A letter and its numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Message {
    pub(super) letter: u8,
    numbers: [i32; NUMBERS],
    count: usize,
}

impl Message {
    /// The numbers.
    pub(super) fn numbers(&self) -> &[i32] {
        self.numbers.get(..self.count).unwrap_or(&[])
    }
}

/// The message that a line is.
fn parse(line: &[u8]) -> Option<Message> {
    let mut words = line.split(|byte| *byte == b' ');
    let &[letter] = words.next()? else { return None };
    let mut message = Message { letter, ..Message::default() };
    for word in words {
        let number = core::str::from_utf8(word).ok()?.parse().ok()?;
        *message.numbers.get_mut(message.count)? = number;
        message.count += 1;
    }
    Some(message)
}

/// Writes a line; its length, or 0 where it does not fit.
pub(super) fn write(free: &mut [u8], letter: u8, numbers: impl Iterator<Item = u32>) -> usize {
    let mut out = free.iter_mut();
    let mut length = 0;
    let mut put = |byte: u8| {
        let slot = out.next()?;
        *slot = byte;
        length += 1;
        Some(())
    };
    let whole = || {
        put(letter)?;
        for number in numbers {
            put(b' ')?;
            let mut digits = [b'0'; 10];
            let (mut rest, mut count) = (number, 0);
            for slot in digits.iter_mut().rev() {
                if rest > 0 || count == 0 {
                    (*slot, rest, count) = (b'0' + (rest % 10) as u8, rest / 10, count + 1);
                }
            }
            digits.iter().skip(10 - count).try_for_each(|digit| put(*digit))?;
        }
        put(b'\n')
    };
    if whole().is_some() { length } else { 0 }
}
