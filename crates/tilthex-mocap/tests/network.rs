//! Our clients read our servers, over loopback; and every wrong configuration ends in one sentence.

#![allow(clippy::unwrap_used)]

use std::{
    io::Write,
    net::{Ipv4Addr, SocketAddrV4, TcpListener, UdpSocket},
    thread,
    time::{Duration, Instant},
};

use tilthex_core::{PoseSample, Vector3, so3};
use tilthex_mocap::{
    ClientParams, UpAxis,
    natnet::Version,
    net::{
        Client, Clock, LineParams, MocapUri, Monotonic, NatNetServer, NatNetServerParams, Publication,
        VrpnServer, VrpnServerParams,
    },
};

const LOOPBACK: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0);

/// A server of either kind.
enum Server {
    NatNet(NatNetServer),
    Vrpn(VrpnServer),
}

impl Server {
    fn natnet(params: NatNetServerParams) -> Self {
        Self::NatNet(NatNetServer::start(NatNetServerParams { address: LOOPBACK, ..params }).unwrap())
    }

    fn vrpn(params: VrpnServerParams) -> Self {
        Self::Vrpn(VrpnServer::start(VrpnServerParams { address: LOOPBACK, ..params }).unwrap())
    }

    fn uri(&self, protocol: &str, body: &str) -> MocapUri {
        let address = match self {
            Self::NatNet(server) => server.address(),
            Self::Vrpn(server) => server.address(),
        };
        format!("{protocol}://{address}/{body}").parse().unwrap()
    }

    /// Publishes a pose that tells its time; see [`assert_true`].
    fn publish(&mut self, tracking_valid: bool) {
        let time = Monotonic.now();
        let phase = time as f64 * 1e-9;
        let publication = Publication {
            time,
            position_w: position(phase),
            rotation_wr: so3::exp(&rotation(phase)),
            tracking_valid,
        };
        match self {
            Self::NatNet(server) => server.publish(publication),
            Self::Vrpn(server) => server.publish(publication),
        };
    }
}

fn position(time: f64) -> Vector3 {
    Vector3::new((7.0 * time).sin(), (5.0 * time).cos(), 1.0 + 0.5 * (3.0 * time).sin())
}

fn rotation(time: f64) -> Vector3 {
    Vector3::new(0.4 * (2.0 * time).sin(), 0.3 * time.cos(), 2.0 * (0.5 * time).sin())
}

/// The time of a pose tells where it was: position and rotation must fit, within `slack` (s) of time.
fn assert_true(sample: &PoseSample, slack: f64) {
    assert!(sample.time <= sample.arrival);
    let off = (sample.position_w - position(sample.time)).norm();
    assert!(off < 10.0 * slack + 1e-5, "{off} m off, age {}", sample.arrival - sample.time);
    let turned = so3::log(&(so3::exp(&rotation(sample.time)).transpose() * sample.rotation_wr)).norm();
    assert!(turned < 3.0 * slack + 1e-5, "{turned} rad off");
}

/// A body in motion, published every 5 ms by a thread of its own until the test is over.
fn in_motion(mut server: Server) -> (impl Fn(&str, &str) -> MocapUri, impl FnOnce() -> Server) {
    let (stop, stopped) = std::sync::mpsc::channel::<()>();
    let address = server.uri("natnet", "x");
    let publisher = thread::spawn(move || {
        while stopped.try_recv() == Err(std::sync::mpsc::TryRecvError::Empty) {
            server.publish(true);
            thread::sleep(Duration::from_millis(5));
        }
        server
    });
    let uri = move |protocol: &str, body: &str| {
        format!("{protocol}://{}:{}/{body}", address.host, address.port).parse().unwrap()
    };
    (uri, move || {
        drop(stop);
        publisher.join().unwrap()
    })
}

/// Waits for this many poses.
fn collect(ring: &mut rtrb::Consumer<PoseSample>, count: usize) -> Vec<PoseSample> {
    let (mut samples, end) = (Vec::new(), Instant::now() + Duration::from_secs(60));
    while samples.len() < count && Instant::now() < end {
        match ring.pop() {
            Ok(sample) => samples.push(sample),
            Err(_) => thread::sleep(Duration::from_millis(2)),
        }
    }
    assert_eq!(samples.len(), count);
    samples
}

#[test]
fn natnet_poses_carry_their_own_time() {
    for (version, up_axis) in [(Version::V3_0, UpAxis::Y), (Version::V4_1, UpAxis::Z)] {
        let line = LineParams { latency: 0.1, jitter: 0.02, ..LineParams::default() };
        let params = NatNetServerParams { version, up_axis, line, ..NatNetServerParams::new("tilt hex") };
        let (uri, _end) = in_motion(Server::natnet(params));
        let (client, mut ring) =
            Client::start(&uri("natnet", "tilt%20hex"), ClientParams { up_axis, latency: 0.0 }).unwrap();
        for sample in collect(&mut ring, 40) {
            // Exposures are stamped and the clock is asked for: only half the echo's way is unknown.
            assert_true(&sample, 0.04);
            assert!(sample.arrival - sample.time > 0.06 && sample.tracking_valid);
        }
        let status = client.status();
        assert!(status.latency > 0.06 && status.clock_resets == 0 && status.refused == 0);
    }
}

