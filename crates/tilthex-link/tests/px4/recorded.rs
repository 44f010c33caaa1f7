//! Recorded conversations with clients that others wrote.

use super::{framed, messages, params::params, written};
use tilthex_core::flight::MotorCommand;
use tilthex_link::{Link, LinkKind, MAX_BYTES_IN, Outgoing, VehicleLink, px4::*};

/// A conversation with eProsima's Micro-XRCE-DDS-Client 3.0.1 over a serial line, recorded by tilthex: the session, clock
/// and topics as PX4's `uxrce_dds_client` makes them, then streams. Records of `V` (from the vehicle) or `H` (from the
/// host), the number of bytes (u16), and the bytes.
const OF_CLIENT: &[u8] = include_bytes!("../data/micro_xrce_dds_client.bin");

/// Four parts of a conversation with PX4 (main of February 2025, in software) over UDP: the session with the first
/// streams; the orders to change the mode, to arm and to disarm, each until PX4 reports that it has obeyed. Each record is
/// a datagram.
const OF_PX4: &[u8] = include_bytes!("../data/px4.bin");

fn recorded(mut rest: &'static [u8]) -> impl Iterator<Item = (u8, &'static [u8])> {
    std::iter::from_fn(move || {
        let (&[from, low, high], after) = rest.split_first_chunk()?;
        let (bytes, after) = after.split_at(usize::from(u16::from_le_bytes([low, high])));
        rest = after;
        Some((from, bytes))
    })
}

fn host() -> Link {
    Link::new(LinkKind::Px4, params(), 6).unwrap()
}

/// Takes framed bytes in a tick that ends at `now`, s. Returns the number of samples, whether `look` saw one, and the bytes
/// that the host sends.
fn tick(link: &mut Link, bytes: &[u8], now: f64) -> (usize, bool, Vec<u8>) {
    let (mut samples, mut due) = (0, false);
    for part in bytes.chunks(MAX_BYTES_IN) {
        due |= link.look(part).arrived;
        samples += link.receive(part, now).inertial.samples().len();
    }
    let mut out = Outgoing::default();
    link.command(&MotorCommand::Stop, now, &mut out);
    (samples, due, out.bytes().to_vec())
}

/// The orders to PX4 in data that the agent sends.
fn orders<'a>(said: impl Iterator<Item = FromAgent<'a>>) -> Vec<VehicleCommand> {
    let length = written(&VehicleCommand::Arm).len();
    said.filter_map(|said| match said {
        FromAgent::Data(_, data) if data.len() == length => VehicleCommand::read(data),
        _ => None,
    })
    .collect()
}

/// What the agent says in its messages.
fn said(messages: &[Vec<u8>]) -> impl Iterator<Item = FromAgent<'_>> {
    messages.iter().flat_map(|message| {
        Message::parse(message).unwrap().from_agent().collect::<Option<Vec<_>>>().unwrap()
    })
}

/// The messages that answer requests. The clock's answers change with the time, and are left out.
fn answers(messages: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
    let answers = |said: FromAgent<'_>| {
        matches!(said, FromAgent::StatusAgent(_) | FromAgent::Status(..) | FromAgent::Info(..))
    };
    messages.into_iter().filter(|message| said(std::slice::from_ref(message)).any(answers)).collect()
}

#[test]
fn a_client_that_others_wrote_gets_its_session_and_is_understood() {
    let (mut link, mut now, mut samples, mut due, mut sent) = (host(), 1.0, 0, 0, Vec::new());
    for (_, bytes) in recorded(OF_CLIENT).filter(|(from, _)| *from == b'V') {
        now += 0.002;
        let (found, seen, out) = tick(&mut link, bytes, now);
        (samples, due) = (samples + found, due + usize::from(seen));
        sent.extend(out);
    }
    let telemetry = link.telemetry();
    assert!(telemetry.link.identified && telemetry.link.refused_frames == 0);
    assert!(telemetry.battery.is_none_or(|volts| (volts - 15.5).abs() < 1e-6));
    assert!(samples > 20 && due > 0, "{samples} {due}");
    assert!(telemetry.motors().iter().all(|motor| motor.heard > 1.0));
    let unlisted = |complaint| {
        matches!(complaint, tilthex_link::Complaint::Px4(Complaint::Missing(_) | Complaint::Unwanted(_)))
    };
    assert!(!link.complaint().is_some_and(unlisted));
    let then: Vec<u8> =
        recorded(OF_CLIENT).filter(|(from, _)| *from == b'H').flat_map(|(_, bytes)| bytes.to_vec()).collect();
    let host = || Decoder::new(CLIENT);
    let (then, now) = (answers(messages(&mut host(), &then)), answers(messages(&mut host(), &sent)));
    assert_eq!(then, now);
    assert_eq!(then.len(), 2 + 1 + 9 * 3, "ping, session, participant, and three parts of nine topics");
}

