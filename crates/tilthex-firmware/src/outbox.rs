//! What goes to the base: identity, streams, texts, records.

use crate::{board::Board, inbox::Received, sensing::Sensors};
use tilthex_core::{
    flight::Record,
    supervisor::{Fault, FaultSet, Phase, Reaction, Row},
};
use tilthex_link::{
    Outgoing, Severity, Text,
    onboard::{Answer, Facts, IDENTITY, Periods, RecordParts, ToBase},
    tk3::{
        ImuFrame, ImuScales, MotorFrame, MotorState, Schedule, Stream, VehicleMessage, nearest_half_period,
    },
};

/// The units of the counts in the inertial stream.
const SCALES: ImuScales = ImuScales::MILLI;

/// After each of this many records, the periods of the streams are told.
const RECORDS: u8 = 32;

/// The part of a record that is sent next, and the periods after it. A tick sends one of them at most.
#[derive(Clone, Copy, Debug)]
enum Next {
    Flight(RecordParts),
    State(RecordParts),
    Tool(RecordParts),
    Periods,
}

/// The sending end of the line.
#[derive(Clone, Debug)]
pub(crate) struct Outbox {
    announced: bool,
    imu: Schedule,
    motors: Schedule,
    battery: Schedule,
    records: Schedule,
    next: Option<Next>,
    phase: Phase,
    faults: FaultSet,
    text: Option<(Severity, Text)>,
    motor_number: u8,
}

impl Outbox {
    pub(crate) fn new() -> Self {
        Self {
            announced: false,
            imu: Schedule::default(),
            motors: Schedule::default(),
            battery: Schedule::default(),
            records: Schedule::default(),
            next: None,
            phase: Phase::Disarmed,
            faults: FaultSet::NONE,
            text: None,
            motor_number: 0,
        }
    }

    /// Sends a text as soon as possible, before every other text.
    pub(crate) fn say(&mut self, severity: Severity, parts: &[&str]) {
        self.text = Some((severity, Text::of(parts)));
    }

    /// Sends what is due. `told` gives what a record needs beside the flight's own.
    pub(crate) fn speak(
        &mut self,
        board: &mut impl Board,
        micros: u64,
        received: &Received,
        sensors: &Sensors,
        record: &Record,
        told: (Facts, Option<u8>, Answer),
    ) {
        let mut out = Outgoing::default();
        self.set_periods(received, micros);
        if received.identify || !self.announced {
            // Without a request it says that the board has started.
            self.announced = true;
            append(&mut out, VehicleMessage::Identity(Text::of(&[IDENTITY])));
        }
        if let Some((severity, text)) = self.text.take().or_else(|| self.news(record)) {
            append(&mut out, VehicleMessage::Text { severity, text });
        }
        self.stream(micros, sensors, &mut out);
        self.next = match self.next.take() {
            Some(Next::Flight(parts)) => {
                out.append(|b| ToBase::Flight(parts.flight).encode(b));
                Some(Next::State(parts))
            }
            Some(Next::State(parts)) => {
                out.append(|b| ToBase::State(parts.state).encode(b));
                Some(Next::Tool(parts))
            }
            Some(Next::Tool(parts)) => {
                out.append(|b| ToBase::Tool(parts.tool).encode(b));
                parts.tool.number.is_multiple_of(RECORDS).then_some(Next::Periods)
            }
            Some(Next::Periods) => {
                out.append(|b| ToBase::Periods(self.periods()).encode(b));
                None
            }
            None if self.records.due(micros) => {
                let (facts, ended_by, answer) = told;
                let number = self.records.sequence();
                Some(Next::Flight(RecordParts::new(number, record, facts, ended_by, answer)))
            }
            None => None,
        };
        if !out.bytes().is_empty() {
            board.write(out.bytes());
        }
    }

    fn periods(&self) -> Periods {
        Periods {
            battery: self.battery.period(),
            motors: self.motors.period(),
            imu: self.imu.period(),
            records: self.records.period(),
        }
    }

    fn set_periods(&mut self, received: &Received, micros: u64) {
        for (stream, period) in received.rates.iter().flatten() {
            match stream {
                Stream::Battery => self.battery.set(*period, micros),
                Stream::Motors => self.motors.set(*period, micros),
                Stream::Imu => self.imu.set(*period, micros),
                // There is no magnetometer.
                Stream::Magnetometer => {}
            }
        }
        if let Some(period) = received.records {
            self.records.set(period, micros);
        }
    }

    fn stream(&mut self, micros: u64, sensors: &Sensors, out: &mut Outgoing) {
        if let Some(reading) = sensors.imu.filter(|_| self.imu.due(micros)) {
            let (accelerometer, gyro) = SCALES.encode(&reading.specific_force_i, &reading.gyro_i);
            let sequence = self.imu.sequence();
            append(out, VehicleMessage::Imu(ImuFrame { sequence, accelerometer, gyro, temperature: None }));
        }
        if self.motors.due(micros) {
            self.motor_number = self.motor_number.wrapping_add(1);
            for (number, motor) in (1..).zip(sensors.telemetry.motors()) {
                let bit = |bit, set| if set { bit } else { 0 };
                let state = number & 0x0f
                    | bit(MotorState::STARTING, motor.starting)
                    | bit(MotorState::SPINNING, motor.spinning)
                    | bit(MotorState::EMERGENCY, motor.emergency);
                let frame = MotorFrame {
                    sequence: self.motor_number,
                    state: MotorState(state),
                    half_period: nearest_half_period(motor.speed),
                    throttle: 0,
                    current_ma: (1e3 * motor.current) as u16,
                };
                append(out, VehicleMessage::Motor(frame));
            }
        }
        if let Some(volts) = sensors.telemetry.battery.filter(|_| self.battery.due(micros)) {
            let sequence = self.battery.sequence();
            append(out, VehicleMessage::Battery { sequence, millivolts: (1e3 * volts) as u16 });
        }
    }

    /// The next text about a phase or a fault that is new, or over.
    fn news(&mut self, record: &Record) -> Option<(Severity, Text)> {
        if record.phase != self.phase {
            self.phase = record.phase;
            return Some((Severity::Note, Text::of(&["phase: ", record.phase.name()])));
        }
        let first = |faults: u64| FaultSet(faults).rows().next();
        if let Some(row) = first(record.faults.0 & !self.faults.0) {
            self.faults.insert_if(row.fault, true);
            return Some((severity(row, record.phase), Text::of(&["fault: ", row.name])));
        }
        let row = first(self.faults.0 & !record.faults.0)?;
        self.faults.0 &= !(1 << row.fault as u8);
        Some((Severity::Note, Text::of(&["over: ", row.name])))
    }
}

/// How serious a fault is in a phase.
fn severity(row: &Row, phase: Phase) -> Severity {
    let reaction = if phase.in_flight() { row.in_flight } else { row.on_ground };
    match reaction {
        // An ordered landing is no fault of the vehicle.
        _ if row.fault == Fault::Operator => Severity::Note,
        Reaction::Note => Severity::Note,
        Reaction::Refuse | Reaction::Hold => Severity::Warning,
        Reaction::Land | Reaction::Descend => Severity::Error,
    }
}

fn append(out: &mut Outgoing, message: VehicleMessage) {
    out.append(|b| ToBase::Tk3(message).encode(b));
}
