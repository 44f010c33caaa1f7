//! Passes poses from the simulation to the thread of a server, which sends them. Latency, jitter and losses of the line are
//! configured.

use std::{
    cmp::Reverse,
    collections::BinaryHeap,
    io,
    os::fd::{AsFd, BorrowedFd},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
};

use rustix::{
    event::{EventfdFlags, PollFd, PollFlags, eventfd, poll},
    fd::OwnedFd,
    time::Timespec,
};
use tilthex_core::{Matrix3, Vector3, random::Random};

use super::clock::{Clock, Monotonic};
use tilthex_core::types::Nanos;

/// Number of poses that can wait for the thread, and for their time.
const CAPACITY: usize = 512;
const SECOND: Nanos = 1_000_000_000;

/// The line between a simulated capture and its clients.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LineParams {
    /// Time from the exposure to the sending, s.
    pub latency: f64,
    /// Largest jitter, s. A random time from 0 to this is added to [`Self::latency`], uniformly distributed.
    pub jitter: f64,
    /// Part of the poses that are not sent.
    pub loss: f64,
    /// Seed of the random jitter and losses.
    pub seed: u64,
}

/// A pose to be sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Publication {
    /// Time at which it was taken, monotonic clock.
    pub time: Nanos,
    /// Position of the body, m, world.
    pub position_w: Vector3,
    /// Maps the body's coordinates to the world's.
    pub rotation_wr: Matrix3,
    /// Whether the body is tracked.
    pub tracking_valid: bool,
}

/// The simulation's end of a server, whose thread it runs. The thread ends when this is dropped.
#[derive(Debug)]
pub(super) struct Publisher {
    ring: rtrb::Producer<Publication>,
    bell: Arc<OwnedFd>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Publisher {
    /// Starts the server's thread.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub(super) fn start(
        name: &str,
        line: LineParams,
        run: impl FnOnce(Delivery) + Send + 'static,
    ) -> io::Result<Self> {
        let bell = Arc::new(eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?);
        let stop = Arc::new(AtomicBool::new(false));
        let (producer, consumer) = rtrb::RingBuffer::new(CAPACITY);
        let delivery = Delivery {
            ring: consumer,
            bell: Arc::clone(&bell),
            stop: Arc::clone(&stop),
            line,
            random: Random::new(line.seed),
            count: 0,
            waiting: BinaryHeap::with_capacity(CAPACITY),
        };
        let thread = std::thread::Builder::new()
            .name(name.into())
            .stack_size(256 * 1024)
            .spawn(move || run(delivery))?;
        Ok(Self { ring: producer, bell, stop, thread: Some(thread) })
    }

    /// Passes a pose to the thread: wait-free, with one system call. Returns whether there was room.
    pub(super) fn publish(&mut self, publication: Publication) -> bool {
        let taken = self.ring.push(publication).is_ok();
        self.ring_bell();
        taken
    }

    /// Wakes the sending thread.
    fn ring_bell(&self) {
        // It fails only if the thread has already been woken.
        let _ = rustix::io::write(&*self.bell, &1_u64.to_ne_bytes());
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.ring_bell();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A pose with the time at which it is due, and its number. Ordered by time, then by number.
#[derive(Clone, Copy, Debug)]
struct Due(Nanos, u64, Publication);

impl PartialEq for Due {
    fn eq(&self, other: &Self) -> bool {
        (self.0, self.1) == (other.0, other.1)
    }
}

impl Eq for Due {}

impl PartialOrd for Due {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Due {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.0, self.1).cmp(&(other.0, other.1))
    }
}

/// The thread's end, which sends.
#[derive(Debug)]
pub(super) struct Delivery {
    ring: rtrb::Consumer<Publication>,
    bell: Arc<OwnedFd>,
    stop: Arc<AtomicBool>,
    line: LineParams,
    random: Random,
    count: u64,
    waiting: BinaryHeap<Reverse<Due>>,
}

impl Delivery {
    /// Whether the publisher still exists.
    pub(super) fn is_open(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    /// Waits until a pose was published, a pose is due, or one of `sources` is readable. Waits for 1 s at most.
    pub(super) fn wait<'a>(&'a self, sources: impl Iterator<Item = BorrowedFd<'a>>) {
        let left = self.due().map_or(SECOND, |due| due.saturating_sub(Monotonic.now()).min(SECOND));
        let timeout = Timespec { tv_sec: (left / SECOND) as _, tv_nsec: (left % SECOND) as _ };
        let mut sources: Vec<_> = sources
            .chain([self.bell.as_fd()])
            .map(|source| PollFd::from_borrowed_fd(source, PollFlags::IN))
            .collect();
        // The reason does not matter: after the return the thread examines everything.
        let _ = poll(&mut sources, Some(&timeout));
    }

    /// Time at which the next pose is due.
    fn due(&self) -> Option<Nanos> {
        self.waiting.peek().map(|Reverse(Due(due, ..))| *due)
    }

    /// The next pose that is due at `now`, with its number.
    pub(super) fn next(&mut self, now: Nanos) -> Option<(u64, Publication)> {
        let mut bell = [0; 8];
        let _ = rustix::io::read(&*self.bell, &mut bell);
        while let Ok(publication) = self.ring.pop() {
            let number = self.count;
            self.count += 1;
            let delay = self.line.latency + self.line.jitter * self.random.uniform();
            if self.random.uniform() >= self.line.loss && self.waiting.len() < CAPACITY {
                let due = publication.time + (delay * 1e9) as Nanos;
                self.waiting.push(Reverse(Due(due, number, publication)));
            }
        }
        let due = self.due().is_some_and(|due| due <= now);
        let Reverse(Due(_, number, publication)) = due.then(|| self.waiting.pop()).flatten()?;
        Some((number, publication))
    }
}
