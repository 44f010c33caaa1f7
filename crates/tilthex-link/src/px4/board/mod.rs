//! The client's end of the link for simulated vehicles: a flight board that, seen from the link, behaves like PX4. It opens
//! a session, creates its topics, sends its streams, and executes throttles in the offboard mode. It has none of PX4's
//! control laws: its failsafe sets the rotors to their lowest speeds, and disarms later.

mod session;

use alloc::vec::Vec;

use self::session::Session;
use super::{
    ARMED, ActuatorMotors, BatteryStatus, ESCS, EscReport, EscStatus, FIRST_MOTOR, OFFBOARD,
    OffboardControlMode, SensorCombined, ThrottleMap, Topic, TopicMessage, VehicleCommand, VehicleStatus,
};
use crate::board::{Board, BoardParams, Measurements, Micros, Noted};
use tilthex_core::{
    MAX_ROTORS, RotorVector, Vector3, Vehicle,
    plant::{Battery, rotor_current},
};

/// The board leaves the offboard mode if [`OffboardControlMode`] does not arrive for this time.
pub const OFFBOARD_LOST: Micros = 500_000;
/// The board disarms after this time in its failsafe.
pub const DISARM: Micros = 10_000_000;
/// PX4's arming state in which motors stand still.
const DISARMED: u8 = 1;
/// The mode before the offboard mode, and the mode after its loss.
const MANUAL: u8 = 0;
const DESCEND: u8 = 12;

/// The board's constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClientParams {
    /// Its battery at the start.
    pub battery: Battery,
    /// The throttle that each speed of its motors needs.
    pub throttle: ThrottleMap,
    /// Periods of the inertial samples and of the motor controllers' measurements.
    pub periods: (Micros, Micros),
    /// A topic that is missing in its `dds_topics.yaml`: it neither publishes it nor subscribes to it.
    pub without: Option<Topic>,
}

impl From<BoardParams> for ClientParams {
    /// Motors that need the throttles of the host's link, streams with its rates, and every topic.
    fn from(BoardParams { battery, link }: BoardParams) -> Self {
        let periods = (Micros::from(link.imu_period_us), Micros::from(link.motor_period_us));
        Self { battery, throttle: link.throttle, periods, without: None }
    }
}

/// The board.
#[derive(Clone, Debug)]
pub struct Client {
    params: ClientParams,
    session: Session,
    battery: Battery,
    lowest: [f64; MAX_ROTORS],
    highest: [f64; MAX_ROTORS],
    motor_count: usize,
    throttles: [f32; MAX_ROTORS],
    status: VehicleStatus,
    /// The time at which the newest [`OffboardControlMode`] arrived.
    heartbeat: Option<Micros>,
    /// The time at which its failsafe began.
    failsafe: Option<Micros>,
    next_imu: Micros,
    next_motors: Micros,
    next_battery: Micros,
    next_status: Micros,
    heartbeats_received: u64,
    noted: Noted,
}

impl Client {
    /// A board that was just switched on, for a vehicle.
    #[must_use]
    pub fn new(vehicle: &Vehicle, params: ClientParams) -> Self {
        let (mut lowest, mut highest) = ([0.0; MAX_ROTORS], [0.0; MAX_ROTORS]);
        for ((low, high), rotor) in lowest.iter_mut().zip(&mut highest).zip(vehicle.rotors()) {
            (*low, *high) = (rotor.min_speed.max(0.0), rotor.max_speed);
        }
        Self {
            params,
            session: Session::new(params.without),
            battery: params.battery,
            lowest,
            highest,
            motor_count: vehicle.rotor_count(),
            throttles: [f32::NAN; MAX_ROTORS],
            status: VehicleStatus { timestamp: 0, arming: DISARMED, mode: MANUAL },
            heartbeat: None,
            failsafe: None,
            next_imu: 0,
            next_motors: 0,
            next_battery: 0,
            next_status: 0,
            heartbeats_received: 0,
            noted: Noted::default(),
        }
    }

    /// Whether motors may turn.
    #[must_use]
    pub fn is_armed(&self) -> bool {
        self.status.arming == ARMED
    }

    /// The time at which its failsafe began.
    #[must_use]
    pub fn failsafe(&self) -> Option<Micros> {
        self.failsafe
    }

    /// Number of [`OffboardControlMode`] messages that it has received.
    #[must_use]
    pub fn heartbeats_received(&self) -> u64 {
        self.heartbeats_received
    }

    /// A pilot takes over. This board has no control laws, so that it then turns its rotors at their lowest speeds.
    pub fn take_over(&mut self, now: Micros) {
        (self.status.mode, self.failsafe) = (MANUAL, None);
        self.next_status = now;
    }

    /// The battery.
    pub fn battery_mut(&mut self) -> &mut Battery {
        &mut self.battery
    }

    fn is_offboard(&self) -> bool {
        self.status.mode == OFFBOARD
    }

