//! Poses in UDP packets: the codec, and a client among wrong, late and forged packets.
#![cfg(feature = "net")]

use std::{
    net::{Ipv4Addr, UdpSocket},
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

use proptest::prelude::*;
use tilthex_mocap::{
    ClientParams, UpAxis,
    net::{Client, MocapUri},
    udp::{MAX_LENGTH, PosePacket},
};

fn packet(number: u32, x: f64, body: &[u8]) -> Vec<u8> {
    let pose = PosePacket {
        number,
        tracking_valid: true,
        time: 0.01 * f64::from(number),
        position: [x, 0.0, 1.0],
        quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
        body,
    };
    let mut bytes = [0; MAX_LENGTH];
    let length = pose.encode(&mut bytes);
    bytes[..length].to_vec()
}

proptest! {
    #[test]
    fn what_is_written_is_read(
        number: u32, tracking_valid: bool, time in -1e9..1e9f64, position in prop::array::uniform3(-1e3..1e3f64),
        quaternion_xyzw in prop::array::uniform4(-1.0..1.0f64), body in prop::collection::vec(any::<u8>(), 1..=64),
    ) {
        let pose = PosePacket { number, tracking_valid, time, position, quaternion_xyzw, body: &body };
        let mut bytes = [0; MAX_LENGTH];
        let length = pose.encode(&mut bytes);
        prop_assert_eq!(length, 80 + body.len());
        prop_assert_eq!(PosePacket::parse(&bytes[..length]), Ok(pose));
        // Cut anywhere before the name's first byte it is refused.
        for cut in 0..=80 {
            prop_assert!(PosePacket::parse(&bytes[..cut]).is_err());
        }
    }

    #[test]
    fn only_what_is_seen_must_have_a_pose(at in 0..8_usize, seen: bool, bad in prop::sample::select(vec![f64::NAN, f64::INFINITY])) {
        let pose = PosePacket {
            number: 1, tracking_valid: seen, time: 1.0, position: [0.0; 3], quaternion_xyzw: [0.0, 0.0, 0.0, 1.0], body: b"hex",
        };
        let mut bytes = [0; MAX_LENGTH];
        let length = pose.encode(&mut bytes);
        bytes[16 + 8 * at..][..8].copy_from_slice(&bad.to_le_bytes());
        prop_assert_eq!(PosePacket::parse(&bytes[..length]).is_ok(), !seen && at > 0);
    }

    #[test]
    fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = PosePacket::parse(&bytes);
        let _ = PosePacket::parse(&[b"tilthex1", &bytes[..]].concat());
    }
}

/// Ends the sender's thread also where an assertion fails.
struct OnDrop<'a>(&'a AtomicBool);

impl Drop for OnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[test]
fn a_client_takes_one_senders_poses_of_its_body_and_nothing_else() {
    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    let port = free.local_addr().expect("bound").port();
    drop(free);
    let uri: MocapUri = format!("udp://127.0.0.1:{port}/hex").parse().expect("valid");
    let (connected, ended) = (AtomicBool::new(false), AtomicBool::new(false));
    std::thread::scope(|scope| {
        let _end = OnDrop(&ended);
        scope.spawn(|| {
            let (sender, forger) = (
                UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port"),
                UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port"),
            );
            let mut number = 0;
            while !ended.load(Ordering::Relaxed) {
                number += 1;
                let send = |socket: &UdpSocket, bytes: &[u8]| {
                    let _ = socket.send_to(bytes, (Ipv4Addr::LOCALHOST, port));
                };
                send(&sender, &packet(number, 0.5, b"hex"));
                send(&sender, &packet(number + 1, 9.0, b"other"));
                send(&sender, b"tilthex1 and more");
                if connected.load(Ordering::Relaxed) {
                    send(&sender, &packet(number, 9.0, b"hex"));
                    send(&forger, &packet(number + 1, 9.0, b"hex"));
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        });
        let params = ClientParams { up_axis: UpAxis::Z, ..ClientParams::default() };
        let (client, mut poses) = Client::start(&uri, params).expect("poses come");
        connected.store(true, Ordering::Relaxed);
        std::thread::sleep(Duration::from_millis(300));
        let mut count = 0;
        while let Ok(pose) = poses.pop() {
            assert_eq!(pose.position_w.as_slice(), [0.5, 0.0, 1.0]);
            assert!(pose.time <= pose.arrival && pose.tracking_valid);
            count += 1;
        }
        let status = client.status();
        assert!(count > 10, "{count}");
        assert!(status.refused > 10, "{status:?}");
        assert_eq!(status.dropped, 0);
    });
}

#[test]
fn nobody_who_sends_is_one_sentence() {
    let taken = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).expect("a port");
    let port = taken.local_addr().expect("bound").port();
    let uri: MocapUri = format!("udp://127.0.0.1:{port}/hex").parse().expect("valid");
    let refusal = || Client::start(&uri, ClientParams::default()).expect_err("refused").to_string();
    assert!(refusal().contains("name a free port"), "{}", refusal());
    drop(taken);
    let message = refusal();
    assert!(message.contains("no UDP pose of `hex` arrived from 127.0.0.1"), "{message}");
    assert!(!message.contains('\n'));
}

/// What a client says whose only sender repeats one packet.
fn refusal_of(packet: &[u8], host: &str) -> String {
    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    let port = free.local_addr().expect("bound").port();
    drop(free);
    let uri: MocapUri = format!("udp://{host}:{port}/hex").parse().expect("valid");
    let ended = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let _end = OnDrop(&ended);
        scope.spawn(|| {
            let sender = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
            while !ended.load(Ordering::Relaxed) {
                let _ = sender.send_to(packet, (Ipv4Addr::LOCALHOST, port));
                std::thread::sleep(Duration::from_millis(50));
            }
        });
        Client::start(&uri, ClientParams::default()).expect_err("refused").to_string()
    })
}

#[test]
fn each_wrong_packet_is_answered_with_its_reason() {
    let with = |at: usize, value: f64| {
        let mut bytes = packet(1, 0.0, b"hex");
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    let cases = [
        (with(24, f64::NAN), "127.0.0.1", "a number that is not finite"),
        (with(16, f64::INFINITY), "127.0.0.1", "a number that is not finite"),
        (with(72, 0.9), "127.0.0.1", "quaternion [0, 0, 0, 0.9] is not of unit length"),
        (
            packet(1, 0.0, b"hex")[..60].to_vec(),
            "127.0.0.1",
            "size is malformed, of 60 bytes; expected `tilthex1`",
        ),
        (packet(1, 0.0, &[b'x'; 64]).repeat(2), "127.0.0.1", "name is malformed, of 145 bytes"),
        (packet(1, 0.0, b"hex"), "127.0.0.9", "a packet came from 127.0.0.1"),
    ];
    std::thread::scope(|scope| {
        for (bytes, host, reason) in &cases {
            scope.spawn(move || {
                let said = refusal_of(bytes, host);
                assert!(said.contains(reason) && !said.contains('\n'), "expected {reason}: {said}");
            });
        }
    });
}
