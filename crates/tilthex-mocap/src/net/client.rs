//! The client's thread, and its end of the ring that passes poses to the loop.

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

/// Number of poses that can wait for the loop.
const CAPACITY: usize = 256;

/// A running client of a capture system. It ends when it is dropped.
#[derive(Debug)]
pub struct Client {
    counters: Arc<Counters>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Client {
    /// Connects, finds the body and waits for its first frame, for about 4 s at most. After that, a thread of the client
    /// puts the poses into the ring.
    ///
    /// # Errors
    /// One sentence: the host is unknown, no server or another server answers, the body is unknown (with the names of the
    /// bodies that the server has), or no frames arrive.
    pub fn start(
        uri: &MocapUri,
        params: ClientParams,
    ) -> Result<(Self, rtrb::Consumer<PoseSample>), SourceError> {
        Self::start_with(uri, params, || ())
    }

    /// [`Self::start`], with what the client's thread does first: it may ask for a priority, for example.
    ///
    /// # Errors
    /// Those of [`Self::start`].
    pub fn start_with(
        uri: &MocapUri,
        params: ClientParams,
        first: fn(),
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
            .spawn(move || {
                first();
                source.run(&stopped);
            })
            .map_err(|error| SourceError::new(format!("no thread for the motion capture: {error}")))?;
        Ok((Self { counters, stop, thread: Some(thread) }, consumer))
    }

    /// What it has received since the start.
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
    // Capture systems use IPv4.
    let ipv4 = addresses.iter().find(|address| address.is_ipv4());
    ipv4.or(addresses.first()).copied().ok_or_else(|| unknown("the list is empty".into()))
}

/// Writes names that came from the network as a part of a sentence.
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
    /// Puts a pose into the ring. It was taken at a time (s) and has the axes of the capture system. A pose that is not
    /// valid is counted and dropped. Returns false only for a pose that is marked as tracked and is not valid.
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
            // For a body that they do not track, systems send zeros or numbers that are not finite.
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
