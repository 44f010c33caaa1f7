//! Messages from the vehicle to the host.

use super::{
    frame::Frame,
    receiver::{Message, Refusal},
    speed::speed,
};
use crate::{Severity, Text};

/// One sample of the IMU, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImuFrame {
    /// Sequence number of the stream.
    pub sequence: u8,
    /// Specific force, counts, IMU coordinates.
    pub accelerometer: [i16; 3],
    /// Angular velocity, counts, IMU coordinates.
    pub gyro: [i16; 3],
    /// Temperature, counts, if the board sends it.
    pub temperature: Option<i16>,
}

impl ImuFrame {
    /// Temperature of a `chimera`, degrees Celsius.
    #[must_use]
    pub fn chimera_temperature(&self) -> Option<f64> {
        self.temperature.map(|raw| f64::from(raw) / 333.87 + 21.0)
    }
}

/// The bits of a motor's state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MotorState(pub u8);

impl MotorState {
    /// The bit of a motor that is starting.
    pub const STARTING: u8 = 0x10;
    /// The bit of a motor that spins.
    pub const SPINNING: u8 = 0x20;
    /// The bit of a motor in emergency stop.
    pub const EMERGENCY: u8 = 0x80;

    /// The motor's number, from 1 (0 if the board sends none).
    #[must_use]
    pub const fn motor(self) -> u8 {
        self.0 & 0x0f
    }

    /// Whether it is starting.
    #[must_use]
    pub const fn is_starting(self) -> bool {
        self.0 & Self::STARTING != 0
    }

    /// Whether it spins.
    #[must_use]
    pub const fn is_spinning(self) -> bool {
        self.0 & Self::SPINNING != 0
    }

    /// Whether it is in emergency stop.
    #[must_use]
    pub const fn is_emergency(self) -> bool {
        self.0 & Self::EMERGENCY != 0
    }
}

/// One sample of one motor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MotorFrame {
    /// Sequence number of this motor's stream.
    pub sequence: u8,
    /// Number and state.
    pub state: MotorState,
    /// Half a revolution's period, us; negative in reverse.
    pub half_period: i16,
    /// Throttle, within +-1023.
    pub throttle: i16,
    /// Current, mA.
    pub current_ma: u16,
}

impl MotorFrame {
    /// Speed, Hz; 0 while it does not spin.
    #[must_use]
    pub fn speed(&self) -> f64 {
        if self.state.is_spinning() { speed(self.half_period) } else { 0.0 }
    }
}

/// The letter of a text's frame.
const fn letter(severity: Severity) -> u8 {
    match severity {
        Severity::Note => b'N',
        Severity::Warning => b'A',
        Severity::Error => b'E',
    }
}

/// A message from the vehicle to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VehicleMessage {
    /// The identity of the vehicle, see [`super::Identity::parse`].
    Identity(Text),
    /// One sample of the IMU.
    Imu(ImuFrame),
    /// One sample of the magnetometer.
    Magnetometer {
        /// Sequence number of the stream.
        sequence: u8,
        /// Magnetic field, 1e-8 T.
        field: [i16; 3],
    },
    /// One sample of one motor.
    Motor(MotorFrame),
    /// Battery voltage.
    Battery {
        /// Sequence number of the stream.
        sequence: u8,
        /// Voltage, mV.
        millivolts: u16,
    },
    /// Clock calibration of one motor controller.
    Clock {
        /// The motor, from 1.
        motor: u8,
        /// Its calibration, raw.
        calibration: u8,
    },
    /// A text for the operator. It is shown, but not parsed.
    Text {
        /// How serious it is.
        severity: Severity,
        /// The text.
        text: Text,
    },
}

impl VehicleMessage {
    /// The message's frame.
    #[must_use]
    pub fn frame(&self) -> Frame {
        let mut frame = Frame::empty();
        let words = |frame: &mut Frame, words: &[i16]| {
            words.iter().for_each(|word| frame.extend(&word.to_be_bytes()));
        };
        match self {
            Self::Identity(text) => {
                frame.extend(b"?");
                frame.extend(text.as_bytes());
            }
            Self::Imu(imu) => {
                frame.extend(&[b'I', imu.sequence]);
                words(&mut frame, &imu.accelerometer);
                words(&mut frame, &imu.gyro);
                words(&mut frame, imu.temperature.as_slice());
            }
            Self::Magnetometer { sequence, field } => {
                frame.extend(&[b'C', *sequence]);
                words(&mut frame, field);
            }
            Self::Motor(motor) => {
                frame.extend(&[b'M', motor.sequence, motor.state.0]);
                words(&mut frame, &[motor.half_period, motor.throttle]);
                frame.extend(&motor.current_ma.to_be_bytes());
            }
            Self::Battery { sequence, millivolts } => {
                frame.extend(&[b'B', *sequence]);
                frame.extend(&millivolts.to_be_bytes());
            }
            Self::Clock { motor, calibration } => frame.extend(&[b'T', *motor, *calibration]),
            Self::Text { severity, text } => {
                frame.extend(&[letter(*severity)]);
                frame.extend(text.as_bytes());
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

/// Three big-endian words.
const fn triple(x: [u8; 2], y: [u8; 2], z: [u8; 2]) -> [i16; 3] {
    [i16::from_be_bytes(x), i16::from_be_bytes(y), i16::from_be_bytes(z)]
}

impl Message for VehicleMessage {
    fn parse(body: &[u8]) -> Result<Self, Refusal> {
        let text = |severity, text| Self::Text { severity, text: Text::new(text) };
        match *body {
            [b'?', ref identity @ ..] => Ok(Self::Identity(Text::new(identity))),
            [b'I', sequence, a, b, c, d, e, f, g, h, i, j, k, l, ref rest @ ..]
                if matches!(rest.len(), 0 | 2) =>
            {
                Ok(Self::Imu(ImuFrame {
                    sequence,
                    accelerometer: triple([a, b], [c, d], [e, f]),
                    gyro: triple([g, h], [i, j], [k, l]),
                    temperature: rest.first_chunk().map(|&raw| i16::from_be_bytes(raw)),
                }))
            }
            [b'C', sequence, a, b, c, d, e, f] => {
                Ok(Self::Magnetometer { sequence, field: triple([a, b], [c, d], [e, f]) })
            }
            [b'M', sequence, state, a, b, c, d, e, f] => Ok(Self::Motor(MotorFrame {
                sequence,
                state: MotorState(state),
                half_period: i16::from_be_bytes([a, b]),
                throttle: i16::from_be_bytes([c, d]),
                current_ma: u16::from_be_bytes([e, f]),
            })),
            [b'B', sequence, a, b] => Ok(Self::Battery { sequence, millivolts: u16::from_be_bytes([a, b]) }),
            [b'T', motor, calibration] => Ok(Self::Clock { motor, calibration }),
            [b'N', ref note @ ..] => Ok(text(Severity::Note, note)),
            [b'A', ref warning @ ..] => Ok(text(Severity::Warning, warning)),
            [b'E', ref error @ ..] => Ok(text(Severity::Error, error)),
            [letter @ (b'I' | b'C' | b'M' | b'B' | b'T'), ..] => {
                Err(Refusal::WrongLength { letter, found: body.len() })
            }
            [letter, ..] => Err(Refusal::UnknownLetter(letter)),
            [] => Err(Refusal::WrongLength { letter: 0, found: 0 }),
        }
    }
}
