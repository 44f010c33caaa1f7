//! The numbers in a body, and its checksum. Integers and floats are big-endian.

use crate::{
    crc::crc_with,
    tk3::{Frame, Refusal},
};
use tilthex_core::{Matrix3, Vector3, Vector6, so3};

/// Largest coordinate, m.
pub(super) const FAR: f64 = 1e4;

fn checksum(body: &[u8]) -> u16 {
    body.iter().fold(0, |crc, byte| crc_with(crc, *byte))
}

/// Writes a body.
pub(super) struct Writer(Frame);

impl Writer {
    pub(super) fn new(letter: u8) -> Self {
        let mut frame = Frame::empty();
        frame.push(letter);
        Self(frame)
    }

    pub(super) fn bytes(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }

    pub(super) fn floats<'a>(mut self, values: impl IntoIterator<Item = &'a f64>) -> Self {
        values.into_iter().for_each(|value| self.0.extend(&(*value as f32).to_be_bytes()));
        self
    }

    pub(super) fn rotation(self, rotation: &Matrix3) -> Self {
        self.floats(&so3::to_quaternion_xyzw(rotation))
    }

    /// The body with its checksum.
    pub(super) fn finish(mut self) -> Frame {
        let crc = checksum(self.0.body());
        self.0.extend(&crc.to_be_bytes());
        self.0
    }
}

/// Reads a body whose checksum is right.
pub(super) struct Reader<'a> {
    letter: u8,
    length: usize,
    left: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(super) fn new(body: &'a [u8]) -> Result<Self, Refusal> {
        let length = body.len();
        let letter = body.first().copied().unwrap_or(0);
        let wrong_length = Refusal::WrongLength { letter, found: length };
        let (body, crc) = body.split_last_chunk::<2>().ok_or(wrong_length)?;
        let left = body.get(1..).ok_or(wrong_length)?;
        if checksum(body) == u16::from_be_bytes(*crc) {
            Ok(Self { letter, length, left })
        } else {
            Err(Refusal::WrongChecksum(letter))
        }
    }

    pub(super) fn out_of_range(&self) -> Refusal {
        Refusal::OutOfRange(self.letter)
    }

    fn wrong_length(&self) -> Refusal {
        Refusal::WrongLength { letter: self.letter, found: self.length }
    }

    pub(super) fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Refusal> {
        let (first, rest) = self.left.split_first_chunk().ok_or(self.wrong_length())?;
        self.left = rest;
        Ok(*first)
    }

    pub(super) fn u8(&mut self) -> Result<u8, Refusal> {
        self.bytes().map(u8::from_be_bytes)
    }

    pub(super) fn u16(&mut self) -> Result<u16, Refusal> {
        self.bytes().map(u16::from_be_bytes)
    }

    pub(super) fn u32(&mut self) -> Result<u32, Refusal> {
        self.bytes().map(u32::from_be_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, Refusal> {
        self.bytes().map(u64::from_be_bytes)
    }

    /// A number within `min` and `max`.
    pub(super) fn float(&mut self, min: f64, max: f64) -> Result<f64, Refusal> {
        let value = f64::from(f32::from_be_bytes(self.bytes()?));
        if (min..=max).contains(&value) { Ok(value) } else { Err(self.out_of_range()) }
    }

    /// Three numbers of at most this magnitude.
    pub(super) fn vector(&mut self, most: f64) -> Result<Vector3, Refusal> {
        Ok(Vector3::new(self.float(-most, most)?, self.float(-most, most)?, self.float(-most, most)?))
    }

    /// Six numbers within `min` and `max`.
    pub(super) fn six(&mut self, min: f64, max: f64) -> Result<Vector6, Refusal> {
        let mut values = Vector6::zeros();
        for value in values.iter_mut() {
            *value = self.float(min, max)?;
        }
        Ok(values)
    }

    pub(super) fn rotation(&mut self) -> Result<Matrix3, Refusal> {
        let mut quaternion = [0.0; 4];
        for value in &mut quaternion {
            *value = self.float(-2.0, 2.0)?;
        }
        so3::from_quaternion_xyzw(quaternion).ok_or(self.out_of_range())
    }

    /// Refuses bytes that are left.
    pub(super) fn end<T>(self, message: T) -> Result<T, Refusal> {
        if self.left.is_empty() { Ok(message) } else { Err(self.wrong_length()) }
    }
}
