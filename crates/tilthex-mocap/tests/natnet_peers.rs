//! NatNet servers that are not as they should be, each told apart from the others in one sentence.

#![allow(clippy::unwrap_used)]

use std::{
    net::{Ipv4Addr, SocketAddrV4, UdpSocket},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use tilthex_mocap::natnet::{
    BodyName, FrameTimes, MessageId, RigidBody, ServerInfo, Version, parse_packet, write_frame,
    write_model_def, write_server_info,
};
use tilthex_mocap::{ClientParams, net::Client};

/// A server that answers as it is told.
struct Script {
    /// Its introduction.
    introduction: Vec<u8>,
    /// What it captures; `None` where it does not answer.
    models: Option<Vec<u8>>,
    /// Its frames; `None` where it sends none.
    frame: Option<Vec<u8>>,
}

fn packet(write: impl FnOnce(&mut [u8]) -> usize) -> Vec<u8> {
    let mut bytes = vec![0; 4096];
    let length = write(&mut bytes);
    assert!(length > 0);
    bytes.truncate(length);
    bytes
}

fn introduction(version: Version) -> Vec<u8> {
    let info = ServerInfo {
        application: b"Motive",
        application_version: [3, 1, 0, 0],
        version,
        clock_frequency: 10_000_000,
        data_port: 1511,
        multicast: None,
    };
    packet(|out| write_server_info(out, &info))
}

fn models(version: Version) -> Vec<u8> {
    packet(|out| write_model_def(out, &[BodyName { name: b"hex", id: 7 }], version))
}

fn frame(ids: &[i32], version: Version) -> Vec<u8> {
    let body = |&id| RigidBody { id, quaternion_xyzw: [0.0, 0.0, 0.0, 1.0], ..RigidBody::default() };
    let bodies: Vec<_> = ids.iter().map(body).collect();
    packet(|out| {
        write_frame(out, 1, &bodies, &FrameTimes { timestamp: 1.0, ..FrameTimes::default() }, version)
    })
}

/// A packet with more bytes at a place of its payload.
fn longer(mut packet: Vec<u8>, from_end: usize, more: &[u8]) -> Vec<u8> {
    let at = packet.len() - from_end;
    packet.splice(at..at, more.iter().copied());
    let length = (packet.len() - 4) as u16;
    packet[2..4].copy_from_slice(&length.to_le_bytes());
    packet
}

struct Running {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    port: u16,
}

impl Script {
    fn run(self) -> Running {
        let socket = UdpSocket::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        let port = socket.local_addr().unwrap().port();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            let mut bytes = [0; 2048];
            let mut client = None;
            while !stopped.load(Ordering::Relaxed) {
                if let Ok((length, from)) = socket.recv_from(&mut bytes) {
                    client = Some(from);
                    let answer = match parse_packet(&bytes[..length]) {
                        Ok((MessageId::Connect, _)) => Some(&self.introduction),
                        Ok((MessageId::RequestModelDef, _)) => self.models.as_ref(),
                        _ => None,
                    };
                    answer.map(|bytes| socket.send_to(bytes, from));
                }
                if let (Some(to), Some(frame)) = (client, &self.frame) {
                    let _ = socket.send_to(frame, to);
                }
            }
        });
        Running { stop, thread: Some(thread), port }
    }
}

impl Running {
    fn start(&self) -> Result<Client, String> {
        let uri = format!("natnet://127.0.0.1:{}/hex", self.port).parse().unwrap();
        Client::start(&uri, ClientParams::default()).map(|(client, _)| client).map_err(|e| e.to_string())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

const ALL: [Version; 4] = [Version::V3_0, Version::V4_0, Version::V4_1, Version::V4_2];

#[test]
fn every_layout_is_read_whatever_was_announced() {
    for announced in ALL {
        for sent in ALL {
            let server = Script {
                introduction: introduction(announced),
                models: Some(models(sent)),
                frame: Some(frame(&[3, 7], sent)),
            };
            let found = server.run().start();
            assert!(found.is_ok(), "{announced:?} announced, {sent:?} sent: {:?}", found.err());
        }
    }
}

#[test]
fn a_server_of_another_generation_is_named_with_its_version() {
    for (major, minor) in [(2, 5), (2, 7), (2, 9), (2, 10), (1, 3), (5, 0)] {
        // An introduction of NatNet 2 ends behind the version; a later one does not.
        let whole = introduction(Version { major, minor });
        let introduction = if major < 3 {
            let mut short = whole[..4 + 264].to_vec();
            short[2..4].copy_from_slice(&264_u16.to_le_bytes());
            short
        } else {
            whole
        };
        let said = Script { introduction, models: None, frame: None }.run().start().unwrap_err();
        assert!(said.contains(&format!("NatNet {major}.{minor}; expected 3.0 to 4.2")), "{said}");
    }
}

#[test]
fn each_reason_has_its_own_sentence() {
    let v = Version::V4_1;
    let script = |models, frame| Script { introduction: introduction(v), models, frame };
    let empty = packet(|out| write_model_def(out, &[], v));
    let unreadable = longer(models(v), 0, &[1, 2, 3]);
    let mut unreadable = unreadable;
    // A count of two descriptions where one and a half are.
    unreadable[4..8].copy_from_slice(&2_i32.to_le_bytes());
    // An added section of one number, before the suffix of 50 bytes.
    let added = longer(frame(&[7], v), 50, &[1, 0, 0, 0, 4, 0, 0, 0, 9, 9, 9, 9]);
    let cases = [
        (script(None, None), "does not send its list of models"),
        (script(Some(empty), None), "captures no rigid body at all"),
        (script(Some(unreadable), None), "lists its models in an unknown layout"),
        (script(Some(models(v)), None), "sends no frames: start the capture's stream"),
        (script(Some(models(v)), Some(frame(&[], v))), "hold no rigid body at all: switch rigid bodies on"),
        (script(Some(models(v)), Some(frame(&[1, 2], v))), "hold 2 rigid bodies but not `hex`"),
        (script(Some(models(v)), Some(added)), "have an unknown layout"),
    ];
    let mut sentences = Vec::new();
    for (script, expected) in cases {
        let said = script.run().start().unwrap_err();
        assert!(said.contains(expected), "expected {expected}: {said}");
        assert!(!said.contains('\n'));
        sentences.push(said);
    }
    sentences.sort();
    sentences.dedup_by_key(|said| said.replace(char::is_numeric, ""));
    assert_eq!(sentences.len(), 7);
}
