//! The messages between a base and a vehicle that flies itself: every message comes back, damaged ones are refused.

#![allow(clippy::unwrap_used)]

use std::fmt::Debug;

use proptest::{array::uniform3, prelude::*};
use tilthex_core::{
    Matrix3, Vector3, Vector6, Wrench,
    flight::Record,
    so3,
    supervisor::{COUNT, FaultSet, Phase},
    trajectory::Limits,
    types::RobotState,
};
use tilthex_link::{
    onboard::{
        Answer, Facts, GoTo, Order, Part, Periods, PoseMessage, RecordParts, RemoteClock, ToBase, ToVehicle,
    },
    tk3::{HostMessage, MAX_BODY, MAX_FRAME, Message, Receiver, Refusal, VehicleMessage},
};

/// The magnitudes of the numbers in the messages.
fn vector() -> impl Strategy<Value = Vector3> {
    uniform3(-50.0f32..50.0).prop_map(|v| Vector3::from(v.map(f64::from)))
}

fn rotation() -> impl Strategy<Value = Matrix3> {
    uniform3(-1.7..1.7).prop_map(|v| so3::exp(&Vector3::from(v)))
}

fn diagonal() -> impl Strategy<Value = Vector6> {
    prop::array::uniform6(0.0f32..500.0).prop_map(|v| Vector6::from(v.map(f64::from)))
}

fn rate() -> impl Strategy<Value = f64> {
    (0.01f32..50.0).prop_map(f64::from)
}

fn order() -> impl Strategy<Value = Order> {
    let limits = (rate(), rate(), rate(), rate()).prop_map(
        |(velocity, acceleration, angular_velocity, angular_acceleration)| Limits {
            velocity,
            acceleration,
            angular_velocity,
            angular_acceleration,
        },
    );
    let go_to =
        (vector(), rotation(), rate(), limits).prop_map(|(position_w, rotation_we, duration, limits)| {
            Order::GoTo(GoTo { position_w, rotation_we, duration, limits })
        });
    prop_oneof![
        Just(Order::TakeOff),
        Just(Order::Land),
        Just(Order::Kill),
        Just(Order::Hold),
        Just(Order::ZeroBias),
        go_to,
        (prop::sample::select(&[Part::Mass, Part::Damping, Part::Stiffness][..]), diagonal())
            .prop_map(|(part, diagonal)| Order::Admittance(part, diagonal)),
    ]
}

fn to_vehicle() -> impl Strategy<Value = ToVehicle> {
    let pose = (any::<(u8, bool, u32, u32)>(), vector(), rotation()).prop_map(
        |((number, tracking_valid, sent, age), position_w, rotation_wr)| {
            ToVehicle::Pose(PoseMessage { number, tracking_valid, sent, age, position_w, rotation_wr })
        },
    );
    prop_oneof![
        pose,
        (any::<u8>(), order()).prop_map(|(number, order)| ToVehicle::Order(number, order)),
        any::<u16>().prop_map(ToVehicle::Heartbeat),
        any::<u32>().prop_map(ToVehicle::Records),
        Just(ToVehicle::Tk3(HostMessage::StopAll)),
    ]
}

prop_compose! {
    fn record()(
        a in vector(), b in vector(), c in vector(), d in vector(), e in vector(), r in rotation(), q in rotation(),
        faults in 0u64..1 << COUNT, start in prop::option::of(vector()), compliant: bool, saturated: bool,
        phase in prop::sample::select(&[Phase::Disarmed, Phase::Flying, Phase::Emergency][..]),
        pose_age in prop_oneof![0.0..60.0, Just(f64::INFINITY)], time in 0.0..1e5,
    ) -> Record {
        let mut record = Record { phase, faults: FaultSet(faults), start_w: start, ..Record::default() };
        record.state = RobotState { position_w: a, velocity_w: b, rotation_wr: r, angular_velocity_r: c };
        record.wrench_tool_w = Wrench { force: d, torque: e };
        (record.reference.position_w, record.reference.rotation_we) = (b, q);
        (record.setpoint.position_w, record.setpoint.rotation_we) = (c, r);
        (record.compliant, record.saturated, record.pose_age) = (compliant, saturated, pose_age);
        record.input.time = time;
        record
    }
}

