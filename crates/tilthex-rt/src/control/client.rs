//! The thread of one connection.

use std::{
    io::{self, ErrorKind, Read, Write},
    sync::{Arc, atomic::Ordering},
    time::Duration,
};

use serde_json::{Value, json};

use super::{Shared, address::Stream, desk::Client, places::Place, session::Session};
use crate::sleeper::{Clock, Monotonic, Nanos};

/// Longest line of a request, bytes.
const LONGEST_LINE: usize = 64 * 1024;
/// Longest wait for the socket before the thread does other work.
pub(super) const LOOK: Duration = Duration::from_millis(20);
/// After the orders of one read, the thread pauses for this many times the time that they took, and for these times at least and
/// at most. It may have real-time rights, and clients without a pause must not take the processors from the loop.
const SHARE: Nanos = 8;
const PAUSE: (Duration, Duration) = (Duration::from_micros(100), Duration::from_millis(20));
/// A client that does not read for this time is disconnected.
const STUCK: Duration = Duration::from_millis(500);

/// A connection and its conversation.
pub(super) struct Connection {
    stream: Stream,
    session: Session,
    place: Place,
    received: Vec<u8>,
}

impl Connection {
    /// A connection with a client that has a place.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub(super) fn new(stream: Stream, name: String, place: Place, shared: Arc<Shared>) -> io::Result<Self> {
        stream.set_blocking(STUCK)?;
        let client = Client { id: place.id, name };
        let session = Session::new(client, shared, Monotonic.now());
        Ok(Self { stream, session, place, received: Vec::new() })
    }

    /// Serves until the client or the program ends.
    pub(super) fn serve(mut self, shared: &Shared) {
        while !shared.stop.load(Ordering::Relaxed) {
            if self.turn().is_err() {
                return;
            }
        }
    }

    fn turn(&mut self) -> io::Result<()> {
        self.stream.set_patience(self.session.patience(Monotonic.now(), LOOK))?;
        let mut bytes = [0; 4096];
        match self.stream.read(&mut bytes) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => self.received.extend_from_slice(bytes.get(..count).unwrap_or_default()),
            Err(e)
                if matches!(
                    e.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            Err(e) => return Err(e),
        }
        let mut busy = 0;
        while let Some(end) = self.received.iter().position(|&byte| byte == b'\n') {
            let line: Vec<_> = self.received.drain(..=end).collect();
            let now = Monotonic.now();
            self.place.touch(now);
            let reply = self.session.line(&line, now);
            busy += Monotonic.now().saturating_sub(now);
            if let Some(line) = &reply.line {
                self.say(line)?;
            }
            if reply.ends {
                return Err(ErrorKind::InvalidData.into());
            }
        }
        if busy > 0 {
            std::thread::sleep(Duration::from_nanos(SHARE * busy).max(PAUSE.0).min(PAUSE.1));
        }
        if self.received.len() > LONGEST_LINE {
            self.say(&json!({"error": format!("a line is longer than {LONGEST_LINE} bytes")}))?;
            return Err(ErrorKind::InvalidData.into());
        }
        let now = Monotonic.now();
        if let Some(reason) = self.session.overdue(!self.received.is_empty(), now) {
            self.say(&reason)?;
            return Err(ErrorKind::TimedOut.into());
        }
        for answer in self.session.answers() {
            self.say(&answer)?;
        }
        match self.session.due(now) {
            Some(state) => self.say(&state),
            None => Ok(()),
        }
    }

    fn say(&mut self, value: &Value) -> io::Result<()> {
        self.stream.write_all(format!("{value}\n").as_bytes())
    }
}
