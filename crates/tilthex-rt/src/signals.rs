//! What each signal does to a flight: it lands the vehicle, or nothing. None drops it.

use std::{
    os::raw::c_int,
    sync::{Arc, atomic::AtomicBool},
};

use signal_hook::consts::{
    SIGALRM, SIGHUP, SIGINT, SIGIO, SIGPIPE, SIGPROF, SIGQUIT, SIGTERM, SIGTSTP, SIGTTIN, SIGTTOU, SIGUSR1,
    SIGUSR2, SIGVTALRM, SIGXCPU, SIGXFSZ,
};

use crate::{Failure, sys};

/// What a signal does to a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reaction {
    Land,
    Ignore,
}

use Reaction::{Ignore, Land};

/// Every signal that would end or stop a program that does not say otherwise, and can be told otherwise; but for those
/// of the program's own errors (SIGSEGV, SIGABRT and the like). docs/loop.md shows this table; a test compares the two.
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

/// Those that end a program in which nothing flies.
const ENDING: [c_int; 3] = [SIGINT, SIGTERM, SIGHUP];

/// Has each signal of the table, and every real-time signal, do to a flight what the table says: those that land set
/// the flag.
///
/// # Errors
/// Where the kernel refuses a handler.
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

/// A flag that a signal sets which ends a program.
///
/// # Errors
/// Where the kernel refuses a handler.
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
        // SIGKILL and SIGSTOP cannot be; errors of the program are its end; these do nothing unasked.
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
