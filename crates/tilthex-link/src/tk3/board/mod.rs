//! The board's end of tk3, for simulated vehicles: identity, streams on request, motors that are started one by one,
//! watchdogs, texts. The caller gives it the time, so that it works in real time behind a pseudo-terminal and in the
//! virtual time of the fault campaign.

pub mod motor;

use alloc::{format, vec::Vec};

use self::motor::{Event, Motor};
use super::{
    HostMessage, Identity, ImuFrame, ImuScales, MAX_FRAME, Receiver, Schedule, Stream, VehicleMessage, speed,
};
use crate::{
    Severity, Text,
    board::{Board, BoardParams, Measurements, Micros, Noted},
};
use tilthex_core::{
    MAX_ROTORS, RotorVector, Vehicle,
    plant::{Battery, rotor_current},
};

/// Duration of the board's boot: after a reboot it does nothing for this time.
const BOOT: Micros = 300_000;

/// The board's constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirmwareParams {
    /// The text with which it identifies itself.
    pub identity: Text,
    /// The units of its IMU's counts.
    pub scales: ImuScales,
    /// Its battery at the start.
    pub battery: Battery,
}

impl Default for FirmwareParams {
    fn default() -> Self {
        let identity = Text::new(b"chimera1.1");
        let scales = Identity::parse(identity.as_bytes()).and_then(|known| ImuScales::known(&known));
        Self { identity, scales: scales.unwrap_or(ImuScales::CHIMERA), battery: Battery::new(5.0, 0.9) }
    }
}

impl From<BoardParams> for FirmwareParams {
    /// The default board, with this battery.
    fn from(params: BoardParams) -> Self {
        Self { battery: params.battery, ..Self::default() }
    }
}

/// The board.
#[derive(Clone, Debug)]
pub struct Firmware {
    params: FirmwareParams,
    receiver: Receiver<HostMessage>,
    battery: Battery,
    motors: [Motor; MAX_ROTORS],
    motor_count: usize,
    imu: Schedule,
    motor_states: Schedule,
    voltage: Schedule,
    magnetometer: Schedule,
    noted: Noted,
    /// Whether all motors have been spinning at the same time.
    flew: bool,
    silent_until: Micros,
}

impl Firmware {
    /// A board that was just powered, for the rotors of a vehicle.
    #[must_use]
    pub fn new(vehicle: &Vehicle, params: FirmwareParams) -> Self {
        let mut motors = [Motor::new(0.0, 0.0); MAX_ROTORS];
        for (motor, rotor) in motors.iter_mut().zip(vehicle.rotors()) {
            *motor = Motor::new(rotor.min_speed.max(0.0), rotor.max_speed);
        }
        Self {
            params,
            receiver: Receiver::default(),
            battery: params.battery,
            motors,
            motor_count: vehicle.rotor_count(),
            imu: Schedule::default(),
            motor_states: Schedule::default(),
            voltage: Schedule::default(),
            magnetometer: Schedule::default(),
            noted: Noted::default(),
            flew: false,
            silent_until: 0,
        }
    }

    fn obey(&mut self, message: &HostMessage, now: Micros, out: &mut Vec<u8>) {
        let motors = &mut self.motors[..self.motor_count];
        match *message {
            HostMessage::Identify => send(&VehicleMessage::Identity(self.params.identity), out),
            HostMessage::Rate { stream, period_us } => self.schedule(stream).set(period_us, now),
            HostMessage::Start(number) => {
                if let Some(motor) = one(motors, number) {
                    motor.start(now);
                    self.noted.first_start.get_or_insert(now);
                }
            }
            HostMessage::Stop(number) => {
                if let Some(motor) = one(motors, number) {
                    motor.stop();
                }
            }
            HostMessage::StopAll => {
                // Motors that were checked one by one have not started yet.
                if !motors.iter().all(Motor::is_spinning) {
                    self.noted.first_start = self.noted.first_start.filter(|_| self.flew);
                }
                motors.iter_mut().for_each(Motor::stop);
            }
            HostMessage::Speeds(values) => {
                self.noted.commands_received += 1;
                for (motor, &value) in motors.iter_mut().zip(values.as_slice()) {
                    motor.set_speed(speed(value), now);
                }
            }
            HostMessage::Throttles(values) => {
                for (motor, &value) in motors.iter_mut().zip(values.as_slice()) {
                    motor.set_throttle(value, now);
                }
            }
            HostMessage::Beep(_) => {}
        }
    }

    fn schedule(&mut self, stream: Stream) -> &mut Schedule {
        match stream {
            Stream::Battery => &mut self.voltage,
            Stream::Motors => &mut self.motor_states,
            Stream::Imu => &mut self.imu,
            Stream::Magnetometer => &mut self.magnetometer,
        }
    }

