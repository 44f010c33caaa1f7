//! The recorder: a wait-free ring takes the records of the loop, and a thread encodes them and writes the log.

use std::{
    fs::File,
    path::PathBuf,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    thread::JoinHandle,
    time::Duration,
};

use mcap::McapError;
use rtrb::{Consumer, Producer, RingBuffer};
use tilthex_sim::{
    Truth,
    feed::{Fate, Feed, Tick},
};

use crate::{
    Failure,
    log::{Attachments, BlackBox, Epoch, FlightLog, Index, LogFile, Whereabouts, file::refused},
    summary::Statistics,
};

/// Number of truths that the ring can hold.
const TRUTH_RING: usize = 256;
/// Time between two looks of the recorder at its rings.
const LOOK: Duration = Duration::from_millis(10);
/// Time between two flushes of the file, s. A program that is killed loses at most this.
const FLUSH: f64 = 0.5;

/// The simulation's end of its ring.
pub type TruthFeed = Producer<(f64, Truth)>;

/// A message to the recorder from a thread that is not the loop.
#[derive(Clone, Debug)]
enum Note {
    /// An order, its monotonic time (s), and whether it was urgent: it reached the loop by a flag, not through the ring.
    Command(f64, String, bool),
}

#[derive(Debug, Default)]
struct Shared {
    fate: Arc<Fate>,
    stop: AtomicBool,
    latest: Mutex<Latest>,
}

/// The newest data that the recorder has read.
#[derive(Clone, Debug, Default)]
pub struct Latest {
    /// The newest tick.
    pub tick: Option<Tick>,
    /// The newest truth of the simulated vehicle.
    pub truth: Option<Truth>,
    /// Statistics of the flight.
    pub statistics: Statistics,
    /// Ticks that did not fit into the ring.
    pub dropped: u64,
    /// Number of rotors of the vehicle.
    pub rotor_count: usize,
    /// Why the log can no longer be written.
    pub error: Option<String>,
}

/// Access to the recorder for threads other than the loop.
#[derive(Clone, Debug)]
pub struct Observer {
    shared: Arc<Shared>,
    notes: mpsc::Sender<Note>,
}

impl Observer {
    /// A copy of the newest data.
    #[must_use]
    pub fn latest(&self) -> Latest {
        let mut latest = lock(&self.shared.latest).clone();
        latest.dropped = self.shared.fate.dropped.load(Ordering::Relaxed);
        latest
    }

    /// Calls `see` with the newest data, without a copy.
    pub fn look<T>(&self, see: impl FnOnce(&Latest) -> T) -> T {
        see(&lock(&self.shared.latest))
    }

    /// Logs an order that was passed to the loop at a monotonic time (s): through the ring or, if urgent, by a flag.
    pub fn command(&self, time: f64, json: String, urgent: bool) {
        // If the recorder has ended, no log is left to write to.
        let _ = self.notes.send(Note::Command(time, json, urgent));
    }
}

fn lock(latest: &Mutex<Latest>) -> MutexGuard<'_, Latest> {
    latest.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Settings of the recorder.
#[derive(Debug)]
pub struct RecorderParams {
    /// The log, if one is wanted.
    pub log: Option<LogFile>,
    /// File for the last seconds after a fault. If it exists, a number is added to the name.
    pub black_box: PathBuf,
    /// Attachments of the log.
    pub attachments: Attachments,
    /// Number of rotors of the vehicle.
    pub rotor_count: usize,
    /// What its thread does first: it may ask for a priority.
    pub first: fn(),
}

/// The running recorder.
#[derive(Debug)]
pub struct Recorder {
    shared: Arc<Shared>,
    notes: mpsc::Sender<Note>,
    thread: JoinHandle<Left>,
}

/// What the thread returns at its end.
#[derive(Debug, Default)]
struct Left {
    black_box: Option<PathBuf>,
    moved: bool,
}

/// What the recorder returns at its end.
#[derive(Clone, Debug, Default)]
pub struct Recorded {
    /// The last data of [`Observer::latest`].
    pub latest: Latest,
    /// The file with the last seconds, if a fault occurred.
    pub black_box: Option<PathBuf>,
    /// Whether the log's file was moved or replaced during the flight.
    pub moved: bool,
}

