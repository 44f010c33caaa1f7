//! A client of a VRPN server.

use std::{
    io::{ErrorKind, Read, Write},
    net::{SocketAddr, TcpStream},
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use crate::vrpn::{COOKIE, Decoder, Description, Message, POSE_TYPE, check_cookie};
use tilthex_core::clock_sync::{ClockEvent, ClockParams, ClockSync};

use super::SourceError;
use super::{
    client::{Sink, list},
    counters::add,
    now,
    source::{PAUSE, PoseSource},
    uri::MocapUri,
};

/// Longest wait for each of connection, greeting and first pose.
const PATIENCE: Duration = Duration::from_millis(1200);
/// A read returns after this time at the latest, so that the thread can stop.
const READ_TIMEOUT: Duration = Duration::from_millis(100);
/// Time between two attempts to connect again; the first attempt is made at once. It is short, because the vehicle lands if
/// its pose is lost for 0.5 s.
const RECONNECT: Duration = Duration::from_millis(20);
/// Longest wait for a server when the client connects again.
const PATIENCE_AGAIN: Duration = Duration::from_millis(200);
/// Number of names that are kept for a message.
const MAX_NAMES: usize = 64;
/// Largest relative drift: times are wall-clock times of another computer.
const DRIFT: f64 = 1e-4;

/// The ids that the server has announced in this connection.
#[derive(Debug, Default)]
struct Names {
    tracker: Option<i32>,
    pose: Option<i32>,
    others: Vec<Vec<u8>>,
}

/// The sensor that the client follows. It stays the same over all connections, because another sensor is another body.
#[derive(Debug)]
struct Followed {
    /// The sensor that the address names, or the first that reported.
    sensor: Option<i32>,
    /// Other sensors that reported, for a message.
    others: Vec<i32>,
}

/// A connection to a server.
pub(super) struct Session {
    uri: MocapUri,
    server: SocketAddr,
    stream: TcpStream,
    decoder: Decoder,
    names: Names,
    followed: Followed,
    clock: ClockSync,
    sink: Sink,
}

impl PoseSource for Session {
    fn connect(uri: &MocapUri, server: SocketAddr, sink: Sink) -> Result<Self, SourceError> {
        let stream = greet(server, PATIENCE)?;
        let clock = ClockSync::new(ClockParams { drift: DRIFT, ..ClockParams::default() })
            .map_err(|error| SourceError::new(error.to_string()))?;
        let names = Names::default();
        let decoder = Decoder::default();
        let followed = Followed { sensor: uri.sensor, others: Vec::new() };
        let mut session = Self { uri: uri.clone(), server, stream, decoder, names, followed, clock, sink };
        session.first_pose()?;
        Ok(session)
    }

    fn run(mut self: Box<Self>, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            if self.read().is_some() {
                std::thread::sleep(PAUSE);
                continue;
            }
            add(&self.sink.counters.silences, 1);
            while !stop.load(Ordering::Relaxed) {
                if let Ok(stream) = greet(self.server, PATIENCE_AGAIN) {
                    self.stream = stream;
                    self.decoder = Decoder::default();
                    self.names = Names::default();
                    break;
                }
                std::thread::sleep(RECONNECT);
            }
        }
    }
}

