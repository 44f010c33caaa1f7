//! What a flight says: neither a full disk, a closed pipe nor a reader that stands still can hold it up or end it.
//!
//! Lines go through a queue to a thread that writes them. Where the queue is full, they are left out; where nobody
//! takes them, the end of the program waits for a moment and no longer.

use std::{
    io::{IsTerminal, Write, stderr, stdout},
    sync::{
        OnceLock,
        mpsc::{self, SyncSender, TrySendError},
    },
    time::Duration,
};

/// Lines that may wait. A summary has some twenty.
const QUEUE: usize = 256;
/// This long is waited at the end for a reader that takes nothing.
const PATIENCE: Duration = Duration::from_millis(500);

enum Order {
    /// A text to standard output, and one to standard error.
    Out(String),
    Err(String),
    /// All before it is written: say so.
    Settle(SyncSender<()>),
}

static WRITER: OnceLock<Option<SyncSender<Order>>> = OnceLock::new();

fn writer() -> Option<&'static SyncSender<Order>> {
    let start = || {
        let (send, orders) = mpsc::sync_channel(QUEUE);
        let write = move || {
            for order in orders {
                // What cannot be written is lost, and the flight goes on.
                let _ = match order {
                    Order::Out(text) => {
                        let mut out = stdout().lock();
                        out.write_all(text.as_bytes()).and_then(|()| out.flush())
                    }
                    Order::Err(text) => stderr().write_all(text.as_bytes()),
                    Order::Settle(done) => {
                        let _ = done.send(());
                        Ok(())
                    }
                };
            }
        };
        std::thread::Builder::new().name("output".into()).spawn(write).ok().map(|_| send)
    };
    WRITER.get_or_init(start).as_ref()
}

fn order(order: Order) {
    if let Some(writer) = writer() {
        // A full queue: nobody reads.
        let _ = writer.try_send(order);
    }
}

/// Writes a line to standard output, sooner or later.
pub(crate) fn line(text: impl std::fmt::Display) {
    order(Order::Out(format!("{text}\n")));
}

/// Writes a text without an end of line to standard output, sooner or later.
pub(crate) fn text(text: String) {
    order(Order::Out(text));
}

/// Writes a line to standard error, sooner or later.
pub(crate) fn error(text: impl std::fmt::Display) {
    order(Order::Err(format!("{text}\n")));
}

/// Whether standard output is a terminal.
pub(crate) fn is_terminal() -> bool {
    stdout().is_terminal()
}

/// Waits until all is written, or for a moment where nobody takes it.
pub(crate) fn settle() {
    let Some(Some(writer)) = WRITER.get() else { return };
    let (done, settled) = mpsc::sync_channel(1);
    let begin = std::time::Instant::now();
    let mut order = Order::Settle(done);
    while begin.elapsed() < PATIENCE {
        match writer.try_send(order) {
            Ok(()) => {
                let _ = settled.recv_timeout(PATIENCE.saturating_sub(begin.elapsed()));
                return;
            }
            Err(TrySendError::Full(back)) => order = back,
            Err(TrySendError::Disconnected(_)) => return,
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Prints the output of a command. A reader that closes the pipe early is no failure.
///
/// # Errors
/// Where it cannot be written: a full disk.
pub(crate) fn print(text: &str) -> Result<(), crate::Failure> {
    let mut out = stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(crate::Failure::machine(format!(
            "the output cannot be written: {e}; name another place for it"
        ))),
        _ => Ok(()),
    }
}

/// `println!` for a flight.
macro_rules! say {
    ($($argument:tt)*) => { $crate::output::line(format_args!($($argument)*)) };
}
pub(crate) use say;