fn to_base() -> impl Strategy<Value = [ToBase; 4]> {
    let ended = prop::option::of(0..COUNT as u8);
    let answer = prop_oneof![
        Just(Answer::Nothing),
        any::<u8>().prop_map(Answer::Accepted),
        any::<u8>().prop_map(Answer::Refused)
    ];
    let told = (any::<u8>(), ended, answer, 0u8..64, any::<[u32; 4]>());
    (told, record()).prop_map(|((number, ended, answer, facts, [battery, motors, imu, records]), record)| {
        let parts = RecordParts::new(number, &record, Facts(facts), ended, answer);
        let periods = Periods { battery, motors, imu, records };
        [
            ToBase::Flight(parts.flight),
            ToBase::State(parts.state),
            ToBase::Tool(parts.tool),
            ToBase::Periods(periods),
        ]
    })
}

fn bytes(encode: impl FnOnce(&mut [u8]) -> usize) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let length = encode(&mut out);
    assert!(length > 0);
    out[..length].to_vec()
}

fn received<M: Message>(bytes: &[u8]) -> (Vec<M>, Receiver<M>) {
    let mut receiver = Receiver::default();
    (bytes.iter().filter_map(|byte| receiver.push(*byte)).collect(), receiver)
}

/// Whether two messages are the same but for the rounding of their floats: a rotation goes through a quaternion of 32 bits.
fn alike(one: &impl Debug, other: &impl Debug) -> bool {
    let (one, other) = (format!("{one:?}"), format!("{other:?}"));
    let part = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | 'e');
    let numbers =
        |text: &str| text.split(|c| !part(c)).filter_map(|word| word.parse().ok()).collect::<Vec<f64>>();
    let words = |text: &str| text.chars().filter(|c| c.is_alphabetic() && *c != 'e').collect::<String>();
    let (a, b) = (numbers(&one), numbers(&other));
    let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-4;
    words(&one) == words(&other) && a.len() == b.len() && a.iter().zip(&b).all(near)
}

proptest! {
    #[test]
    fn every_message_to_the_vehicle_comes_back(message in to_vehicle()) {
        prop_assert!(message.frame().body().len() <= MAX_BODY);
        let (back, _) = received::<ToVehicle>(&bytes(|out| message.encode(out)));
        prop_assert!(back.len() == 1 && alike(&back[0], &message), "{:?} {:?}", message, back);
    }

    #[test]
    fn every_message_to_the_base_comes_back(parts in to_base()) {
        for part in parts {
            prop_assert!(part.frame().body().len() <= MAX_BODY);
            let (back, _) = received::<ToBase>(&bytes(|out| part.encode(out)));
            prop_assert!(back.len() == 1 && alike(&back[0], &part), "{:?} {:?}", part, back);
        }
    }

    /// Up to two bits of a body are found by its checksum. In the letter they can make a message of tk3 of it, which has none:
    /// at the worst one that sets the rate of a stream.
    #[test]
    fn a_damaged_message_is_refused(
        message in to_vehicle(), at in any::<[prop::sample::Index; 2]>(), bits in (0u8..8, 0u8..8)
    ) {
        prop_assume!(!matches!(message, ToVehicle::Tk3(_)));
        let mut body = message.frame().body().to_vec();
        let [at, also] = at.map(|at| at.index(body.len()));
        body[at] ^= 1 << bits.0;
        if (at, bits.0) != (also, bits.1) {
            body[also] ^= 1 << bits.1;
        }
        let found = ToVehicle::parse(&body);
        let letter = at == 0 || also == 0;
        prop_assert!(found.is_err() || letter && matches!(found, Ok(ToVehicle::Tk3(HostMessage::Rate { .. }))), "{:?}", found);
    }

    #[test]
    fn a_damaged_record_is_refused(parts in to_base(), at in any::<prop::sample::Index>(), bit in 0u8..8) {
        for part in parts {
            let mut body = part.frame().body().to_vec();
            // The letter of a text of tk3 is not protected.
            let at = 1 + at.index(body.len() - 1);
            body[at] ^= 1 << bit;
            prop_assert_eq!(ToBase::parse(&body), Err(Refusal::WrongChecksum(body[0])));
        }
    }

    #[test]
    fn a_cut_message_is_refused(message in to_vehicle(), cut in any::<prop::sample::Index>()) {
        let body = message.frame().body().to_vec();
        let shorter = &body[..cut.index(body.len())];
        prop_assert!(ToVehicle::parse(shorter).is_err());
    }

    #[test]
    fn any_bytes_are_read_without_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        received::<ToVehicle>(&bytes);
        received::<ToBase>(&bytes);
    }

    /// The clock of the other end differs by any offset, wraps, and its messages come with a jitter.
    #[test]
    fn the_time_of_a_pose_survives_the_line(begin: u32, offset in -1e4..1e4, jitter in prop::collection::vec(0.0..3e-3, 200)) {
        let mut clock = RemoteClock::new().unwrap();
        let mut worst: f64 = 0.0;
        for (k, late) in (0_u32..).zip(&jitter) {
            let sent = 0.01 * f64::from(k);
            let found = clock.sent(begin.wrapping_add(10_000 * k), sent + offset + late);
            if k > 100 {
                worst = worst.max(f64::abs(found - sent - offset));
            }
        }
        prop_assert!(worst < 3e-3);
    }
}

