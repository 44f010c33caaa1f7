//! The toy's lines, over random and damaged bytes.

#![allow(clippy::unwrap_used)]

use proptest::{collection::vec, prelude::*};
use tilthex_core::flight::MotorCommand;
use tilthex_link::{
    Link, LinkKind, LinkParams, MAX_BYTES_IN, Outgoing, VehicleLink,
    ascii::{Line, MAX_LINE, MAX_NUMBERS, Reader},
};

fn written(line: &Line) -> Vec<u8> {
    let mut bytes = [0; MAX_LINE];
    let length = line.encode(&mut bytes);
    assert!(length > 0, "MAX_LINE bytes always suffice");
    bytes[..length].to_vec()
}

fn read(bytes: &[u8]) -> Vec<Line> {
    let mut reader = Reader::default();
    bytes.iter().filter_map(|byte| reader.push(*byte)).collect()
}

fn any_line() -> impl Strategy<Value = Line> {
    (b'a'..=b'z', vec(any::<i32>(), 0..=MAX_NUMBERS)).prop_map(|(letter, numbers)| Line::new(letter, numbers))
}

#[test]
fn a_line_is_what_the_page_says() {
    assert_eq!(written(&Line::new(b'g', [3])), b"g 3*ba\n");
    assert_eq!(read(b"g 3*ba\n"), [Line::new(b'g', [3])]);
    for wrong in ["g 3*bb\n", "g 3\n", "\n", "*00\n", "g  3*da\n", "g 3-*e7\n", "g 99999999999*49\n"] {
        assert_eq!(read(wrong.as_bytes()), [], "{wrong}");
    }
}

proptest! {
    #[test]
    fn lines_survive(lines in vec(any_line(), 0..5)) {
        let bytes: Vec<u8> = lines.iter().flat_map(written).collect();
        prop_assert_eq!(read(&bytes), lines);
    }

    #[test]
    fn a_changed_byte_loses_its_line(line in any_line(), at in 0usize..MAX_LINE, flip in 1u8..=255) {
        let mut bytes = written(&line);
        let at = at % (bytes.len() - 1);
        bytes[at] ^= flip;
        prop_assert!(!read(&bytes).contains(&line));
    }

    #[test]
    fn any_bytes_are_taken(bytes in vec(prop_oneof![any::<u8>(), select_byte()], 0..MAX_BYTES_IN)) {
        let params = LinkParams {
            imu_period_us: 2000,
            motor_period_us: 4000,
            battery_period_us: 1_000_000,
            scales: None,
            throttle: Default::default(),
        };
        let mut link = Link::new(LinkKind::Ascii, params, 6).unwrap();
        link.look(&bytes);
        let telemetry = link.receive(&bytes, 1.0);
        prop_assert!(telemetry.motors().iter().all(|motor| motor.speed.is_finite()));
        let mut out = Outgoing::default();
        link.command(&MotorCommand::Kill, 1.0, &mut out);
        prop_assert!(read(out.bytes()).iter().any(|line| matches!(line.letter, b'v' | b'r')));
    }
}

fn select_byte() -> impl Strategy<Value = u8> {
    proptest::sample::select(b"imvb 0123456789*-abcdef\n".to_vec())
}
