//! A client of a NatNet server.

mod packets;
mod sender;

use std::{
    net::SocketAddr,
    sync::atomic::{AtomicBool, Ordering},
};

use tilthex_core::clock_sync::{ClockParams, ClockSync};

use super::{
    SourceError,
    client::{Sink, list},
    clock::{Clock, Monotonic},
    counters::add,
    natnet_line::Line,
    now, seconds,
    source::{PAUSE, PoseSource, Protocol},
    uri::MocapUri,
};
use crate::{
    echo_clock::EchoClock,
    natnet::{DATA_PORT, MessageId, Version, parse_packet, write_bare, write_connect, write_echo_request},
};
use packets::{Found, Introduction, Taken};
use sender::Sender;
use tilthex_core::types::Nanos;

const MILLISECOND: Nanos = 1_000_000;
/// A question that is not answered is repeated after this time.
const ASK_AGAIN: Nanos = 200 * MILLISECOND;
/// Longest wait for each of introduction, models and first frame.
const PATIENCE: Nanos = 1_200 * MILLISECOND;
/// Time between two keep-alives. The server forgets a client that does not send them.
const KEEP_ALIVE: Nanos = 200 * MILLISECOND;
/// If no frame arrives for this time, the client asks the server again.
const SILENCE: Nanos = 1_000 * MILLISECOND;
/// Largest relative drift between a server's clock and ours.
const DRIFT: f64 = 1e-4;

/// A connection to a server.
pub(super) struct Session {
    uri: MocapUri,
    server: SocketAddr,
    line: Line,
    buffer: Vec<u8>,
    version: Version,
    frequency: f64,
    data_port: u16,
    body: i32,
    echo: EchoClock,
    /// Clock for servers whose cameras do not send exposure times.
    passive: ClockSync,
    newest: Option<i32>,
    sender: Sender,
    sink: Sink,
}

impl PoseSource for Session {
    fn connect(uri: &MocapUri, server: SocketAddr, sink: Sink) -> Result<Self, SourceError> {
        let system = |error: std::io::Error| SourceError::new(format!("no socket for {uri}: {error}"));
        let passive = ClockSync::new(ClockParams { drift: DRIFT, ..ClockParams::default() })
            .map_err(|error| SourceError::new(error.to_string()))?;
        let mut session = Self {
            uri: uri.clone(),
            server,
            line: Line::open(server).map_err(system)?,
            buffer: vec![0; 65_536],
            version: Version::V3_0,
            frequency: 1.0,
            data_port: DATA_PORT,
            body: 0,
            echo: EchoClock::new(DRIFT),
            passive,
            newest: None,
            sender: Sender::new(server.port()),
            sink,
        };
        let multicast = session.introduce()?;
        if uri.protocol == Protocol::NatNetMulticast {
            let group = multicast.ok_or_else(|| {
                SourceError::new(format!(
                    "{server} sends unicast frames: use {}",
                    session.with(Protocol::NatNet)
                ))
            })?;
            session.line.join(group, session.data_port).map_err(system)?;
        }
        session.find_body()?;
        session.first_frame(multicast)?;
        Ok(session)
    }

    fn run(mut self: Box<Self>, stop: &AtomicBool) {
        let (mut keep_alive, mut frame) = (0, Monotonic.now());
        while !stop.load(Ordering::Relaxed) {
            let now = Monotonic.now();
            if now >= keep_alive {
                keep_alive = now + KEEP_ALIVE;
                self.line.say(|out| write_bare(out, MessageId::KeepAlive));
                self.line.say(|out| write_echo_request(out, Monotonic.now()));
            }
            if now.saturating_sub(frame) > SILENCE {
                frame = now;
                add(&self.sink.counters.silences, 1);
                self.say_connect();
                self.line.say(|out| write_bare(out, MessageId::RequestModelDef));
            }
            self.receive(keep_alive, |session, id, payload| match id {
                MessageId::Frame => {
                    if matches!(session.take_frame(payload), Taken::Body) {
                        frame = Monotonic.now();
                    }
                    None::<()>
                }
                // The server may have restarted with other bodies.
                MessageId::ServerInfo => {
                    session.take_info(payload);
                    None
                }
                MessageId::ModelDef => {
                    if let Some(Found::Body(id)) = session.take_models(payload) {
                        session.body = id;
                    }
                    None
                }
                _ => None,
            });
        }
        self.line.say(|out| write_bare(out, MessageId::Disconnect));
    }
}

impl Session {
    /// Asks for the server's introduction. Returns the multicast group to which it sends frames.
    fn introduce(&mut self) -> Result<Option<[u8; 4]>, SourceError> {
        let refused = self.refused();
        let info = self.ask(Self::say_connect, |session, id, payload| {
            (id == MessageId::ServerInfo).then(|| session.take_info(payload)).flatten()
        });
        let server = self.server;
        match info {
            Some(Introduction::Server(group)) => Ok(group),
            Some(Introduction::Version(Version { major, minor })) => Err(SourceError::new(format!(
                "{server} speaks NatNet {major}.{minor}; expected 3.0 to 4.2: use a newer capture program, or set its \
                 stream to another version"
            ))),
            None => Err(SourceError::new(if let Some(port) = self.sender.stranger() {
                format!(
                    "the answer of {server} comes from port {port}; expected it from the port that was asked: check the \
                     port, usually 1510, and that no other program answers there"
                )
            } else if self.refused() > refused {
                format!("{server} answers, but not as a NatNet server: check the port, usually 1510")
            } else {
                format!(
                    "no NatNet server answers at {server}: check the address, that the capture system \
                     streams, and that no firewall blocks UDP"
                )
            })),
        }
    }

