//! A client for poses in the UDP packets of tilthex.

use std::{
    fmt,
    io::ErrorKind,
    net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket},
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use super::{
    SourceError,
    client::{Sink, list},
    counters::add,
    now,
    source::{PAUSE, PoseSource},
    uri::MocapUri,
};
use crate::{
    Malformed,
    udp::{MAX_LENGTH, PosePacket},
};
use tilthex_core::clock_sync::{ClockEvent, ClockParams, ClockSync};

/// Longest wait for the first pose.
const PATIENCE: Duration = Duration::from_secs(2);
/// A read returns after this time at the latest, so that the thread can stop.
const READ_TIMEOUT: Duration = Duration::from_millis(100);
/// If no pose arrives for this time, s, the sender may send from another port.
const FORGOTTEN: f64 = 1.0;
/// Largest relative drift: times may come from the clock of another computer.
const DRIFT: f64 = 1e-4;
/// Number of names that are kept for a message.
const MAX_NAMES: usize = 16;

/// Why a packet was refused.
#[derive(Clone, Copy, Debug)]
enum Refusal {
    /// It came from another host.
    Stranger(IpAddr),
    /// It does not have the form of `crate::udp`; with its length, bytes.
    Malformed(Malformed, usize),
    /// The length of its quaternion is not 1.
    Turned([f64; 4]),
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stranger(host) => write!(f, "a packet came from {host}"),
            Self::Malformed(what, length) => write!(
                f,
                "{what}, of {length} bytes; expected `tilthex1`, u32, u32, 8 finite f64 (little-endian) and the body's \
                 name, 81 to {MAX_LENGTH} bytes"
            ),
            Self::Turned([x, y, z, w]) => {
                write!(f, "the packet's quaternion [{x}, {y}, {z}, {w}] is not of unit length")
            }
        }
    }
}

/// A socket that receives the packets of one sender.
pub(super) struct Session {
    uri: MocapUri,
    socket: UdpSocket,
    /// The accepted sender: the host that the address names, and the port from which its first pose came.
    host: IpAddr,
    sender: Option<SocketAddr>,
    newest: f64,
    number: Option<u32>,
    others: Vec<Vec<u8>>,
    /// Why the last packet was refused, for a message.
    refusal: Option<Refusal>,
    clock: ClockSync,
    sink: Sink,
}

impl PoseSource for Session {
    fn connect(uri: &MocapUri, server: SocketAddr, sink: Sink) -> Result<Self, SourceError> {
        let any: IpAddr =
            if server.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
        let refuse = |e: std::io::Error| {
            SourceError::new(format!(
                "UDP poses cannot be received at port {}: {e}; name a free port",
                uri.port
            ))
        };
        let socket = UdpSocket::bind((any, uri.port)).map_err(refuse)?;
        socket.set_read_timeout(Some(READ_TIMEOUT)).map_err(refuse)?;
        let clock = ClockSync::new(ClockParams { drift: DRIFT, ..ClockParams::default() })
            .map_err(|error| SourceError::new(error.to_string()))?;
        let mut session = Self {
            uri: uri.clone(),
            socket,
            host: server.ip(),
            sender: None,
            newest: 0.0,
            number: None,
            others: Vec::new(),
            refusal: None,
            clock,
            sink,
        };
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            if session.read() {
                return Ok(session);
            }
        }
        let (body, host, port) = (&uri.body, session.host, uri.port);
        let came = match session.refusal {
            Some(refusal) => refusal.to_string(),
            None => format!("the packets that arrived name {}", list(&session.others)),
        };
        Err(SourceError::new(format!(
            "no UDP pose of `{body}` arrived from {host} at port {port}: {came}; start the sender, and check its address, \
             the body's name and the layout of its packets"
        )))
    }

    fn run(mut self: Box<Self>, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            self.read();
            std::thread::sleep(PAUSE);
        }
    }
}

impl Session {
    /// Takes a packet, or waits for one for [`READ_TIMEOUT`]. Returns whether it was a pose of the body.
    fn read(&mut self) -> bool {
        // With one byte more than the longest packet, a packet that is too long is noticed.
        let mut packet = [0; MAX_LENGTH + 1];
        let (length, from) = match self.socket.recv_from(&mut packet) {
            Ok(received) => received,
            Err(error) => {
                if ![ErrorKind::WouldBlock, ErrorKind::TimedOut, ErrorKind::Interrupted]
                    .contains(&error.kind())
                {
                    std::thread::sleep(READ_TIMEOUT);
                }
                return false;
            }
        };
        let arrival = now();
        let known = self.sender.filter(|_| arrival - self.newest < FORGOTTEN);
        if from.ip() != self.host || known.is_some_and(|sender| sender != from) {
            return self.refuse(Refusal::Stranger(from.ip()));
        }
        let pose = match PosePacket::parse(packet.get(..length).unwrap_or_default()) {
            Ok(pose) => pose,
            Err(what) => return self.refuse(Refusal::Malformed(what, length)),
        };
        if pose.body != self.uri.body.as_bytes() {
            if self.others.len() < MAX_NAMES && !self.others.iter().any(|name| name == pose.body) {
                self.others.push(pose.body.to_vec());
            }
            return false;
        }
        // A packet that arrives after a newer one has no new information.
        let ahead = self.number.map_or(1, |last| pose.number.wrapping_sub(last));
        if known.is_some() && (ahead == 0 || ahead > u32::MAX / 2) {
            return false;
        }
        if known.is_some() {
            add(&self.sink.counters.lost, ahead - 1);
        }
        (self.sender, self.newest, self.number) = (Some(from), arrival, Some(pose.number));
        let stamp = self.clock.step(pose.time, arrival);
        add(&self.sink.counters.clock_resets, (stamp.event == ClockEvent::Reset).into());
        let taken = stamp.time - self.sink.params.latency;
        // The sink counts poses that are not valid.
        let is_pose =
            self.sink.pose((taken, arrival), pose.position, pose.quaternion_xyzw, pose.tracking_valid);
        self.refusal = (!is_pose).then_some(Refusal::Turned(pose.quaternion_xyzw));
        is_pose
    }

    /// Counts a packet that is refused.
    fn refuse(&mut self, why: Refusal) -> bool {
        add(&self.sink.counters.refused, 1);
        self.refusal = Some(why);
        false
    }
}