#[test]
fn px4_gets_its_session_and_obeys() {
    // Eight messages come in each period of the IMU.
    const RECORD: f64 = 0.002 / 8.0;
    /// Length of a message's header without a key, bytes.
    const HEADER: usize = 4;
    let armed = |link: &Link| link.complaint() == Some(tilthex_link::Complaint::Px4(Complaint::Armed));
    let (mut link, mut now, mut sent, mut changes) = (host(), 1.0, Vec::new(), vec![false]);
    let (mut samples, mut of_streams) = (0, 0);
    for (_, message) in recorded(OF_PX4).filter(|(from, _)| *from == b'V') {
        now += RECORD;
        let (found, _, out) = tick(&mut link, &framed(message), now);
        samples += found;
        of_streams += if samples > 0 { framed(message).len() } else { 0 };
        sent.extend(out);
        if link.telemetry().link.identified && armed(&link) != changes[changes.len() - 1] {
            changes.push(armed(&link));
        }
    }
    assert_eq!(changes, [false, true, false], "the vehicle status says when PX4 is armed");
    let telemetry = link.telemetry();
    assert_eq!((telemetry.link.refused_frames, telemetry.link.refused_samples), (0, 0));
    assert!(samples > 40, "{samples}");
    let period = of_streams / samples;
    assert!(2 * period < MAX_BYTES_IN, "a tick takes all topics of two periods, {period} bytes each");
    assert!(telemetry.battery.is_some_and(|volts| (14.0..17.0).contains(&volts)));
    assert!(telemetry.motors().iter().all(|motor| motor.heard > 1.0));
    let then: Vec<_> =
        recorded(OF_PX4).filter(|(from, _)| *from == b'H').map(|(_, bytes)| bytes.to_vec()).collect();
    // The numbers in the headers differ: the host of then also sent throttles.
    let bodies = |all| answers(all).into_iter().map(|message| message[HEADER..].to_vec()).collect::<Vec<_>>();
    assert_eq!(bodies(then.clone()), bodies(messages(&mut Decoder::new(CLIENT), &sent)));
    // The orders that PX4 obeyed in this conversation.
    assert_eq!(orders(said(&then)), [VehicleCommand::Offboard, VehicleCommand::Arm, VehicleCommand::Disarm]);
    assert!(said(&then).any(|said| matches!(said, FromAgent::Data(_, data)
        if data == written(&OffboardControlMode { direct_actuator: true }))));
}

/// Receives the recorded conversation up to the order number `count` (from 0), then wants to start with a silent PX4.
/// Returns the texts and the orders of 3 s.
fn start_with_a_silent_px4(count: usize) -> (Vec<String>, Vec<VehicleCommand>) {
    let (mut link, mut now, mut ordered) = (host(), 1.0, 0);
    for (from, message) in recorded(OF_PX4) {
        now += 1e-4;
        match from {
            b'V' => drop(tick(&mut link, &framed(message), now)),
            _ if ordered == count && !orders(said(&[message.to_vec()])).is_empty() => break,
            _ => ordered += orders(said(&[message.to_vec()])).len(),
        }
    }
    let (mut told, mut sent) = (Vec::new(), Vec::new());
    for _ in 0..1500 {
        now += 0.002;
        link.receive(&[], now);
        told.extend(link.text().map(|(_, text)| text.to_string()));
        let mut out = Outgoing::default();
        link.command(&MotorCommand::Start(Default::default()), now, &mut out);
        sent.extend_from_slice(out.bytes());
    }
    (told, orders(said(&messages(&mut Decoder::new(CLIENT), &sent))))
}

#[test]
fn an_order_that_px4_does_not_obey_is_told_once() {
    let cases = [
        (VehicleCommand::Offboard, "PX4 does not enter the offboard mode: QGroundControl says why"),
        (VehicleCommand::Arm, "PX4 does not arm: QGroundControl shows which check refuses"),
    ];
    for (count, (order, text)) in cases.into_iter().enumerate() {
        let (told, sent) = start_with_a_silent_px4(count);
        assert_eq!(told, [text]);
        assert!(sent.len() > 5 && sent.iter().all(|other| *other == order), "{sent:?}");
    }
}
