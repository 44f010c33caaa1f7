//! Messages of the toy link, and bytes that are none.

#![allow(clippy::unwrap_used)]

use proptest::{collection::vec, prelude::*};
use tilthex_core::{RotorVector, flight::MotorCommand};
use tilthex_link::{Link, LinkKind, LinkParams, Outgoing, VehicleLink};

fn link(rotors: usize) -> Link {
    let params =
        LinkParams { imu_period_us: 2000, motor_period_us: 4000, battery_period_us: 1_000_000, scales: None };
    Link::new(LinkKind::Toy, params, rotors).unwrap()
}

proptest! {
    #[test]
    fn messages_survive_the_wire(
        gyro in -3000..3000_i32, force in -20_000..20_000_i32, motor in 1..7_usize, speed in 0..110_000_i32,
        battery in 9000..17_000_i32, cut in 0..40_usize,
    ) {
        let text = format!("V\nI 7 {gyro} 0 {gyro} 0 {force} 0\nM {motor} {speed} 1\nB {battery}\n");
        let mut link = link(6);
        let (before, after) = text.as_bytes().split_at(cut.min(text.len()));
        link.receive(before, 1.0);
        let samples = link.telemetry().inertial.samples().len();
        let telemetry = link.receive(after, 1.0);
        prop_assert!(telemetry.link.identified);
        prop_assert_eq!((telemetry.link.messages, telemetry.link.refused_frames), (4, 0));
        prop_assert_eq!(telemetry.inertial.samples().len() + samples, 1);
        if let [sample] = telemetry.inertial.samples() {
            prop_assert_eq!((1e3 * sample.gyro_i).map(f64::round).z as i32, gyro);
            prop_assert_eq!((1e3 * sample.specific_force_i).map(f64::round).y as i32, force);
        }
        prop_assert_eq!((1e3 * telemetry.motors()[motor - 1].speed).round() as i32, speed);
        prop_assert_eq!((1e3 * telemetry.battery.unwrap()).round() as i32, battery);
    }

    #[test]
    fn a_command_is_one_line(speeds in vec(0.0..120.0_f64, 12)) {
        let mut out = Outgoing::default();
        link(12).command(&MotorCommand::Turn(RotorVector::from_fn(|i, _| speeds[i % 12])), 0.0, &mut out);
        let text = std::str::from_utf8(out.bytes()).unwrap();
        let line = text.lines().next().unwrap();
        let read: Vec<f64> = line[2..].split(' ').map(|word| 1e-3 * word.parse::<f64>().unwrap()).collect();
        prop_assert_eq!(read.len(), RotorVector::zeros().len().min(12));
        prop_assert!(read.iter().zip(&speeds).all(|(read, sent)| (read - sent).abs() < 1.001e-3));
    }

    #[test]
    fn hostile_bytes_are_refused_and_a_message_after_them_is_read(
        bytes in vec(prop_oneof![any::<u8>(), prop::sample::select(b"VIMB 0123456789-\n".to_vec())], 0..400),
    ) {
        let mut link = link(6);
        link.look(&bytes);
        link.receive(&bytes, 1.0);
        let telemetry = link.receive(b"\nB 15000\n", 1.002);
        prop_assert_eq!(telemetry.battery, Some(15.0));
        let lines = 2 + bytes.iter().filter(|byte| **byte == b'\n').count();
        prop_assert_eq!((telemetry.link.messages + telemetry.link.refused_frames) as usize, lines);
    }
}