impl Session {
    fn first_pose(&mut self) -> Result<(), SourceError> {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            let poses = self.read().ok_or_else(|| {
                SourceError::new(format!("the VRPN server at {} closed the connection", self.server))
            })?;
            if poses > 0 {
                return Ok(());
            }
        }
        let (server, tracker) = (self.server, &self.uri.body);
        Err(SourceError::new(match (self.names.tracker, self.followed.sensor) {
            (Some(_), Some(sensor)) if !self.followed.others.is_empty() => format!(
                "the tracker `{tracker}` of {server} has no sensor {sensor}; its sensors that report are {}",
                self.followed.others.iter().map(i32::to_string).collect::<Vec<_>>().join(", ")
            ),
            (Some(_), _) => {
                format!("the tracker `{tracker}` of {server} sends no poses: check that its body is tracked")
            }
            (None, _) => {
                format!("{server} has no tracker named `{tracker}`; it has {}", list(&self.names.others))
            }
        }))
    }

    /// Reads what has arrived, or waits for it for [`READ_TIMEOUT`]. Returns the number of poses, or `None` if the
    /// connection is lost.
    fn read(&mut self) -> Option<u32> {
        let mut bytes = [0; 4096];
        let count = match self.stream.read(&mut bytes) {
            Ok(0) => return None,
            Ok(count) => count,
            Err(error) => {
                let waits = [ErrorKind::WouldBlock, ErrorKind::TimedOut, ErrorKind::Interrupted];
                return waits.contains(&error.kind()).then_some(0);
            }
        };
        let arrival = now();
        let mut poses = 0;
        for &byte in bytes.iter().take(count) {
            match self.decoder.push(byte) {
                Ok(None) => {}
                Ok(Some(message)) => {
                    poses += u32::from(take(
                        (&mut self.names, &mut self.followed),
                        &mut self.clock,
                        &mut self.sink,
                        &self.uri,
                        &message,
                        arrival,
                    ));
                }
                Err(_) => {
                    add(&self.sink.counters.refused, 1);
                    return None;
                }
            }
        }
        Some(poses)
    }
}

/// Takes a message. Returns whether it was a pose of the tracker.
fn take(
    (names, followed): (&mut Names, &mut Followed),
    clock: &mut ClockSync,
    sink: &mut Sink,
    uri: &MocapUri,
    message: &Message<'_>,
    arrival: f64,
) -> bool {
    match message.description() {
        Some(Description::Sender(id, name)) if name == uri.body.as_bytes() => names.tracker = Some(id),
        Some(Description::Sender(_, name)) if names.others.len() < MAX_NAMES => {
            names.others.push(name.to_vec())
        }
        Some(Description::Type(id, name)) if name == POSE_TYPE => names.pose = Some(id),
        _ => {}
    }
    if names.tracker != Some(message.sender) || names.pose != Some(message.kind) {
        return false;
    }
    let Ok(pose) = message.pose() else {
        add(&sink.counters.refused, 1);
        return false;
    };
    if *followed.sensor.get_or_insert(pose.sensor) != pose.sensor {
        if followed.others.len() < MAX_NAMES && !followed.others.contains(&pose.sensor) {
            followed.others.push(pose.sensor);
        }
        return false;
    }
    let stamp = clock.step(message.seconds(), arrival);
    add(&sink.counters.clock_resets, (stamp.event == ClockEvent::Reset).into());
    sink.pose((stamp.time - sink.params.latency, arrival), pose.position, pose.quaternion_xyzw, true)
}

/// Connects, then exchanges cookies. Waits for each of the two for `patience`.
fn greet(server: SocketAddr, patience: Duration) -> Result<TcpStream, SourceError> {
    let lost = |why: &str| SourceError::new(format!("no VRPN server at {server}: {why}"));
    let mut stream = TcpStream::connect_timeout(&server, patience).map_err(|error| match error.kind() {
        ErrorKind::ConnectionRefused => {
            lost("no program listens there; check the address and that the server runs")
        }
        ErrorKind::TimedOut => lost("no computer answers; check the address and the network"),
        _ => lost(&error.to_string()),
    })?;
    let set_up = stream.set_nodelay(true).and_then(|()| stream.set_read_timeout(Some(READ_TIMEOUT)));
    set_up.and_then(|()| stream.write_all(&COOKIE)).map_err(|error| lost(&error.to_string()))?;
    let mut cookie = [0; COOKIE.len()];
    let (mut filled, end) = (0, Instant::now() + patience);
    while filled < cookie.len() && Instant::now() < end {
        match stream.read(&mut cookie[filled..]) {
            Ok(0) => break,
            Ok(count) => filled += count,
            Err(error) if [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind()) => {}
            Err(error) => return Err(lost(&error.to_string())),
        }
    }
    if filled == cookie.len() && check_cookie(&cookie).is_ok() {
        return Ok(stream);
    }
    let said = String::from_utf8_lossy(&cookie[..filled]);
    Err(lost(&if filled == 0 {
        "a program listens there but sends no VRPN greeting; check the port, usually 3883".into()
    } else {
        format!(
            "another program answers, with `{}`; expected VRPN 7: check the port, usually 3883",
            said.trim_end_matches('\0').escape_debug()
        )
    }))
}
