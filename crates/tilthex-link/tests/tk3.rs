//! The tk3 codec: the protocol's test vectors, and properties over all messages and hostile bytes.

#![allow(clippy::unwrap_used)]

use proptest::{collection::vec, option, prelude::*, sample::select};
use std::fmt::Debug;
use tilthex_core::{MAX_ROTORS, Vector3};
use tilthex_link::{
    Severity, Text,
    tk3::{
        Board, Decoder, Frame, HostMessage, Identity, ImuFrame, ImuScales, LOWEST_SPEED, MAX_BODY, MAX_FRAME,
        MAX_THROTTLE, Message, MotorFrame, MotorState, MotorValues, Receiver, Refusal, Stream,
        VehicleMessage, half_period, speed,
    },
};

fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u32> = text.chars().filter_map(|c| c.to_digit(16)).collect();
    digits.chunks(2).map(|pair| (pair[0] * 16 + pair[1]) as u8).collect()
}

fn encoded(frame: &Frame) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let length = frame.encode(&mut out);
    assert!(length > 0, "MAX_FRAME bytes always suffice");
    out[..length].to_vec()
}

fn bodies(bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut decoder = Decoder::default();
    bytes.iter().filter_map(|&byte| decoder.push(byte)).map(|frame| frame.body().to_vec()).collect()
}

fn received<M: Message>(bytes: &[u8]) -> (Vec<M>, Receiver<M>) {
    let mut receiver = Receiver::default();
    (bytes.iter().filter_map(|&byte| receiver.push(byte)).collect(), receiver)
}

fn speeds(hertz: &[f64]) -> HostMessage {
    HostMessage::Speeds(MotorValues::from_speeds(hertz).unwrap())
}

#[test]
fn the_published_frames() {
    let rate = |stream, period_us| HostMessage::Rate { stream, period_us };
    let vectors = [
        (HostMessage::Identify, "5e3f24"),
        (HostMessage::Start(1), "5e670124"),
        (HostMessage::StopAll, "5e7824"),
        (rate(Stream::Imu, 1_000), "5e69000003e824"),
        (rate(Stream::Motors, 10_000), "5e6d0000271024"),
        (rate(Stream::Battery, 1_000_000), "5e62000f424024"),
        (HostMessage::Beep(440), "5e7e01b824"),
        (speeds(&[60.0; 6]), "5e77 208d208d208d208d208d208d 24"),
        (HostMessage::Speeds(MotorValues::new(&[0x215e]).unwrap()), "5e775cde5ca124"),
    ];
    for (message, text) in vectors {
        assert_eq!(encoded(&message.frame()), hex(text), "{message:?}");
        assert_eq!(received::<HostMessage>(&hex(text)).0, [message]);
    }
}

#[test]
fn the_published_speeds() {
    let vectors: [(f64, u16); 9] = [
        (0.0, 0x7fff),
        (10.0, 0x7fff),
        (15.25, 0x7fff),
        (16.0, 0x7a12),
        (50.0, 0x2710),
        (60.0, 0x208d),
        (100.0, 0x1388),
        (110.0, 0x11c1),
        (-50.0, 0xd8f0),
    ];
    for (hertz, word) in vectors {
        assert_eq!(half_period(hertz), word as i16, "{hertz} Hz");
    }
    assert!((speed(0x11c1) - 110.011).abs() < 1e-3);
    assert_eq!([half_period(-10.0), half_period(f64::NAN)], [-32767, 32767]);
    assert_eq!([half_period(f64::INFINITY), half_period(f64::NEG_INFINITY)], [1, -1]);
    assert_eq!(speed(0), 0.0);
}

