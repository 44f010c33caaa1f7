//! A whole flight over the toy link: the simulated body, its sensors, and a board that speaks the text protocol.

#![allow(clippy::unwrap_used)]

use std::{fmt::Write, path::Path};
use tilthex_config::Config;
use tilthex_core::{
    PoseSample, RotorVector,
    flight::HostFacts,
    plant::{Plant, SensorParams, Sensors},
};
use tilthex_link::{LinkedFlight, LinkedOutput, WireInput};
use tilthex_sim::{Body, Own, Pushes, body::Cycle};

/// The board's end: motors that start and stop at once.
struct Board {
    spinning: Vec<bool>,
    speeds: RotorVector,
    asked: bool,
}

impl Board {
    fn obey(&mut self, line: &str) {
        let mut words = line.split(' ');
        let letter = words.next().unwrap();
        let mut numbers = words.map(|word| word.parse::<u32>().unwrap());
        let mut one = || numbers.next().unwrap() as usize - 1;
        match letter {
            "H" => self.asked = true,
            "S" => self.spinning.fill(false),
            "G" => self.spinning[one()] = true,
            "X" => self.spinning[one()] = false,
            "T" => numbers.enumerate().for_each(|(i, speed)| self.speeds[i] = 1e-3 * f64::from(speed)),
            _ => panic!("{line}"),
        }
    }

    fn driven(&self) -> RotorVector {
        RotorVector::from_fn(|i, _| if self.spinning.get(i) == Some(&true) { self.speeds[i] } else { 0.0 })
    }
}

#[test]
fn it_takes_off_hovers_and_lands_over_the_toy_link() {
    let text = "vehicle.preset = \"tilt-hex\"\nlink.protocol = \"toy\"\nlink.baud = 2000000";
    let params = Config::from_text(text, Path::new("")).unwrap().linked_params(true).unwrap();
    let (plant, rotors) = (Plant::new(params.flight.vehicle), params.flight.vehicle.rotor_count());
    let mut linked = LinkedFlight::new(params, None).unwrap();
    let mut body = Own::new(plant, Pushes::default(), 1);
    let mut sensors = Sensors::new(SensorParams::EXPERIMENTS, 1);
    let mut board = Board { spinning: vec![false; rotors], speeds: RotorVector::zeros(), asked: false };
    let (mut out, mut host, mut highest) = (LinkedOutput::default(), HostFacts::default(), 0.0_f64);
    for tick in 0..15_000_u32 {
        let time = 100.0 + 0.002 * f64::from(tick);
        body.advance(&Cycle { at: 0, dt: 0.002, since_start: None }, &board.driven());
        let milli = |x: f64| (1e3 * x).round() as i32;
        let mut bytes = String::new();
        if board.asked {
            bytes.push_str("V\n");
            board.asked = false;
        }
        let imu = sensors.imu(&body.imu());
        write!(bytes, "I {}", tick % 256).unwrap();
        imu.gyro_i.iter().chain(&imu.specific_force_i).for_each(|x| write!(bytes, " {}", milli(*x)).unwrap());
        bytes.push('\n');
        let measured = sensors.rotor_speeds(&plant, body.state());
        for (motor, spins) in board.spinning.iter().enumerate() {
            writeln!(bytes, "M {} {} {}", motor + 1, milli(measured[motor]), i32::from(*spins)).unwrap();
        }
        let (position_w, rotation_wr) = sensors.pose(body.state());
        let pose = PoseSample { time, arrival: time, position_w, rotation_wr, tracking_valid: true };
        let poses = if tick % 5 == 0 { &[pose][..] } else { &[] };
        linked.tick(&WireInput { time, bytes: bytes.as_bytes(), poses, command: None, host }, &mut out);
        std::str::from_utf8(out.wire.sent.bytes()).unwrap().lines().for_each(|line| board.obey(line));
        highest = highest.max(body.state().robot.position_w.z);
        host.land |= tick > 10_000;
        if linked.finished() {
            break;
        }
    }
    assert!(linked.finished(), "{:?}", linked.flight.supervisor());
    assert!(highest > 0.9 && body.rests(), "{highest}");
}
