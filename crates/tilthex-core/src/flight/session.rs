//! The conversation with the vehicle: identity, stream rates, starting and
//! stopping motors, and what the streams say. It keeps the sequence of
//! tk3.md ("Sequence and behaviour") without ever waiting.

use super::{imu_stream::ImuStream, io::TickOutput};
use crate::{
    Error,
    link::{
        Gate, GateParams, Verdict,
        tk3::{
            HostMessage, Identity, ImuScales, MotorFrame, MotorState, MotorValues, Receiver, Severity,
            Stream, Text, VehicleMessage,
        },
    },
    types::{MAX_ROTORS, RotorVector},
};

/// What is asked of the vehicle's streams.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SessionParams {
    /// Period of the IMU stream, us.
    pub imu_period_us: u32,
    /// Period of the motor stream, us.
    pub motor_period_us: u32,
    /// Period of the battery stream, us.
    pub battery_period_us: u32,
    /// Units of the IMU's counts; None takes those known of the board.
    pub scales: Option<ImuScales>,
}

/// Between two identity requests, s, and how many there are.
const IDENTIFY_EVERY: f64 = 0.5;
const IDENTIFY_TRIES: u32 = 4;
/// Streams that are silent for so long are asked for again, s.
const SILENCE: f64 = 0.5;
/// Between two start or stop commands, s.
const MOTOR_COMMAND_EVERY: f64 = 0.1;
/// Largest change of a rotor's speed from one sample to the next, Hz.
const MOTOR_JUMP: f64 = 40.0;
/// A jump is believed after so many samples that agree with it.
const PATIENCE: u8 = 4;

/// The newest that is known of one motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motor {
    /// When it was heard, s.
    pub(super) heard: f64,
    /// Measured speed, Hz.
    pub(super) speed: f64,
    /// It is being started.
    pub(super) starting: bool,
    /// It spins.
    pub(super) spinning: bool,
    /// Its emergency bit.
    pub(super) emergency: bool,
    /// Current, A.
    pub(super) current: f64,
    /// State of the newest frame.
    state: Option<MotorState>,
}

/// Where the conversation stands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Identify { tries: u32, asked: f64 },
    Refused,
    Streams { asked: f64 },
}

/// The host's end of the link.
#[derive(Clone, Debug)]
pub(super) struct Session {
    params: SessionParams,
    stage: Stage,
    receiver: Receiver<VehicleMessage>,
    identity: Option<Identity>,
    imu: ImuStream,
    heard: f64,
    motors: [Motor; MAX_ROTORS],
    motor_gates: [Gate<1>; MAX_ROTORS],
    rotor_count: usize,
    battery: Option<f64>,
    text: Option<(Severity, Text)>,
    rebooted: bool,
    motor_asked: f64,
    next_motor: usize,
}

impl Session {
    /// Before the first byte.
    ///
    /// # Errors
    /// A stream period that can not be.
    pub(super) fn new(params: SessionParams, rotor_count: usize) -> Result<Self, Error> {
        let motor_gate = Gate::new(GateParams {
            min: [-1e3],
            max: [1e3],
            jump: [MOTOR_JUMP],
            patience: PATIENCE,
            longest: PATIENCE,
        })?;
        let long_ago = -1e9;
        let motor = Motor {
            heard: long_ago,
            speed: 0.0,
            starting: false,
            spinning: false,
            emergency: false,
            current: 0.0,
            state: None,
        };
        Ok(Self {
            params,
            stage: Stage::Identify { tries: 0, asked: long_ago },
            receiver: Receiver::default(),
            identity: None,
            imu: ImuStream::new(&params)?,
            heard: long_ago,
            motors: [motor; MAX_ROTORS],
            motor_gates: [motor_gate; MAX_ROTORS],
            rotor_count,
            battery: None,
            text: None,
            rebooted: false,
            motor_asked: long_ago,
            next_motor: 0,
        })
    }

    /// Takes in the bytes of one tick.
    pub(super) fn receive(&mut self, bytes: &[u8], now: f64) {
        self.imu.begin_tick();
        self.text = None;
        self.rebooted = false;
        for byte in bytes {
            if let Some(message) = self.receiver.push(*byte) {
                self.heard = now;
                self.take(&message, now);
            }
        }
    }

