//! Orders to a running flight: lines of JSON over TCP or a Unix socket. `docs/protocols.md` describes the protocol.
//!
//! Each client has a thread (`client`), which runs its conversation (`session`). The conversation does not know the socket.
//! The orders of all clients go through one desk (`desk`) to the loop.

mod address;
mod client;
mod desk;
mod places;
mod session;
mod state;
#[cfg(test)]
mod tests;
mod token;

use std::{
    io,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

pub use address::DEFAULT_ADDRESS;
pub use desk::{Desk, Way};
pub use state::BESIDES;
pub use token::Token;

use address::{Address, Listener, Stream};
use client::{Connection, LOOK};
use places::{Place, Places};

use crate::{
    Failure,
    sleeper::{Clock, Monotonic},
};

/// The version of the protocol. It changes when a client that speaks the version before would misunderstand a line, or be
/// misunderstood. New commands, new keys of answers and new values of the state change nothing for such a client.
pub const PROTOCOL: u64 = 1;

/// Time between two attempts to find a place for a new connection.
const WAIT: Duration = Duration::from_millis(5);

/// The state that all connections share.
#[derive(Debug)]
struct Shared {
    desk: Desk,
    token: Option<Token>,
    stop: AtomicBool,
    refused: AtomicU64,
}

/// A listening control socket. It ends when it is dropped.
#[derive(Debug)]
pub struct ControlSocket {
    address: String,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl ControlSocket {
    /// Listens at `ADDRESS:PORT` or `unix:PATH`. If a token is given, every client must send it first. Each of the threads
    /// does `first` first.
    ///
    /// # Errors
    /// One sentence: the address means every network, does not belong to this computer or is in use, or other computers
    /// can reach it without a token.
    pub fn start(address: &str, token: Option<Token>, desk: Desk, first: fn()) -> Result<Self, Failure> {
        let listener = Address::parse(address, token.is_some())?.listen()?;
        let failed = |e: io::Error| Failure::machine(format!("the control socket cannot be served: {e}"));
        let address = listener.name().map_err(failed)?;
        let shared =
            Arc::new(Shared { desk, token, stop: AtomicBool::new(false), refused: AtomicU64::new(0) });
        let listening = Arc::clone(&shared);
        let thread = spawn("control", first, move || listen(&listener, &listening, first)).map_err(failed)?;
        Ok(Self { address, shared, thread: Some(thread) })
    }

    /// The address at which it listens.
    #[must_use]
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Number of requests that were refused.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.shared.refused.load(Ordering::Relaxed)
    }
}

impl Drop for ControlSocket {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn spawn(name: &str, first: fn(), run: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name(name.into()).stack_size(256 * 1024).spawn(move || {
        first();
        run();
    })
}

fn listen(listener: &Listener, shared: &Arc<Shared>, first: fn()) {
    let places = Arc::new(Places::default());
    while !shared.stop.load(Ordering::Relaxed) {
        let Ok((stream, name)) = listener.accept() else {
            std::thread::sleep(LOOK);
            continue;
        };
        let Some(place) = place_for(&stream, &places, shared) else { return };
        let name = format!("{name} (client {})", place.id);
        let serving = Arc::clone(shared);
        // If no thread can be started, the connection and its place are dropped.
        let _ = spawn("control-client", first, move || {
            if let Ok(connection) = Connection::new(stream, name, place, Arc::clone(&serving)) {
                connection.serve(&serving);
            }
        });
    }
}

/// Waits for a place; `None` if the program ends before. The client that holds the controls keeps its place.
fn place_for(stream: &Stream, places: &Arc<Places>, shared: &Shared) -> Option<Place> {
    while !shared.stop.load(Ordering::Relaxed) {
        let holder = shared.desk.holder().map(|(id, _)| id);
        if let Some(place) = places.enter(stream, holder, Monotonic.now()) {
            return Some(place);
        }
        std::thread::sleep(WAIT);
    }
    None
}
