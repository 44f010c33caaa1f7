//! The reaction of a flight to each signal: the vehicle lands, or the signal is ignored. No signal lets it fall.

use std::{
    os::raw::c_int,
    sync::{Arc, atomic::AtomicBool},
};

use signal_hook::consts::{
    SIGALRM, SIGHUP, SIGINT, SIGIO, SIGPIPE, SIGPROF, SIGQUIT, SIGTERM, SIGTSTP, SIGTTIN, SIGTTOU, SIGUSR1,
    SIGUSR2, SIGVTALRM, SIGXCPU, SIGXFSZ,
};

use crate::{Failure, sys};

/// The reaction of a flight to a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reaction {
    Land,
    Ignore,
}

use Reaction::{Ignore, Land};

/// Every signal that by default ends or stops a program, and that can be handled. The signals of the program's own errors
/// (SIGSEGV, SIGABRT and the like) are left out. docs/loop.md shows this table; a test compares the two.
const TABLE: &[(c_int, &str, Reaction)] = &[
    (SIGINT, "SIGINT", Land),
    (SIGTERM, "SIGTERM", Land),
    (SIGHUP, "SIGHUP", Land),
    (SIGQUIT, "SIGQUIT", Land),
    (SIGTSTP, "SIGTSTP", Land),
    (SIGXCPU, "SIGXCPU", Land),
    (libc::SIGPWR, "SIGPWR", Land),
    (SIGUSR1, "SIGUSR1", Ignore),
    (SIGUSR2, "SIGUSR2", Ignore),
    (SIGALRM, "SIGALRM", Ignore),
    (SIGVTALRM, "SIGVTALRM", Ignore),
    (SIGPROF, "SIGPROF", Ignore),
    (SIGIO, "SIGIO", Ignore),
    (SIGPIPE, "SIGPIPE", Ignore),
    (SIGTTIN, "SIGTTIN", Ignore),
    (SIGTTOU, "SIGTTOU", Ignore),
    (SIGXFSZ, "SIGXFSZ", Ignore),
    (libc::SIGSTKFLT, "SIGSTKFLT", Ignore),
];

/// The signals that end a program in which no vehicle flies.
const ENDING: [c_int; 3] = [SIGINT, SIGTERM, SIGHUP];

/// Installs the reactions of the table, and ignores every real-time signal. A signal that lands sets `land`.
///
/// # Errors
/// If the kernel refuses a handler.
pub(crate) fn land_or_ignore(land: &Arc<AtomicBool>) -> Result<(), Failure> {
    for &(signal, name, reaction) in TABLE {
        match reaction {
            Land => set_by(signal, land),
            Ignore => sys::ignore(signal),
        }
        .map_err(|e| Failure::machine(format!("{name} cannot be handled: {e}")))?;
    }
    for signal in libc::SIGRTMIN()..=libc::SIGRTMAX() {
        sys::ignore(signal)
            .map_err(|e| Failure::machine(format!("signal {signal} cannot be ignored: {e}")))?;
    }
    Ok(())
}

/// A flag that is set by the signals that end a program.
///
/// # Errors
/// If the kernel refuses a handler.
pub(crate) fn flag() -> Result<Arc<AtomicBool>, Failure> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in ENDING {
        set_by(signal, &flag)
            .map_err(|e| Failure::machine(format!("signal {signal} cannot be handled: {e}")))?;
    }
    Ok(flag)
}

fn set_by(signal: c_int, flag: &Arc<AtomicBool>) -> std::io::Result<()> {
    signal_hook::flag::register(signal, Arc::clone(flag)).map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_shows_the_table() {
        let page = include_str!("../../../docs/loop.md");
        let row = |wanted| {
            let names = TABLE.iter().filter(|(_, _, reaction)| *reaction == wanted).map(|(_, name, _)| *name);
            names.collect::<Vec<_>>().join(", ")
        };
        for expected in [format!("| {} |", row(Land)), format!("| {}, real-time signals |", row(Ignore))] {
            assert!(page.contains(&expected), "docs/loop.md lacks {expected}");
        }
    }

    #[test]
    fn every_signal_that_drops_a_program_is_in_the_table() {
        // SIGKILL and SIGSTOP cannot be handled. Errors of the program end it. The others do nothing by default.
        let left_out = [libc::SIGKILL, libc::SIGSTOP]
            .into_iter()
            .chain([
                libc::SIGSEGV,
                libc::SIGBUS,
                libc::SIGILL,
                libc::SIGFPE,
                libc::SIGABRT,
                libc::SIGSYS,
                libc::SIGTRAP,
            ])
            .chain([libc::SIGCHLD, libc::SIGCONT, libc::SIGURG, libc::SIGWINCH]);
        let mut all: Vec<_> = TABLE.iter().map(|(signal, ..)| *signal).chain(left_out).collect();
        all.sort_unstable();
        assert_eq!(all, (1..=31).collect::<Vec<_>>());
    }
}
