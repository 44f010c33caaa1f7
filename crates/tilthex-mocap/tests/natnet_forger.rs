//! Packets that another program on the server's host sends do not move the vehicle.

#![allow(clippy::unwrap_used)]

use std::{
    net::{Ipv4Addr, SocketAddrV4, UdpSocket},
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

use tilthex_mocap::{
    ClientParams, UpAxis,
    natnet::{
        BodyName, FrameTimes, MessageId, RigidBody, ServerInfo, Version, parse_packet, write_echo_response,
        write_frame, write_model_def, write_server_info,
    },
    net::Client,
};

const V: Version = Version::V4_1;

fn socket() -> UdpSocket {
    let socket = UdpSocket::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)).unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
    socket
}

fn frame(number: i32, x: f32) -> Vec<u8> {
    let body = RigidBody {
        id: 7,
        position: [x, 0.0, 1.0],
        quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
        tracking_valid: true,
        ..RigidBody::default()
    };
    let times = FrameTimes { timestamp: 0.005 * f64::from(number), ..FrameTimes::default() };
    written(|out| write_frame(out, number, &[body], &times, V))
}

fn written(write: impl FnOnce(&mut [u8]) -> usize) -> Vec<u8> {
    let mut bytes = vec![0; 4096];
    let length = write(&mut bytes);
    bytes.truncate(length);
    bytes
}

/// Serves the body at x = 0.5 while a forger on another port answers too, with x = 9; places that a client takes.
fn places(frames_from_command_port: bool) -> Vec<f64> {
    let (command, data, forger) = (socket(), socket(), socket());
    let port = command.local_addr().unwrap().port();
    let info = ServerInfo {
        application: b"Motive",
        application_version: [3, 1, 0, 0],
        version: V,
        clock_frequency: 10_000_000,
        data_port: data.local_addr().unwrap().port(),
        multicast: None,
    };
    let forged_info = written(|out| write_server_info(out, &ServerInfo { clock_frequency: 1, ..info }));
    let info = written(|out| write_server_info(out, &info));
    let model = |id| written(|out| write_model_def(out, &[BodyName { name: b"hex", id }], V));
    let (models, forged_models) = (model(7), model(8));
    let ended = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let (mut bytes, mut client, mut number) = ([0; 2048], None, 0);
            while !ended.load(Ordering::Relaxed) {
                if let Ok((length, from)) = command.recv_from(&mut bytes) {
                    client = Some(from);
                    match parse_packet(&bytes[..length]) {
                        Ok((MessageId::Connect, _)) => {
                            forger.send_to(&forged_info, from).unwrap();
                            command.send_to(&info, from).unwrap();
                        }
                        Ok((MessageId::RequestModelDef, _)) => {
                            forger.send_to(&forged_models, from).unwrap();
                            command.send_to(&models, from).unwrap();
                        }
                        Ok((MessageId::EchoRequest, _)) => {
                            let echo = written(|out| write_echo_response(out, 1, 1));
                            forger.send_to(&echo, from).unwrap();
                        }
                        _ => {}
                    }
                }
                let Some(to) = client else { continue };
                number += 1;
                // The forger is the first, and always newer.
                let _ = forger.send_to(&frame(number + 500, 9.0), to);
                let from = if frames_from_command_port { &command } else { &data };
                let _ = from.send_to(&frame(number, 0.5), to);
            }
        });
        let uri = format!("natnet://127.0.0.1:{port}/hex").parse().unwrap();
        let params = ClientParams { up_axis: UpAxis::Z, ..ClientParams::default() };
        let started = Client::start(&uri, params);
        thread::sleep(Duration::from_millis(300));
        ended.store(true, Ordering::Relaxed);
        let (client, mut poses) = started.unwrap();
        let status = client.status();
        assert!(status.refused > 20, "{status:?}");
        std::iter::from_fn(|| poses.pop().ok()).map(|pose| pose.position_w.x).collect()
    })
}

#[test]
fn a_forger_on_another_port_is_refused_and_counted() {
    for from_command_port in [true, false] {
        let places = places(from_command_port);
        // Until the server's first frame the forger is alone: that is before the client was ready.
        let taken = places.iter().skip_while(|&&x| x != 0.5).count();
        assert!(taken > 10 && places.len() - taken <= 2, "{places:?}");
        assert!(places.iter().skip_while(|&&x| x != 0.5).all(|&x| x == 0.5), "{places:?}");
    }
}

#[test]
fn a_server_that_answers_from_another_port_is_told_apart() {
    let (asked, other) = (socket(), socket());
    let port = asked.local_addr().unwrap().port();
    let ended = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut bytes = [0; 2048];
            while !ended.load(Ordering::Relaxed) {
                if let Ok((_, from)) = asked.recv_from(&mut bytes) {
                    other.send_to(&bytes[..10], from).unwrap();
                }
            }
        });
        let uri = format!("natnet://127.0.0.1:{port}/hex").parse().unwrap();
        let said = Client::start(&uri, ClientParams::default()).unwrap_err().to_string();
        ended.store(true, Ordering::Relaxed);
        let from = other.local_addr().unwrap().port();
        assert!(
            said.contains(&format!("comes from port {from}; expected it from the port that was asked")),
            "{said}"
        );
    });
}
