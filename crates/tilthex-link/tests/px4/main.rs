//! The PX4 link's codec: framing, messages and topics, over random and damaged bytes.

#![allow(clippy::unwrap_used)]

#[path = "../params/mod.rs"]
mod params;
mod recorded;

use proptest::{collection::vec, prelude::*};
use std::fmt::Debug;
use tilthex_link::px4::*;

/// The byte that begins an escape sequence.
const ESCAPE: u8 = 0x7d;

fn framed(message: &[u8]) -> Vec<u8> {
    let mut out = vec![0; 2 * message.len() + 13];
    let length = encode(CLIENT, AGENT, message, &mut out);
    assert!(length > 0, "2 n + 13 bytes always suffice");
    out.truncate(length);
    out
}

fn messages(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Vec<u8>> {
    bytes.iter().filter_map(|byte| decoder.push(*byte).map(<[u8]>::to_vec)).collect()
}

fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u32> = text.chars().filter_map(|c| c.to_digit(16)).collect();
    digits.chunks(2).map(|pair| (pair[0] * 16 + pair[1]) as u8).collect()
}

/// Bytes with many of those that the framing escapes.
fn any_bytes(most: usize) -> impl Strategy<Value = Vec<u8>> {
    vec(prop_oneof![any::<u8>(), Just(0x7e), Just(0x7d)], 0..most)
}

fn written<T: TopicMessage>(message: &T) -> Vec<u8> {
    let mut out = [0; 512];
    let length = message.write(&mut out);
    assert!(length > 0);
    out[..length].to_vec()
}

fn survives<T: TopicMessage + PartialEq + Debug>(message: T) -> Result<usize, TestCaseError> {
    let data = written(&message);
    for short in 0..data.len().min(4) {
        prop_assert_eq!(message.write(&mut vec![0; short]), 0);
    }
    prop_assert_eq!(T::read(&data), Some(message));
    Ok(data.len())
}

fn request() -> impl Strategy<Value = Request> {
    any::<([u8; 2], [u8; 2])>().prop_map(|(number, object)| Request { number, object: ObjectId(object) })
}

fn time() -> impl Strategy<Value = Time> {
    any::<(i32, u32)>().prop_map(|(seconds, nanoseconds)| Time { seconds, nanoseconds })
}

#[test]
fn the_crc_is_that_of_the_standard() {
    // CRC-16/ARC of "123456789" is 0xbb3d.
    assert_eq!(framed(b"123456789"), hex("7e 01 00 09 00 31 32 33 34 35 36 37 38 39 3d bb"));
    assert_eq!(framed(&[0x7e, 0x7d]), hex("7e 01 00 02 00 7d5e 7d5d e1 81"));
}

#[test]
fn a_topic_is_known_by_its_name_alone() {
    for topic in Topic::ALL {
        let name = topic.name();
        for text in [format!("rt{name}"), format!("rt/uav_1{name}"), format!("rt{name}_v1")] {
            assert_eq!(Topic::named(text.as_bytes()), Some(*topic), "{text}");
        }
        for text in [name.to_owned(), format!("rt{name}x"), format!("rt{name}_v"), format!("rr{name}")] {
            assert_eq!(Topic::named(text.as_bytes()), None, "{text}");
        }
    }
}

#[test]
fn topics_have_the_lengths_of_their_definitions() {
    assert_eq!(written(&SensorCombined::default()).len(), 48);
    assert_eq!(written(&EscStatus::default()).len(), EscStatus::LENGTH);
    assert_eq!(written(&ActuatorMotors { control: [0.0; MOTORS] }).len(), 68);
    assert_eq!(written(&OffboardControlMode::default()).len(), 15);
    assert_eq!(written(&VehicleCommand::Arm).len(), 56);
}

