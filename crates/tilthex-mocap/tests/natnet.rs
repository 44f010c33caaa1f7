//! The NatNet codec: packets of a real server, round trips, hostile bytes.

#![allow(clippy::unwrap_used)]

use proptest::{collection::vec, option, prelude::*, sample::select};
use std::{fs, path::PathBuf};
use tilthex_mocap::{
    Malformed,
    natnet::{
        BodyName, Frame, FrameTimes, MAX_PACKET, MessageId, ModelDef, RigidBody, ServerInfo, Version,
        announced_version, parse_connect, parse_echo_request, parse_echo_response, parse_packet, write_bare,
        write_connect, write_echo_request, write_echo_response, write_frame, write_model_def,
        write_server_info,
    },
};

/// A recorded file; the test that asks for it ends early where there is none.
fn recorded(name: &str) -> Option<Vec<u8>> {
    let folder = std::env::var_os("TILTHEX_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let path = folder.join("natnet").join(name);
    fs::read(&path).inspect_err(|_| eprintln!("skipped: {} is absent; set TILTHEX_DATA", path.display())).ok()
}

fn payload(packet: &[u8], expected: MessageId) -> &[u8] {
    let (id, payload) = parse_packet(packet).unwrap();
    assert_eq!(id, expected);
    payload
}

#[test]
fn a_recorded_frame() {
    // The session holds the same 336 bytes as the packet that was cut from it.
    let Some(capture) = recorded("traffic.pcapng") else { return };
    let golden = |datagram: &&[u8]| datagram.get(4..8) == Some(&162_734_i32.to_le_bytes());
    let packet = datagrams(&capture).into_iter().find(golden).unwrap();
    assert_eq!(packet.len(), 336);
    let frame = Frame::parse(payload(packet, MessageId::Frame), Version::V3_0).unwrap();
    assert_eq!(frame.number, 162_734);
    assert!((frame.times.timestamp - 1_356.116_667).abs() < 1e-6);
    assert_eq!(frame.bodies().count(), 1);
    let body = frame.body(2).unwrap();
    let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near(&body.position, &[0.174_447, 1.447_131, -0.734_304]));
    assert!(near(&body.quaternion_xyzw, &[-0.054_594, 0.509_948, 0.043_704, -0.857_358]));
    assert!((body.mean_error - 5.15e-4).abs() < 1e-6);
    assert!(body.tracking_valid && !frame.models_changed);
    let times = frame.times;
    assert!(times.mid_exposure < times.received && times.received < times.transmitted);
    assert!(frame.body(3).is_none());
}

#[test]
fn a_recorded_frame_with_a_hidden_marker() {
    let Some(packet) = recorded("mocapframe_packet_occluded_v3.bin") else { return };
    let frame = Frame::parse(payload(&packet, MessageId::Frame), Version::V3_0).unwrap();
    assert_eq!(frame.number, 0x41acf);
    let bodies: Vec<_> = frame.bodies().collect();
    assert_eq!(bodies.len(), 1);
    assert_eq!((bodies[0].id, bodies[0].tracking_valid), (7, true));
    assert_eq!(bodies[0].position[0].to_bits(), 0xbe1d_d4aa);
    assert_eq!(bodies[0].mean_error.to_bits(), 0x31d5_5555);
    assert_eq!(frame.times.transmitted, 0x07dc_303e_456d);
}