#[test]
fn identities() {
    let identity = |board, major, minor| Some(Identity { board, major, minor });
    assert_eq!(Identity::parse(b"mkfl1.8"), identity(Board::Mkfl, 1, 8));
    assert_eq!(Identity::parse(b"flymu2.0"), identity(Board::Flymu, 2, 0));
    assert_eq!(Identity::parse(b"chimera1.10"), identity(Board::Chimera, 1, 10));
    assert_eq!(Identity::parse(b"teensy0.3"), identity(Board::Teensy, 0, 3));
    for text in [
        "",
        "mkfl",
        "mkfl1",
        "mkfl1.",
        "mkfl.1",
        "mkfl1.2.3",
        "mkfl-1.2",
        "Mkfl1.2",
        "mkfl1.70000",
        "arduino1.0",
    ] {
        assert_eq!(Identity::parse(text.as_bytes()), None, "{text}");
    }
    let scales = |text: &[u8]| ImuScales::known(&Identity::parse(text).unwrap());
    assert_eq!(scales(b"mkfl1.8"), Some(ImuScales::MILLI));
    assert_eq!(scales(b"chimera1.1"), Some(ImuScales::CHIMERA));
    assert_eq!(scales(b"chimera2.0"), Some(ImuScales::CHIMERA));
    assert_eq!([scales(b"chimera1.0"), scales(b"teensy1.0")], [None, None]);
}

#[test]
fn the_imu_in_physical_units() {
    let one_g = ImuFrame {
        accelerometer: [0, 0, 4096],
        gyro: [0, -32768, 0],
        temperature: Some(0),
        ..ImuFrame::default()
    };
    let (force, gyro) = ImuScales::CHIMERA.decode(&one_g);
    assert!((force - Vector3::new(0.0, 0.0, 9.81)).norm() < 1e-12);
    assert!((gyro.y.to_degrees() + 1000.0).abs() < 1e-9);
    assert_eq!(one_g.chimera_temperature(), Some(21.0));
    let far = Vector3::new(1e9, -1e9, f64::NAN);
    assert_eq!(ImuScales::MILLI.encode(&far, &far).0, [i16::MAX, i16::MIN, 0]);
}

#[test]
fn text_for_people_has_no_control_characters() {
    let text = Text::new(b"low\x1b[2J \xff battery");
    assert_eq!(text.to_string(), "low\\x1b[2J \\xff battery");
    assert_eq!(Text::new(&[b'a'; 100]).as_bytes().len(), Text::MAX);
}

#[test]
fn a_motor_that_does_not_spin_has_no_speed() {
    let motor = |state| MotorFrame { state: MotorState(state), half_period: 5000, ..MotorFrame::default() };
    assert_eq!(motor(0x21).speed(), 100.0);
    assert_eq!(motor(0x11).speed(), 0.0);
    let state = MotorState(0xb5);
    assert_eq!(
        (state.motor(), state.is_starting(), state.is_spinning(), state.is_emergency()),
        (5, true, true, true)
    );
}

#[test]
fn refusals_are_counted() {
    let bytes = [
        &b"noise"[..],
        b"^B\x01^B\x01\x02\x03$", // the first is cut by the second
        b"^B\x01!",               // aborted
        b"^$",                    // empty
        b"^B\\x$",                // an escape that nobody sends, and a stray `$`
        b"^Z12$",                 // no such message
        b"^B\x01\x02$",           // too short
        &[&b"^N"[..], &[b'x'; MAX_BODY], b"$"].concat(),
    ]
    .concat();
    let (messages, receiver) = received::<VehicleMessage>(&bytes);
    assert_eq!(messages, [VehicleMessage::Battery { sequence: 1, millivolts: 0x0203 }]);
    let counters = receiver.counters();
    let frames = counters.frames;
    assert_eq!(
        (frames.cut, frames.aborted, frames.empty, frames.bad_escape, frames.overlong),
        (1, 1, 1, 1, 1)
    );
    assert_eq!(
        (frames.whole, counters.messages, counters.unknown_letter, counters.wrong_length),
        (3, 1, 1, 1)
    );
    assert_eq!((frames.stray_bytes, counters.refused()), (7, 7));
}

fn values(range: impl Strategy<Value = i16>) -> impl Strategy<Value = MotorValues> {
    vec(range, 1..=MAX_ROTORS).prop_map(|v| MotorValues::new(&v).unwrap())
}