proptest! {
    #[test]
    fn messages_survive_the_line_wherever_they_are_cut(
        all in vec(any_bytes(300), 1..5), stray in any_bytes(20), cut in any::<prop::sample::Index>(),
    ) {
        let stray: Vec<u8> = stray.into_iter().filter(|byte| *byte != 0x7e).collect();
        let mut line = stray.clone();
        all.iter().for_each(|message| line.extend(framed(message)));
        let (before, after) = line.split_at(cut.index(line.len()));
        let mut decoder = Decoder::new(AGENT);
        let found = [messages(&mut decoder, before), messages(&mut decoder, after)].concat();
        prop_assert_eq!(&found, &all);
        let counters = decoder.counters();
        prop_assert_eq!((counters.whole as usize, counters.refused()), (all.len(), 0));
        prop_assert_eq!(counters.stray_bytes as usize, stray.len());
    }

    #[test]
    fn one_damaged_byte_never_passes_and_the_next_message_does(
        message in any_bytes(200), place in any::<prop::sample::Index>(), with in 1..=255_u8,
    ) {
        let mut line = framed(&message);
        let index = place.index(line.len());
        // If an escape appears or disappears, the bytes behind it shift. One in 65536 such changes passes 16 bits of checksum.
        prop_assume!(line[index] != ESCAPE && line[index] ^ with != ESCAPE);
        line[index] ^= with;
        // A longer length may take in the frames behind it; a start of a frame ends it.
        line.extend(framed(b"next"));
        let found = messages(&mut Decoder::new(AGENT), &line);
        prop_assert_eq!(found.last().map(Vec::as_slice), Some(b"next".as_slice()));
        // The first byte of an address decides whom it is for, and the sender's is not looked at.
        let harmless = index == 1;
        prop_assert!(found.len() == 1 || harmless && found[0] == message, "{:?}", found);
    }

    #[test]
    fn hostile_bytes_are_refused_and_a_message_after_them_is_read(bytes in any_bytes(2000)) {
        let mut decoder = Decoder::new(AGENT);
        for found in messages(&mut decoder, &bytes) {
            if let Some(message) = Message::parse(&found) {
                message.from_client().count();
                message.from_agent().count();
            }
        }
        prop_assert_eq!(messages(&mut decoder, &framed(b"next")).pop(), Some(b"next".to_vec()));
    }

    #[test]
    fn any_bytes_are_parsed_or_refused(bytes in any_bytes(600), id in 0..16_u8, session in any::<u8>()) {
        let length = (bytes.len() as u16).to_le_bytes();
        let whole = [&[session, 1, 0, 0, id, 1, length[0], length[1]], bytes.as_slice()].concat();
        for message in Message::parse(&whole).into_iter().chain(Message::parse(&bytes)) {
            prop_assert!(message.submessages().count() <= whole.len());
            message.from_client().count();
            message.from_agent().count();
        }
        SensorCombined::read(&bytes);
        EscStatus::read(&bytes);
        BatteryStatus::read(&bytes);
        VehicleStatus::read(&bytes);
        ActuatorMotors::read(&bytes);
        OffboardControlMode::read(&bytes);
        VehicleCommand::read(&bytes);
        let _ = Topic::named(&bytes);
    }

    #[test]
    fn what_the_agent_says_survives(
        a in request(), b in request(), status in any::<u8>(), active in any::<bool>(), times in (time(), time()),
        numbers in any::<(u16, u16, u8)>(), data in any_bytes(90), sequence in any::<u16>(),
    ) {
        let said = [
            FromAgent::StatusAgent(status),
            FromAgent::Status(a, status),
            FromAgent::Info(b, active),
            FromAgent::AckNack { first: numbers.0, missing: numbers.1, stream: numbers.2 },
            FromAgent::TimestampReply { now: times.0, asked: times.1 },
            FromAgent::Data(a, &data),
        ];
        let header = Header { session: 0x81, stream: BEST_EFFORT, sequence };
        let mut draft = Draft::<256>::new(header);
        prop_assert!(draft.is_empty() && said.iter().all(|submessage| draft.agent(submessage)));
        let message = Message::parse(draft.bytes()).unwrap();
        prop_assert_eq!(message.header, header);
        prop_assert_eq!(message.from_agent().collect::<Option<Vec<_>>>(), Some(said.to_vec()));
        // What does not fit is left out whole.
        let mut small = Draft::<32>::new(header);
        let fitted: Vec<_> = said.iter().filter(|submessage| small.agent(submessage)).copied().collect();
        prop_assert!(fitted.len() < said.len());
        let message = Message::parse(small.bytes()).unwrap();
        prop_assert_eq!(message.from_agent().collect::<Option<Vec<_>>>(), Some(fitted));
    }

    #[test]
    fn topics_survive(
        timestamp in any::<u64>(), six in any::<[i16; 6]>(), clipped in any::<bool>(),
        escs in any::<[(i32, u8, u16); ESCS]>(), flags in any::<(u8, u8)>(), controls in any::<[u16; MOTORS]>(),
    ) {
        let number = |x: i16| f32::from(x) / 64.0;
        let [a, b, c, d, e, f] = six.map(number);
        survives(SensorCombined { timestamp, gyro: [a, b, c], accelerometer: [d, e, f], clipped })?;
        let report = |(rpm, function, failures)| EscReport { timestamp, rpm, voltage: a, current: b, function, failures };
        survives(EscStatus { timestamp, count: flags.0, online: flags.1, escs: escs.map(report) })?;
        survives(BatteryStatus { timestamp, connected: clipped, voltage: c })?;
        survives(VehicleStatus { timestamp, arming: flags.0, mode: flags.1 })?;
        survives(ActuatorMotors { control: controls.map(|x| f32::from(x) / 65_536.0) })?;
        survives(OffboardControlMode { direct_actuator: clipped })?;
        for command in [VehicleCommand::Offboard, VehicleCommand::Arm, VehicleCommand::Disarm] {
            survives(command)?;
        }
    }
}

/// The client's half is written by simulated vehicles only.
#[cfg(feature = "board")]
mod client {
    use super::*;

    fn named() -> impl Strategy<Value = Vec<u8>> {
        "rt/fmu/(out|in)/[a-z_]{1,40}".prop_map(String::into_bytes)
    }

    proptest! {
        #[test]
        fn what_the_client_says_survives(
            a in request(), object in any::<[u8; 2]>(), name in named(), session in 0x80..=255_u8, time in time(),
            numbers in any::<(u16, u16, u8)>(), data in any_bytes(90),
        ) {
            let topic = TopicName::Object(ObjectId(object));
            let said = [
                FromClient::CreateClient { session },
                FromClient::Create(a, Entity::Other),
                FromClient::Create(a, Entity::Topic(&name)),
                FromClient::Create(a, Entity::Writer(topic)),
                FromClient::Create(a, Entity::Writer(TopicName::Text(&name))),
                FromClient::Create(a, Entity::Reader(topic)),
                FromClient::Create(a, Entity::Reader(TopicName::Text(&name))),
                FromClient::GetInfo(a),
                FromClient::Delete(a),
                FromClient::ReadData(a),
                FromClient::AckNack,
                FromClient::Heartbeat { first: numbers.0, last: numbers.1, stream: numbers.2 },
                FromClient::Timestamp(time),
                FromClient::WriteData(ObjectId(object), &data),
            ];
            let mut draft = Draft::<1024>::new(Header { session, stream: RELIABLE, sequence: 3 });
            prop_assert!(said.iter().all(|submessage| draft.client(submessage)));
            let message = Message::parse(draft.bytes()).unwrap();
            prop_assert_eq!(message.from_client().collect::<Option<Vec<_>>>(), Some(said.to_vec()));
        }
    }
}