#[test]
fn natnet_poses_come_by_multicast() {
    let group = SocketAddrV4::new(Ipv4Addr::new(239, 255, 42, 99), 15_511);
    let params = NatNetServerParams { multicast: Some(group), ..NatNetServerParams::new("hex") };
    let (uri, _end) = in_motion(Server::natnet(params));
    let refused = Client::start(&uri("natnet", "hex"), ClientParams::default()).unwrap_err();
    assert!(refused.to_string().contains("use natnet+multicast://127.0.0.1:"), "{refused}");
    let two =
        [(); 2].map(|()| Client::start(&uri("natnet+multicast", "hex"), ClientParams::default()).unwrap());
    for (_client, mut ring) in two {
        collect(&mut ring, 20).iter().for_each(|sample| assert_true(sample, 0.04));
    }
}

#[test]
fn vrpn_poses_carry_their_own_time() {
    let (uri, _end) = in_motion(Server::vrpn(VrpnServerParams::new("hex")));
    let params = ClientParams { up_axis: UpAxis::Z, latency: 0.0 };
    let (client, mut ring) = Client::start(&uri("vrpn", "hex"), params).unwrap();
    // What one-way synchronisation cannot see is the smallest latency of the line.
    collect(&mut ring, 40).iter().for_each(|sample| assert_true(sample, 0.1));
    assert_eq!((client.status().refused, client.status().clock_resets), (0, 0));
}

#[test]
fn a_line_that_loses_is_counted() {
    let line = LineParams { loss: 0.3, seed: 5, ..LineParams::default() };
    let params = NatNetServerParams { line, ..NatNetServerParams::new("hex") };
    let (uri, _end) = in_motion(Server::natnet(params));
    let (client, mut ring) = Client::start(&uri("natnet", "hex"), ClientParams::default()).unwrap();
    let samples = collect(&mut ring, 100);
    samples.iter().for_each(|sample| assert_true(sample, 0.04));
    let status = client.status();
    let share = f64::from(status.lost) / f64::from(status.lost + status.poses);
    assert!((0.1..0.5).contains(&share), "{status:?}");
}

#[test]
fn a_hidden_body_is_told_apart() {
    let mut server = Server::natnet(NatNetServerParams::new("hex"));
    let uri = server.uri("natnet", "hex");
    let publisher = thread::spawn(move || {
        for i in 0..400 {
            server.publish(i % 2 == 0);
            thread::sleep(Duration::from_millis(5));
        }
    });
    let (client, mut ring) = Client::start(&uri, ClientParams::default()).unwrap();
    let samples = collect(&mut ring, 20);
    assert!(samples.windows(2).any(|pair| pair[0].tracking_valid != pair[1].tracking_valid));
    assert!(client.status().untracked > 0);
    drop(client);
    publisher.join().unwrap();
}

#[test]
fn a_server_that_is_started_anew_is_found_again() {
    let (uri, end) = in_motion(Server::vrpn(VrpnServerParams::new("hex")));
    let uri = uri("vrpn", "hex");
    let params = ClientParams { up_axis: UpAxis::Z, latency: 0.0 };
    let (client, mut ring) = Client::start(&uri, params).unwrap();
    collect(&mut ring, 5);
    drop(end());
    while ring.pop().is_ok() {}
    let address = SocketAddrV4::new(Ipv4Addr::LOCALHOST, uri.port);
    let again = VrpnServer::start(VrpnServerParams { address, ..VrpnServerParams::new("hex") }).unwrap();
    let (_uri, _end) = in_motion(Server::Vrpn(again));
    collect(&mut ring, 5);
    assert!(client.status().silences > 0);
}

fn refusal(uri: &MocapUri) -> String {
    Client::start(uri, ClientParams::default()).unwrap_err().to_string()
}

#[test]
fn a_wrong_body_lists_those_that_are_there() {
    let (uri, _end) = in_motion(Server::natnet(NatNetServerParams::new("tilt-hex")));
    let message = refusal(&uri("natnet", "tilthex"));
    assert!(message.ends_with("captures no rigid body named `tilthex`; it captures `tilt-hex`"), "{message}");
    let (uri, _end) = in_motion(Server::vrpn(VrpnServerParams::new("tilt-hex")));
    let message = refusal(&uri("vrpn", "tilthex"));
    assert!(
        message.contains("has no tracker named `tilthex`; it has `VRPN Control`, `tilt-hex`"),
        "{message}"
    );
}