/// A number that no vehicle uses, in a message with a right checksum.
#[test]
fn a_number_out_of_range_is_refused() {
    let pose = PoseMessage {
        number: 1,
        tracking_valid: true,
        sent: 0,
        age: 0,
        position_w: Vector3::zeros(),
        rotation_wr: Matrix3::identity(),
    };
    for (message, letter) in [
        (ToVehicle::Pose(PoseMessage { position_w: Vector3::new(1e6, 0.0, 0.0), ..pose }), b'p'),
        (ToVehicle::Pose(PoseMessage { position_w: Vector3::new(f64::NAN, 0.0, 0.0), ..pose }), b'p'),
        (ToVehicle::Order(1, Order::Admittance(Part::Mass, Vector6::repeat(-1.0))), b'o'),
        (ToVehicle::Order(1, Order::Admittance(Part::Mass, Vector6::repeat(f64::INFINITY))), b'o'),
    ] {
        assert_eq!(ToVehicle::parse(message.frame().body()), Err(Refusal::OutOfRange(letter)), "{message:?}");
        let (none, receiver) = received::<ToVehicle>(&bytes(|out| message.encode(out)));
        assert!(none.is_empty() && receiver.counters().refused() == 1);
    }
}

/// The published frames: other programs may use them to check their codec.
#[test]
fn frames_of_this_version() {
    let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    let frame = |message: ToVehicle| hex(&bytes(|out| message.encode(out)));
    assert_eq!(frame(ToVehicle::Order(1, Order::TakeOff)), "5e6f01014df024");
    assert_eq!(frame(ToVehicle::Heartbeat(0)), "5e680000dc8124");
    assert_eq!(frame(ToVehicle::Records(20_000)), "5e7200004e20730c24");
    assert_eq!(frame(ToVehicle::Order(0, Order::Kill)), "5e6f00031c7024");
}

/// The letters of tk3 mean the same in both protocols.
#[test]
fn messages_of_tk3_pass_unchanged() {
    let stop = bytes(|out| HostMessage::StopAll.encode(out));
    assert_eq!(received::<ToVehicle>(&stop).0, [ToVehicle::Tk3(HostMessage::StopAll)]);
    let battery = VehicleMessage::Battery { sequence: 3, millivolts: 15_000 };
    assert_eq!(received::<ToBase>(&bytes(|out| battery.encode(out))).0, [ToBase::Tk3(battery)]);
}
