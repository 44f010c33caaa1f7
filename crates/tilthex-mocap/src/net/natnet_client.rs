//! A client of a NatNet server.

use std::{
    net::SocketAddr,
    sync::atomic::{AtomicBool, Ordering},
};

use tilthex_core::clock_sync::{ClockEvent, ClockParams, ClockSync};

use super::{
    SourceError,
    client::{Sink, list},
    clock::{Clock, Monotonic},
    counters::add,
    natnet_line::Line,
    now, seconds,
    source::{PoseSource, Protocol},
    uri::MocapUri,
};
use crate::{
    Malformed,
    echo_clock::EchoClock,
    natnet::{
        DATA_PORT, Frame, MessageId, ModelDef, ServerInfo, Version, announced_version, parse_echo_response,
        parse_packet, write_bare, write_connect, write_echo_request,
    },
};
use tilthex_core::types::Nanos;

const MILLISECOND: Nanos = 1_000_000;
/// A question that is not answered is asked again.
const ASK_AGAIN: Nanos = 200 * MILLISECOND;
/// So long is waited for each of introduction, models and first frame.
const PATIENCE: Nanos = 1_200 * MILLISECOND;
/// The server forgets clients that do not say that they listen.
const KEEP_ALIVE: Nanos = 200 * MILLISECOND;
/// After so long without a frame the server is asked anew.
const SILENCE: Nanos = 1_000 * MILLISECOND;
/// Names kept for a message.
const MAX_NAMES: usize = 64;
/// Largest relative drift between a server's clock and ours.
const DRIFT: f64 = 1e-4;

/// What the server captures under the name asked for, or what else it captures.
enum Found {
    Body(i32),
    Others(Vec<Vec<u8>>),
}

/// What became of a frame.
enum Taken {
    /// It holds the body.
    Body,
    /// It holds so many others.
    Others(usize),
    /// It is laid out otherwise.
    Unreadable(Malformed),
}

