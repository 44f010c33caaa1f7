//! From the readings of the board to the telemetry of the flight.

use crate::board::{Board, ImuReading};
use tilthex_core::{
    Error, MAX_ROTORS,
    flight::{Inertial, MAX_SAMPLES, Telemetry},
    supervisor::limits::STREAM_SILENT,
};
use tilthex_link::{Gate, Verdict};

/// Largest readings: rad/s, m/s^2. Larger ones are no measurements.
const LARGEST: (f64, f64) = (100.0, 400.0);

/// The sensors' readings so far.
#[derive(Clone, Debug)]
pub(crate) struct Sensors {
    pub(crate) telemetry: Telemetry,
    /// The newest reading.
    pub(crate) imu: Option<ImuReading>,
    /// Whether a reading since the last sample has left its range.
    shaken: bool,
    /// The gate of each rotor's speed: a single wrong one must not reach the estimator.
    rotor_gates: [Gate<1>; MAX_ROTORS],
}

impl Sensors {
    pub(crate) fn new(rotor_count: usize) -> Result<Self, Error> {
        let mut telemetry = Telemetry::new(rotor_count);
        telemetry.link.identified = true;
        Ok(Self { telemetry, imu: None, shaken: false, rotor_gates: [Gate::rotor_speed()?; MAX_ROTORS] })
    }

    /// Reads everything that is new at `now`, s.
    pub(crate) fn read(&mut self, board: &mut impl Board, now: f64) {
        self.telemetry.begin_tick();
        for _ in 0..MAX_SAMPLES {
            let Some(reading) = board.imu() else { break };
            self.take(&reading, now);
        }
        for (rotor, gate) in (0..self.telemetry.motors().len()).zip(&mut self.rotor_gates) {
            let reading = board.rotor(rotor);
            let Some(motor) = self.telemetry.motor_mut(rotor) else { break };
            (motor.starting, motor.spinning) = (reading.starting, reading.spinning);
            (motor.emergency, motor.current) = (reading.emergency, reading.current);
            if let Some(speed) = reading.speed.filter(|speed| gate.step(&[*speed], 0) == Verdict::Pass) {
                (motor.speed, motor.heard) = (speed, now);
            }
        }
        self.telemetry.battery = board.battery().filter(|volts| volts.is_finite());
        let silent =
            self.telemetry.inertial.age(now) > STREAM_SILENT || self.telemetry.motor_age(now) > STREAM_SILENT;
        // The sensors are on the board: the line to the base is not the flight's link.
        (self.telemetry.link.ready, self.telemetry.link.heard) = (!silent, now);
    }

    fn take(&mut self, reading: &ImuReading, now: f64) {
        let alike = |last: ImuReading| {
            last.gyro_i == reading.gyro_i && last.specific_force_i == reading.specific_force_i
        };
        let last = self.imu.replace(*reading);
        let inertial = &mut self.telemetry.inertial;
        inertial.note_reading(last.is_some_and(alike));
        inertial.saturated = reading.saturated;
        let within = |values: &[f64], most: f64| values.iter().all(|x| (-most..=most).contains(x));
        let sound = within(reading.gyro_i.as_slice(), LARGEST.0)
            && within(reading.specific_force_i.as_slice(), LARGEST.1);
        inertial.refused_now |= !sound;
        self.shaken |= reading.saturated;
        if inertial.frozen || reading.saturated || !sound {
            return;
        }
        let time = (reading.time_us as f64 * 1e-6).min(now);
        let (gyro_i, specific_force_i) = (reading.gyro_i, reading.specific_force_i);
        inertial.push(now, Inertial { time, gyro_i, specific_force_i, shaken: self.shaken });
        self.shaken = false;
    }
}
