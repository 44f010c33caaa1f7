//! A line: its letter, its numbers and its checksum.

use crate::{
    bump,
    outgoing::{Slots, write_frame},
};

/// Largest number of numbers in a line.
pub const MAX_NUMBERS: usize = 12;
/// Longest line, bytes.
pub const MAX_LINE: usize = 160;

/// A message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    /// Its letter.
    pub letter: u8,
    numbers: [i32; MAX_NUMBERS],
    count: usize,
}

impl Line {
    /// A line of a letter and numbers; numbers after the first [`MAX_NUMBERS`] are left out.
    #[must_use]
    pub fn new(letter: u8, numbers: impl IntoIterator<Item = i32>) -> Self {
        let mut line = Self { letter, numbers: [0; MAX_NUMBERS], count: 0 };
        for (slot, number) in line.numbers.iter_mut().zip(numbers) {
            *slot = number;
            line.count += 1;
        }
        line
    }

    /// Its numbers.
    #[must_use]
    pub fn numbers(&self) -> &[i32] {
        self.numbers.get(..self.count).unwrap_or(&[])
    }

    /// Writes the line into `out` and returns its length, bytes; 0 if it does not fit.
    pub fn encode(&self, out: &mut [u8]) -> usize {
        write_frame(out, |out| {
            let mut sum = 0;
            put(out, self.letter, &mut sum)?;
            for number in self.numbers() {
                put(out, b' ', &mut sum)?;
                write_number(*number, |byte| put(out, byte, &mut sum))?;
            }
            let hex = [hex(sum >> 4), hex(sum & 15)];
            [b'*', hex[0], hex[1], b'\n'].into_iter().try_for_each(|byte| out.put(byte))
        })
    }

    /// The line in these bytes, without its end.
    fn parse(bytes: &[u8]) -> Option<Self> {
        let (body, check) = bytes.split_at_checked(bytes.len().checked_sub(3)?)?;
        let sum = body.iter().fold(0, |sum: u8, byte| sum.wrapping_add(*byte));
        if check != [b'*', hex(sum >> 4), hex(sum & 15)] {
            return None;
        }
        let (letter, rest) = body.split_first()?;
        let mut line = Self::new(*letter, []);
        if rest.is_empty() {
            return Some(line);
        }
        for digits in rest.strip_prefix(b" ")?.split(|byte| *byte == b' ') {
            *line.numbers.get_mut(line.count)? = read_number(digits)?;
            line.count += 1;
        }
        Some(line)
    }
}

fn put(out: &mut Slots<'_>, byte: u8, sum: &mut u8) -> Option<()> {
    *sum = sum.wrapping_add(byte);
    out.put(byte)
}

fn hex(nibble: u8) -> u8 {
    if nibble < 10 { b'0' + nibble } else { b'a' + (nibble & 15) - 10 }
}

fn write_number(number: i32, mut put: impl FnMut(u8) -> Option<()>) -> Option<()> {
    if number < 0 {
        put(b'-')?;
    }
    let mut digits = [0; 10];
    let mut left = number.unsigned_abs();
    for digit in digits.iter_mut().rev() {
        *digit = b'0' + (left % 10) as u8;
        left /= 10;
    }
    let zeros = digits.iter().take(9).take_while(|digit| **digit == b'0').count();
    digits.into_iter().skip(zeros).try_for_each(put)
}

fn read_number(text: &[u8]) -> Option<i32> {
    let (sign, digits) = text.strip_prefix(b"-").map_or((1, text), |digits| (-1, digits));
    if digits.is_empty() {
        return None;
    }
    digits.iter().try_fold(0_i32, |number, byte| {
        let digit = i32::from(byte.checked_sub(b'0').filter(|digit| *digit < 10)?);
        number.checked_mul(10)?.checked_add(sign * digit)
    })
}

/// Finds lines in bytes.
#[derive(Clone, Copy, Debug)]
pub struct Reader {
    bytes: [u8; MAX_LINE],
    length: usize,
    /// Lines that were accepted, and lines that were refused for their form; both saturate.
    pub accepted: u32,
    /// See `accepted`.
    pub refused: u32,
}

impl Default for Reader {
    fn default() -> Self {
        Self { bytes: [0; MAX_LINE], length: 0, accepted: 0, refused: 0 }
    }
}

impl Reader {
    /// Takes a byte; returns the line that it ends.
    pub fn push(&mut self, byte: u8) -> Option<Line> {
        if byte != b'\n' {
            if let Some(slot) = self.bytes.get_mut(self.length) {
                *slot = byte;
            }
            self.length = self.length.saturating_add(1);
            return None;
        }
        let length = core::mem::take(&mut self.length);
        let line = self.bytes.get(..length).and_then(Line::parse);
        bump(if line.is_some() { &mut self.accepted } else { &mut self.refused });
        line
    }
}