/// What an introduction says.
enum Introduction {
    /// The group that frames are sent to, where they are.
    Server(Option<[u8; 4]>),
    /// A version that this client does not read.
    Version(Version),
}

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
    /// For servers whose cameras do not tell the exposure.
    passive: ClockSync,
    newest: Option<i32>,
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
                // The server may have been started anew, with other bodies.
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
    /// Asks who is there; the group that frames are sent to.
    fn introduce(&mut self) -> Result<Option<[u8; 4]>, SourceError> {
        let refused = self.refused();
        let info = self.ask(Self::say_connect, |session, id, payload| {
            (id == MessageId::ServerInfo).then(|| session.take_info(payload)).flatten()
        });
        let server = self.server;
        match info {
            Some(Introduction::Server(group)) => Ok(group),
            Some(Introduction::Version(Version { major, minor })) => Err(SourceError::new(format!(
                "{server} speaks NatNet {major}.{minor}; expected 3.0 to 4.2: use a newer capture program, or let it \
                 stream in another version"
            ))),
            None => Err(SourceError::new(if self.refused() > refused {
                format!("{server} answers, but not as a NatNet server: check the port, usually 1510")
            } else {
                format!(
                    "no NatNet server answers at {server}: check the address, that the capture system \
                     streams, and that no firewall stops UDP"
                )
            })),
        }
    }

    /// Asks for the models; the body's id.
    fn find_body(&mut self) -> Result<(), SourceError> {
        let ask = |session: &mut Self| {
            session.line.say(|out| write_bare(out, MessageId::RequestModelDef));
            // Until the first frame is due, the clock is known.
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
                "{server} captures nothing, no rigid body: define `{}` there, and switch rigid bodies on in its stream",
                self.uri.body
            ))),
            Some(Found::Others(names)) => Err(SourceError::new(format!(
                "{server} captures no rigid body named `{}`; it captures {}",
                self.uri.body,
                list(&names)
            ))),
            None => Err(SourceError::new(match unreadable {
                Some(length) => format!(
                    "{server} (NatNet {major}.{minor}) lists what it captures in a layout that is none of NatNet 3.0 to \
                     4.2 ({length} bytes): let it stream in one of these versions"
                ),
                None => format!(
                    "{server} (NatNet {major}.{minor}) does not answer what it captures: switch on its stream"
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
                    "the frames of {server} hold {count} rigid bodies but not `{body}`: is it switched on, and is its id \
                     its own?"
                ),
                (Some(Taken::Unreadable(what)), _) => format!(
                    "the frames of {server} (NatNet {major}.{minor}) are laid out otherwise than those of NatNet 3.0 to 4.2 \
                     ({what}): let it stream in one of these versions"
                ),
                (_, Some(_)) if !self.line.has_group() => format!(
                    "{server} sends its frames to a group, none came here: use {}",
                    self.with(Protocol::NatNetMulticast)
                ),
                _ => format!("{server} answers but sends no frames: start the capture's stream"),
            })
        })
    }

    /// This body's address in another protocol.
    fn with(&self, protocol: Protocol) -> MocapUri {
        MocapUri { protocol, ..self.uri.clone() }
    }

    fn say_connect(&mut self) {
        self.line.say(|out| write_connect(out, MessageId::Connect, "tilthex", Version::V3_0));
    }

    /// Asks, again and again, until an answer is found or patience ends.
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

    /// Reads packets until `end`, or until one is what `take` looks for. Echoes are taken on the way.
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
            // Out of the way while the session is changed.
            let mut buffer = std::mem::take(&mut self.buffer);
            let mut found = None;
            while found.is_none()
                && let Some(length) = self.line.read(&mut buffer)
            {
                match parse_packet(&buffer[..length]) {
                    Ok((MessageId::EchoResponse, payload)) => self.take_echo(payload),
                    Ok((id, payload)) => found = take(self, id, payload),
                    Err(_) => add(&self.sink.counters.refused, 1),
                }
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

    fn take_info(&mut self, payload: &[u8]) -> Option<Introduction> {
        if let Some(version) = announced_version(payload).filter(|version| !version.is_known()) {
            return Some(Introduction::Version(version));
        }
        let Ok(info) = ServerInfo::parse(payload) else {
            add(&self.sink.counters.refused, 1);
            return None;
        };
        self.version = info.version;
        self.frequency = info.clock_frequency as f64;
        self.data_port = info.data_port;
        Some(Introduction::Server(info.multicast))
    }

    fn take_models(&mut self, payload: &[u8]) -> Option<Found> {
        let mut names = Vec::new();
        let Ok(models) = ModelDef::new_either(payload, self.version) else {
            add(&self.sink.counters.refused, 1);
            return None;
        };
        for body in models.flatten() {
            if body.name == self.uri.body.as_bytes() {
                return Some(Found::Body(body.id));
            }
            if names.len() < MAX_NAMES {
                names.push(body.name.to_vec());
            }
        }
        Some(Found::Others(names))
    }

    fn take_echo(&mut self, payload: &[u8]) {
        let Ok((asked, server)) = parse_echo_response(payload) else {
            add(&self.sink.counters.refused, 1);
            return;
        };
        if self.echo.step(seconds(asked), server as f64 / self.frequency, now()) {
            add(&self.sink.counters.clock_resets, 1);
        }
    }

    /// Hands the body's pose on, where the frame holds it.
    fn take_frame(&mut self, payload: &[u8]) -> Taken {
        let arrival = now();
        let (frame, version) = match Frame::parse_either(payload, self.version) {
            Ok(read) => read,
            Err(what) => {
                add(&self.sink.counters.refused, 1);
                return Taken::Unreadable(what);
            }
        };
        self.version = version;
        let Some(body) = frame.body(self.body) else { return Taken::Others(frame.bodies().count()) };
        if frame.models_changed {
            self.line.say(|out| write_bare(out, MessageId::RequestModelDef));
        }
        if !self.count(frame.number) {
            return Taken::Body;
        }
        let exposed = (frame.times.mid_exposure != 0)
            .then(|| self.echo.to_ours(frame.times.mid_exposure as f64 / self.frequency, arrival))
            .flatten();
        let time = exposed.map_or_else(
            || {
                let stamp = self.passive.step(frame.times.timestamp, arrival);
                add(&self.sink.counters.clock_resets, (stamp.event == ClockEvent::Reset).into());
                stamp.time - self.sink.params.latency
            },
            |(time, _)| time,
        );
        let position = body.position.map(f64::from);
        let quaternion = body.quaternion_xyzw.map(f64::from);
        self.sink.pose((time, arrival), position, quaternion, body.tracking_valid);
        Taken::Body
    }

    /// Counts the frames that were lost before this one; false for one that came before.
    fn count(&mut self, number: i32) -> bool {
        let ahead = self.newest.map_or(1, |newest| number.wrapping_sub(newest));
        if ahead > 0 {
            // A long jump is a server that was started anew.
            add(&self.sink.counters.lost, if ahead < 1000 { ahead.unsigned_abs() - 1 } else { 0 });
        }
        if !(-1000..=0).contains(&ahead) {
            self.newest = Some(number);
        }
        ahead != 0
    }
}