fn text() -> impl Strategy<Value = Text> {
    vec(any::<u8>(), 0..=Text::MAX).prop_map(|bytes| Text::new(&bytes))
}

fn host_message() -> impl Strategy<Value = HostMessage> {
    let stream = select(vec![Stream::Battery, Stream::Motors, Stream::Imu, Stream::Magnetometer]);
    prop_oneof![
        Just(HostMessage::Identify),
        (stream, any::<u32>()).prop_map(|(stream, period_us)| HostMessage::Rate { stream, period_us }),
        any::<u8>().prop_map(HostMessage::Start),
        any::<u8>().prop_map(HostMessage::Stop),
        Just(HostMessage::StopAll),
        values(any::<i16>()).prop_map(HostMessage::Speeds),
        values(-MAX_THROTTLE..=MAX_THROTTLE).prop_map(HostMessage::Throttles),
        any::<u16>().prop_map(HostMessage::Beep),
    ]
}

fn vehicle_message() -> impl Strategy<Value = VehicleMessage> {
    let imu = (any::<u8>(), any::<[i16; 3]>(), any::<[i16; 3]>(), option::of(any::<i16>())).prop_map(
        |(sequence, accelerometer, gyro, temperature)| ImuFrame {
            sequence,
            accelerometer,
            gyro,
            temperature,
        },
    );
    let motor = (any::<u8>(), any::<u8>(), any::<i16>(), any::<i16>(), any::<u16>()).prop_map(
        |(sequence, state, half_period, throttle, current_ma)| MotorFrame {
            sequence,
            state: MotorState(state),
            half_period,
            throttle,
            current_ma,
        },
    );
    let severity = select(vec![Severity::Note, Severity::Warning, Severity::Error]);
    prop_oneof![
        text().prop_map(VehicleMessage::Identity),
        imu.prop_map(VehicleMessage::Imu),
        (any::<u8>(), any::<[i16; 3]>())
            .prop_map(|(sequence, field)| VehicleMessage::Magnetometer { sequence, field }),
        motor.prop_map(VehicleMessage::Motor),
        any::<(u8, u16)>()
            .prop_map(|(sequence, millivolts)| VehicleMessage::Battery { sequence, millivolts }),
        any::<(u8, u8)>().prop_map(|(motor, calibration)| VehicleMessage::Clock { motor, calibration }),
        (severity, text()).prop_map(|(severity, text)| VehicleMessage::Text { severity, text }),
    ]
}

/// Bytes in which marks, escapes and letters are frequent.
fn hostile() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![
        3 => select(b"^$!\\".to_vec()),
        2 => select(vec![0xa1, 0xdb, 0xde, 0xa3]),
        2 => select(b"?ICMBTNAEbmicgxwq~".to_vec()),
        3 => any::<u8>(),
    ];
    vec(byte, 0..400)
}

/// The framing as a specification: a frame ends at every `$` whose nearest `^`
/// before it opens 1 to 64 bytes, with each mark among them escaped.
fn specified_bodies(bytes: &[u8]) -> Vec<Vec<u8>> {
    let ends = bytes.iter().enumerate().filter(|&(_, &byte)| byte == b'$').map(|(at, _)| at);
    ends.filter_map(|end| {
        let start = bytes[..end].iter().rposition(|&byte| byte == b'^')?;
        let mut rest = bytes[start + 1..end].iter();
        let mut body = Vec::new();
        while let Some(&byte) = rest.next() {
            body.push(match byte {
                b'$' | b'!' => return None,
                b'\\' => Some(!*rest.next()?).filter(|byte| b"^$!\\".contains(byte))?,
                byte => byte,
            });
        }
        (1..=MAX_BODY).contains(&body.len()).then_some(body)
    })
    .collect()
}

