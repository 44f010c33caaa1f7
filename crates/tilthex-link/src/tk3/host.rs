//! The host's end of the conversation: identity, stream rates, starting and stopping motors, and the contents of the
//! streams. It follows the sequence of `docs/protocols.md` and never waits.

use super::{
    Frame, HostMessage, Identity, ImuFrame, MotorFrame, MotorState, MotorValues, Receiver, Stream,
    VehicleMessage, imu_stream::ImuStream, scan::Scan,
};
use crate::{
    Awaited, FrameLengths, Gate, GateCounters, InertialDue, LONG_AGO, LinkParams, Outgoing, Severity, Text,
    VehicleLink, Verdict,
};
use core::convert::Infallible;
use tilthex_core::{
    Error,
    flight::{MotorCommand, Telemetry},
    supervisor::limits::STREAM_SILENT,
    types::{MAX_ROTORS, RotorVector},
};

/// Time between two identity requests, s.
const IDENTIFY_EVERY: f64 = 0.5;
/// Number of identity requests.
const IDENTIFY_TRIES: u32 = 4;
/// Time between two start or stop commands, s.
const MOTOR_COMMAND_EVERY: f64 = 0.1;
/// Motors that were driven get stop commands for at least this time, s, whatever state they report.
const INSIST: f64 = 0.5;

/// The state of the conversation.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Identify { tries: u32, asked: f64 },
    Refused,
    Streams { asked: f64 },
}

/// The host's end of the link.
#[derive(Clone, Debug)]
pub struct Host {
    params: LinkParams,
    stage: Stage,
    receiver: Receiver<VehicleMessage>,
    scan: Scan,
    awaited: Awaited,
    imu: ImuStream,
    telemetry: Telemetry,
    /// State of each motor's newest frame.
    motor_states: [Option<MotorState>; MAX_ROTORS],
    motor_gates: [Gate<1>; MAX_ROTORS],
    rotor_count: usize,
    text: Option<(Severity, Text)>,
    motor_asked: f64,
    next_motor: usize,
    /// The motor that is driven alone, from 0.
    alone: Option<usize>,
    /// Whether motors were started or turned since the last stop, and the time until which stops are repeated, s.
    driven: bool,
    insist: f64,
}

impl Host {
    /// The host's end before the first byte, for a vehicle with `rotor_count` rotors.
    ///
    /// # Errors
    /// If the period of a stream is not possible.
    pub fn new(params: LinkParams, rotor_count: usize) -> Result<Self, Error> {
        Ok(Self {
            params,
            stage: Stage::Identify { tries: 0, asked: LONG_AGO },
            receiver: Receiver::default(),
            scan: Scan::default(),
            awaited: Awaited::default(),
            imu: ImuStream::new(&params)?,
            telemetry: Telemetry::new(rotor_count),
            motor_states: [None; MAX_ROTORS],
            motor_gates: [Gate::rotor_speed()?; MAX_ROTORS],
            rotor_count,
            text: None,
            motor_asked: LONG_AGO,
            next_motor: 0,
            alone: None,
            driven: false,
            insist: LONG_AGO,
        })
    }

    fn take(&mut self, message: &VehicleMessage, now: f64) {
        match message {
            VehicleMessage::Identity(text) => self.identify(text),
            VehicleMessage::Imu(frame) => self.imu.take(frame, now, &mut self.telemetry.inertial),
            VehicleMessage::Motor(frame) => self.take_motor(frame, now),
            VehicleMessage::Battery { millivolts, .. } => {
                self.telemetry.battery = Some(f64::from(*millivolts) * 1e-3);
            }
            VehicleMessage::Text { severity, text } => self.text = Some((*severity, *text)),
            VehicleMessage::Magnetometer { .. } | VehicleMessage::Clock { .. } => {}
        }
    }

    fn identify(&mut self, text: &Text) {
        let Some(identity) = Identity::parse(text.as_bytes()) else {
            self.text = Some((Severity::Error, *text));
            return;
        };
        match self.stage {
            Stage::Identify { .. } => {
                self.telemetry.link.identified = true;
                let known = self.imu.know(&identity);
                self.stage = if known { Stage::Streams { asked: LONG_AGO } } else { Stage::Refused };
            }
            // The host did not ask for the identity: the board has restarted.
            Stage::Streams { .. } => {
                self.telemetry.link.rebooted = true;
                self.stage = Stage::Streams { asked: LONG_AGO };
            }
            Stage::Refused => {}
        }
    }

