//! A text protocol, one line a message: the host's end.
//!
//! From the vehicle: `I gx gy gz ax ay az` (rad/s, m/s^2), `M number speed spins` (from 1, Hz, 0 or 1), `B volts`.
//! To the vehicle: `S` stops all motors, `G` starts them, `T speed...` gives each its speed in tenths of a hertz.

use crate::{Awaited, FrameLengths, InertialDue, LinkParams, Outgoing, Severity, Text, VehicleLink, bump};
use core::fmt::Write as _;
use tilthex_core::{
    Error, RotorVector, Vector3,
    flight::{Inertial, MotorCommand, Telemetry},
    supervisor::limits::STREAM_SILENT,
};

/// Longest line, bytes.
const LINE: usize = 96;

/// The host's end of the link.
#[derive(Clone, Debug)]
pub struct Host {
    line: [u8; LINE],
    length: usize,
    awaited: Awaited,
    telemetry: Telemetry,
    rotor_count: usize,
}

impl Host {
    /// Before the first byte.
    ///
    /// # Errors
    /// None.
    pub fn new(_: LinkParams, rotor_count: usize) -> Result<Self, Error> {
        let telemetry = Telemetry::new(rotor_count);
        Ok(Self { line: [0; LINE], length: 0, awaited: Awaited::default(), telemetry, rotor_count })
    }

    /// Takes a whole line; whether it means something.
    fn take(&mut self, line: &str, now: f64) -> bool {
        let mut words = line.split(' ');
        let kind = words.next();
        let mut number = || words.next().and_then(|w| w.parse::<f64>().ok()).filter(|x| x.is_finite());
        let mut three = || Some(Vector3::new(number()?, number()?, number()?));
        match kind {
            Some("I") => {
                let (Some(gyro_i), Some(specific_force_i)) = (three(), three()) else { return false };
                let sample = Inertial { time: now, gyro_i, specific_force_i, shaken: false };
                self.telemetry.inertial.push(now, sample);
            }
            Some("M") => {
                let (Some(motor), Some(speed), Some(spins)) = (number(), number(), number()) else {
                    return false;
                };
                let Some(motor) = self.telemetry.motor_mut((motor as usize).wrapping_sub(1)) else {
                    return false;
                };
                (motor.heard, motor.speed, motor.spinning) = (now, speed, spins > 0.5);
            }
            Some("B") => self.telemetry.battery = number(),
            _ => return false,
        }
        true
    }

    fn speeds(&self, speeds: &RotorVector, out: &mut Outgoing) {
        out.append(|free| {
            let mut line = Writer { free, length: 0 };
            let mut whole = line.write_str("T").is_ok();
            for speed in speeds.iter().take(self.rotor_count) {
                whole &= write!(line, " {}", (10.0 * speed) as i32).is_ok();
            }
            whole &= line.write_str("\n").is_ok();
            if whole { line.length } else { 0 }
        });
    }
}

/// A text of fixed capacity.
struct Writer<'a> {
    free: &'a mut [u8],
    length: usize,
}

impl core::fmt::Write for Writer<'_> {
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        let room = self.free.get_mut(self.length..self.length + text.len()).ok_or(core::fmt::Error)?;
        room.copy_from_slice(text.as_bytes());
        self.length += text.len();
        Ok(())
    }
}

fn word(text: &[u8], out: &mut Outgoing) {
    out.append(|free| match free.get_mut(..text.len()) {
        Some(room) => {
            room.copy_from_slice(text);
            text.len()
        }
        None => 0,
    });
}

impl VehicleLink for Host {
    fn look(&mut self, bytes: &[u8]) -> InertialDue {
        if bytes.contains(&b'I') && bytes.ends_with(b"\n") {
            self.awaited.arrive();
        }
        self.awaited.due()
    }

    fn receive(&mut self, bytes: &[u8], now: f64) -> &Telemetry {
        self.awaited.end_tick();
        self.telemetry.begin_tick();
        for &byte in bytes {
            if byte != b'\n' {
                if let Some(room) = self.line.get_mut(self.length) {
                    *room = byte;
                    self.length += 1;
                }
                continue;
            }
            let line = self.line;
            let text = line.get(..core::mem::take(&mut self.length)).unwrap_or_default();
            let known = core::str::from_utf8(text).is_ok_and(|text| self.take(text, now));
            let link = &mut self.telemetry.link;
            if known {
                (link.identified, link.heard) = (true, now);
                bump(&mut link.messages);
            } else {
                bump(&mut link.refused_frames);
            }
        }
        self.telemetry.link.ready =
            self.telemetry.inertial.age(now) < STREAM_SILENT && self.telemetry.motor_age(now) < STREAM_SILENT;
        &self.telemetry
    }

    fn telemetry(&self) -> &Telemetry {
        &self.telemetry
    }

    fn text(&self) -> Option<(Severity, Text)> {
        None
    }

    fn command(&mut self, command: &MotorCommand, _: f64, out: &mut Outgoing) {
        match command {
            MotorCommand::Stop => word(b"S\n", out),
            MotorCommand::Start(speeds) => {
                word(b"G\n", out);
                self.speeds(speeds, out);
            }
            MotorCommand::Turn(speeds) => self.speeds(speeds, out),
        }
    }

    fn frames(&self) -> FrameLengths {
        FrameLengths { inertial: 60, motor: 14, battery: 8, command: 2 + 5 * self.rotor_count as u16 }
    }

    fn refused(&self) -> bool {
        false
    }

    fn part(&mut self, _: &mut Outgoing) {}
}
