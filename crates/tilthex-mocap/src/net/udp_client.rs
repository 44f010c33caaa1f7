//! Poses in UDP packets of our own.

use std::{
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
    source::PoseSource,
    uri::MocapUri,
};
use crate::udp::{MAX_LENGTH, PosePacket};
use tilthex_core::clock_sync::{ClockEvent, ClockParams, ClockSync};

/// This long is waited for the first pose.
const PATIENCE: Duration = Duration::from_secs(2);
/// Reads return at least this often, to see whether to stop.
const READ_TIMEOUT: Duration = Duration::from_millis(100);
/// Without a pose for this long, the sender may come back from another port, s.
const FORGOTTEN: f64 = 1.0;
/// Stamps may be times of another machine.
const DRIFT: f64 = 1e-4;
/// Names kept for a message.
const MAX_NAMES: usize = 16;

/// A socket that one sender's packets come to.
pub(super) struct Session {
    uri: MocapUri,
    socket: UdpSocket,
    /// Whose packets are taken: the host that the address names, from the port of its first pose.
    host: IpAddr,
    sender: Option<SocketAddr>,
    newest: f64,
    number: Option<u32>,
    others: Vec<Vec<u8>>,
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
            clock,
            sink,
        };
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            if session.read() {
                return Ok(session);
            }
        }
        Err(SourceError::new(format!(
            "no UDP pose of `{}` came from {} at port {}; what came was of {}: start the sender, and check its address \
             and the body's name",
            uri.body,
            session.host,
            uri.port,
            list(&session.others)
        )))
    }

    fn run(mut self: Box<Self>, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            self.read();
        }
    }
}

impl Session {
    /// Takes a packet, or waits a moment for one; whether it was a pose of the body.
    fn read(&mut self) -> bool {
        // One byte more than a packet may have shows those that are too long.
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
            add(&self.sink.counters.refused, 1);
            return false;
        }
        let Ok(pose) = PosePacket::parse(packet.get(..length).unwrap_or_default()) else {
            add(&self.sink.counters.refused, 1);
            return false;
        };
        if pose.body != self.uri.body.as_bytes() {
            if self.others.len() < MAX_NAMES && !self.others.iter().any(|name| name == pose.body) {
                self.others.push(pose.body.to_vec());
            }
            return false;
        }
        // A packet that was overtaken comes too late to say anything new.
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
        self.sink.pose((taken, arrival), pose.position, pose.quaternion_xyzw, pose.tracking_valid);
        true
    }
}
