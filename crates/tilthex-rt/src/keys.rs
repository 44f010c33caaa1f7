//! Keys of the terminal in which the program runs, for example `K`, which stops the motors at once.

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

/// The key that stops the motors. All keys are capital letters, so that nobody presses them by mistake.
pub(crate) const KILL: u8 = b'K';
/// Time between two tests of whether the thread must end.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };

/// A key, and what it does.
pub(crate) type Key = (u8, Box<dyn Fn() + Send>);

/// The key that stops the motors.
pub(crate) fn kill(flags: &Flags) -> Key {
    let flags = flags.clone();
    (KILL, Box::new(move || flags.kill()))
}

/// Reads the terminal's keys. It restores the terminal's settings when it is dropped.
pub(crate) struct Keys {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    before: Termios,
}

impl Keys {
    /// Starts to read keys, if standard input is a terminal and this program is in its foreground. Its thread does `first`
    /// first.
    pub(crate) fn watch(known: Vec<Key>, first: fn()) -> Option<Self> {
        let terminal = stdin();
        let before = tcgetattr(terminal).ok()?;
        if tcgetpgrp(terminal).ok()? != getpgrp() {
            return None;
        }
        // Each key is read when it is pressed, and is not shown. Ctrl-C and the like stay signals.
        let mut modes = before.clone();
        modes.local_modes.remove(LocalModes::ICANON | LocalModes::ECHO);
        tcsetattr(terminal, OptionalActions::Now, &modes).ok()?;
        let stop = Arc::new(AtomicBool::new(false));
        let mut keys = Self { stop: Arc::clone(&stop), thread: None, before };
        let read = move || {
            first();
            // After an error the terminal is gone, and no more keys come.
            while !stop.load(Ordering::Relaxed) {
                if read(&known).is_err() {
                    return;
                }
            }
        };
        keys.thread = std::thread::Builder::new().name("keys".into()).stack_size(64 * 1024).spawn(read).ok();
        keys.thread.is_some().then_some(keys)
    }
}

/// Waits for [`LOOK`] at most, and handles the keys that were pressed.
fn read(known: &[Key]) -> io::Result<()> {
    let mut waiting = [PollFd::from_borrowed_fd(stdin(), PollFlags::IN)];
    if poll(&mut waiting, Some(&LOOK))? == 0 {
        return Ok(());
    }
    let mut struck = [0; 64];
    match rustix::io::read(stdin(), &mut struck)? {
        0 => Err(io::ErrorKind::UnexpectedEof.into()),
        count => {
            take(struck.get(..count).unwrap_or_default(), known);
            Ok(())
        }
    }
}

fn take(struck: &[u8], known: &[Key]) {
    // Only this key alone: pasted text and the sequence of a cursor key are not orders.
    let alone = |key: &Key| !struck.is_empty() && struck.iter().all(|byte| *byte == key.0);
    if let Some((_, act)) = known.iter().find(|key| alone(key)) {
        act();
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
            take(struck, &[kill(&flags)]);
            assert_eq!(flags.kills(), kills, "{struck:?}");
        }
    }
}
