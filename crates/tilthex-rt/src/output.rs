//! The output of a flight. A full disk, a closed pipe or a reader that does not read can neither delay nor end the flight.
//!
//! Lines go through a queue to a thread that writes them. If the queue is full, lines are dropped. If nobody reads them, the
//! program waits for [`PATIENCE`] at its end, and not longer.

use std::{
    io::{IsTerminal, Write, stderr, stdout},
    sync::{
        OnceLock,
        mpsc::{self, SyncSender, TrySendError},
    },
    time::Duration,
};

/// Number of lines that can wait. A summary has about twenty.
const QUEUE: usize = 256;
/// Longest wait at the end of the program for a reader that does not read.
const PATIENCE: Duration = Duration::from_millis(500);

enum Order {
    /// A text to standard output, and one to standard error.
    Out(String),
    Err(String),
    /// Answers when all lines before it are written.
    Settle(SyncSender<()>),
}

static WRITER: OnceLock<Option<SyncSender<Order>>> = OnceLock::new();

fn writer() -> Option<&'static SyncSender<Order>> {
    let start = || {
        let (send, orders) = mpsc::sync_channel(QUEUE);
        let write = move || {
            for order in orders {
                // A line that cannot be written is lost, and the flight continues.
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
        // The queue is full if nobody reads. The line is then dropped.
        let _ = writer.try_send(order);
    }
}

/// Queues a line for standard output.
pub(crate) fn line(text: impl std::fmt::Display) {
    order(Order::Out(format!("{text}\n")));
}

/// Queues a text without an end of line for standard output.
pub(crate) fn text(text: String) {
    order(Order::Out(text));
}

/// Queues a line for standard error.
pub(crate) fn error(text: impl std::fmt::Display) {
    order(Order::Err(format!("{text}\n")));
}

/// Colours of a terminal, by their numbers.
#[derive(Clone, Copy)]
pub(crate) enum Colour {
    Red = 31,
    Green = 32,
    Yellow = 33,
}

/// A text in a colour if standard output is a terminal and `NO_COLOR` is not set.
pub(crate) fn coloured(text: &str, colour: Colour) -> String {
    if is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()) {
        format!("\x1b[{}m{text}\x1b[0m", colour as u8)
    } else {
        text.into()
    }
}

/// Whether standard output is a terminal.
pub(crate) fn is_terminal() -> bool {
    stdout().is_terminal()
}

/// Waits until all lines are written, for [`PATIENCE`] at most.
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

/// Prints the output of a command. It is not a failure if the reader closes the pipe early.
///
/// # Errors
/// If the output cannot be written, for example because the disk is full.
pub(crate) fn print(text: &str) -> Result<(), crate::Failure> {
    let mut out = stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(crate::Failure::machine(format!(
            "the output cannot be written: {e}; name another place for it"
        ))),
        _ => Ok(()),
    }
}

/// `println!` for a flight: see [`line`].
macro_rules! say {
    ($($argument:tt)*) => { $crate::output::line(format_args!($($argument)*)) };
}
pub(crate) use say;
