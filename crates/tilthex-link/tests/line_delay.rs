//! A late line is told by the numbers of its samples, and not where these begin anew.

#![allow(clippy::unwrap_used)]

mod params;

use params::params;
use proptest::prelude::*;
use tilthex_link::{
    Link, LinkKind, Text, VehicleLink,
    tk3::{ImuFrame, MAX_FRAME, VehicleMessage},
};

const PERIOD: f64 = 0.002;

/// The host's end of a line to a board that has told what it is.
fn link() -> Link {
    let mut link = Link::new(LinkKind::Tk3, params(), 6).unwrap();
    link.receive(&encoded(&VehicleMessage::Identity(Text::new(b"chimera1.1"))), 0.0);
    link
}

fn encoded(message: &VehicleMessage) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME];
    let length = message.encode(&mut frame);
    frame[..length].to_vec()
}

/// A sample of a vehicle at rest, with noise in its last bit.
fn sample(sequence: u8) -> Vec<u8> {
    let frame =
        ImuFrame { sequence, accelerometer: [i16::from(sequence), 0, 2048], gyro: [0; 3], temperature: None };
    encoded(&VehicleMessage::Imu(frame))
}

/// The delay that the host finds in each tick, s, for a board that is silent from 2 s on and then begins with another number.
/// All samples arrive `late.0` s late from 1 s on, and `late.1` s late after the silence.
fn found(silence: f64, number: u8, late: (f64, f64)) -> Vec<(f64, f64)> {
    let mut link = link();
    let mut samples: Vec<_> = (0..2000_u32)
        .map(|i| {
            let (made, sequence) = if i < 1000 {
                (f64::from(i) * PERIOD, i as u8)
            } else {
                (f64::from(i) * PERIOD + silence, number.wrapping_add(i as u8))
            };
            let late = match i {
                ..500 => 0.0,
                500..1000 => late.0,
                1000.. => late.1,
            };
            (made + 1e-4 + late, sample(sequence))
        })
        .collect();
    let mut found = vec![];
    for k in 1..3000_u32 {
        let now = f64::from(k) * PERIOD;
        let due = samples.partition_point(|(arrives, _)| *arrives <= now);
        let bytes: Vec<u8> = samples.drain(..due).flat_map(|(_, bytes)| bytes).collect();
        found.push((now, link.receive(&bytes, now).inertial.line_delay));
    }
    found
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_board_that_starts_again_makes_no_line_late(silence in 0.26..1.5_f64, number in any::<u8>()) {
        for (now, delay) in found(silence, number, (0.0, 0.0)) {
            prop_assert_eq!(delay, 0.0, "at {} s", now);
        }
    }

    #[test]
    fn a_late_line_stays_late_when_its_board_starts_again(
        silence in 0.26..1.0_f64, number in any::<u8>(), late in 0.015..0.06_f64,
    ) {
        for (now, delay) in found(silence, number, (late, late)) {
            let known = now > 1.2;
            prop_assert!(!known || (0.6 * late..1.1 * late).contains(&delay), "{} at {} s", delay, now);
        }
    }

    #[test]
    fn a_line_that_is_mended_during_a_long_silence_is_not_late(
        silence in 2.1..3.0_f64, number in any::<u8>(), late in 0.015..0.06_f64,
    ) {
        for (now, delay) in found(silence, number, (late, 0.0)) {
            let known = now > 2.1 + silence;
            prop_assert!(!known || delay == 0.0, "{} at {} s", delay, now);
        }
    }
}
