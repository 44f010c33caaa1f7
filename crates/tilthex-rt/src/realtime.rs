//! Real-time rights, which make the loop punctual. They are requested once, before the loop starts.

use std::{
    fs::{self, File, OpenOptions},
    hint::black_box,
    io::Write,
    num::NonZeroU64,
};

use rustix::{
    mm::{MlockAllFlags, mlockall},
    thread::{CpuSet, sched_getaffinity, sched_setaffinity, set_current_timer_slack},
};

use crate::{Failure, sys};

/// What to do if the computer refuses a right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Demand {
    /// Do not fly without every right.
    Require,
    /// Warn and fly.
    Prefer,
    /// Do not ask for rights.
    Off,
}

/// Part of the stack that is touched before the loop starts, bytes.
pub const TOUCHED_STACK: usize = 1024 * 1024;

/// Stack of the loop's thread, bytes: twice the part that is touched.
pub const LOOP_STACK: usize = 2 * TOUCHED_STACK;

/// The rights that were granted. They must be kept while the loop runs.
#[derive(Debug, Default)]
pub struct Rights {
    /// One sentence for each right that was refused, which says how to grant it.
    pub warnings: Vec<String>,
    /// While this file is open, the processor does not sleep deeply. `None` if the computer does not offer it.
    pub held: Option<File>,
}

/// Asks for real-time rights for the calling thread: `SCHED_FIFO` in the middle of its range, locked memory, one processor,
/// and no deep sleep. Also touches its stack.
///
/// # Errors
/// With [`Demand::Require`], the first right that was refused.
pub fn acquire(demand: Demand) -> Result<Rights, Failure> {
    let mut rights = Rights::default();
    if demand == Demand::Off {
        return Ok(rights);
    }
    let mut refused = |right: &str, why: &dyn std::fmt::Display| {
        rights.warnings.push(format!(
            "{right} was refused ({why}): grant it with `sudo setcap cap_sys_nice,cap_ipc_lock=ep {}`, or fly with \
             --realtime off",
            std::env::current_exe().unwrap_or_else(|_| "tilthex-rt".into()).display()
        ));
    };
    if let Err(e) = sys::set_fifo(0) {
        refused("real-time scheduling (SCHED_FIFO)", &e);
    }
    if let Err(e) = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE) {
        refused("locked memory (mlockall)", &e);
    }
    if let Err(e) = pin() {
        refused("a processor of its own (affinity)", &e);
    }
    // Without this, the kernel may end a sleep up to 50 us late on purpose. SCHED_FIFO does not need it.
    let _ = set_current_timer_slack(NonZeroU64::new(1));
    touch_stack();
    rights.held = stay_awake();
    match (demand, rights.warnings.first()) {
        (Demand::Require, Some(first)) => Err(Failure::machine(first.clone())),
        _ => Ok(rights),
    }
}

impl Demand {
    /// What a thread that serves the loop does first: asks for its rights by `acquire`, or nothing with [`Demand::Off`].
    #[must_use]
    pub fn first(self, acquire: fn()) -> fn() {
        match self {
            Self::Off => || (),
            Self::Require | Self::Prefer => acquire,
        }
    }
}

/// Asks for a part of these rights, for threads that bring the loop poses or a kill, or that simulate hardware: no timer
/// slack, and `SCHED_FIFO` with a lower priority than the loop. Beside busy programs, a thread of ordinary priority can wait
/// for 0.1 s for a processor. It is not an error if they are refused.
pub fn acquire_helper() {
    let _ = set_current_timer_slack(NonZeroU64::new(1));
    let _ = sys::set_fifo(-1);
}

/// Asks for `SCHED_FIFO` below the helpers, for the thread that writes the log: beside busy programs, a thread of ordinary
/// priority can be more than a second late, and ticks are missing in the log. It is not an error if it is refused.
pub fn acquire_recorder() {
    let _ = sys::set_fifo(-2);
}

/// Asks for `SCHED_FIFO` below the recorder, for the threads that take orders: beside busy programs, a thread of ordinary
/// priority can carry out a kill a second late. It is not an error if it is refused.
pub fn acquire_control() {
    let _ = sys::set_fifo(-3);
}

/// Binds the calling thread to an isolated processor. If there is none, to the last processor that it may use, because most
/// interrupts arrive at the first.
fn pin() -> rustix::io::Result<()> {
    let allowed = sched_getaffinity(None)?;
    let usable = |cpu: &usize| allowed.is_set(*cpu);
    let isolated = fs::read_to_string("/sys/devices/system/cpu/isolated").unwrap_or_default();
    let chosen = parse_cpu_list(&isolated)
        .into_iter()
        .find(usable)
        .or_else(|| (0..CpuSet::MAX_CPU).rev().find(usable))
        .ok_or(rustix::io::Errno::INVAL)?;
    let mut one = CpuSet::new();
    one.set(chosen);
    sched_setaffinity(None, &one)
}

/// Reads the kernel's list format: `2-3,6`.
pub(crate) fn parse_cpu_list(text: &str) -> Vec<usize> {
    text.trim()
        .split(',')
        .filter_map(|part| {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            Some(first.parse::<usize>().ok()?..=last.parse::<usize>().ok()?)
        })
        .flatten()
        .collect()
}

#[inline(never)]
fn touch_stack() {
    let mut pages = [0_u8; TOUCHED_STACK];
    for byte in pages.iter_mut().step_by(4096) {
        *byte = 1;
    }
    black_box(&pages);
}

/// Asks for zero wake-up latency, if the computer offers it. `cyclictest` does the same.
fn stay_awake() -> Option<File> {
    let mut file = OpenOptions::new().write(true).open("/dev/cpu_dma_latency").ok()?;
    file.write_all(&0_i32.to_ne_bytes()).ok()?;
    Some(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cpu_lists() {
        assert_eq!(parse_cpu_list("2-4,7\n"), [2, 3, 4, 7]);
        assert_eq!(parse_cpu_list("\n"), [] as [usize; 0]);
    }

    #[test]
    fn a_refused_right_says_how_to_grant_it() {
        std::thread::spawn(|| {
            assert!(acquire(Demand::Off).expect("asks for nothing").warnings.is_empty());
            for warning in acquire(Demand::Prefer).expect("only warns").warnings {
                assert!(warning.contains("setcap cap_sys_nice,cap_ipc_lock=ep"), "{warning}");
            }
        })
        .join()
        .expect("the thread ends");
    }
}
