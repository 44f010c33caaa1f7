//! The simulated vehicle in real time, behind a pseudo-terminal.

use std::{
    io,
    net::SocketAddr,
    os::unix::net::UnixListener,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

use rustix::{
    event::{PollFd, PollFlags, poll},
    time::Timespec,
};

use tilthex_link::board::Board;
use tilthex_sim::{Body, Firmware, Own, STEP, Simulation};

use crate::{
    Failure,
    histogram::{Histogram, Quantiles},
    port::Port,
    sleeper::{Clock, Monotonic, Nanos},
};

/// If the simulation lags behind the clock by more than this, ns, it skips this time instead of simulating it.
const HOPELESS: Nanos = 1_000_000_000;

/// Stack of the simulation's thread, bytes: a vehicle that flies itself makes a new flight on it.
const STACK: usize = 4 << 20;

/// What the simulated vehicle measured.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Time from just before the write of an inertial sample to the end of the read of its command, ns: the latency of
    /// controller and line.
    pub imu_to_command: Quantiles,
    /// Time from the moment at which a cycle was due to its end, ns: the lag of the simulation behind the clock.
    pub lag: Quantiles,
    /// Why the simulation ended by itself, or ended with an error.
    pub failure: Option<Failure>,
}

/// Is called after every cycle with the cycle's monotonic time and the simulation. Motion capture and the recorder of the
/// truth use it.
pub type Observer<B = Own, F = Firmware> = Box<dyn FnMut(Nanos, &mut Simulation<B, F>) + Send>;

/// A running simulation. It ends when it is dropped.
#[derive(Debug)]
pub struct Server {
    path: PathBuf,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Report>>,
}

impl Server {
    /// Starts a simulation behind its own pseudo-terminal. If a `socket` is given, a program that connects there has the line
    /// until it leaves. If an `agent` is given, the line is datagrams to and from this address. `each_step` is called after
    /// every cycle with the time of the cycle.
    ///
    /// # Errors
    /// Errors of the kernel: no more pseudo-terminals or threads.
    pub fn start<B: Body + Send + 'static, F: Board + Send + 'static>(
        simulation: Simulation<B, F>,
        each_step: Observer<B, F>,
        socket: Option<UnixListener>,
        agent: Option<SocketAddr>,
    ) -> io::Result<Self> {
        let (port, path) = Port::pseudo_terminal()?;
        let guest = agent.map(Port::to_agent).transpose()?;
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        if let Some(socket) = &socket {
            socket.set_nonblocking(true)?;
        }
        let mut worker = Worker {
            socket,
            guest,
            // The other end is kept open, so that reads do not fail while no controller is connected.
            _far_side: rustix::fs::open(
                &path,
                rustix::fs::OFlags::RDWR | rustix::fs::OFlags::NOCTTY | rustix::fs::OFlags::CLOEXEC,
                rustix::fs::Mode::empty(),
            )?,
            port,
            simulation,
            each_step,
            out: Vec::with_capacity(4096),
            samples: 0,
            imu_written: None,
            latency: Histogram::default(),
            lag: Histogram::default(),
        };
        let thread = std::thread::Builder::new()
            .name("sim".into())
            .stack_size(STACK)
            .spawn(move || worker.run(&stopped))?;
        Ok(Self { path, stop, thread: Some(thread) })
    }

    /// The pseudo-terminal that a controller opens.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the simulation still runs. It ends by itself only if its world fails.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Ends the simulation and returns what it measured.
    #[must_use]
    pub fn stop(mut self) -> Report {
        self.end().unwrap_or_default()
    }

    fn end(&mut self) -> Option<Report> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take()?.join().ok()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end();
    }
}

struct Worker<B, F> {
    _far_side: rustix::fd::OwnedFd,
    port: Port,
    socket: Option<UnixListener>,
    /// The program that has connected to the socket, or the agent.
    guest: Option<Port>,
    simulation: Simulation<B, F>,
    each_step: Observer<B, F>,
    out: Vec<u8>,
    /// Number of inertial samples that were written.
    samples: u64,
    /// Time at which the newest of them was written; `None` after its command has arrived.
    imu_written: Option<Nanos>,
    latency: Histogram,
    lag: Histogram,
}

impl<B: Body, F: Board> Worker<B, F> {
    fn run(&mut self, stop: &AtomicBool) -> Report {
        // This thread is the board's clock. Real-time rights make it more punctual, but it also runs without them.
        crate::realtime::acquire_helper();
        let step = Duration::from_micros(STEP).as_nanos() as Nanos;
        let mut due = Monotonic.now() + step;
        while !stop.load(Ordering::Relaxed) && !self.simulation.failed() {
            self.receive_until(due);
            let now = Monotonic.now();
            if now.saturating_sub(due) > HOPELESS {
                due = now;
            }
            while due <= now && !self.simulation.failed() {
                self.simulation.advance_at(due, &mut self.out);
                self.send();
                (self.each_step)(due, &mut self.simulation);
                self.lag.record(Monotonic.now().saturating_sub(due));
                due += step;
            }
        }
        Report {
            imu_to_command: self.latency.quantiles(),
            lag: self.lag.quantiles(),
            failure: self.simulation.finish().err().map(Failure::from),
        }
    }

    /// Handles bytes of the controller at the moment at which they arrive, until `due`.
    fn receive_until(&mut self, due: Nanos) {
        self.admit();
        loop {
            let left = due.saturating_sub(Monotonic.now());
            if left == 0 {
                return;
            }
            let timeout = Timespec { tv_sec: 0, tv_nsec: left as _ };
            let line = self.guest.as_mut().unwrap_or(&mut self.port);
            let ready = poll(&mut [PollFd::new(&*line, PollFlags::IN)], Some(&timeout));
            if ready != Ok(1) {
                continue;
            }
            let mut bytes = [0; 1024];
            let count = match line.read(&mut bytes) {
                // The socket is readable but holds no bytes: the program has closed it.
                None | Some(0) if self.socket.is_some() && self.guest.is_some() => {
                    self.guest = None;
                    continue;
                }
                Some(count) => count,
                None => return,
            };
            let before = self.simulation.firmware().noted().commands_received;
            self.simulation.receive(&bytes[..count], &mut self.out);
            if self.simulation.firmware().noted().commands_received > before
                && let Some(written) = self.imu_written.take()
            {
                self.latency.record(Monotonic.now().saturating_sub(written));
            }
            self.send();
        }
    }

    /// Accepts a new connection to the socket, if none is open.
    fn admit(&mut self) {
        if let (Some(socket), None) = (&self.socket, &self.guest)
            && let Ok((stream, _)) = socket.accept()
        {
            self.guest = Port::of_stream(stream, self.port.path()).ok();
        }
    }

    fn send(&mut self) {
        let samples = self.simulation.firmware().noted().samples_sent;
        if std::mem::replace(&mut self.samples, samples) < samples {
            self.imu_written = Some(Monotonic.now());
        }
        if !self.out.is_empty() {
            // If the line is full, the bytes are lost, as on a serial line.
            self.guest.as_mut().unwrap_or(&mut self.port).write(&self.out);
            self.out.clear();
        }
    }
}