    /// Asks for the models, and finds the body's id in them.
    fn find_body(&mut self) -> Result<(), SourceError> {
        let ask = |session: &mut Self| {
            session.line.say(|out| write_bare(out, MessageId::RequestModelDef));
            // The clock is then known before the first frame arrives.
            session.line.say(|out| write_echo_request(out, Monotonic.now()));
        };
        let mut unreadable = None;
        let found = self.ask(ask, |session, id, payload| {
            if id != MessageId::ModelDef {
                return None;
            }
            let found = session.take_models(payload);
            if found.is_none() {
                unreadable = Some(payload.len());
            }
            found
        });
        let (server, Version { major, minor }) = (self.server, self.version);
        match found {
            Some(Found::Body(id)) => {
                self.body = id;
                Ok(())
            }
            Some(Found::Others(names)) if names.is_empty() => Err(SourceError::new(format!(
                "{server} captures no rigid body at all: define `{}` there, and switch rigid bodies on in its stream",
                self.uri.body
            ))),
            Some(Found::Others(names)) => Err(SourceError::new(format!(
                "{server} captures no rigid body named `{}`; it captures {}",
                self.uri.body,
                list(&names)
            ))),
            None => Err(SourceError::new(match unreadable {
                Some(length) => format!(
                    "{server} (NatNet {major}.{minor}) lists its models in an unknown layout ({length} bytes); expected \
                     that of NatNet 3.0 to 4.2: set its stream to one of these versions"
                ),
                None => format!(
                    "{server} (NatNet {major}.{minor}) does not send its list of models: switch its stream on"
                ),
            })),
        }
    }

    fn first_frame(&mut self, multicast: Option<[u8; 4]>) -> Result<(), SourceError> {
        let mut last = None;
        let ask = |session: &mut Self| {
            session.line.say(|out| write_bare(out, MessageId::KeepAlive));
            session.line.say(|out| write_echo_request(out, Monotonic.now()));
        };
        let taken = self.ask(ask, |session, id, payload| {
            if id != MessageId::Frame {
                return None;
            }
            match session.take_frame(payload) {
                Taken::Body => Some(()),
                other => {
                    last = Some(other);
                    None
                }
            }
        });
        taken.ok_or_else(|| {
            let (server, body) = (self.server, &self.uri.body);
            let Version { major, minor } = self.version;
            SourceError::new(match (last, multicast) {
                (Some(Taken::Others(0)), _) => format!(
                    "the frames of {server} hold no rigid body at all: switch rigid bodies on in its stream"
                ),
                (Some(Taken::Others(count)), _) => format!(
                    "the frames of {server} hold {count} rigid bodies but not `{body}`: check that it is switched on and \
                     that no other body has its id"
                ),
                (Some(Taken::Unreadable(what)), _) => format!(
                    "the frames of {server} (NatNet {major}.{minor}) have an unknown layout ({what}); expected that of \
                     NatNet 3.0 to 4.2: set its stream to one of these versions"
                ),
                (_, Some(_)) if !self.line.has_group() => format!(
                    "{server} sends its frames to a multicast group, and none arrived here: use {}",
                    self.with(Protocol::NatNetMulticast)
                ),
                _ => format!("{server} answers but sends no frames: start the capture's stream"),
            })
        })
    }

    /// The address of this body with another protocol.
    fn with(&self, protocol: Protocol) -> MocapUri {
        MocapUri { protocol, ..self.uri.clone() }
    }

    fn say_connect(&mut self) {
        self.line.say(|out| write_connect(out, MessageId::Connect, "tilthex", Version::V3_0));
    }

    /// Asks every [`ASK_AGAIN`] until `take` finds the answer, for [`PATIENCE`] at most.
    fn ask<T>(
        &mut self,
        mut question: impl FnMut(&mut Self),
        mut answer: impl FnMut(&mut Self, MessageId, &[u8]) -> Option<T>,
    ) -> Option<T> {
        let end = Monotonic.now() + PATIENCE;
        while Monotonic.now() < end {
            question(self);
            let again = Monotonic.now() + ASK_AGAIN;
            if let Some(found) = self.receive(again, &mut answer) {
                return Some(found);
            }
        }
        None
    }

    /// Reads packets until `end`, or until `take` returns a result. Also handles the answers to echo requests.
    fn receive<T>(
        &mut self,
        end: Nanos,
        mut take: impl FnMut(&mut Self, MessageId, &[u8]) -> Option<T>,
    ) -> Option<T> {
        loop {
            let left = end.saturating_sub(Monotonic.now());
            if left == 0 {
                return None;
            }
            self.line.wait(left);
            // The buffer is taken out of the session, because the session is changed meanwhile.
            let mut buffer = std::mem::take(&mut self.buffer);
            let mut found = None;
            while found.is_none()
                && let Some((length, port)) = self.line.read(&mut buffer)
            {
                let packet = parse_packet(&buffer[..length]);
                let id = packet.as_ref().ok().map(|(id, _)| *id);
                let admitted = self.sender.admits(port, id, self.data_port, now());
                match packet.ok().filter(|_| admitted) {
                    Some((MessageId::EchoResponse, payload)) => self.take_echo(payload),
                    Some((id, payload)) => found = take(self, id, payload),
                    None => add(&self.sink.counters.refused, 1),
                }
                std::thread::sleep(PAUSE);
            }
            self.buffer = buffer;
            if found.is_some() {
                return found;
            }
        }
    }

    fn refused(&self) -> u32 {
        self.sink.counters.status().refused
    }
}
