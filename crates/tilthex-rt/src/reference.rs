//! A thread that only sleeps, in the same way as the loop. If it loses periods, the computer is the cause, not the loop.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

use crate::{
    histogram::{Histogram, Quantiles},
    realtime::{self, Demand},
    sleeper::{Clock, Monotonic, Nanos, Sleeper},
};

/// What the sleeping thread measured.
#[derive(Clone, Copy, Debug, Default)]
pub struct Slept {
    /// Time from the deadline to the wake-up.
    pub wake: Quantiles,
    /// Number of periods that it skipped.
    pub skipped: u64,
}

/// A running reference.
#[derive(Debug)]
pub struct Reference {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Slept>,
}

impl Reference {
    /// Starts the thread. It has the rights of the loop, and its deadlines lie half a period after the loop's.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn start(period: Duration, demand: Demand) -> std::io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("reference".into())
            .stack_size(realtime::LOOP_STACK)
            .spawn(move || {
                // The loop has already reported the rights that were refused.
                let _rights = realtime::acquire(demand);
                let mut sleeper = Sleeper::new(period, Monotonic.now() + period.as_nanos() as Nanos * 3 / 2);
                let (mut wakes, mut skipped) = (Histogram::default(), 0);
                while !stopped.load(Ordering::Relaxed) {
                    let wake = sleeper.wait(&Monotonic);
                    wakes.record(wake.latency());
                    skipped += wake.skipped;
                }
                Slept { wake: wakes.quantiles(), skipped }
            })?;
        Ok(Self { stop, thread })
    }

    /// Ends the thread and returns what it measured.
    #[must_use]
    pub fn stop(self) -> Slept {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or_default()
    }
}
