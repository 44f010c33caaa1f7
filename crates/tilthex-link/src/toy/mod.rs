//! A text protocol, one line for each message: the host's end.
//!
//! From the vehicle: `V` (it is there), `I number gyro*3 force*3` (u8; mrad/s; mm/s^2),
//! `M number speed spins` (from 1; mHz; 0 or 1), `B millivolts`. From the host: `H` (who is there?),
//! `S` (all motors stop), `G number` and `X number` (one starts, stops), `T speed...` (mHz).

mod line;

use crate::{
    Arrival, Awaited, FrameLengths, Gate, GateParams, InertialDue, LinkParams, Outgoing, SequenceClock,
    Severity, Text, VehicleLink, Verdict, bump,
};
use line::{Lines, Message};
use tilthex_core::{
    Error, Vector3,
    clock_sync::ClockParams,
    flight::{Inertial, MotorCommand, Telemetry},
    supervisor::limits::STREAM_SILENT,
    types::RotorVector,
};

/// Between two questions who is there, s.
const ASK_EVERY: f64 = 0.5;
/// After this many questions the link gives up.
const QUESTIONS: u32 = 4;

/// The host's end of the link.
#[derive(Clone, Debug)]
pub struct Host {
    /// Lines that are received, and the same bytes as they are looked at before.
    lines: [Lines; 2],
    awaited: Awaited,
    clock: SequenceClock,
    gate: Gate<6>,
    telemetry: Telemetry,
    asked: f64,
    questions: u32,
}

impl Host {
    /// Before the first byte, for a vehicle with `rotor_count` rotors.
    ///
    /// # Errors
    /// A period of the inertial stream that [`SequenceClock::new`] refuses.
    pub fn new(params: LinkParams, rotor_count: usize) -> Result<Self, Error> {
        let (max, jump) = ([100.0, 100.0, 100.0, 400.0, 400.0, 400.0], [3.0, 3.0, 3.0, 40.0, 40.0, 40.0]);
        let gate = GateParams { min: max.map(|x: f64| -x), max, jump, patience: 4, longest: 2 };
        let period = f64::from(params.imu_period_us) * 1e-6;
        Ok(Self {
            lines: [Lines::default(); 2],
            awaited: Awaited::default(),
            clock: SequenceClock::new(period, ClockParams::default())?,
            gate: Gate::new(gate)?,
            telemetry: Telemetry::new(rotor_count),
            asked: f64::NEG_INFINITY,
            questions: 0,
        })
    }

    /// Takes a message; whether it is one that the vehicle sends.
    fn take(&mut self, message: &Message, now: f64) -> bool {
        match (message.letter, message.numbers()) {
            (b'V', []) => self.telemetry.link.identified = true,
            (b'I', &[number @ 0..256, wx, wy, wz, fx, fy, fz]) => {
                self.take_inertial(number as u8, [wx, wy, wz, fx, fy, fz].map(|x| 1e-3 * f64::from(x)), now);
            }
            (b'M', &[number @ 1..=255, speed, spins @ 0..2]) => {
                if let Some(motor) = self.telemetry.motor_mut(number as usize - 1) {
                    (motor.heard, motor.speed, motor.spinning) = (now, 1e-3 * f64::from(speed), spins == 1);
                }
            }
            (b'B', &[millivolts]) => self.telemetry.battery = Some(1e-3 * f64::from(millivolts)),
            _ => return false,
        }
        true
    }

    fn take_inertial(&mut self, number: u8, values: [f64; 6], now: f64) {
        let (time, lost) = match self.clock.step(number, now) {
            Arrival::New { time, lost, .. } => (time, lost),
            Arrival::Duplicate => return,
            Arrival::Suspect => (now, 1),
        };
        if self.gate.step(&values, lost) == Verdict::Pass {
            let [wx, wy, wz, fx, fy, fz] = values;
            let (gyro_i, specific_force_i) = (Vector3::new(wx, wy, wz), Vector3::new(fx, fy, fz));
            self.telemetry.inertial.push(now, Inertial { time, gyro_i, specific_force_i, shaken: false });
        } else {
            self.telemetry.inertial.refused_now = true;
        }
    }

    fn send_speeds(&self, speeds: &RotorVector, out: &mut Outgoing) {
        let count = self.telemetry.motors().len();
        out.append(|free| {
            line::write(free, b'T', speeds.iter().take(count).map(|speed| (1e3 * speed.abs()) as u32))
        });
    }

    /// Starts each motor that stands, of those that `wanted` names; stops the others.
    fn send_starts(&self, wanted: impl Fn(usize) -> bool, out: &mut Outgoing) {
        for (index, motor) in self.telemetry.motors().iter().enumerate() {
            if motor.spinning != wanted(index) {
                let letter = if wanted(index) { b'G' } else { b'X' };
                out.append(|free| line::write(free, letter, core::iter::once(index as u32 + 1)));
            }
        }
    }
}

impl VehicleLink for Host {
    fn look(&mut self, bytes: &[u8]) -> InertialDue {
        let [_, lines] = &mut self.lines;
        for byte in bytes {
            if lines.push(*byte).flatten().is_some_and(|message| message.letter == b'I') {
                self.awaited.arrive();
            }
        }
        self.awaited.due()
    }

    fn receive(&mut self, bytes: &[u8], now: f64) -> &Telemetry {
        self.awaited.end_tick();
        self.telemetry.begin_tick();
        for byte in bytes {
            let [lines, _] = &mut self.lines;
            let Some(line) = lines.push(*byte) else { continue };
            if line.is_some_and(|message| self.take(&message, now)) {
                self.telemetry.link.heard = now;
                bump(&mut self.telemetry.link.messages);
            } else {
                bump(&mut self.telemetry.link.refused_frames);
            }
        }
        let gate = self.gate.counters();
        let (inertial, motors) = (self.telemetry.inertial.age(now), self.telemetry.motor_age(now));
        let link = &mut self.telemetry.link;
        link.ready = link.identified && inertial.max(motors) < STREAM_SILENT;
        link.refused_samples = gate.out_of_range.saturating_add(gate.jumps);
        link.lost_samples = self.clock.counters().lost;
        &self.telemetry
    }

    fn telemetry(&self) -> &Telemetry {
        &self.telemetry
    }

    fn text(&self) -> Option<(Severity, Text)> {
        None
    }

    fn command(&mut self, command: &MotorCommand, now: f64, out: &mut Outgoing) {
        match command {
            MotorCommand::Stop => out.append(|free| line::write(free, b'S', core::iter::empty())),
            MotorCommand::Alone(motor, speeds) => {
                self.send_speeds(speeds, out);
                self.send_starts(|index| index == *motor, out);
            }
            MotorCommand::Start(speeds) => {
                self.send_speeds(speeds, out);
                self.send_starts(|_| true, out);
            }
            MotorCommand::Turn(speeds) => self.send_speeds(speeds, out),
        }
        if !self.telemetry.link.identified && now - self.asked >= ASK_EVERY {
            out.append(|free| line::write(free, b'H', core::iter::empty()));
            (self.asked, self.questions) = (now, self.questions.saturating_add(1));
        }
    }

    fn frames(&self) -> FrameLengths {
        // `I 255` and six numbers of up to seven bytes; `T` and numbers of up to six digits.
        let command = 2 + 7 * self.telemetry.motors().len() as u16;
        FrameLengths { inertial: 6 + 6 * 8, motor: 14, battery: 8, command }
    }

    fn refused(&self) -> bool {
        !self.telemetry.link.identified && self.questions > QUESTIONS
    }

    fn part(&mut self, _: &mut Outgoing) {}
}