#[test]
fn recorded_introductions() {
    let Some(packet) = recorded("serverinfo_packet_v3.bin") else { return };
    let info = ServerInfo::parse(payload(&packet, MessageId::ServerInfo)).unwrap();
    assert_eq!(info.application, b"Motive");
    assert_eq!((info.application_version, info.version), ([2, 1, 0, 0], Version::V3_0));
    assert_eq!((info.clock_frequency, info.data_port), (3_312_787, 1511));
    assert_eq!(info.multicast, Some([239, 255, 42, 99]));

    let Some(packet) = recorded("modeldef_packet_v3.bin") else { return };
    let models = ModelDef::new(payload(&packet, MessageId::ModelDef), Version::V3_0).unwrap();
    let models: Vec<_> = models.collect::<Result<_, _>>().unwrap();
    assert_eq!(models, [BodyName { name: b"RaceQuad", id: 2 }]);

    let Some(packet) = recorded("echoresponse_packet_v3.bin") else { return };
    let Some(request) = recorded("echorequest_packet_v3.bin") else { return };
    let asked = parse_echo_request(payload(&request, MessageId::EchoRequest)).unwrap();
    let (client, server) = parse_echo_response(payload(&packet, MessageId::EchoResponse)).unwrap();
    assert_eq!((client, server), (asked, 0x0149_cde4_8504));
}

#[test]
fn requests_are_those_that_were_recorded() {
    let Some(connect) = recorded("connect_packet_v3.bin") else { return };
    let mut out = [0; MAX_PACKET];
    let length = write_connect(&mut out, MessageId::Connect, "NatNetLib", Version::V3_0);
    assert_eq!(&out[..length], connect);
    let Some(discovery) = recorded("discovery_packet_v3.bin") else { return };
    let length = write_connect(&mut out, MessageId::Discovery, "NatNetLib", Version::V3_0);
    assert_eq!(&out[..length], discovery);
    let Some(models) = recorded("requestmodeldef_packet_v3.bin") else { return };
    let length = write_bare(&mut out, MessageId::RequestModelDef);
    assert_eq!(&out[..length], models);
    let Some(echo) = recorded("echorequest_packet_v3.bin") else { return };
    let length = write_echo_request(&mut out, 0x109a_664e);
    assert_eq!(&out[..length], echo);
}

/// The UDP payloads of a capture of Ethernet and IPv4.
fn datagrams(pcapng: &[u8]) -> Vec<&[u8]> {
    let word = |at: usize| u32::from_le_bytes(pcapng[at..at + 4].try_into().unwrap()) as usize;
    let (mut at, mut found) = (0, Vec::new());
    while at < pcapng.len() {
        let (kind, length) = (word(at), word(at + 4));
        if kind == 6 {
            let packet = &pcapng[at + 28..][..word(at + 20)];
            let ip = &packet[14..];
            if packet[12..14] == [8, 0] && ip[9] == 17 {
                let udp = &ip[usize::from(ip[0] & 15) * 4..];
                found.push(&udp[8..usize::from(u16::from_be_bytes([udp[4], udp[5]]))]);
            }
        }
        at += length;
    }
    found
}

#[test]
fn a_recorded_session() {
    let Some(capture) = recorded("traffic.pcapng") else { return };
    let (mut frames, mut last): (u32, Option<(i32, FrameTimes)>) = (0, None);
    for datagram in datagrams(&capture) {
        let (id, payload) = parse_packet(datagram).unwrap();
        assert_eq!(payload.len() + 4, datagram.len());
        if id == MessageId::Frame {
            let (frame, version) = Frame::parse_either(payload, Version::V4_1).unwrap();
            assert_eq!(version, Version::V3_0);
            assert!(frame.body(2).is_some());
            if let Some((number, times)) = last {
                assert!(frame.number > number);
                assert!(frame.times.mid_exposure > times.mid_exposure);
            }
            last = Some((frame.number, frame.times));
            frames += 1;
        }
    }
    assert_eq!(frames, 518);
}

const VERSIONS: [Version; 4] = [Version::V3_0, Version { major: 4, minor: 0 }, Version::V4_1, Version::V4_2];

fn version() -> impl Strategy<Value = Version> {
    select(VERSIONS.to_vec())
}

fn finite() -> impl Strategy<Value = f32> {
    prop::num::f32::NORMAL | prop::num::f32::ZERO
}

fn body() -> impl Strategy<Value = RigidBody> {
    (
        any::<i32>(),
        [finite(), finite(), finite()],
        [finite(), finite(), finite(), finite()],
        finite(),
        any::<bool>(),
    )
        .prop_map(|(id, position, quaternion_xyzw, mean_error, tracking_valid)| RigidBody {
            id,
            position,
            quaternion_xyzw,
            mean_error,
            tracking_valid,
        })
}

