//! A whole flight behind the toy link takes its telemetry and writes its commands.

use tilthex_core::{RotorVector, flight::MotorCommand};
use tilthex_link::{Link, LinkKind, LinkParams, Outgoing, VehicleLink};

#[test]
fn lines_become_telemetry_and_commands_become_lines() {
    let params =
        LinkParams { imu_period_us: 2000, motor_period_us: 4000, battery_period_us: 1_000_000, scales: None };
    let mut link = Link::new(LinkKind::Toy, params, 2).expect("valid");
    let telemetry = link.receive(b"I 0 0 0.1 0 0 9.81\nM 1 60.5 1\nM 2 59 1\nB 15.2\nnonsense\n", 1.0);
    assert_eq!(telemetry.inertial.samples()[0].gyro_i.z, 0.1);
    assert_eq!(telemetry.motors()[0].speed, 60.5);
    assert_eq!((telemetry.battery, telemetry.link.refused_frames), (Some(15.2), 1));
    assert!(telemetry.link.ready);
    let mut out = Outgoing::default();
    link.command(&MotorCommand::Turn(RotorVector::repeat(61.2)), 1.0, &mut out);
    assert_eq!(out.bytes(), b"T 612 612\n");
}
