//! A VRPN server with one tracker, for a simulated body.

use std::{
    io::{self, ErrorKind, Read, Write},
    net::{Ipv4Addr, SocketAddr, SocketAddrV4, TcpListener, TcpStream},
    os::fd::AsFd,
    time::{Duration, SystemTime},
};

use crate::{
    UpAxis,
    vrpn::{self, COOKIE, Description, TrackerPose, check_cookie, write_description, write_pose},
};

use super::clock::{Clock, Monotonic};
use super::delivery::{Delivery, LineParams, Publication, Publisher};

/// Largest number of clients at the same time.
const MAX_CLIENTS: usize = 16;
/// Largest number of bytes that wait for a client. A client that reads too slowly is disconnected.
const MAX_PENDING: usize = 64 * 1024;

/// Ids that this server announces.
const CONTROL_SENDER: i32 = 0;
const TRACKER_SENDER: i32 = 1;
const POSE_TYPE: i32 = 0;

/// Settings of the server.
#[derive(Clone, Debug)]
pub struct VrpnServerParams {
    /// The address at which it accepts connections. Port 0 means any free port.
    pub address: SocketAddrV4,
    /// The tracker's name.
    pub tracker: String,
    /// The number of its sensor.
    pub sensor: i32,
    /// The axis that points up in its coordinates.
    pub up_axis: UpAxis,
    /// The line to the clients.
    pub line: LineParams,
}

impl VrpnServerParams {
    /// Default settings: loopback, the usual port, z up, and a line without delay and losses.
    #[must_use]
    pub fn new(tracker: impl Into<String>) -> Self {
        Self {
            address: SocketAddrV4::new(Ipv4Addr::LOCALHOST, vrpn::PORT),
            tracker: tracker.into(),
            sensor: 0,
            up_axis: UpAxis::Z,
            line: LineParams::default(),
        }
    }
}

/// A running server. It ends when it is dropped.
#[derive(Debug)]
pub struct VrpnServer {
    address: SocketAddr,
    publisher: Publisher,
}

impl VrpnServer {
    /// Starts the server.
    ///
    /// # Errors
    /// Errors of the kernel: usually the port is in use.
    pub fn start(params: VrpnServerParams) -> io::Result<Self> {
        let listener = TcpListener::bind(params.address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let publisher = Publisher::start("vrpn-server", params.line, move |delivery| {
            Worker { listener, params, delivery, clients: Vec::with_capacity(MAX_CLIENTS) }.run();
        })?;
        Ok(Self { address, publisher })
    }

    /// The address at which it accepts connections.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Publishes a pose. A pose that is not tracked is not sent, because VRPN cannot mark it. Never blocks. Returns whether
    /// there was room for the pose.
    pub fn publish(&mut self, publication: Publication) -> bool {
        self.publisher.publish(publication)
    }
}

struct Client {
    stream: TcpStream,
    /// The part of its cookie that has arrived.
    cookie: Vec<u8>,
    /// Bytes that it has not received yet.
    pending: Vec<u8>,
    sequence: u32,
}

impl Client {
    /// Reads what has arrived. Returns whether the client is still connected and speaks VRPN.
    fn read(&mut self) -> bool {
        let mut bytes = [0; 1024];
        loop {
            match self.stream.read(&mut bytes) {
                Ok(0) => return false,
                Ok(count) => {
                    // The server ignores everything that a client sends after its cookie.
                    let missing = COOKIE.len() - self.cookie.len();
                    self.cookie.extend_from_slice(&bytes[..count.min(missing)]);
                    let whole: Result<&[u8; COOKIE.len()], _> = self.cookie.as_slice().try_into();
                    if whole.is_ok_and(|cookie| check_cookie(cookie).is_err()) {
                        return false;
                    }
                }
                Err(error) => return error.kind() == ErrorKind::WouldBlock,
            }
        }
    }

    fn is_greeted(&self) -> bool {
        self.cookie.len() == COOKIE.len()
    }

    /// Sends a message, now or as soon as it fits. Returns whether the client reads fast enough.
    fn send(&mut self, write: impl FnOnce(&mut [u8], u32) -> usize) -> bool {
        let mut message = [0; vrpn::MAX_MESSAGE];
        let length = write(&mut message, self.sequence);
        self.sequence = self.sequence.wrapping_add(1);
        self.pending.extend_from_slice(&message[..length]);
        self.flush()
    }

    fn flush(&mut self) -> bool {
        while !self.pending.is_empty() {
            match self.stream.write(&self.pending) {
                Ok(count) => drop(self.pending.drain(..count)),
                Err(error) => {
                    return error.kind() == ErrorKind::WouldBlock && self.pending.len() < MAX_PENDING;
                }
            }
        }
        true
    }
}

struct Worker {
    listener: TcpListener,
    params: VrpnServerParams,
    delivery: Delivery,
    clients: Vec<Client>,
}

impl Worker {
    fn run(&mut self) {
        while self.delivery.is_open() {
            let clients = self.clients.iter().map(|client| client.stream.as_fd());
            self.delivery.wait(clients.chain([self.listener.as_fd()]));
            while let Ok((stream, _)) = self.listener.accept() {
                self.welcome(stream);
            }
            let tracker = self.params.tracker.as_bytes();
            self.clients.retain_mut(|client| {
                let was_greeted = client.is_greeted();
                client.read() && (was_greeted || !client.is_greeted() || introduce(client, tracker))
            });
            while let Some((_, publication)) = self.delivery.next(Monotonic.now()) {
                self.send(&publication);
            }
        }
    }

    fn welcome(&mut self, stream: TcpStream) {
        let ready = stream.set_nonblocking(true).and_then(|()| stream.set_nodelay(true));
        if ready.is_ok() && self.clients.len() < MAX_CLIENTS {
            let mut client = Client { stream, cookie: Vec::new(), pending: COOKIE.to_vec(), sequence: 0 };
            if client.flush() {
                self.clients.push(client);
            }
        }
    }

    fn send(&mut self, publication: &Publication) {
        if !publication.tracking_valid {
            return;
        }
        let (position, quaternion_xyzw) =
            self.params.up_axis.from_world(&publication.position_w, &publication.rotation_wr);
        let pose = TrackerPose { sensor: self.params.sensor, position, quaternion_xyzw };
        // The times of VRPN messages are wall-clock times.
        let age = Duration::from_nanos(Monotonic.now().saturating_sub(publication.time));
        let taken = SystemTime::now() - age;
        let time = taken.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let time = (time.as_secs() as u32, time.subsec_micros());
        self.clients.retain_mut(|client| {
            !client.is_greeted()
                || client
                    .send(|out, sequence| write_pose(out, (TRACKER_SENDER, POSE_TYPE), time, &pose, sequence))
        });
    }
}

/// Announces the names of the ids. Returns whether the client reads fast enough.
fn introduce(client: &mut Client, tracker: &[u8]) -> bool {
    let names = [
        Description::Sender(CONTROL_SENDER, b"VRPN Control"),
        Description::Sender(TRACKER_SENDER, tracker),
        Description::Type(POSE_TYPE, vrpn::POSE_TYPE),
    ];
    names.iter().all(|name| client.send(|out, sequence| write_description(out, name, sequence)))
}