fn times() -> impl Strategy<Value = FrameTimes> {
    (0.0..1e6_f64, any::<u64>(), any::<u64>(), any::<u64>()).prop_map(
        |(timestamp, mid_exposure, received, transmitted)| FrameTimes {
            timestamp,
            mid_exposure,
            received,
            transmitted,
        },
    )
}

/// A frame of any version.
fn frame() -> impl Strategy<Value = (i32, Vec<RigidBody>, FrameTimes, Version)> {
    (any::<i32>(), vec(body(), 0..20), times(), version())
}

fn packet(write: impl Fn(&mut [u8]) -> usize) -> Vec<u8> {
    let mut out = vec![0; MAX_PACKET];
    let length = write(&mut out);
    assert!(length > 0);
    assert!((0..length).all(|room| write(&mut vec![0; room]) == 0), "what does not fit is not written");
    out.truncate(length);
    out
}

/// Reads bytes in every way there is.
fn read_all(datagram: &[u8]) -> usize {
    let Ok((_, payload)) = parse_packet(datagram) else { return 0 };
    let mut read = 0;
    for version in VERSIONS {
        read += Frame::parse(payload, version).map_or(0, |frame| frame.bodies().count());
        read += ModelDef::new(payload, version).map_or(0, |models| models.take(100_000).count());
    }
    read += usize::from(ServerInfo::parse(payload).is_ok());
    read += usize::from(parse_connect(payload).is_some());
    read + usize::from(parse_echo_response(payload).is_ok())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn frames_round_trip((number, bodies, times, version) in frame()) {
        let bytes = packet(|out| write_frame(out, number, &bodies, &times, version));
        let frame = Frame::parse(payload(&bytes, MessageId::Frame), version).unwrap();
        prop_assert_eq!((frame.number, frame.times, frame.models_changed), (number, times, false));
        prop_assert_eq!(frame.bodies().collect::<Vec<_>>(), bodies);
    }

    #[test]
    fn a_frame_names_its_own_layout((number, bodies, times, version) in frame(), told in version()) {
        let bytes = packet(|out| write_frame(out, number, &bodies, &times, version));
        let (frame, found) = Frame::parse_either(payload(&bytes, MessageId::Frame), told).unwrap();
        prop_assert_eq!(found >= Version::V4_1, version >= Version::V4_1);
        prop_assert_eq!(frame.bodies().collect::<Vec<_>>(), bodies);
    }

    #[test]
    fn a_frame_of_any_other_length_is_refused(
        (number, bodies, times, version) in frame(), extra in vec(any::<u8>(), 1..20),
    ) {
        let bytes = packet(|out| write_frame(out, number, &bodies, &times, version));
        let payload = payload(&bytes, MessageId::Frame);
        for length in 0..payload.len() {
            prop_assert!(Frame::parse(&payload[..length], version).is_err());
        }
        prop_assert!(Frame::parse(&[payload, &extra].concat(), version).is_err());
        for length in 0..bytes.len() {
            prop_assert!(parse_packet(&bytes[..length]).is_err());
        }
    }

    #[test]
    fn model_definitions_round_trip(
        names in vec((vec(1..=255_u8, 0..30), any::<i32>()), 0..15), version in version(),
    ) {
        let models: Vec<_> = names.iter().map(|(name, id)| BodyName { name, id: *id }).collect();
        let bytes = packet(|out| write_model_def(out, &models, version));
        let read = ModelDef::new(payload(&bytes, MessageId::ModelDef), version).unwrap();
        prop_assert_eq!(read.collect::<Result<Vec<_>, _>>().unwrap(), models);
    }

    /// A server may be told to send another version than its own.
    #[test]
    fn a_model_definition_names_its_own_layout(
        names in vec((vec(1..=255_u8, 1..30), 1..100_000_i32), 0..15), version in version(), told in version(),
    ) {
        let models: Vec<_> = names.iter().map(|(name, id)| BodyName { name, id: *id }).collect();
        let bytes = packet(|out| write_model_def(out, &models, version));
        let read = ModelDef::new_either(payload(&bytes, MessageId::ModelDef), told).unwrap();
        prop_assert_eq!(read.collect::<Result<Vec<_>, _>>().unwrap(), models);
    }

    /// An introduction of NatNet 2 ends behind its version; newer ones have it in the same place.
    #[test]
    fn an_introduction_tells_its_version(name in vec(1..=255_u8, 0..=255), major in 1..9_u8, minor in 0..9_u8) {
        let mut payload = [0; 264];
        payload[..name.len()].copy_from_slice(&name);
        (payload[260], payload[261]) = (major, minor);
        let version = Version { major, minor };
        prop_assert_eq!(announced_version(&payload), Some(version));
        prop_assert_eq!(version.is_known(), (3..=4).contains(&major));
        prop_assert!(ServerInfo::parse(&payload).is_err());
        prop_assert_eq!(announced_version(&payload[..263]), None);
    }

    #[test]
    fn introductions_round_trip(
        name in vec(1..=255_u8, 0..=255), version in version(), frequency in 1..u64::MAX, port in any::<u16>(),
        multicast in option::of(any::<[u8; 4]>()),
    ) {
        let info = ServerInfo {
            application: &name,
            application_version: [1, 2, 3, 4],
            version,
            clock_frequency: frequency,
            data_port: port,
            multicast,
        };
        let bytes = packet(|out| write_server_info(out, &info));
        prop_assert_eq!(bytes.len(), 283);
        prop_assert_eq!(ServerInfo::parse(payload(&bytes, MessageId::ServerInfo)).unwrap(), info);
    }

    #[test]
    fn small_packets_round_trip(client in any::<u64>(), server in any::<u64>(), version in version()) {
        let bytes = packet(|out| write_echo_request(out, client));
        prop_assert_eq!(parse_echo_request(payload(&bytes, MessageId::EchoRequest)), Ok(client));
        let bytes = packet(|out| write_echo_response(out, client, server));
        prop_assert_eq!(parse_echo_response(payload(&bytes, MessageId::EchoResponse)), Ok((client, server)));
        let bytes = packet(|out| write_connect(out, MessageId::Connect, "tilthex", version));
        prop_assert_eq!(bytes.len(), 268);
        prop_assert_eq!(parse_connect(payload(&bytes, MessageId::Connect)), Some(version));
    }

    #[test]
    fn flipped_bytes_never_panic((number, bodies, times, version) in frame(), flips in vec((any::<u16>(), any::<u8>()), 1..8)) {
        let mut bytes = packet(|out| write_frame(out, number, &bodies, &times, version));
        for (at, byte) in flips {
            let length = bytes.len();
            bytes[usize::from(at) % length] ^= byte;
        }
        // No packet can hold more bodies than its length allows, whatever its counts say.
        prop_assert!(read_all(&bytes) <= 4 * (bytes.len() / 38 + bytes.len() / 8) + 3);
    }

    #[test]
    fn random_payloads_never_panic(id in select(vec![0_u16, 1, 5, 7, 13]), bytes in vec(prop_oneof![3 => Just(0), 1 => any::<u8>()], 0..600)) {
        let header = [id.to_le_bytes(), (bytes.len() as u16).to_le_bytes()].concat();
        read_all(&[&header[..], &bytes].concat());
    }
}

#[test]
fn refusals_say_what_is_wrong() {
    assert_eq!(parse_packet(&[7]), Err(Malformed("message id")));
    assert_eq!(parse_packet(&[7, 0, 1, 0]), Err(Malformed("length")));
    assert_eq!(Malformed("length").to_string(), "the packet's length is malformed");
    // A count of four thousand million bodies.
    let bytes = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff, 0xff, 0xff];
    assert_eq!(Frame::parse(&bytes, Version::V3_0).unwrap_err(), Malformed("list of sections"));
}
