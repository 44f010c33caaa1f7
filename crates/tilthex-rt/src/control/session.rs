//! The conversation with one client: its lines and the answers. It knows neither the socket nor a clock; every call gets the
//! time.

use std::{
    sync::{Arc, atomic::Ordering},
    time::Duration,
};

use serde_json::{Map, Value, json};

use super::{
    PROTOCOL, Shared,
    desk::{Client, Urgent},
    state::state,
};
use crate::{sleeper::Nanos, waiting::Fate};

/// Slowest and fastest stream of states, Hz; 0 ends it.
const RATES: (f64, f64) = (0.1, 100.0);
/// A client is disconnected if it has not sent a line of the protocol after this time, or has not ended a line that it has
/// begun, ns.
pub(super) const PATIENCE: Nanos = 5_000_000_000;

/// The conversation with one client.
#[derive(Debug)]
pub(super) struct Session {
    client: Client,
    shared: Arc<Shared>,
    /// Whether it has sent the token, if one is required.
    admitted: bool,
    /// Whether it has sent a line of the protocol.
    known: bool,
    /// Time at which it connected, or ended its last line.
    since: Nanos,
    stream: Option<Stream>,
    /// Orders that are answered when the vehicle has answered.
    unanswered: Vec<Unanswered>,
}

/// An order that is not answered yet.
#[derive(Debug)]
struct Unanswered {
    id: Value,
    name: String,
    fate: Fate,
}

/// A stream of states.
#[derive(Clone, Copy, Debug)]
struct Stream {
    period: Nanos,
    next: Nanos,
}

/// The reaction to a line.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Reply {
    /// The answer, if there is one.
    pub(super) line: Option<Value>,
    /// Whether the connection ends.
    pub(super) ends: bool,
}

impl Reply {
    fn of(line: Value) -> Self {
        Self { line: Some(line), ends: false }
    }
}

impl Session {
    /// A conversation with a client that has just connected.
    pub(super) fn new(client: Client, shared: Arc<Shared>, now: Nanos) -> Self {
        let admitted = shared.token.is_none();
        Self { client, shared, admitted, known: false, since: now, stream: None, unanswered: Vec::new() }
    }

    /// Takes a complete line.
    pub(super) fn line(&mut self, line: &[u8], now: Nanos) -> Reply {
        self.since = now;
        let reply = self.reply(line, now);
        self.shared.desk.hear(self.client.id, now);
        reply
    }

    fn reply(&mut self, line: &[u8], now: Nanos) -> Reply {
        let request: Result<Map<String, Value>, _> = serde_json::from_slice(line);
        let request = match request {
            Ok(request) if request.get("command").is_some_and(Value::is_string) => request,
            found => {
                let reason = match found {
                    Ok(_) => "no command; expected a string such as \"land\"".into(),
                    Err(e) => format!("not a JSON object: {e}"),
                };
                // The client speaks another protocol, for example that of a web page. All that it sends is ignored.
                return Reply { line: Some(self.refuse(Value::Null, &reason)), ends: !self.known };
            }
        };
        self.known = true;
        self.request(request, now)
    }

    fn request(&mut self, mut request: Map<String, Value>, now: Nanos) -> Reply {
        let id = request.remove("id");
        let quiet = id.is_none();
        let id = id.unwrap_or_default();
        let name = request.get("command").and_then(Value::as_str).unwrap_or_default().to_string();
        if name == "authenticate" || !self.admitted {
            return self.admit(&request, id);
        }
        let done = match name.as_str() {
            "heartbeat" if quiet => return Reply { line: None, ends: false },
            "heartbeat" => Ok(()),
            "kill" => {
                self.shared.desk.urgent(Urgent::Kill, Value::Object(request).to_string(), now);
                Ok(())
            }
            "land" => {
                self.shared.desk.urgent(Urgent::Land, Value::Object(request).to_string(), now);
                Ok(())
            }
            "take_controls" => {
                self.shared.desk.take_controls(&self.client, now);
                Ok(())
            }
            "configuration" => {
                return Reply::of(
                    json!({"id": id, "ok": true, "configuration": self.shared.desk.configuration()}),
                );
            }
            "state" => {
                return Reply::of(json!({"id": id, "ok": true, "protocol": PROTOCOL, "state": self.state()}));
            }
            "stream" => self.set_stream(&request, now),
            _ => match self.shared.desk.order(&self.client, &name, Value::Object(request).to_string(), now) {
                Ok(Some(fate)) => {
                    self.unanswered.push(Unanswered { id, name, fate });
                    return Reply { line: None, ends: false };
                }
                Ok(None) => Ok(()),
                Err(reason) => Err(reason),
            },
        };
        Reply::of(self.answer(id, done))
    }