    fn take_motor(&mut self, frame: &MotorFrame, now: f64) {
        let index = usize::from(frame.state.motor()).wrapping_sub(1);
        if index >= self.rotor_count {
            return;
        }
        let Some(gate) = self.motor_gates.get_mut(index) else { return };
        if gate.step(&[frame.speed()], 0) != Verdict::Pass {
            return;
        }
        let states = self.motor_states.get_mut(index);
        if let Some((motor, state)) = self.telemetry.motor_mut(index).zip(states) {
            motor.heard = now;
            motor.speed = frame.speed();
            motor.current = f64::from(frame.current_ma) * 1e-3;
            // There is no checksum: a state counts after two equal frames in a row.
            if state.replace(frame.state) == Some(frame.state) {
                motor.starting = frame.state.is_starting();
                motor.spinning = frame.state.is_spinning();
                motor.emergency = frame.state.is_emergency();
            }
        }
    }

    /// Writes the messages that the conversation needs now: identity requests and stream rates.
    fn talk(&mut self, now: f64, out: &mut Outgoing) {
        match self.stage {
            Stage::Identify { tries, asked } if now - asked >= IDENTIFY_EVERY => {
                if tries < IDENTIFY_TRIES {
                    out.append(|b| HostMessage::Identify.encode(b));
                    self.stage = Stage::Identify { tries: tries + 1, asked: now };
                } else {
                    self.stage = Stage::Refused;
                }
            }
            Stage::Streams { asked } if now - asked >= STREAM_SILENT && self.silent(now) => {
                for (stream, period_us) in [
                    (Stream::Battery, self.params.battery_period_us),
                    (Stream::Motors, self.params.motor_period_us),
                    (Stream::Imu, self.params.imu_period_us),
                ] {
                    out.append(|b| HostMessage::Rate { stream, period_us }.encode(b));
                }
                self.stage = Stage::Streams { asked: now };
            }
            _ => {}
        }
    }

    /// Commanded speeds, Hz; they cannot stop a motor.
    fn send_speeds(&self, speeds: &RotorVector, out: &mut Outgoing) {
        if let Some(values) = speeds.as_slice().get(..self.rotor_count).and_then(MotorValues::from_speeds) {
            out.append(|b| HostMessage::Speeds(values).encode(b));
        }
    }

    /// Starts the next motor that does not spin. Repeats this ten times a second.
    fn send_start(&mut self, now: f64, out: &mut Outgoing) {
        if now - self.motor_asked < MOTOR_COMMAND_EVERY {
            return;
        }
        let motors = self.telemetry.motors();
        let waiting = |i: &usize| motors.get(*i).is_some_and(|m| !m.spinning && !m.starting);
        let order = (self.next_motor..self.rotor_count).chain(0..self.next_motor);
        if let Some(index) = order.into_iter().find(waiting) {
            out.append(|b| HostMessage::Start(index as u8 + 1).encode(b));
            self.next_motor = if index + 1 < self.rotor_count { index + 1 } else { 0 };
            self.motor_asked = now;
        }
    }

    /// Starts one motor and stops every other motor that turns: at once if another motor was driven until now, then
    /// ten times a second.
    fn send_alone(&mut self, motor: usize, now: f64, out: &mut Outgoing) {
        let at_once = self.alone.replace(motor) != Some(motor);
        if !at_once && now - self.motor_asked < MOTOR_COMMAND_EVERY {
            return;
        }
        for (index, known) in self.telemetry.motors().iter().enumerate() {
            let turns = known.spinning || known.starting;
            let number = index as u8 + 1;
            let message = if index == motor { HostMessage::Start(number) } else { HostMessage::Stop(number) };
            if turns != (index == motor) {
                out.append(|b| message.encode(b));
                self.motor_asked = now;
            }
        }
    }

