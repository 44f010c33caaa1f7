//! A simulated vehicle that flies itself: the firmware on a simulated board.

use std::collections::VecDeque;

use tilthex_config::Config;
use tilthex_core::{
    MAX_ROTORS, RotorVector,
    plant::{Battery, rotor_current},
};
use tilthex_firmware::{Drive, Firmware, FirmwareParams, ImuReading, RotorReading};
use tilthex_link::{
    board::{Board, Measurements, Micros, Noted},
    tk3::board::motor::Motor,
};

use crate::{STEP, SimError};

/// Cycles of the board between two ticks of the firmware.
const CYCLES: Micros = 2;
/// Bytes that wait at most in the board's serial ports, in each direction.
const BUFFER: usize = 4096;

/// The firmware's parameters for a configuration.
///
/// # Errors
/// Names the section and the key with an impossible value.
pub fn firmware_params(config: &Config) -> Result<FirmwareParams, SimError> {
    let flight = config.flight_params(false).map_err(|e| SimError::refused(e.to_string()))?;
    Ok(FirmwareParams { flight, operator_timeout: config.supervisor().operator_timeout })
}

/// The simulated board: sensors, motor controllers, battery, serial port.
#[derive(Clone, Debug)]
pub struct Chips {
    now: Micros,
    imu: VecDeque<ImuReading>,
    speeds: RotorVector,
    /// What takes the place of a rotor's measured speed, Hz.
    misread: [Option<f64>; MAX_ROTORS],
    fresh: bool,
    motors: [Motor; MAX_ROTORS],
    motor_count: usize,
    battery: Battery,
    received: VecDeque<u8>,
    sent: Vec<u8>,
    noted: Noted,
    /// Rotors that were started in this tick.
    started: usize,
}

impl tilthex_firmware::Board for Chips {
    fn now_us(&mut self) -> u64 {
        self.now
    }

    fn imu(&mut self) -> Option<ImuReading> {
        self.imu.pop_front()
    }

    fn rotor(&mut self, rotor: usize) -> RotorReading {
        let speed = self.speeds[rotor];
        let motor = &self.motors[rotor];
        RotorReading {
            speed: self.fresh.then_some(self.misread[rotor].unwrap_or(speed)),
            starting: motor.is_starting(),
            spinning: motor.is_spinning(),
            emergency: false,
            current: rotor_current(speed),
        }
    }

    fn battery(&mut self) -> Option<f64> {
        Some(self.battery.voltage())
    }

    fn drive(&mut self, rotor: usize, drive: Drive) {
        let motor = &mut self.motors[rotor];
        match drive {
            Drive::Stop => motor.stop(),
            Drive::Start(speed) => {
                motor.start(self.now);
                motor.set_speed(speed, self.now);
                self.started += 1;
            }
            Drive::Turn(speed) => motor.set_speed(speed, self.now),
        }
    }

    fn read(&mut self, bytes: &mut [u8]) -> usize {
        let count = bytes.len().min(self.received.len());
        for (slot, byte) in bytes.iter_mut().zip(self.received.drain(..count)) {
            *slot = byte;
        }
        count
    }

    fn write(&mut self, bytes: &[u8]) {
        if self.sent.len() + bytes.len() <= BUFFER {
            self.sent.extend_from_slice(bytes);
        }
    }
}

/// The vehicle's board with the firmware on it.
#[derive(Clone, Debug)]
pub struct Onboard {
    params: FirmwareParams,
    firmware: Firmware,
    chips: Chips,
}

impl Onboard {
    /// A board that was just powered, with this battery.
    ///
    /// # Errors
    /// The first parameter that the firmware refuses.
    pub fn new(params: FirmwareParams, battery: Battery) -> Result<Self, SimError> {
        let mut motors = [Motor::new(0.0, 0.0); MAX_ROTORS];
        let vehicle = params.flight.vehicle;
        for (motor, rotor) in motors.iter_mut().zip(vehicle.rotors()) {
            *motor = Motor::new(rotor.min_speed.max(0.0), rotor.max_speed);
        }
        let chips = Chips {
            now: 0,
            imu: VecDeque::new(),
            speeds: RotorVector::zeros(),
            misread: [None; MAX_ROTORS],
            fresh: false,
            motors,
            motor_count: vehicle.rotor_count(),
            battery,
            received: VecDeque::new(),
            sent: Vec::new(),
            noted: Noted::default(),
            started: 0,
        };
        let firmware = Firmware::new(params).map_err(|e| SimError::refused(e.to_string()))?;
        Ok(Self { params, firmware, chips })
    }

    /// The firmware.
    #[must_use]
    pub fn firmware(&self) -> &Firmware {
        &self.firmware
    }

    /// The board starts again, for the next flight.
    #[inline(never)]
    fn restart(&mut self) {
        // The parameters were accepted before.
        if let Ok(firmware) = Firmware::new(self.params) {
            self.firmware = firmware;
            self.chips.noted.first_start = None;
        }
    }

    /// Lets a rotor, from 0, measure this speed, Hz, whatever it does; `None` for its own.
    pub fn misread(&mut self, rotor: usize, speed: Option<f64>) {
        self.chips.misread[rotor] = speed;
    }

    /// Whether a motor spins.
    #[must_use]
    pub fn any_spins(&self) -> bool {
        self.chips.motors.iter().any(Motor::is_spinning)
    }
}

impl Board for Onboard {
    fn receive(&mut self, bytes: &[u8], _now: Micros, _out: &mut Vec<u8>) {
        let free = BUFFER - self.chips.received.len().min(BUFFER);
        self.chips.received.extend(bytes.iter().take(free));
    }

    fn advance(
        &mut self,
        now: Micros,
        dt: f64,
        true_speeds: &RotorVector,
        measure: impl FnOnce() -> Measurements,
        out: &mut Vec<u8>,
    ) {
        let chips = &mut self.chips;
        let count = chips.motor_count;
        chips.now = now;
        chips.battery.advance(&true_speeds.as_slice()[..count], dt);
        for motor in &mut chips.motors[..count] {
            // Their watchdogs act, but nobody reports it: the firmware sees the speeds.
            motor.advance(now);
        }
        if !now.is_multiple_of(CYCLES * STEP) {
            return;
        }
        let Measurements { imu, rotor_speeds } = measure();
        let (gyro_i, specific_force_i) = (imu.gyro_i, imu.specific_force_i);
        chips.imu.push_back(ImuReading { time_us: now, gyro_i, specific_force_i, saturated: false });
        (chips.speeds, chips.fresh, chips.started) = (rotor_speeds, true, 0);
        self.firmware.tick(chips);
        chips.noted.commands_received += 1;
        chips.noted.samples_sent += 1;
        // The check of the motors starts them one by one.
        if chips.started == count {
            chips.noted.first_start.get_or_insert(now);
        }
        out.append(&mut chips.sent);
        if self.firmware.finished() {
            self.restart();
        }
    }

    fn commands(&self) -> RotorVector {
        let count = self.chips.motor_count;
        RotorVector::from_fn(|i, _| if i < count { self.chips.motors[i].command() } else { 0.0 })
    }

    fn noted(&self) -> Noted {
        self.chips.noted
    }
}