fn assert_round_trip<M: Message + PartialEq + Debug>(message: M, frame: Frame, before: &[u8]) {
    let wire = encoded(&frame);
    let stream: Vec<u8> = [before, &wire].concat();
    let (messages, _) = received::<M>(&stream);
    assert_eq!(messages.last(), Some(&message), "after {before:02x?}");
    assert!(wire[1..wire.len() - 1].iter().all(|byte| !b"^$!".contains(byte)));
    // Every shorter buffer is refused whole.
    for room in 0..wire.len() {
        assert_eq!(frame.encode(&mut vec![0; room]), 0);
    }
    // A frame cut anywhere is no frame, and does not harm the next.
    for cut in 0..wire.len() {
        let (messages, _) = received::<M>(&[&wire[..cut], &wire[..]].concat());
        assert_eq!(messages, [M::parse(frame.body()).unwrap()], "cut at {cut}");
    }
}

proptest! {
    #[test]
    fn host_messages_survive_the_wire(message in host_message(), before in hostile()) {
        assert_round_trip(message, message.frame(), &before);
    }

    #[test]
    fn vehicle_messages_survive_the_wire(message in vehicle_message(), before in hostile()) {
        assert_round_trip(message, message.frame(), &before);
    }

    #[test]
    fn escapes_at_every_position(mut body in vec(any::<u8>(), 1..=MAX_BODY)) {
        for at in 0..body.len() {
            for mark in *b"^$!\\" {
                let kept = std::mem::replace(&mut body[at], mark);
                prop_assert_eq!(bodies(&encoded(&Frame::new(&body).unwrap())), vec![body.clone()]);
                body[at] = kept;
            }
        }
    }

    #[test]
    fn exactly_the_frames_that_are_there(bytes in hostile()) {
        prop_assert_eq!(bodies(&bytes), specified_bodies(&bytes));
    }

    #[test]
    fn only_canonical_messages_are_read(bytes in hostile()) {
        for body in bodies(&bytes) {
            if let Ok(message) = HostMessage::parse(&body) {
                prop_assert_eq!(message.frame(), Frame::new(&body).unwrap());
            }
            if let Ok(message) = VehicleMessage::parse(&body) {
                prop_assert_eq!(message.frame(), Frame::new(&body).unwrap());
            }
        }
    }

    #[test]
    fn messages_of_any_other_length_are_refused(message in vehicle_message(), extra in vec(any::<u8>(), 1..8)) {
        let frame = message.frame();
        let body = frame.body();
        let longer = [body, &extra].concat();
        let free_length = b"?NAE".contains(&body[0]);
        for other in [&longer[..], &body[..body.len() - 1]] {
            let allowed = free_length || body[0] == b'I' && matches!(other.len(), 14 | 16);
            if !allowed {
                let refusal = Refusal::WrongLength { letter: body[0], found: other.len() };
                prop_assert_eq!(VehicleMessage::parse(other), Err(refusal));
            }
        }
    }

    #[test]
    fn speeds_are_truncated_half_periods(hertz in prop_oneof![15.26..2000.0_f64, -2000.0..-15.26_f64]) {
        let word = half_period(hertz);
        let exact = 5e5 / hertz;
        prop_assert_eq!(f64::from(word).signum(), hertz.signum());
        prop_assert!(f64::from(word).abs() <= exact.abs() && exact.abs() < f64::from(word).abs() + 1.0);
        prop_assert!(speed(word).abs() >= LOWEST_SPEED);
    }

    #[test]
    fn any_speed_asks_for_a_speed_that_exists(bits in any::<u64>()) {
        let word = half_period(f64::from_bits(bits));
        prop_assert!(word != 0 && word != i16::MIN);
    }

    #[test]
    fn imu_counts_round_trip(accelerometer in any::<[i16; 3]>(), gyro in any::<[i16; 3]>()) {
        for scales in [ImuScales::MILLI, ImuScales::CHIMERA] {
            let (force, rate) = scales.decode(&ImuFrame { accelerometer, gyro, ..ImuFrame::default() });
            prop_assert_eq!(scales.encode(&force, &rate), (accelerometer, gyro));
        }
    }
}
