//! The board's end of the toy.

use super::{Line, MAX_LINE, Reader, VERSION};
use crate::board::{Board, BoardParams, Measurements, Micros, Noted};
use alloc::vec::Vec;
use tilthex_core::{
    MAX_ROTORS, RotorVector, Vehicle,
    plant::{Battery, rotor_current},
};

/// Duration of the start of a motor.
const START: Micros = 300_000;
/// Motors without speeds for this time stop.
pub const STOP: Micros = 1_000_000;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Motor {
    #[default]
    Stands,
    Starts(Micros),
    Spins,
}

#[derive(Clone, Copy, Debug, Default)]
struct Stream {
    period: Micros,
    next: Micros,
}

impl Stream {
    fn due(&mut self, now: Micros) -> bool {
        let due = self.period > 0 && now >= self.next;
        if due {
            self.next += self.period;
        }
        due
    }
}

/// The board.
#[derive(Clone, Debug)]
pub struct Plain {
    reader: Reader,
    battery: Battery,
    lowest: Vec<f64>,
    highest: Vec<f64>,
    motors: Vec<Motor>,
    speeds: [f64; MAX_ROTORS],
    heard: Micros,
    streams: [Stream; 3],
    number: u8,
    flew: bool,
    noted: Noted,
}

impl Plain {
    /// A board that was just powered, for the rotors of a vehicle.
    #[must_use]
    pub fn new(vehicle: &Vehicle, params: BoardParams) -> Self {
        Self {
            reader: Reader::default(),
            battery: params.battery,
            lowest: vehicle.rotors().iter().map(|rotor| rotor.min_speed.max(0.0)).collect(),
            highest: vehicle.rotors().iter().map(|rotor| rotor.max_speed).collect(),
            motors: alloc::vec![Motor::default(); vehicle.rotor_count()],
            speeds: [0.0; MAX_ROTORS],
            heard: 0,
            streams: [Stream::default(); 3],
            number: 0,
            flew: false,
            noted: Noted::default(),
        }
    }

    fn obey(&mut self, line: &Line, now: Micros, out: &mut Vec<u8>) {
        match (line.letter, line.numbers()) {
            (b'v', []) => send(b'v', [VERSION], out),
            (b'r', periods) => {
                for (stream, period) in self.streams.iter_mut().zip(periods) {
                    *stream = Stream { period: u64::from(period.unsigned_abs()), next: now };
                }
            }
            (b'w', speeds) => {
                self.noted.commands_received += 1;
                self.heard = now;
                for (slot, speed) in self.speeds.iter_mut().zip(speeds) {
                    *slot = 1e-3 * f64::from(*speed);
                }
            }
            (b'g', [index]) => {
                let motor = self.motors.get_mut(*index as usize);
                if let Some(motor) = motor.filter(|motor| **motor == Motor::Stands) {
                    *motor = Motor::Starts(now + START);
                    self.noted.first_start.get_or_insert(now);
                }
            }
            (b'x', [index]) => {
                if let Some(motor) = self.motors.get_mut(*index as usize) {
                    *motor = Motor::Stands;
                }
            }
            (b'k', []) => self.stop(),
            _ => {}
        }
    }

    fn stop(&mut self) {
        self.motors.fill(Motor::Stands);
        if !self.flew {
            self.noted.first_start = None;
        }
    }
}

fn send(letter: u8, numbers: impl IntoIterator<Item = i32>, out: &mut Vec<u8>) {
    let mut bytes = [0; MAX_LINE];
    let length = Line::new(letter, numbers).encode(&mut bytes);
    out.extend_from_slice(&bytes[..length]);
}

impl Board for Plain {
    fn receive(&mut self, bytes: &[u8], now: Micros, out: &mut Vec<u8>) {
        for byte in bytes {
            if let Some(line) = self.reader.push(*byte) {
                self.obey(&line, now, out);
            }
        }
    }

    fn advance(
        &mut self,
        now: Micros,
        dt: f64,
        true_speeds: &RotorVector,
        measure: impl FnOnce() -> Measurements,
        out: &mut Vec<u8>,
    ) {
        self.battery.advance(&true_speeds.as_slice()[..self.motors.len()], dt);
        for motor in &mut self.motors {
            if matches!(motor, Motor::Starts(until) if now >= *until) {
                (*motor, self.heard) = (Motor::Spins, now);
            }
        }
        self.flew |= self.motors.iter().all(|motor| *motor == Motor::Spins);
        if now > self.heard + STOP && self.motors.contains(&Motor::Spins) {
            self.stop();
        }
        let [imu, motors, battery] = self.streams.each_mut().map(|stream| stream.due(now));
        if imu || motors {
            let measured = measure();
            if imu {
                self.noted.samples_sent += 1;
                self.number = self.number.wrapping_add(1);
                let rates = measured.imu.gyro_i.iter().map(|x| libm::round(1e4 * x) as i32);
                let forces = measured.imu.specific_force_i.iter().map(|x| libm::round(1e3 * x) as i32);
                send(b'i', [i32::from(self.number)].into_iter().chain(rates).chain(forces), out);
            }
            for (index, motor) in self.motors.iter().enumerate().filter(|_| motors) {
                let speed = measured.rotor_speeds[index];
                let state = match motor {
                    Motor::Stands => 0,
                    Motor::Starts(_) => 1,
                    Motor::Spins => 2,
                };
                let milli = [speed, rotor_current(speed)].map(|x| (1e3 * x) as i32);
                send(b'm', [index as i32, state].into_iter().chain(milli), out);
            }
        }
        if battery {
            send(b'b', [(1e3 * self.battery.voltage()) as i32], out);
        }
    }

    fn commands(&self) -> RotorVector {
        RotorVector::from_fn(|index, _| match self.motors.get(index) {
            None | Some(Motor::Stands) => 0.0,
            Some(Motor::Starts(_)) => 0.5 * self.lowest[index],
            Some(Motor::Spins) => self.speeds[index].clamp(self.lowest[index], self.highest[index]),
        })
    }

    fn noted(&self) -> Noted {
        self.noted
    }
}