impl Recorder {
    /// Begins the log and starts the thread.
    ///
    /// # Errors
    /// One sentence, if the log cannot be written.
    pub fn start(params: RecorderParams) -> Result<(Self, Feed, TruthFeed), Failure> {
        let epoch = Epoch::now();
        let log = match &params.log {
            None => None,
            Some(log) => {
                let refuse = |e: &dyn std::fmt::Display| refused(log.path(), e);
                let file = log.handle().map_err(|e| refuse(&e))?;
                Some(
                    FlightLog::new(file, Index::Written, epoch, params.rotor_count, &params.attachments)
                        .map_err(|e| refuse(&root(&e)))?,
                )
            }
        };
        let (truth_feed, truths) = RingBuffer::new(TRUTH_RING);
        let (sender, notes) = mpsc::channel();
        let shared = Arc::new(Shared::default());
        lock(&shared.latest).rotor_count = params.rotor_count;
        let (feed, ticks) = Feed::of(Arc::clone(&shared.fate));
        let worker = Worker {
            black_box: BlackBox::new(epoch, params.rotor_count, params.attachments.clone()),
            params,
            log,
            ticks,
            truths,
            notes,
            shared: Arc::clone(&shared),
            flushed: 0.0,
        };
        let first = worker.params.first;
        let thread = std::thread::Builder::new()
            .name("recorder".into())
            .stack_size(512 * 1024)
            .spawn(move || {
                first();
                worker.run()
            })
            .map_err(|e| Failure::machine(format!("the recorder's thread cannot be started: {e}")))?;
        Ok((Self { shared, notes: sender, thread }, feed, truth_feed))
    }

    /// Access for threads other than the loop.
    #[must_use]
    pub fn observer(&self) -> Observer {
        Observer { shared: Arc::clone(&self.shared), notes: self.notes.clone() }
    }

    /// Writes what is still in the rings, then ends the log and the thread.
    #[must_use]
    pub fn finish(self) -> Recorded {
        let observer = self.observer();
        self.shared.stop.store(true, Ordering::Release);
        let left = self.thread.join().unwrap_or_default();
        Recorded { latest: observer.latest(), black_box: left.black_box, moved: left.moved }
    }
}

struct Worker {
    params: RecorderParams,
    log: Option<FlightLog<File>>,
    black_box: BlackBox,
    ticks: Consumer<Tick>,
    truths: Consumer<(f64, Truth)>,
    notes: mpsc::Receiver<Note>,
    shared: Arc<Shared>,
    flushed: f64,
}

impl Worker {
    fn run(mut self) -> Left {
        loop {
            // Read before the rings, so that everything that was pushed before `stop` was set is read below.
            let last = self.shared.stop.load(Ordering::Acquire);
            self.drain();
            if last {
                break;
            }
            std::thread::sleep(LOOK);
        }
        self.look_for_file();
        if let Some(log) = self.log.take()
            && let Err(e) = log.finish()
        {
            self.lose(&e);
        }
        let moved = self.params.log.as_ref().is_some_and(|log| log.whereabouts() == Whereabouts::Moved);
        let mut left = Left { black_box: None, moved };
        if lock(&self.shared.latest).statistics.ended_by_fault() {
            match self.report() {
                Ok(path) => left.black_box = Some(path),
                Err(e) => self.lose(&e),
            }
        }
        left
    }

    fn report(&mut self) -> Result<PathBuf, McapError> {
        let (file, path) = LogFile::create_beside(&self.params.black_box)?;
        self.black_box.dump(file)?;
        Ok(path)
    }

    /// Reports a log whose file was deleted: it would be lost at the end of the program.
    fn look_for_file(&mut self) {
        if let (Some(file), true) = (&self.params.log, self.log.is_some())
            && file.whereabouts() == Whereabouts::Deleted
        {
            self.lose(&std::io::Error::other("its file was deleted").into());
        }
    }

    fn drain(&mut self) {
        while let Ok(note) = self.notes.try_recv() {
            let Note::Command(time, json, urgent) = note;
            self.write(|log| log.command(time, &json, urgent));
        }
        while let Ok((time, truth)) = self.truths.pop() {
            self.write(|log| log.truth(time, &truth));
            // A write to memory does not fail.
            let _ = self.black_box.truth(time, &truth);
            let mut latest = lock(&self.shared.latest);
            latest.statistics.truth(&truth);
            latest.truth = Some(truth);
        }
        while let Ok(tick) = self.ticks.pop() {
            self.write(|log| log.tick(&tick));
            let _ = self.black_box.tick(&tick);
            let time = tick.record.input.time;
            if time - self.flushed >= FLUSH {
                self.flushed = time;
                self.write(FlightLog::flush);
                self.look_for_file();
            }
            let mut latest = lock(&self.shared.latest);
            latest.statistics.tick(&tick);
            latest.tick = Some(tick);
        }
    }

    fn write(&mut self, put: impl FnOnce(&mut FlightLog<File>) -> Result<(), McapError>) {
        if let Some(log) = &mut self.log
            && let Err(e) = put(log)
        {
            self.lose(&e);
        }
    }

    /// Ends the log after an error. The flight continues without it. The loop is told now, the user at the end.
    fn lose(&mut self, e: &McapError) {
        self.log = None;
        self.shared.fate.lost.store(true, Ordering::Relaxed);
        lock(&self.shared.latest).error.get_or_insert_with(|| root(e).to_string());
    }
}

/// The first cause of an error, without the calls that passed it on.
fn root<'a>(error: &'a (dyn std::error::Error + 'static)) -> &'a (dyn std::error::Error + 'static) {
    std::iter::successors(Some(error), |e| e.source()).last().unwrap_or(error)
}