    /// Stops all motors: at once if they were driven until now, then ten times a second while one of them spins, and
    /// in any case for [`INSIST`].
    fn send_stop(&mut self, now: f64, out: &mut Outgoing) {
        let at_once = core::mem::take(&mut self.driven);
        if at_once {
            self.insist = now + INSIST;
        }
        let wanted = self.telemetry.any_spinning() || now < self.insist;
        if at_once || (wanted && now - self.motor_asked >= MOTOR_COMMAND_EVERY) {
            out.append(|b| HostMessage::StopAll.encode(b));
            self.motor_asked = now;
        }
    }

    fn silent(&self, now: f64) -> bool {
        self.telemetry.inertial.age(now) > STREAM_SILENT || self.telemetry.motor_age(now) > STREAM_SILENT
    }

    /// Samples that the gates have refused.
    fn refused_samples(&self) -> u32 {
        let imu = self.imu.gate_counters();
        let motors = self.motor_gates.iter().map(Gate::counters);
        let refused = |sum: u32, c: GateCounters| sum.saturating_add(c.out_of_range).saturating_add(c.jumps);
        motors.fold(refused(0, imu), refused)
    }
}

impl VehicleLink for Host {
    type Complaint = Infallible;

    fn look(&mut self, bytes: &[u8]) -> InertialDue {
        if self.scan.finds_imu(bytes) {
            self.awaited.arrive();
        }
        self.awaited.due()
    }

    fn receive(&mut self, bytes: &[u8], now: f64) -> &Telemetry {
        self.awaited.end_tick();
        self.telemetry.begin_tick();
        self.text = None;
        self.imu.read(now);
        for byte in bytes {
            if let Some(message) = self.receiver.push(*byte) {
                self.telemetry.link.heard = now;
                self.take(&message, now);
            }
        }
        let counters = self.receiver.counters();
        let (ready, refused, lost) = (
            matches!(self.stage, Stage::Streams { .. }) && !self.silent(now),
            self.refused_samples(),
            self.imu.lost(),
        );
        let link = &mut self.telemetry.link;
        link.ready = ready;
        link.messages = counters.messages;
        link.refused_frames = counters.refused();
        link.refused_samples = refused;
        link.lost_samples = lost;
        &self.telemetry
    }

    fn telemetry(&self) -> &Telemetry {
        &self.telemetry
    }

    fn text(&self) -> Option<(Severity, Text)> {
        self.text
    }

    fn command(&mut self, command: &MotorCommand, now: f64, out: &mut Outgoing) {
        self.driven |= !matches!(command, MotorCommand::Stop | MotorCommand::Kill);
        if !matches!(command, MotorCommand::Alone(..)) {
            self.alone = None;
        }
        match command {
            MotorCommand::Stop | MotorCommand::Kill => self.send_stop(now, out),
            MotorCommand::Alone(motor, speeds) => {
                self.send_speeds(speeds, out);
                self.send_alone(*motor, now, out);
            }
            MotorCommand::Start(speeds) => {
                self.send_speeds(speeds, out);
                self.send_start(now, out);
            }
            MotorCommand::Turn(speeds) => self.send_speeds(speeds, out),
        }
        self.talk(now, out);
    }

    fn frames(&self) -> FrameLengths {
        // The two marks; escapes are added to this length.
        let length = |frame: Frame| frame.body().len() as u16 + 2;
        let imu = VehicleMessage::Imu(ImuFrame { temperature: Some(0), ..ImuFrame::default() });
        let speeds = [0; MAX_ROTORS];
        let speeds = MotorValues::new(speeds.get(..self.rotor_count).unwrap_or(&[]));
        FrameLengths {
            inertial: length(imu.frame()),
            motor: length(VehicleMessage::Motor(MotorFrame::default()).frame()),
            battery: length(VehicleMessage::Battery { sequence: 0, millivolts: 0 }.frame()),
            command: speeds.map_or(0, |speeds| length(HostMessage::Speeds(speeds).frame())),
        }
    }

    fn refused(&self) -> bool {
        self.stage == Stage::Refused
    }

    fn part(&mut self, out: &mut Outgoing) {
        for stream in [Stream::Imu, Stream::Motors, Stream::Battery] {
            out.append(|b| HostMessage::Rate { stream, period_us: 0 }.encode(b));
        }
    }
}