    fn answer(&self, id: Value, done: Result<(), String>) -> Value {
        match done {
            Ok(()) => json!({"id": id, "ok": true}),
            Err(reason) => self.refuse(id, &reason),
        }
    }

    /// The answers to orders that the vehicle has answered since the last call.
    pub(super) fn answers(&mut self) -> Vec<Value> {
        let answered: Vec<_> = self.unanswered.extract_if(.., |order| order.fate.get().is_some()).collect();
        let answers = answered.into_iter().filter_map(|Unanswered { id, name, fate }| {
            let done = fate.get()?.clone();
            Some(self.answer(id, done.map_err(|reason| format!("{name}: {reason}"))))
        });
        answers.collect()
    }

    /// Takes the token. Before the token, every other request is refused.
    fn admit(&mut self, request: &Map<String, Value>, id: Value) -> Reply {
        let said = request.get("token").and_then(Value::as_str);
        self.admitted = match (&self.shared.token, said) {
            (None, _) => true,
            (Some(token), Some(said)) => token.is(said),
            (Some(_), None) => false,
        };
        if self.admitted {
            return Reply::of(json!({"id": id, "ok": true, "protocol": PROTOCOL}));
        }
        let reason = "authenticate: the token is wrong or missing; this flight takes orders only from clients that first send its token";
        Reply { line: Some(self.refuse(id, reason)), ends: true }
    }

    fn set_stream(&mut self, request: &Map<String, Value>, now: Nanos) -> Result<(), String> {
        let (slowest, fastest) = RATES;
        let rate = request.get("rate").and_then(Value::as_f64);
        self.stream = match rate {
            Some(0.0) => None,
            Some(rate) if (slowest..=fastest).contains(&rate) => {
                Some(Stream { period: (1e9 / rate) as Nanos, next: now })
            }
            _ => return Err(format!("stream: expected a rate of 0, or from {slowest} to {fastest} Hz")),
        };
        Ok(())
    }

    fn refuse(&self, id: Value, reason: &str) -> Value {
        self.shared.refused.fetch_add(1, Ordering::Relaxed);
        json!({"id": id, "error": reason})
    }

    /// The state, if one is due. Periods that were missed are skipped.
    pub(super) fn due(&mut self, now: Nanos) -> Option<Value> {
        let stream = self.stream.as_mut().filter(|stream| now >= stream.next)?;
        let missed = (now - stream.next) / stream.period;
        stream.next = stream.next.saturating_add(stream.period.saturating_mul(missed + 1));
        Some(json!({"state": self.state()}))
    }

    /// Time until the next state is due, at most `longest`: the wait for the client.
    pub(super) fn patience(&self, now: Nanos, longest: Duration) -> Duration {
        let next = self.stream.map_or(longest, |s| Duration::from_nanos(s.next.saturating_sub(now)));
        next.clamp(Duration::from_millis(1), longest)
    }

    /// Why the client must be disconnected, if it must. `begun` says whether it has begun a line.
    pub(super) fn overdue(&self, begun: bool, now: Nanos) -> Option<Value> {
        let late = now.saturating_sub(self.since) > PATIENCE && (begun || !self.known || !self.admitted);
        late.then(|| json!({"error": "no complete order arrived within 5 s"}))
    }

    fn state(&self) -> Value {
        let holder = self.shared.desk.holder();
        let holder = holder.as_ref().map(|(_, name)| name.as_str());
        let refused = self.shared.refused.load(Ordering::Relaxed);
        self.shared.desk.observer().look(|latest| state(latest, refused, holder))
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.shared.desk.leave(self.client.id);
    }
}