#[test]
fn a_server_without_frames_is_told_apart() {
    let server = Server::natnet(NatNetServerParams::new("hex"));
    assert!(refusal(&server.uri("natnet", "hex")).ends_with("sends no frames: start the capture's stream"));
    assert!(refusal(&server.uri("natnet+multicast", "hex")).contains("sends unicast frames: use natnet://"));
    let server = Server::vrpn(VrpnServerParams::new("hex"));
    assert!(refusal(&server.uri("vrpn", "hex")).ends_with("sends no poses: check that its body is tracked"));
}

#[test]
fn nobody_and_somebody_else() {
    let silent = UdpSocket::bind(LOOPBACK).unwrap();
    let uri = |protocol: &str, port: u16| format!("{protocol}://127.0.0.1:{port}/hex").parse().unwrap();
    let port = silent.local_addr().unwrap().port();
    assert!(
        refusal(&uri("natnet", port)).starts_with(&format!("no NatNet server answers at 127.0.0.1:{port}"))
    );

    let other = UdpSocket::bind(LOOPBACK).unwrap();
    let port = other.local_addr().unwrap().port();
    thread::spawn(move || {
        let mut bytes = [0; 512];
        while let Ok((_, from)) = other.recv_from(&mut bytes) {
            let _ = other.send_to(b"\xff\xffwho are you?", from);
        }
    });
    assert!(refusal(&uri("natnet", port)).contains("answers, but not as a NatNet server"));

    let listener = TcpListener::bind(LOOPBACK).unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        let mut kept = Vec::new();
        for (i, stream) in listener.incoming().enumerate() {
            let mut stream = stream.unwrap();
            if i == 0 {
                stream.write_all(b"220 mail.example.org ESMTP ready\r\n").unwrap();
            }
            kept.push(stream);
        }
    });
    let message = refusal(&uri("vrpn", port));
    assert!(message.contains("another program answers, with `220 mail.example"), "{message}");
    assert!(refusal(&uri("vrpn", port)).contains("sends no VRPN greeting"));

    let closed = TcpListener::bind(LOOPBACK).unwrap().local_addr().unwrap().port();
    assert!(refusal(&uri("vrpn", closed)).contains("no program listens there"));
    assert!(
        refusal(&"vrpn://nowhere.invalid/hex".parse().unwrap()).contains("`nowhere.invalid` has no address")
    );
}

#[test]
fn addresses() {
    let parse = |text: &str| text.parse::<MocapUri>();
    for (text, whole) in [
        ("natnet://10.0.0.5/hex", "natnet://10.0.0.5:1510/hex"),
        ("natnet+multicast://motive:1234/tilt%20hex", "natnet+multicast://motive:1234/tilt hex"),
        ("vrpn://[::1]/a/b", "vrpn://[::1]:3883/a/b"),
        ("vrpn://host/hex/2", "vrpn://host:3883/hex/2"),
        ("vrpn://host/room%2F2", "vrpn://host:3883/room%2F2"),
        ("vrpn://host/room/2/0", "vrpn://host:3883/room/2/0"),
        ("vrpn://host/hex/99999999999", "vrpn://host:3883/hex/99999999999"),
        ("natnet://host/hex/2", "natnet://host:1510/hex/2"),
        ("vrpn://[::1]:99/100%25", "vrpn://[::1]:99/100%25"),
    ] {
        let uri = parse(text).unwrap();
        assert_eq!(uri.to_string(), whole);
        assert_eq!(parse(whole).unwrap(), uri);
    }
    for (text, body, sensor) in [
        ("vrpn://host/hex/2", "hex", Some(2)),
        ("vrpn://host/room%2F2", "room/2", None),
        ("vrpn://host/room/2/0", "room/2", Some(0)),
        ("vrpn://host/a/b", "a/b", None),
        ("udp://host/hex/2", "hex/2", None),
    ] {
        let uri = parse(text).unwrap();
        assert_eq!((uri.body.as_str(), uri.sensor), (body, sensor), "{text}");
    }
    for (text, reason) in [
        ("10.0.0.5/hex", "names no protocol"),
        ("http://10.0.0.5/hex", "unknown protocol `http`"),
        ("natnet://10.0.0.5", "names no body"),
        ("natnet://10.0.0.5/", "names no body"),
        ("natnet:///hex", "names no host"),
        ("natnet://host:0/hex", "the port `0`"),
        ("natnet://host:99999/hex", "the port `99999`"),
        ("natnet://host:/hex%2", "broken % escape"),
        ("vrpn://[::1]x/hex", "something other than a port"),
    ] {
        let message = parse(text).unwrap_err().to_string();
        assert!(message.contains(reason) && message.contains("expected natnet://HOST"), "{message}");
    }
}
