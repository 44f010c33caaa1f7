//! The host's end of the toy.

use super::{Line, Reader, VERSION};
use crate::{
    Arrival, Awaited, FrameLengths, Gate, GateParams, InertialDue, LineDelay, LinkParams, Outgoing,
    SequenceClock, Severity, Text, VehicleLink, Verdict,
};
use core::convert::Infallible;
use tilthex_core::{
    Error, Vector3,
    clock_sync::ClockParams,
    flight::{Inertial, MotorCommand, Telemetry},
    supervisor::limits::{IMU_FROZEN, STREAM_SILENT},
    types::{MAX_ROTORS, RotorVector},
};

/// Time between two questions for the version, and between two orders to a motor, s.
const ASK_EVERY: f64 = 0.1;
/// Number of questions after which the link gives up.
const MOST_QUESTIONS: u32 = 20;
/// Motors that were driven get orders to stop for this time, s.
const INSIST: f64 = 0.5;
/// A time before every other time, s.
const LONG_AGO: f64 = -1e9;

/// The host's end of the link.
#[derive(Clone, Debug)]
pub struct Host {
    params: LinkParams,
    rotor_count: usize,
    reader: Reader,
    looked: Reader,
    awaited: Awaited,
    clock: SequenceClock,
    delay: LineDelay,
    gate: Gate<6>,
    last: Option<Line>,
    same: u32,
    telemetry: Telemetry,
    asked: f64,
    questions: u32,
    ordered: f64,
    next_motor: usize,
    driven: bool,
    insist: f64,
}

impl Host {
    /// The host's end before the first byte, for a vehicle with `rotor_count` rotors.
    ///
    /// # Errors
    /// If the period of the inertial stream is not possible.
    pub fn new(params: LinkParams, rotor_count: usize) -> Result<Self, Error> {
        let most = [100.0, 100.0, 100.0, 400.0, 400.0, 400.0];
        let jump = [f64::INFINITY; 6];
        Ok(Self {
            params,
            rotor_count,
            reader: Reader::default(),
            looked: Reader::default(),
            awaited: Awaited::default(),
            clock: SequenceClock::new(1e-6 * f64::from(params.imu_period_us), ClockParams::default())?,
            delay: LineDelay::default(),
            gate: Gate::new(GateParams { min: most.map(|x| -x), max: most, jump, patience: 0, longest: 0 })?,
            last: None,
            same: 0,
            telemetry: Telemetry::new(rotor_count),
            asked: LONG_AGO,
            questions: 0,
            ordered: LONG_AGO,
            next_motor: 0,
            driven: false,
            insist: LONG_AGO,
        })
    }

    fn take(&mut self, line: &Line, now: f64) {
        match (line.letter, line.numbers()) {
            (b'v', [VERSION]) => {
                self.telemetry.link.rebooted = self.telemetry.link.identified;
                self.telemetry.link.identified = true;
                self.asked = LONG_AGO;
            }
            (b'i', [number, readings @ ..]) => self.take_inertial(line, *number as u8, readings, now),
            (b'm', [index, state, speed, current]) => {
                let index = usize::try_from(*index).ok();
                let Some(motor) = index.and_then(|index| self.telemetry.motor_mut(index)) else { return };
                motor.heard = now;
                motor.speed = 1e-3 * f64::from(*speed);
                motor.current = 1e-3 * f64::from(*current);
                (motor.starting, motor.spinning) = (*state == 1, *state == 2);
            }
            (b'b', [millivolts]) => self.telemetry.battery = Some(1e-3 * f64::from(*millivolts)),
            _ => {}
        }
    }

    fn take_inertial(&mut self, line: &Line, number: u8, readings: &[i32], now: f64) {
        let [wx, wy, wz, fx, fy, fz] = *readings else { return };
        let Arrival::New { time, lost, .. } = self.clock.step(number, now) else { return };
        let inertial = &mut self.telemetry.inertial;
        inertial.line_delay = self.clock.made().map_or(0.0, |made| self.delay.step(made, now));
        let alike = |last: Line| last.numbers().get(1..) == line.numbers().get(1..);
        self.same = if self.last.replace(*line).is_some_and(alike) { self.same.saturating_add(1) } else { 0 };
        inertial.frozen = self.same >= IMU_FROZEN;
        let gyro_i = Vector3::from([wx, wy, wz].map(|x| 1e-4 * f64::from(x)));
        let specific_force_i = Vector3::from([fx, fy, fz].map(|x| 1e-3 * f64::from(x)));
        let (w, f) = (&gyro_i, &specific_force_i);
        let verdict = self.gate.step(&[w.x, w.y, w.z, f.x, f.y, f.z], lost);
        inertial.refused_now |= verdict != Verdict::Pass;
        if verdict == Verdict::Pass && !inertial.frozen {
            inertial.push(now, Inertial { time, gyro_i, specific_force_i, shaken: false });
        }
    }

    fn silent(&self, now: f64) -> bool {
        self.telemetry.inertial.age(now) > STREAM_SILENT || self.telemetry.motor_age(now) > STREAM_SILENT
    }

