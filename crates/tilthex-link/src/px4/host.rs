//! The host's end of the link: it receives the streams, sends throttles, asks for the offboard mode, arms and disarms.

use super::{
    agent::Agent,
    complaint::Complaint,
    engaging::Engaging,
    esc_status::{ESCS, EscStatus},
    frame::{AGENT, Decoder},
    inertial::InertialStream,
    motors::Motors,
    rates::Rate,
    streams::Streams,
    throttle::Throttles,
    topics::{ActuatorMotors, MOTORS, OffboardControlMode, Topic, VehicleCommand},
};
use crate::{
    Awaited, FrameLengths, GateCounters, InertialDue, LONG_AGO, LinkParams, Outgoing, Severity, Text,
    VehicleLink,
};
use tilthex_core::{
    Error,
    flight::{MotorCommand, Telemetry},
    types::{MAX_ROTORS, RotorVector},
};

/// The link gives up if no client has begun a session for this long, s. A client that was in a session with another agent
/// needs about 5 s to notice that this agent is gone.
const PATIENCE: f64 = 15.0;
/// Time between two messages that keep the offboard mode active, s. Each is sent with a new command.
const HEARTBEAT_EVERY: f64 = 0.019;
/// Time between two orders to the flight board, s.
const ORDER_EVERY: f64 = 0.2;
/// When motors are tried one by one, the vehicle stays armed for this time between two of them, s.
const STAYS_ARMED: f64 = 0.5;
/// After a flight the host disarms for at least this time, s, even if the vehicle reports that it is disarmed.
const INSIST: f64 = 0.5;
/// Bytes that a frame adds to a sample: the framing, the header and the object.
const AROUND: u16 = 7 + 8 + 4;

/// The newest command to the motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    /// No command, or the vehicle is disarmed since. A pilot may fly it, or PX4's failsafe after another program.
    Nothing,
    Stop,
    Kill,
    Alone(usize),
    All,
}

/// The host's end of the link.
#[derive(Clone, Debug)]
pub struct Host {
    decoder: Decoder,
    /// Decodes the same bytes for `look`, before [`Self::decoder`] does.
    looked: Decoder,
    awaited: Awaited,
    agent: Agent,
    streams: Streams,
    throttles: Throttles,
    rotor_count: usize,
    text: Option<(Severity, Text)>,
    /// Time of the first command, and time since then, s.
    began: Option<f64>,
    waited: f64,
    told: Told,
    stopped: f64,
    insist: f64,
    heartbeat: f64,
    ordered: f64,
    engaging: Engaging,
    was_offboard: bool,
    /// Whether PX4 has left the offboard mode since this link began to drive motors.
    left: bool,
}

impl Host {
    /// The state before the first byte, for a vehicle with `rotor_count` rotors.
    ///
    /// # Errors
    /// More rotors than `esc_status` has motor controllers, or a throttle map with impossible numbers.
    pub fn new(params: LinkParams, rotor_count: usize) -> Result<Self, Error> {
        if rotor_count > ESCS {
            return Err(Error::Count {
                name: "rotors of a PX4 vehicle",
                found: rotor_count,
                min: 1,
                max: ESCS,
            });
        }
        params.throttle.check()?;
        Ok(Self {
            decoder: Decoder::new(AGENT),
            looked: Decoder::new(AGENT),
            awaited: Awaited::default(),
            agent: Agent::default(),
            streams: Streams {
                inertial: InertialStream::new(params.imu_period_us)?,
                motors: Motors::new()?,
                inertial_rate: Rate::new(params.imu_period_us),
                motor_rate: Rate::new(params.motor_period_us),
                telemetry: Telemetry::new(rotor_count),
                status: None,
                unreadable: None,
            },
            throttles: Throttles::new(params.throttle),
            rotor_count,
            text: None,
            began: None,
            waited: 0.0,
            told: Told::Nothing,
            stopped: LONG_AGO,
            insist: LONG_AGO,
            heartbeat: LONG_AGO,
            ordered: LONG_AGO,
            engaging: Engaging::default(),
            was_offboard: false,
            left: false,
        })
    }

    /// Sends throttles and, at times, [`OffboardControlMode`]. PX4's failsafe acts if one of the two stops.
    fn send_throttles(&mut self, throttles: &[f32; MAX_ROTORS], now: f64, out: &mut Outgoing) {
        let mut control = [f32::NAN; MOTORS];
        let driven = throttles.iter().take(self.rotor_count);
        control.iter_mut().zip(driven).for_each(|(slot, throttle)| *slot = *throttle);
        self.agent.send(&ActuatorMotors { control }, out);
        if now - self.heartbeat >= HEARTBEAT_EVERY {
            self.agent.send(&OffboardControlMode { direct_actuator: true }, out);
            self.heartbeat = now;
        }
    }

