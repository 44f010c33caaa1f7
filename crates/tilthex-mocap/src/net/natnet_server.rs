//! A NatNet server for a simulated body. It behaves like Motive.

use std::{
    io,
    net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket},
    os::fd::AsFd,
};

use crate::{
    UpAxis,
    natnet::{
        self, BodyName, FrameTimes, MAX_PACKET, MessageId, RigidBody, ServerInfo, Version,
        parse_echo_request, parse_packet, write_echo_response, write_frame, write_model_def,
        write_server_info,
    },
};

use super::clock::{Clock, Monotonic};
use super::delivery::{Delivery, LineParams, Publication, Publisher};
use tilthex_core::types::Nanos;

/// Largest number of clients at the same time.
const MAX_CLIENTS: usize = 16;
/// A client that sends nothing for this time counts as gone.
const CLIENT_TIMEOUT: Nanos = 10_000_000_000;
/// Period of the server's clock. The clock has an origin of its own.
const TICK: Nanos = 100;
const ORIGIN: u64 = 123_456_789_000;

/// Settings of the server.
#[derive(Clone, Debug)]
pub struct NatNetServerParams {
    /// The address at which it receives commands, and from which it sends frames. Port 0 means any free port.
    pub address: SocketAddrV4,
    /// The body's name.
    pub body: String,
    /// The version whose layout it sends.
    pub version: Version,
    /// The multicast address to which it sends frames; `None` to send them to each client.
    pub multicast: Option<SocketAddrV4>,
    /// The axis that points up in its coordinates.
    pub up_axis: UpAxis,
    /// The line to the clients.
    pub line: LineParams,
}

impl NatNetServerParams {
    /// Settings like those of Motive: loopback, unicast, the usual port, and a line without delay and losses.
    #[must_use]
    pub fn new(body: impl Into<String>) -> Self {
        Self {
            address: SocketAddrV4::new(Ipv4Addr::LOCALHOST, natnet::COMMAND_PORT),
            body: body.into(),
            version: Version::V3_0,
            multicast: None,
            up_axis: UpAxis::Y,
            line: LineParams::default(),
        }
    }
}

/// The body's id in frames.
const BODY_ID: i32 = 1;

/// A running server. It ends when it is dropped.
#[derive(Debug)]
pub struct NatNetServer {
    address: SocketAddr,
    publisher: Publisher,
}

impl NatNetServer {
    /// Starts the server.
    ///
    /// # Errors
    /// Errors of the kernel: usually the port is in use.
    pub fn start(params: NatNetServerParams) -> io::Result<Self> {
        let socket = UdpSocket::bind(params.address)?;
        socket.set_nonblocking(true)?;
        if params.multicast.is_some() {
            let socket = socket2::SockRef::from(&socket);
            socket.set_multicast_if_v4(params.address.ip())?;
            socket.set_multicast_loop_v4(true)?;
        }
        let address = socket.local_addr()?;
        let publisher = Publisher::start("natnet-server", params.line, move |delivery| {
            let clients = Vec::with_capacity(MAX_CLIENTS);
            let started = Monotonic.now();
            Worker { socket, params, delivery, clients, out: vec![0; MAX_PACKET], started }.run();
        })?;
        Ok(Self { address, publisher })
    }

    /// The address at which it receives commands.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Publishes a pose. Never blocks. Returns whether there was room for it.
    pub fn publish(&mut self, publication: Publication) -> bool {
        self.publisher.publish(publication)
    }
}

struct Client {
    address: SocketAddr,
    heard: Nanos,
}

struct Worker {
    socket: UdpSocket,
    params: NatNetServerParams,
    delivery: Delivery,
    clients: Vec<Client>,
    out: Vec<u8>,
    started: Nanos,
}

fn ticks(time: Nanos) -> u64 {
    time / TICK + ORIGIN
}

impl Worker {
    fn run(&mut self) {
        while self.delivery.is_open() {
            self.delivery.wait([self.socket.as_fd()].into_iter());
            let mut request = [0; 2048];
            while let Ok((length, from)) = self.socket.recv_from(&mut request) {
                self.answer(&request[..length], from);
            }
            let now = Monotonic.now();
            while let Some((number, publication)) = self.delivery.next(now) {
                self.send(number, &publication);
            }
            self.clients.retain(|client| now.saturating_sub(client.heard) < CLIENT_TIMEOUT);
        }
    }

    fn answer(&mut self, request: &[u8], from: SocketAddr) {
        let now = Monotonic.now();
        let Ok((id, payload)) = parse_packet(request) else { return };
        let room = self.clients.len() < MAX_CLIENTS;
        let known = self.clients.iter_mut().find(|client| client.address == from);
        match (id, known) {
            (MessageId::Disconnect, _) => self.clients.retain(|client| client.address != from),
            (_, Some(client)) => client.heard = now,
            // A discovery or another question does not make its sender a client.
            (MessageId::Connect | MessageId::KeepAlive, None) if room => {
                self.clients.push(Client { address: from, heard: now });
            }
            _ => {}
        }
        let length = match id {
            MessageId::Connect | MessageId::Discovery => {
                write_server_info(&mut self.out, &self.params.info())
            }
            MessageId::RequestModelDef => {
                let body = BodyName { name: self.params.body.as_bytes(), id: BODY_ID };
                write_model_def(&mut self.out, &[body], self.params.version)
            }
            MessageId::EchoRequest => match parse_echo_request(payload) {
                Ok(client) => write_echo_response(&mut self.out, client, ticks(now)),
                Err(_) => 0,
            },
            MessageId::Request => natnet::write_bare(&mut self.out, MessageId::Unrecognized),
            _ => 0,
        };
        if length > 0 {
            // An answer that cannot be sent is lost, like any datagram.
            let _ = self.socket.send_to(&self.out[..length], from);
        }
    }

    fn send(&mut self, number: u64, publication: &Publication) {
        let now = Monotonic.now();
        let (position, quaternion) =
            self.params.up_axis.from_world(&publication.position_w, &publication.rotation_wr);
        let body = RigidBody {
            id: BODY_ID,
            position: position.map(|x| x as f32),
            quaternion_xyzw: quaternion.map(|x| x as f32),
            mean_error: 0.0,
            tracking_valid: publication.tracking_valid,
        };
        let taken = publication.time;
        let times = FrameTimes {
            timestamp: super::seconds(taken.saturating_sub(self.started)),
            mid_exposure: ticks(taken),
            received: ticks(taken + now.saturating_sub(taken) / 2),
            transmitted: ticks(now),
        };
        let length = write_frame(&mut self.out, number as i32, &[body], &times, self.params.version);
        let frame = &self.out[..length];
        match self.params.multicast {
            Some(group) => {
                let _ = self.socket.send_to(frame, group);
            }
            None => {
                for client in &self.clients {
                    let _ = self.socket.send_to(frame, client.address);
                }
            }
        }
    }
}

impl NatNetServerParams {
    fn info(&self) -> ServerInfo<'static> {
        ServerInfo {
            application: b"tilthex",
            application_version: [0, 1, 0, 0],
            version: self.version,
            clock_frequency: 1_000_000_000 / TICK,
            data_port: self.multicast.map_or(natnet::DATA_PORT, |group| group.port()),
            multicast: self.multicast.map(|group| group.ip().octets()),
        }
    }
}