    fn take(&mut self, message: &VehicleMessage, now: f64) {
        match message {
            VehicleMessage::Identity(text) => self.identify(text),
            VehicleMessage::Imu(frame) => self.imu.take(frame, now),
            VehicleMessage::Motor(frame) => self.take_motor(frame, now),
            VehicleMessage::Battery { millivolts, .. } => {
                self.battery = Some(f64::from(*millivolts) * 1e-3);
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
                self.identity = Some(identity);
                let known = self.imu.know(&identity);
                self.stage = if known { Stage::Streams { asked: -1e9 } } else { Stage::Refused };
            }
            // Nobody asked: the board has started anew.
            Stage::Streams { .. } => {
                self.rebooted = true;
                self.stage = Stage::Streams { asked: -1e9 };
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
        if let Some(motor) = self.motors.get_mut(index) {
            motor.heard = now;
            motor.speed = frame.speed();
            motor.current = f64::from(frame.current_ma) * 1e-3;
            // No checksum: a state counts when two frames in a row agree.
            if motor.state.replace(frame.state) == Some(frame.state) {
                motor.starting = frame.state.is_starting();
                motor.spinning = frame.state.is_spinning();
                motor.emergency = frame.state.is_emergency();
            }
        }
    }

    /// Writes what the conversation needs now: identity requests and stream rates.
    pub(super) fn talk(&mut self, now: f64, out: &mut TickOutput) {
        match self.stage {
            Stage::Identify { tries, asked } if now - asked >= IDENTIFY_EVERY => {
                if tries < IDENTIFY_TRIES {
                    out.append(|b| HostMessage::Identify.encode(b));
                    self.stage = Stage::Identify { tries: tries + 1, asked: now };
                } else {
                    self.stage = Stage::Refused;
                }
            }
            Stage::Streams { asked } if now - asked >= SILENCE && self.silent(now) => {
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

    /// Commanded speeds, Hz; they can not stop a motor.
    pub(super) fn send_speeds(&self, speeds: &RotorVector, out: &mut TickOutput) {
        if let Some(values) = speeds.as_slice().get(..self.rotor_count).and_then(MotorValues::from_speeds) {
            out.append(|b| HostMessage::Speeds(values).encode(b));
        }
    }

    /// Starts the next motor that does not spin, ten times a second.
    pub(super) fn send_start(&mut self, now: f64, out: &mut TickOutput) {
        if now - self.motor_asked < MOTOR_COMMAND_EVERY {
            return;
        }
        let waiting = |i: &usize| self.motors.get(*i).is_some_and(|m| !m.spinning && !m.starting);
        let order = (self.next_motor..self.rotor_count).chain(0..self.next_motor);
        if let Some(index) = order.into_iter().find(waiting) {
            out.append(|b| HostMessage::Start(index as u8 + 1).encode(b));
            self.next_motor = if index + 1 < self.rotor_count { index + 1 } else { 0 };
            self.motor_asked = now;
        }
    }

    /// Stops all motors, ten times a second while one of them spins.
    pub(super) fn send_stop(&mut self, now: f64, out: &mut TickOutput) {
        if self.any_spinning() && now - self.motor_asked >= MOTOR_COMMAND_EVERY {
            out.append(|b| HostMessage::StopAll.encode(b));
            self.motor_asked = now;
        }
    }

    /// The inertial stream.
    #[must_use]
    pub(super) fn imu(&self) -> &ImuStream {
        &self.imu
    }

    /// What is known of the motors.
    #[must_use]
    pub(super) fn motors(&self) -> &[Motor] {
        self.motors.get(..self.rotor_count).unwrap_or(&[])
    }

    /// Who the vehicle says it is.
    #[must_use]
    pub(super) fn identity(&self) -> Option<Identity> {
        self.identity
    }

    /// Whether no known vehicle has answered.
    #[must_use]
    pub(super) fn refused(&self) -> bool {
        self.stage == Stage::Refused
    }

    /// Whether the vehicle is known and all its streams run.
    #[must_use]
    pub(super) fn ready(&self, now: f64) -> bool {
        matches!(self.stage, Stage::Streams { .. }) && !self.silent(now)
    }

    fn silent(&self, now: f64) -> bool {
        self.imu.age(now) > SILENCE || self.motor_age(now) > SILENCE
    }

    /// Age of the oldest motor's measurement, s.
    #[must_use]
    pub(super) fn motor_age(&self, now: f64) -> f64 {
        self.motors().iter().map(|m| now - m.heard).fold(0.0, f64::max)
    }

    /// Time since anything was heard, s.
    #[must_use]
    pub(super) fn silence(&self, now: f64) -> f64 {
        now - self.heard
    }

    /// Whether every motor spins.
    #[must_use]
    pub(super) fn all_spinning(&self) -> bool {
        self.motors().iter().all(|m| m.spinning)
    }

    /// Whether a motor spins.
    #[must_use]
    pub(super) fn any_spinning(&self) -> bool {
        self.motors().iter().any(|m| m.spinning || m.starting)
    }

    /// Battery, V.
    #[must_use]
    pub(super) fn battery(&self) -> Option<f64> {
        self.battery
    }

    /// A text that came in this tick.
    #[must_use]
    pub(super) fn text(&self) -> Option<(Severity, Text)> {
        self.text
    }

    /// Whether the board announced itself unasked in this tick.
    #[must_use]
    pub(super) fn rebooted(&self) -> bool {
        self.rebooted
    }

    /// Samples that the gates have refused.
    #[must_use]
    pub(super) fn refused_samples(&self) -> u32 {
        let imu = self.imu.gate_counters();
        let motors = self.motor_gates.iter().map(Gate::counters);
        let refused = |sum: u32, c: crate::link::GateCounters| {
            sum.saturating_add(c.out_of_range).saturating_add(c.jumps)
        };
        motors.fold(refused(0, imu), refused)
    }

    /// Messages taken and frames refused so far.
    #[must_use]
    pub(super) fn counters(&self) -> crate::link::tk3::Counters {
        self.receiver.counters()
    }
}