    /// Drives one motor alone, or all motors.
    fn drive(&mut self, told: Told, speeds: &RotorVector, now: f64, out: &mut Outgoing) {
        let telemetry = &self.streams.telemetry;
        let obeyed = told == Told::All && self.streams.armed() && self.streams.offboard();
        let mut throttles = self.throttles.step(speeds, telemetry.motors(), telemetry.battery, now, obeyed);
        if let Told::Alone(motor) = told {
            let others = throttles.iter_mut().enumerate().filter(|(index, _)| *index != motor);
            others.for_each(|(_, throttle)| *throttle = f32::NAN);
        }
        self.told = told;
        self.send_throttles(&throttles, now, out);
    }

    /// Asks for the offboard mode, then orders to arm. If a pilot has taken over, it does nothing.
    fn engage(&mut self, now: f64, out: &mut Outgoing) {
        if self.left || self.streams.armed() && self.streams.offboard() {
            self.engaging.end();
            return;
        }
        if now - self.ordered < ORDER_EVERY {
            return;
        }
        let order = if self.streams.offboard() { VehicleCommand::Arm } else { VehicleCommand::Offboard };
        self.agent.send(&order, out);
        self.engaging.send(order, now);
        self.ordered = now;
    }

    /// Stops all motors at once, and disarms: [`STAYS_ARMED`] later if one motor was driven alone. [`Told::Stop`] stops
    /// only motors that this link has driven, and only in the offboard mode: in another mode a pilot or PX4 flies.
    fn stop(&mut self, told: Told, now: f64, out: &mut Outgoing) {
        self.engaging.end();
        if told == Told::Stop && self.told == Told::Nothing {
            return;
        }
        let before = core::mem::replace(&mut self.told, told);
        if before != told {
            let wait = if told == Told::Stop && matches!(before, Told::Alone(_)) { STAYS_ARMED } else { 0.0 };
            (self.stopped, self.ordered) = (now + wait, LONG_AGO);
            self.insist = self.stopped + INSIST;
            self.throttles.forget();
        }
        if !self.streams.armed() && now >= self.insist {
            if told == Told::Stop {
                (self.told, self.left) = (Told::Nothing, false);
            }
            return;
        }
        if !self.stops() {
            return;
        }
        self.send_throttles(&[f32::NAN; MAX_ROTORS], now, out);
        if now >= self.stopped && now - self.ordered >= ORDER_EVERY {
            self.agent.send(&VehicleCommand::Disarm, out);
            self.ordered = now;
        }
    }

    /// Whether a pilot or PX4 may fly the vehicle: it is armed, and not by this link or in another mode.
    fn others_fly(&self) -> bool {
        let may_be_theirs = match self.told {
            Told::Nothing => true,
            Told::Stop => !self.streams.offboard(),
            Told::Kill | Told::Alone(_) | Told::All => false,
        };
        may_be_theirs && self.streams.armed()
    }

    /// Whether all motors have the command to stop. A vehicle that others fly is stopped by [`Told::Kill`] only.
    fn stops(&self) -> bool {
        self.told == Told::Kill || self.told == Told::Stop && !self.others_fly()
    }

    /// Marks motors that will spin soon: driven motors; after a stop all, until the vehicle is disarmed.
    fn mark_starting(&mut self, now: f64) {
        let (armed, stops) = (self.streams.armed(), self.stops() && now >= self.stopped);
        for index in 0..self.rotor_count {
            if let Some(motor) = self.streams.telemetry.motor_mut(index) {
                let wanted = match self.told {
                    Told::All => true,
                    Told::Alone(alone) => index == alone,
                    Told::Nothing | Told::Stop | Told::Kill => stops,
                };
                motor.starting = armed && wanted && !motor.spinning;
            }
        }
    }

    fn update_link(&mut self, now: f64) {
        let others_fly = self.others_fly();
        let missing = self.missing();
        let streams = &mut self.streams;
        // Rates are measured only while the motors stand. In flight `silent` watches the streams.
        if !matches!(self.told, Told::Alone(_) | Told::All) {
            streams.inertial_rate.step(now);
            streams.motor_rate.step(now);
        }
        let enough = streams.inertial_rate.is_enough() && streams.motor_rate.is_enough();
        let refused = |sum: u32, c: GateCounters| sum.saturating_add(c.out_of_range).saturating_add(c.jumps);
        let of_gates =
            streams.motors.gate_counters().fold(refused(0, streams.inertial.gate_counters()), refused);
        let (messages, malformed) = self.agent.counts();
        let seen = streams.status.is_some() && !others_fly;
        let ready = missing.is_none() && enough && seen && !streams.silent(now);
        let link = &mut streams.telemetry.link;
        link.identified |= self.agent.begun();
        link.ready = ready;
        link.messages = messages;
        link.refused_frames = self.decoder.counters().refused().saturating_add(malformed);
        link.refused_samples = of_gates;
        link.lost_samples = streams.inertial.lost();
    }