    fn send(&self, letter: u8, numbers: impl IntoIterator<Item = i32>, out: &mut Outgoing) {
        let line = Line::new(letter, numbers);
        out.append(|bytes| line.encode(bytes));
    }

    fn send_speeds(&self, speeds: &RotorVector, out: &mut Outgoing) {
        let speeds = speeds.iter().take(self.rotor_count).map(|speed| (1e3 * speed) as i32);
        self.send(b'w', speeds, out);
    }

    /// Sends an order to each motor that `order` names, ten times a second at most.
    fn order(
        &mut self,
        order: impl Fn(usize, bool) -> Option<u8>,
        most: usize,
        now: f64,
        out: &mut Outgoing,
    ) {
        if now - self.ordered < ASK_EVERY {
            return;
        }
        let first = self.next_motor;
        let motors = self.telemetry.motors().iter().enumerate();
        let after_first = motors.clone().skip(first).chain(motors.take(first));
        let turns = |motor: &tilthex_core::flight::Motor| motor.spinning || motor.starting;
        let orders = after_first.filter_map(|(index, motor)| Some((index, order(index, turns(motor))?)));
        for (index, letter) in orders.take(most) {
            let line = Line::new(letter, [index as i32]);
            out.append(|bytes| line.encode(bytes));
            self.ordered = now;
            self.next_motor = index + 1;
        }
    }

    /// Asks for the version until it comes, then for streams that are silent.
    fn ask(&mut self, now: f64, out: &mut Outgoing) {
        if !self.telemetry.link.identified {
            if now - self.asked >= ASK_EVERY {
                self.send(b'v', [], out);
                self.asked = now;
                self.questions = self.questions.saturating_add(1);
            }
        } else if self.silent(now) && now - self.asked >= STREAM_SILENT {
            let LinkParams { imu_period_us, motor_period_us, battery_period_us, .. } = self.params;
            let periods = [imu_period_us, motor_period_us, battery_period_us];
            self.send(b'r', periods.map(|period| i32::try_from(period).unwrap_or(i32::MAX)), out);
            self.asked = now;
        }
    }
}

impl VehicleLink for Host {
    type Complaint = Infallible;

    fn look(&mut self, bytes: &[u8]) -> InertialDue {
        for byte in bytes {
            if self.looked.push(*byte).is_some_and(|line| line.letter == b'i') {
                self.awaited.arrive();
            }
        }
        self.awaited.due()
    }

    fn receive(&mut self, bytes: &[u8], now: f64) -> &Telemetry {
        self.awaited.end_tick();
        self.telemetry.begin_tick();
        for byte in bytes {
            if let Some(line) = self.reader.push(*byte) {
                self.telemetry.link.heard = now;
                self.take(&line, now);
            }
        }
        let (silent, refused) = (self.silent(now), self.gate.counters().out_of_range);
        let link = &mut self.telemetry.link;
        link.ready = link.identified && !silent;
        link.messages = self.reader.accepted;
        link.refused_frames = self.reader.refused;
        link.refused_samples = refused;
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
            MotorCommand::Stop | MotorCommand::Kill => {
                let at_once = core::mem::take(&mut self.driven);
                if at_once {
                    self.insist = now + INSIST;
                }
                let wanted = self.telemetry.any_spinning() || now < self.insist;
                if at_once || (wanted && now - self.ordered >= ASK_EVERY) {
                    self.send(b'k', [], out);
                    self.ordered = now;
                }
            }
            MotorCommand::Alone(motor, speeds) => {
                self.driven = true;
                self.send_speeds(speeds, out);
                let letter = |index, turns: bool| match (index == *motor, turns) {
                    (true, false) => Some(b'g'),
                    (false, true) => Some(b'x'),
                    _ => None,
                };
                self.order(letter, MAX_ROTORS, now, out);
            }
            MotorCommand::Start(speeds) => {
                self.driven = true;
                self.send_speeds(speeds, out);
                self.order(|_, turns| (!turns).then_some(b'g'), 1, now, out);
            }
            MotorCommand::Turn(speeds) => {
                self.driven = true;
                self.send_speeds(speeds, out);
            }
        }
        self.ask(now, out);
    }

    fn frames(&self) -> FrameLengths {
        let length = |letter, numbers: &[i32]| {
            let mut bytes = [0; super::MAX_LINE];
            Line::new(letter, numbers.iter().copied()).encode(&mut bytes) as u16
        };
        let (most_rate, most_force) = (-1_000_000, -400_000);
        let speeds = [-100_000; MAX_ROTORS];
        FrameLengths {
            inertial: length(
                b'i',
                &[255, most_rate, most_rate, most_rate, most_force, most_force, most_force],
            ),
            motor: length(b'm', &[11, 2, -100_000, 10_000]),
            battery: length(b'b', &[10_000]),
            command: length(b'w', speeds.get(..self.rotor_count).unwrap_or(&speeds)),
        }
    }

    fn refused(&self) -> bool {
        !self.telemetry.link.identified && self.questions > MOST_QUESTIONS
    }

    fn part(&mut self, out: &mut Outgoing) {
        self.send(b'r', [0, 0, 0], out);
    }
}
