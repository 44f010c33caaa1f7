//! A thread that does nothing but sleep as the loop does: the periods it
//! loses are the machine's doing, not the loop's.

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

/// What the sleeping thread met.
#[derive(Clone, Copy, Debug, Default)]
pub struct Slept {
    /// Begin after the deadline.
    pub wake: Quantiles,
    /// Periods it had to skip.
    pub skipped: u64,
}

/// A running reference.
#[derive(Debug)]
pub struct Reference {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Slept>,
}

impl Reference {
    /// Starts sleeping, with the rights of the loop and half a period beside it.
    ///
    /// # Errors
    /// Where no thread can be started.
    pub fn start(period: Duration, demand: Demand) -> std::io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("reference".into())
            .stack_size(realtime::LOOP_STACK)
            .spawn(move || {
                // The loop has said what is refused.
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

    /// Ends it; what it met.
    #[must_use]
    pub fn stop(self) -> Slept {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or_default()
    }
}