    fn obey(&mut self, topic: Topic, data: &[u8], now: Micros) {
        match topic {
            Topic::ActuatorMotors => {
                if let Some(motors) = ActuatorMotors::read(data) {
                    self.noted.commands_received += 1;
                    self.throttles = motors.control;
                }
            }
            Topic::OffboardControlMode
                if OffboardControlMode::read(data).is_some_and(|mode| mode.direct_actuator) =>
            {
                self.heartbeats_received += 1;
                self.heartbeat = Some(now);
            }
            Topic::VehicleCommand => match VehicleCommand::read(data) {
                Some(VehicleCommand::Offboard) if self.hears(now) => {
                    (self.status.mode, self.failsafe) = (OFFBOARD, None);
                    self.next_status = now;
                }
                Some(VehicleCommand::Arm) if self.is_offboard() => {
                    self.status.arming = ARMED;
                    self.next_status = now;
                }
                Some(VehicleCommand::Disarm) => self.disarm(now),
                _ => {}
            },
            _ => {}
        }
    }

    fn disarm(&mut self, now: Micros) {
        (self.status.arming, self.failsafe) = (DISARMED, None);
        self.next_status = now;
    }

    fn hears(&self, now: Micros) -> bool {
        self.heartbeat.is_some_and(|heard| now - heard < OFFBOARD_LOST)
    }

    /// The speed of a motor at a throttle and the battery's present voltage, Hz.
    fn speed(&self, throttle: f32) -> f64 {
        let [c0, c1, c2] = self.params.throttle.coefficients;
        let wanted = f64::from(throttle) - c0;
        let x = if c2 == 0.0 {
            wanted / c1
        } else {
            (libm::sqrt((c1 * c1 + 4.0 * c2 * wanted).max(0.0)) - c1) / (2.0 * c2)
        };
        let ThrottleMap { voltage, exponent, .. } = self.params.throttle;
        x * libm::pow(self.battery.speed_part(voltage), exponent)
    }

    fn driven(&self, motor: usize) -> f64 {
        let throttle = self.throttles[motor];
        match (self.is_armed(), self.failsafe) {
            (false, _) => 0.0,
            (true, Some(_)) => self.lowest[motor],
            (true, None) if !self.is_offboard() => self.lowest[motor],
            (true, None) if throttle.is_nan() => 0.0,
            (true, None) => self.speed(throttle).max(0.3 * self.lowest[motor]).min(1.1 * self.highest[motor]),
        }
    }

    fn watch(&mut self, now: Micros) {
        if self.is_offboard() && !self.hears(now) {
            self.status.mode = DESCEND;
            self.failsafe = self.is_armed().then_some(now);
            self.next_status = now;
        }
        if self.failsafe.is_some_and(|since| now - since >= DISARM) {
            self.disarm(now);
        }
    }
}

/// Converts a vector from tilthex's axes (forward, left, up) to PX4's (forward, right, down).
fn frd(v: &Vector3) -> [f32; 3] {
    [v.x as f32, -v.y as f32, -v.z as f32]
}

/// Whether the time `next` has come. If it has, `next` moves on by a period.
fn due(next: &mut Micros, period: Micros, now: Micros) -> bool {
    let due = now >= *next;
    if due {
        *next = (*next + period).max(now + period / 2);
    }
    due
}

impl Board for Client {
    fn receive(&mut self, bytes: &[u8], now: Micros, out: &mut Vec<u8>) {
        for &byte in bytes {
            let mut heard = Vec::new();
            self.session.push(byte, now, &mut heard, out);
            for (topic, data) in heard {
                self.obey(topic, &data, now);
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
        self.battery.advance(&true_speeds.as_slice()[..self.motor_count], dt);
        self.watch(now);
        self.session.advance(now, out);
        let turn = (0..self.motor_count).all(|motor| self.driven(motor) > 0.0);
        if turn {
            self.noted.first_start.get_or_insert(now);
        }
        let (of_imu, of_motors) = self.params.periods;
        let (imu, motors) =
            (due(&mut self.next_imu, of_imu, now), due(&mut self.next_motors, of_motors, now));
        if !self.session.runs() {
            return;
        }
        // PX4 too stamps its messages with the host's time, once it knows this time from the session.
        let timestamp = self.session.host_time(now);
        if imu || motors {
            let measured = measure();
            if imu {
                let (gyro, accelerometer) = (frd(&measured.imu.gyro_i), frd(&measured.imu.specific_force_i));
                self.session.send(&SensorCombined { timestamp, gyro, accelerometer, clipped: false }, out);
                self.noted.samples_sent += 1;
            }
            if motors {
                let mut escs = [EscReport::default(); ESCS];
                for (motor, esc) in escs.iter_mut().enumerate().take(self.motor_count) {
                    let speed = measured.rotor_speeds[motor];
                    esc.timestamp = timestamp;
                    esc.rpm = libm::round(60.0 * speed) as i32;
                    esc.voltage = self.battery.voltage() as f32;
                    esc.current = rotor_current(speed) as f32;
                    esc.function = FIRST_MOTOR + motor as u8;
                }
                let count = self.motor_count as u8;
                self.session.send(&EscStatus { timestamp, count, online: 0xff, escs }, out);
            }
        }
        if due(&mut self.next_battery, 1_000_000, now) {
            let voltage = self.battery.voltage() as f32;
            self.session.send(&BatteryStatus { timestamp, connected: true, voltage }, out);
        }
        if due(&mut self.next_status, 200_000, now) {
            self.session.send(&VehicleStatus { timestamp, ..self.status }, out);
        }
    }

    fn commands(&self) -> RotorVector {
        RotorVector::from_fn(|motor, _| if motor < self.motor_count { self.driven(motor) } else { 0.0 })
    }

    fn noted(&self) -> Noted {
        self.noted
    }
}