    /// Whether every motor spins.
    #[must_use]
    pub fn all_spin(&self) -> bool {
        self.motors[..self.motor_count].iter().all(Motor::is_spinning)
    }

    /// The battery.
    pub fn battery_mut(&mut self) -> &mut Battery {
        &mut self.battery
    }

    /// The battery's voltage, V.
    #[must_use]
    pub fn voltage(&self) -> f64 {
        self.battery.voltage()
    }

    /// A motor controller (from 1) stops by itself and sets its emergency bit.
    pub fn fail_motor(&mut self, number: u8, out: &mut Vec<u8>) {
        if let Some(motor) = one(&mut self.motors[..self.motor_count], number) {
            motor.fail();
            say(Severity::Error, &format!("motor {number} emergency stop"), out);
        }
    }

    /// The board restarts. For 0.3 s it neither receives nor sends, and it forgets its streams. The motor controllers
    /// have their own processors and continue.
    pub fn reboot(&mut self, now: Micros) {
        self.receiver = Receiver::default();
        for schedule in [&mut self.imu, &mut self.motor_states, &mut self.voltage, &mut self.magnetometer] {
            *schedule = Schedule::default();
        }
        self.silent_until = now + BOOT;
    }
}

impl Board for Firmware {
    fn receive(&mut self, bytes: &[u8], now: Micros, out: &mut Vec<u8>) {
        if now < self.silent_until {
            return;
        }
        for &byte in bytes {
            if let Some(message) = self.receiver.push(byte) {
                self.obey(&message, now, out);
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
        self.flew |= self.all_spin();
        self.battery.advance(&true_speeds.as_slice()[..self.motor_count], dt);
        // The motor controllers live on while the board boots.
        for (number, motor) in (1_u8..).zip(&mut self.motors[..self.motor_count]) {
            let event = motor.advance(now);
            if now >= self.silent_until {
                announce(event, number, out);
            }
        }
        if now < self.silent_until {
            return;
        }
        let (imu, motors) = (self.imu.due(now), self.motor_states.due(now));
        if imu || motors {
            let measured = measure();
            if imu {
                self.noted.samples_sent += 1;
                let (accelerometer, gyro) =
                    self.params.scales.encode(&measured.imu.specific_force_i, &measured.imu.gyro_i);
                let sequence = self.imu.sequence();
                send(
                    &VehicleMessage::Imu(ImuFrame { sequence, accelerometer, gyro, temperature: Some(4006) }),
                    out,
                );
            }
            if motors {
                for (i, motor) in self.motors[..self.motor_count].iter_mut().enumerate() {
                    let speed = measured.rotor_speeds[i];
                    let report = motor.report(i as u8 + 1, speed, rotor_current(speed));
                    send(&VehicleMessage::Motor(report), out);
                }
            }
        }
        if self.voltage.due(now) {
            let millivolts = (1e3 * self.battery.voltage()).clamp(0.0, 65_535.0) as u16;
            send(&VehicleMessage::Battery { sequence: self.voltage.sequence(), millivolts }, out);
        }
        if self.magnetometer.due(now) {
            // 20 uT north, 43 uT down: a field of middle Europe.
            let field = [2000, 0, -4300];
            send(&VehicleMessage::Magnetometer { sequence: self.magnetometer.sequence(), field }, out);
        }
    }

    fn commands(&self) -> RotorVector {
        RotorVector::from_fn(|i, _| if i < self.motor_count { self.motors[i].command() } else { 0.0 })
    }

    fn noted(&self) -> Noted {
        self.noted
    }
}

fn one(motors: &mut [Motor], number: u8) -> Option<&mut Motor> {
    motors.get_mut(usize::from(number).checked_sub(1)?)
}

fn announce(event: Option<Event>, number: u8, out: &mut Vec<u8>) {
    match event {
        Some(Event::Started) => say(Severity::Note, &format!("motor {number} spins"), out),
        Some(Event::FellBack) => say(Severity::Warning, &format!("motor {number} without set-points"), out),
        Some(Event::Disarmed) => say(Severity::Warning, &format!("motor {number} disarmed"), out),
        None => {}
    }
}

fn say(severity: Severity, text: &str, out: &mut Vec<u8>) {
    send(&VehicleMessage::Text { severity, text: Text::new(text.as_bytes()) }, out);
}

fn send(message: &VehicleMessage, out: &mut Vec<u8>) {
    let mut frame = [0; MAX_FRAME];
    let length = message.encode(&mut frame);
    out.extend_from_slice(&frame[..length]);
}