    /// The first topic that PX4 does not publish or does not subscribe to. The battery's topic may be missing.
    fn missing(&self) -> Option<Complaint> {
        Topic::ALL.iter().copied().filter(|topic| *topic != Topic::BatteryStatus).find_map(|topic| {
            if topic.is_taken() {
                (!self.agent.wants(topic)).then_some(Complaint::Unwanted(topic))
            } else {
                (!self.agent.publishes(topic)).then_some(Complaint::Missing(topic))
            }
        })
    }

    /// Tells the operator if PX4 leaves the offboard mode while this link drives motors.
    fn tell_mode(&mut self) {
        let offboard = self.streams.offboard();
        let drives = !matches!(self.told, Told::Nothing | Told::Kill);
        if drives && self.was_offboard && !offboard {
            self.left = true;
            let text = b"PX4 has left the offboard mode and ignores throttles now";
            self.text = Some((Severity::Error, Text::new(text)));
        }
        self.was_offboard = offboard;
    }
}

impl VehicleLink for Host {
    type Complaint = Complaint;

    fn look(&mut self, bytes: &[u8]) -> InertialDue {
        for byte in bytes {
            if let Some(message) = self.looked.push(*byte)
                && self.agent.finds(message, Topic::SensorCombined)
            {
                self.awaited.arrive();
            }
        }
        self.awaited.due()
    }

    fn receive(&mut self, bytes: &[u8], now: f64) -> &Telemetry {
        self.awaited.end_tick();
        self.streams.telemetry.begin_tick();
        self.text = None;
        self.streams.inertial.read(now);
        for byte in bytes {
            let Self { decoder, agent, streams, .. } = self;
            let Some(message) = decoder.push(*byte) else { continue };
            if agent.take(message, |topic, data| streams.take(topic, data, now)) {
                streams.telemetry.link.heard = now;
            }
        }
        if self.agent.began_anew() {
            self.streams.telemetry.link.rebooted = true;
            self.streams.status = None;
            self.was_offboard = false;
            self.streams.inertial_rate.forget();
            self.streams.motor_rate.forget();
        }
        self.tell_mode();
        if let Some(text) = self.engaging.refused(now) {
            self.text = Some((Severity::Error, Text::new(text)));
        }
        self.mark_starting(now);
        self.update_link(now);
        &self.streams.telemetry
    }

    fn telemetry(&self) -> &Telemetry {
        &self.streams.telemetry
    }

    fn text(&self) -> Option<(Severity, Text)> {
        self.text
    }

    fn command(&mut self, command: &MotorCommand, now: f64, out: &mut Outgoing) {
        self.waited = now - *self.began.get_or_insert(now);
        match command {
            MotorCommand::Stop => self.stop(Told::Stop, now, out),
            MotorCommand::Kill => self.stop(Told::Kill, now, out),
            MotorCommand::Alone(motor, speeds) => {
                self.drive(Told::Alone(*motor), speeds, now, out);
                self.engage(now, out);
            }
            MotorCommand::Start(speeds) => {
                self.drive(Told::All, speeds, now, out);
                self.engage(now, out);
            }
            // No `engage` here: it would take the vehicle back from a pilot.
            MotorCommand::Turn(speeds) => {
                self.engaging.end();
                self.drive(Told::All, speeds, now, out);
            }
        }
        self.agent.answer_all(now, out);
    }

    fn frames(&self) -> FrameLengths {
        let escs = EscStatus::LENGTH as u16 + AROUND;
        let rotors = (self.rotor_count as u16).max(1);
        FrameLengths {
            inertial: 48 + AROUND,
            // One frame holds all motors.
            motor: escs.div_ceil(rotors),
            battery: 220 + AROUND,
            // One command in ten carries a heartbeat as well: its mean length is added.
            command: 68 + AROUND + (15 + AROUND) / 10 + 1,
        }
    }

    fn refused(&self) -> bool {
        !self.streams.telemetry.link.identified && self.waited > PATIENCE
    }

    fn part(&mut self, out: &mut Outgoing) {
        // The motors must stay off: an armed vehicle that receives no more messages executes its failsafe.
        if self.stops() && self.streams.armed() {
            self.agent.send(&VehicleCommand::Disarm, out);
        }
    }

    fn complaint(&self) -> Option<Complaint> {
        if !self.agent.begun() {
            return None;
        }
        let unreadable = || self.streams.unreadable.map(Complaint::Unreadable);
        let rates = [
            (Topic::SensorCombined, &self.streams.inertial_rate),
            (Topic::EscStatus, &self.streams.motor_rate),
        ];
        let slow = || {
            let (topic, rate) = rates.into_iter().find(|(_, rate)| rate.is_slow())?;
            rate.found().map(|(found, expected)| Complaint::Slow { topic, found, expected })
        };
        let armed = || self.others_fly().then_some(Complaint::Armed);
        self.missing().or_else(unreadable).or_else(slow).or_else(armed)
    }
}
