//! The client's thread, and its end of the ring.

use std::{
    net::{SocketAddr, ToSocketAddrs},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
};

use crate::ClientParams;
use tilthex_core::PoseSample;

use super::SourceError;
use super::{
    counters::{Counters, Status, add},
    uri::MocapUri,
};

/// Poses that may wait for the loop.
const CAPACITY: usize = 256;

/// A running client of a capture system. It ends when it is dropped.
#[derive(Debug)]
pub struct Client {
    counters: Arc<Counters>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Client {
    /// Connects, finds the body, waits for its first frame, and from then on hands
    /// poses to the ring in a thread of its own. Takes no longer than about 4 s.
    ///
    /// # Errors
    /// One sentence: no such host, nobody there, somebody else there, no such body (with those
    /// that are there), no frames.
    pub fn start(
        uri: &MocapUri,
        params: ClientParams,
    ) -> Result<(Self, rtrb::Consumer<PoseSample>), SourceError> {
        let server = resolve(uri)?;
        let (producer, consumer) = rtrb::RingBuffer::new(CAPACITY);
        let counters = Arc::new(Counters::default());
        let stop = Arc::new(AtomicBool::new(false));
        let sink = Sink { ring: producer, counters: Arc::clone(&counters), params };
        let stopped = Arc::clone(&stop);
        let source = uri.protocol.connect(uri, server, sink)?;
        let thread = std::thread::Builder::new()
            .name("mocap".into())
            .stack_size(256 * 1024)
            .spawn(move || source.run(&stopped))
            .map_err(|error| SourceError::new(format!("no thread for the motion capture: {error}")))?;
        Ok((Self { counters, stop, thread: Some(thread) }, consumer))
    }

    /// What it saw so far.
    #[must_use]
    pub fn status(&self) -> Status {
        self.counters.status()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn resolve(uri: &MocapUri) -> Result<SocketAddr, SourceError> {
    let unknown = |why: String| {
        SourceError::new(format!(
            "the motion capture's host `{}` has no address: {why}; check its name",
            uri.host
        ))
    };
    let addresses: Vec<_> = (uri.host.as_str(), uri.port)
        .to_socket_addrs()
        .map_err(|error| unknown(error.to_string()))?
        .collect();
    // Capture systems speak IPv4.
    let ipv4 = addresses.iter().find(|address| address.is_ipv4());
    ipv4.or(addresses.first()).copied().ok_or_else(|| unknown("the list is empty".into()))
}

/// Names from the network in a sentence.
pub(super) fn list(names: &[Vec<u8>]) -> String {
    if names.is_empty() {
        return "nothing".into();
    }
    let shown: Vec<_> =
        names.iter().map(|name| format!("`{}`", String::from_utf8_lossy(name).escape_debug())).collect();
    shown.join(", ")
}

/// The thread's end of the ring.
#[derive(Debug)]
pub(super) struct Sink {
    ring: rtrb::Producer<PoseSample>,
    pub(super) counters: Arc<Counters>,
    pub(super) params: ClientParams,
}

impl Sink {
    /// Hands a pose on, taken at a time (s) and in the axes of the capture
    /// system; one that is none is counted and dropped. False only for one
    /// that claims to be valid and is none.
    pub(super) fn pose(
        &mut self,
        (time, arrival): (f64, f64),
        position: [f64; 3],
        quaternion_xyzw: [f64; 4],
        tracking_valid: bool,
    ) -> bool {
        if !tracking_valid {
            add(&self.counters.untracked, 1);
        }
        let Some((position_w, rotation_wr)) = self.params.up_axis.to_world(position, quaternion_xyzw) else {
            // Systems send zeros, or worse, for what they do not see.
            add(&self.counters.refused, tracking_valid.into());
            return !tracking_valid;
        };
        let sample = PoseSample { time: time.min(arrival), arrival, position_w, rotation_wr, tracking_valid };
        self.counters.age(arrival - sample.time);
        let counter = match self.ring.push(sample) {
            Ok(()) => &self.counters.poses,
            Err(_) => &self.counters.dropped,
        };
        add(counter, 1);
        true
    }
}
