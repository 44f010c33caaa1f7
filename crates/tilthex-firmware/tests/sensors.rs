//! What the firmware makes of the readings of a board.

#![allow(clippy::unwrap_used)]

use tilthex_core::supervisor::limits::MOTORS_STALE;
use tilthex_firmware::{Board, Drive, Firmware, ImuReading, RotorReading, example};

/// A board whose rotors all measure one speed, Hz.
struct Bench {
    now: u64,
    speed: f64,
}

impl Board for Bench {
    fn now_us(&mut self) -> u64 {
        self.now
    }

    fn imu(&mut self) -> Option<ImuReading> {
        None
    }

    fn rotor(&mut self, _: usize) -> RotorReading {
        RotorReading { speed: Some(self.speed), spinning: true, ..RotorReading::default() }
    }

    fn battery(&mut self) -> Option<f64> {
        None
    }

    fn drive(&mut self, _: usize, _: Drive) {}

    fn read(&mut self, _: &mut [u8]) -> usize {
        0
    }

    fn write(&mut self, _: &[u8]) {}
}

/// The speeds that the flight gets for these measurements, Hz, and the age of the last one, s.
fn taken(measured: &[f64]) -> (Vec<f64>, f64) {
    let mut firmware = Firmware::new(example::tilt_hex((14.0, 13.0)).unwrap()).unwrap();
    let mut bench = Bench { now: 1_000_000, speed: 0.0 };
    let mut speeds = Vec::new();
    for speed in measured {
        bench.now += 2000;
        bench.speed = *speed;
        firmware.tick(&mut bench);
        let motors = firmware.telemetry().motors();
        assert!(motors.iter().all(|motor| motor.speed == motors[0].speed && motor.spinning));
        speeds.push(motors[0].speed);
    }
    (speeds, firmware.telemetry().motor_age(bench.now as f64 * 1e-6))
}

/// One speed of 1000 Hz turned a simulated vehicle over.
#[test]
fn a_wrong_speed_of_a_rotor_does_not_reach_the_flight() {
    for wrong in [1000.0, -100.0, 1e100, f64::NAN, f64::INFINITY] {
        let (speeds, age) = taken(&[60.0, wrong, 60.0, wrong, 61.0]);
        assert_eq!(speeds, [60.0, 60.0, 60.0, 60.0, 61.0], "{wrong}");
        assert_eq!(age, 0.0);
    }
    // A jump that stays is a measurement; a value that no rotor has is none, however often it comes.
    let (speeds, _) = taken(&[60.0, 130.0, 130.0, 130.0, 130.0, 130.0]);
    assert_eq!(speeds, [60.0, 60.0, 60.0, 60.0, 60.0, 130.0]);
    let mut measured = vec![60.0];
    measured.extend([5000.0; 100]);
    let (speeds, age) = taken(&measured);
    assert!(speeds.iter().all(|speed| *speed == 60.0) && age > MOTORS_STALE);
}
