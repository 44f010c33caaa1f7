//! Keys of the terminal that a flight is watched on: `K` stops the motors at once.

use std::{
    io,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
};

use rustix::{
    event::{PollFd, PollFlags, poll},
    process::getpgrp,
    stdio::stdin,
    termios::{LocalModes, OptionalActions, Termios, tcgetattr, tcgetpgrp, tcsetattr},
    time::Timespec,
};

use crate::flags::Flags;

/// The key: a capital, which a hasty hand does not hit.
pub(crate) const KILL: u8 = b'K';
/// The thread looks this often whether it is to end.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };

/// The watch on the terminal's keys. It gives the terminal back when it is dropped.
pub(crate) struct Keys {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    before: Termios,
}

impl Keys {
    /// Watches, where standard input is a terminal and this program is in its foreground.
    pub(crate) fn watch(flags: Flags) -> Option<Self> {
        let terminal = stdin();
        let before = tcgetattr(terminal).ok()?;
        if tcgetpgrp(terminal).ok()? != getpgrp() {
            return None;
        }
        // Each key as it is struck, and not shown; Ctrl-C and its like stay signals.
        let mut modes = before.clone();
        modes.local_modes.remove(LocalModes::ICANON | LocalModes::ECHO);
        tcsetattr(terminal, OptionalActions::Now, &modes).ok()?;
        let stop = Arc::new(AtomicBool::new(false));
        let mut keys = Self { stop: Arc::clone(&stop), thread: None, before };
        let read = move || {
            // A terminal that is gone says nothing more.
            while !stop.load(Ordering::Relaxed) {
                if read(&flags).is_err() {
                    return;
                }
            }
        };
        keys.thread = std::thread::Builder::new().name("keys".into()).stack_size(64 * 1024).spawn(read).ok();
        keys.thread.is_some().then_some(keys)
    }
}

/// Waits for a moment, and takes what was struck.
fn read(flags: &Flags) -> io::Result<()> {
    let mut waiting = [PollFd::from_borrowed_fd(stdin(), PollFlags::IN)];
    if poll(&mut waiting, Some(&LOOK))? == 0 {
        return Ok(());
    }
    let mut struck = [0; 64];
    match rustix::io::read(stdin(), &mut struck)? {
        0 => Err(io::ErrorKind::UnexpectedEof.into()),
        count => {
            take(struck.get(..count).unwrap_or_default(), flags);
            Ok(())
        }
    }
}

fn take(struck: &[u8], flags: &Flags) {
    // A key alone: a text that is pasted, or the sequence of a cursor key, is no order.
    if !struck.is_empty() && struck.iter().all(|&key| key == KILL) {
        flags.kill();
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let _ = tcsetattr(stdin(), OptionalActions::Now, &self.before);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_key_itself_kills() {
        for (struck, kills) in
            [(&b"K"[..], true), (b"KK", true), (b"k", false), (b"OK\n", false), (b"", false)]
        {
            let flags = Flags::default();
            take(struck, &flags);
            assert_eq!(flags.kills(), kills, "{struck:?}");
        }
    }
}
