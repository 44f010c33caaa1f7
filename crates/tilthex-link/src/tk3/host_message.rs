//! Messages from the host to the vehicle.

use super::{
    frame::Frame,
    receiver::{Message, Refusal},
    speed::half_period,
};
use tilthex_core::types::MAX_ROTORS;

/// Largest magnitude of a throttle set-point.
pub const MAX_THROTTLE: i16 = 1023;

/// A stream whose rate the host chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// Battery voltage.
    Battery,
    /// State of every motor.
    Motors,
    /// Accelerometer and gyro.
    Imu,
    /// Magnetometer.
    Magnetometer,
}

impl Stream {
    const fn letter(self) -> u8 {
        match self {
            Self::Battery => b'b',
            Self::Motors => b'm',
            Self::Imu => b'i',
            Self::Magnetometer => b'c',
        }
    }
}

/// One number for each motor, for 1 to [`MAX_ROTORS`] motors, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotorValues {
    values: [i16; MAX_ROTORS],
    count: usize,
}

impl MotorValues {
    /// The values as they go over the wire; `None` unless there are 1 to [`MAX_ROTORS`].
    #[must_use]
    pub fn new(values: &[i16]) -> Option<Self> {
        Self::collect(values.iter().copied())
    }

    /// The half periods that ask for speeds in Hz, see [`half_period`]; `None` unless there are 1 to [`MAX_ROTORS`].
    #[must_use]
    pub fn from_speeds(speeds: &[f64]) -> Option<Self> {
        Self::collect(speeds.iter().map(|&speed| half_period(speed)))
    }

    /// The values.
    #[must_use]
    pub fn as_slice(&self) -> &[i16] {
        self.values.get(..self.count).unwrap_or(&[])
    }

    fn collect(source: impl ExactSizeIterator<Item = i16>) -> Option<Self> {
        let count = source.len();
        if !(1..=MAX_ROTORS).contains(&count) {
            return None;
        }
        let mut values = [0; MAX_ROTORS];
        for (slot, value) in values.iter_mut().zip(source) {
            *slot = value;
        }
        Some(Self { values, count })
    }

    fn parse(letter: u8, body: &[u8]) -> Result<Self, Refusal> {
        let wrong_length = Refusal::WrongLength { letter, found: body.len() + 1 };
        let (pairs, []) = body.as_chunks::<2>() else { return Err(wrong_length) };
        Self::collect(pairs.iter().map(|&pair| i16::from_be_bytes(pair))).ok_or(wrong_length)
    }
}

/// A message from the host to the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostMessage {
    /// Request the identity of the vehicle.
    Identify,
    /// Set the period of a stream.
    Rate {
        /// The stream.
        stream: Stream,
        /// Its period, us; 0 turns it off.
        period_us: u32,
    },
    /// Start one motor (from 1): it spins at its lowest speed; clears its emergency bit.
    Start(u8),
    /// Stop one motor (from 1).
    Stop(u8),
    /// Stop all motors.
    StopAll,
    /// Speed set-points as half periods, us. They cannot stop a motor.
    Speeds(MotorValues),
    /// Throttle set-points, each within +-[`MAX_THROTTLE`].
    Throttles(MotorValues),
    /// Beep at a frequency, Hz.
    Beep(u16),
}

impl HostMessage {
    /// The message's frame. Throttles are limited to +-[`MAX_THROTTLE`].
    #[must_use]
    pub fn frame(&self) -> Frame {
        let mut frame = Frame::empty();
        match *self {
            Self::Identify => frame.extend(b"?"),
            Self::Rate { stream, period_us } => {
                frame.extend(&[stream.letter()]);
                frame.extend(&period_us.to_be_bytes());
            }
            Self::Start(motor) => frame.extend(&[b'g', motor]),
            Self::Stop(motor) => frame.extend(&[b'x', motor]),
            Self::StopAll => frame.extend(b"x"),
            Self::Speeds(values) => {
                frame.extend(b"w");
                values.as_slice().iter().for_each(|value| frame.extend(&value.to_be_bytes()));
            }
            Self::Throttles(values) => {
                frame.extend(b"q");
                for value in values.as_slice() {
                    frame.extend(&(*value).clamp(-MAX_THROTTLE, MAX_THROTTLE).to_be_bytes());
                }
            }
            Self::Beep(hertz) => {
                frame.extend(b"~");
                frame.extend(&hertz.to_be_bytes());
            }
        }
        frame
    }

    /// Writes the message, see [`Frame::encode`].
    #[must_use = "the length says what to send"]
    pub fn encode(&self, out: &mut [u8]) -> usize {
        self.frame().encode(out)
    }
}

impl Message for HostMessage {
    fn parse(body: &[u8]) -> Result<Self, Refusal> {
        let rate = |stream, period| Self::Rate { stream, period_us: u32::from_be_bytes(period) };
        match *body {
            [b'?'] => Ok(Self::Identify),
            [b'b', a, b, c, d] => Ok(rate(Stream::Battery, [a, b, c, d])),
            [b'm', a, b, c, d] => Ok(rate(Stream::Motors, [a, b, c, d])),
            [b'i', a, b, c, d] => Ok(rate(Stream::Imu, [a, b, c, d])),
            [b'c', a, b, c, d] => Ok(rate(Stream::Magnetometer, [a, b, c, d])),
            [b'g', motor] => Ok(Self::Start(motor)),
            [b'x'] => Ok(Self::StopAll),
            [b'x', motor] => Ok(Self::Stop(motor)),
            [b'w', ref values @ ..] => MotorValues::parse(b'w', values).map(Self::Speeds),
            [b'q', ref values @ ..] => {
                let values = MotorValues::parse(b'q', values)?;
                let allowed = values.as_slice().iter().all(|v| (-MAX_THROTTLE..=MAX_THROTTLE).contains(v));
                if allowed { Ok(Self::Throttles(values)) } else { Err(Refusal::OutOfRange(b'q')) }
            }
            [b'~', a, b] => Ok(Self::Beep(u16::from_be_bytes([a, b]))),
            [letter @ (b'?' | b'b' | b'm' | b'i' | b'c' | b'g' | b'x' | b'~'), ..] => {
                Err(Refusal::WrongLength { letter, found: body.len() })
            }
            [letter, ..] => Err(Refusal::UnknownLetter(letter)),
            [] => Err(Refusal::WrongLength { letter: 0, found: 0 }),
        }
    }
}
