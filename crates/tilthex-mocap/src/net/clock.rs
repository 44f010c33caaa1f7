//! The monotonic clock, which gives the times of poses.

use rustix::{
    io::Errno,
    thread::{ClockId, clock_nanosleep_absolute},
    time::{Timespec, clock_gettime},
};
use tilthex_core::types::Nanos;

/// A clock on which a thread can wait.
pub trait Clock {
    /// The time now.
    fn now(&self) -> Nanos;
    /// Waits until `deadline`. Returns at once if it has passed.
    fn sleep_until(&self, deadline: Nanos);
}

/// `CLOCK_MONOTONIC`. Safe in the loop: two system calls, no allocation.
#[derive(Clone, Copy, Debug, Default)]
pub struct Monotonic;

impl Clock for Monotonic {
    fn now(&self) -> Nanos {
        let t = clock_gettime(rustix::time::ClockId::Monotonic);
        t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
    }

    fn sleep_until(&self, deadline: Nanos) {
        let request =
            Timespec { tv_sec: (deadline / 1_000_000_000) as i64, tv_nsec: (deadline % 1_000_000_000) as _ };
        // A signal ends the sleep early. The deadline is absolute, so that the same request sleeps for the rest.
        while clock_nanosleep_absolute(ClockId::Monotonic, &request) == Err(Errno::INTR) {}
    }
}
