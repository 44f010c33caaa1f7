//! Orders to a running flight over TCP: lines of JSON, on loopback or on an
//! address that was named.
//!
//! A request is an object with `command`, what the command takes, and an `id`
//! that comes back with the answer: `{"id": 1, "ok": true}` or
//! `{"id": 1, "error": "..."}`. Besides the orders of [`tilthex_config::orders`] there is
//! `state`, which answers with the newest state, and `stream` with a `rate`, Hz,
//! after which lines `{"state": {...}}` come of their own accord.

use std::{
    io::{self, ErrorKind, Read, Write},
    net::{SocketAddr, TcpListener, TcpStream},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

use rtrb::Producer;
use serde_json::{Map, Value, json};
use tilthex_core::{Matrix3, Setpoint, Vector3, flight::Command};

use tilthex_config::orders::Orders;

use crate::{
    Failure,
    recorder::{Latest, Observer},
    sleeper::{Clock, Monotonic},
};

/// Where the socket listens unless told otherwise.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:7410";
/// Longest line of a request, bytes.
const LONGEST_LINE: usize = 64 * 1024;
/// Most clients at a time.
const MOST_CLIENTS: usize = 8;
/// Fastest stream of states, Hz.
const FASTEST: f64 = 100.0;
/// How long a thread waits for its socket before it looks at anything else.
const LOOK: Duration = Duration::from_millis(20);
/// A client that takes nothing for so long is dropped.
const STUCK: Duration = Duration::from_millis(500);

/// Hands orders to the loop and to the log, in the same order.
#[derive(Debug)]
pub struct Dispatcher {
    orders: Orders,
    ring: Producer<Command>,
    observer: Observer,
}

impl Dispatcher {
    /// From the parser to the loop's ring and the recorder.
    #[must_use]
    pub fn new(orders: Orders, ring: Producer<Command>, observer: Observer) -> Self {
        Self { orders, ring, observer }
    }

    fn dispatch(&mut self, line: &str) -> Result<(), String> {
        if self.ring.is_full() {
            return Err("the loop has not taken the orders before this one; try again".into());
        }
        let command = self.orders.parse(line)?;
        // Said to the recorder first: the record that holds it must not come before it.
        self.observer.command(Monotonic.now() as f64 * 1e-9, line.into());
        self.ring.push(command).map_err(|_| "the loop takes no orders".into())
    }
}

/// What all connections share.
#[derive(Debug)]
struct Shared {
    dispatcher: Mutex<Dispatcher>,
    observer: Observer,
    stop: AtomicBool,
    clients: AtomicUsize,
    refused: AtomicU64,
}

/// A listening control socket. It ends when it is dropped.
#[derive(Debug)]
pub struct ControlSocket {
    address: SocketAddr,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl ControlSocket {
    /// Listens.
    ///
    /// # Errors
    /// One sentence: an address that is every address, not this computer's, or taken.
    pub fn start(address: &str, dispatcher: Dispatcher) -> Result<Self, Failure> {
        let refuse = |why: &str| {
            Failure::usage(format!(
                "the control socket can not listen at {address}: {why}; name an address of this computer and a free \
                 port, such as {DEFAULT_ADDRESS}"
            ))
        };
        let parsed: SocketAddr = address.parse().map_err(|_| refuse("it is no address with a port"))?;
        if parsed.ip().is_unspecified() {
            return Err(refuse("that is every network this computer is in"));
        }
        let listener = TcpListener::bind(parsed).map_err(|e| refuse(&e.to_string()))?;
        listener.set_nonblocking(true).map_err(|e| refuse(&e.to_string()))?;
        let address = listener.local_addr().map_err(|e| refuse(&e.to_string()))?;
        let shared = Arc::new(Shared {
            observer: dispatcher.observer.clone(),
            dispatcher: Mutex::new(dispatcher),
            stop: AtomicBool::new(false),
            clients: AtomicUsize::new(0),
            refused: AtomicU64::new(0),
        });
        let listening = Arc::clone(&shared);
        let thread = spawn("control", move || listen(&listener, &listening))
            .map_err(|e| refuse(&format!("no thread: {e}")))?;
        Ok(Self { address, shared, thread: Some(thread) })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Requests that were refused.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.shared.refused.load(Ordering::Relaxed)
    }
}

impl Drop for ControlSocket {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn spawn(name: &str, run: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name(name.into()).stack_size(256 * 1024).spawn(run)
}

fn listen(listener: &TcpListener, shared: &Arc<Shared>) {
    while !shared.stop.load(Ordering::Relaxed) {
        let Ok((stream, _)) = listener.accept() else {
            std::thread::sleep(LOOK);
            continue;
        };
        if shared.clients.fetch_add(1, Ordering::Relaxed) >= MOST_CLIENTS {
            shared.clients.fetch_sub(1, Ordering::Relaxed);
            continue;
        }
        let serving = Arc::clone(shared);
        let spawned = spawn("control-client", move || {
            if let Ok(mut client) = Client::new(stream, Arc::clone(&serving)) {
                client.serve();
            }
            serving.clients.fetch_sub(1, Ordering::Relaxed);
        });
        if spawned.is_err() {
            shared.clients.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

struct Client {
    stream: TcpStream,
    shared: Arc<Shared>,
    received: Vec<u8>,
    period: Option<Duration>,
    next: Instant,
}

impl Client {
    fn new(stream: TcpStream, shared: Arc<Shared>) -> io::Result<Self> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(STUCK))?;
        Ok(Self { stream, shared, received: Vec::new(), period: None, next: Instant::now() })
    }

    /// Serves until the client or the program ends.
    fn serve(&mut self) {
        while !self.shared.stop.load(Ordering::Relaxed) {
            if self.receive().and_then(|()| self.stream_state()).is_err() {
                return;
            }
        }
    }

    fn receive(&mut self) -> io::Result<()> {
        let patience = match self.period {
            Some(_) => {
                self.next.saturating_duration_since(Instant::now()).clamp(Duration::from_millis(1), LOOK)
            }
            None => LOOK,
        };
        self.stream.set_read_timeout(Some(patience))?;
        let mut bytes = [0; 4096];
        match self.stream.read(&mut bytes) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => self.received.extend_from_slice(&bytes[..count]),
            Err(e)
                if matches!(
                    e.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            Err(e) => return Err(e),
        }
        while let Some(end) = self.received.iter().position(|&byte| byte == b'\n') {
            let line: Vec<_> = self.received.drain(..=end).collect();
            let answer = self.answer(&String::from_utf8_lossy(&line));
            self.say(&answer)?;
        }
        if self.received.len() > LONGEST_LINE {
            self.shared.refused.fetch_add(1, Ordering::Relaxed);
            self.say(&json!({"error": format!("a line is longer than {LONGEST_LINE} bytes")}))?;
            return Err(ErrorKind::InvalidData.into());
        }
        Ok(())
    }

    fn say(&mut self, value: &Value) -> io::Result<()> {
        self.stream.write_all(format!("{value}\n").as_bytes())
    }

    fn answer(&mut self, line: &str) -> Value {
        let mut request: Map<String, Value> = match serde_json::from_str(line) {
            Ok(request) => request,
            Err(e) => return self.refuse(Value::Null, &format!("not a JSON object: {e}")),
        };
        let id = request.remove("id").unwrap_or_default();
        match request.get("command").and_then(Value::as_str) {
            Some("state") => json!({"id": id, "ok": true, "state": self.state()}),
            Some("stream") => match request.get("rate").and_then(Value::as_f64) {
                Some(rate) if (0.0..=FASTEST).contains(&rate) => {
                    self.period = (rate > 0.0).then(|| Duration::from_secs_f64(1.0 / rate));
                    self.next = Instant::now();
                    json!({"id": id, "ok": true})
                }
                _ => self.refuse(id, &format!("stream: expected a rate from 0 to {FASTEST} Hz")),
            },
            _ => {
                let line = Value::Object(request).to_string();
                let dispatched =
                    self.shared.dispatcher.lock().unwrap_or_else(PoisonError::into_inner).dispatch(&line);
                match dispatched {
                    Ok(()) => json!({"id": id, "ok": true}),
                    Err(reason) => self.refuse(id, &reason),
                }
            }
        }
    }

    fn refuse(&self, id: Value, reason: &str) -> Value {
        self.shared.refused.fetch_add(1, Ordering::Relaxed);
        json!({"id": id, "error": reason})
    }

    fn stream_state(&mut self) -> io::Result<()> {
        let Some(period) = self.period else { return Ok(()) };
        let now = Instant::now();
        if now < self.next {
            return Ok(());
        }
        // Whole periods that were missed are left out.
        self.next += period * (((now - self.next).as_nanos() / period.as_nanos()) as u32 + 1);
        let state = self.state();
        self.say(&json!({"state": state}))
    }

    fn state(&self) -> Value {
        state(&self.shared.observer.latest(), self.shared.refused.load(Ordering::Relaxed))
    }
}

fn vector(v: &Vector3) -> Value {
    json!([v.x, v.y, v.z])
}

fn rotation(r: &Matrix3) -> Value {
    json!([0, 1, 2].map(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)]]))
}

fn target(s: &Setpoint) -> Value {
    json!({
        "position": vector(&s.position_w), "rotation": rotation(&s.rotation_we),
        "velocity": vector(&s.velocity_w), "angular_velocity": vector(&s.angular_velocity_w),
        "force": vector(&s.wrench_w.force), "torque": vector(&s.wrench_w.torque),
    })
}

/// The newest state, as clients get it; numbers that are not finite are null.
fn state(latest: &Latest, refused: u64) -> Value {
    let Some(tick) = &latest.tick else { return Value::Null };
    let r = &tick.record;
    let faults: Vec<_> = r.faults.rows().map(|row| row.name).collect();
    let rotors = |speeds: &[f64]| json!(&speeds[..latest.rotor_count.min(speeds.len())]);
    json!({
        "time": r.input.time,
        "tick": r.tick,
        "phase": r.phase.name(),
        "faults": faults,
        "position": vector(&r.state.position_w),
        "velocity": vector(&r.state.velocity_w),
        "rotation": rotation(&r.state.rotation_wr),
        "angular_velocity": vector(&r.state.angular_velocity_r),
        "setpoint": target(&r.setpoint),
        "reference": target(&r.reference),
        "force": vector(&r.wrench_tool_w.force),
        "torque": vector(&r.wrench_tool_w.torque),
        "position_error": vector(&r.position_error_w),
        "model": {
            "mass": r.model.mass, "centre_of_mass": vector(&r.model.centre_of_mass_r), "hovers": r.model.hovers,
            "false_force": r.model.false_force, "false_torque": r.model.false_torque,
        },
        "compliant": r.compliant,
        "saturated": r.saturated,
        "rotor_command": rotors(r.rotor_command.as_slice()),
        "rotor_speeds": rotors(r.rotor_speeds.as_slice()),
        "battery": r.battery,
        "late": latest.statistics.skipped,
        "refused": refused,
    })
}
