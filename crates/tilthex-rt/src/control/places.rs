//! The places for connections. A new connection takes the place of the one that has been idle for longest.

use std::sync::{
    Arc, Mutex, MutexGuard, PoisonError,
    atomic::{AtomicU64, Ordering},
};

use super::address::Stream;
use crate::sleeper::Nanos;

/// Largest number of connections at the same time.
pub(super) const MOST: usize = 16;
/// Least time for which a client keeps its place, ns: enough for a line that it sent when it connected.
pub(super) const LEAST_STAY: Nanos = 50_000_000;

/// The number of a connection.
pub(super) type Id = u64;

/// The connections that have a place.
#[derive(Debug, Default)]
pub(super) struct Places {
    taken: Mutex<Vec<Entry>>,
    next: AtomicU64,
}

#[derive(Debug)]
struct Entry {
    id: Id,
    stream: Stream,
    /// Time at which it connected, or sent its last complete line.
    active: Nanos,
}

/// A place. It becomes free when this is dropped, also after a panic.
#[derive(Debug)]
pub(super) struct Place {
    places: Arc<Places>,
    pub(super) id: Id,
}

impl Places {
    fn taken(&self) -> MutexGuard<'_, Vec<Entry>> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for a connection. If no place is free, the connection that has been idle for longest ends, but never `kept`.
    /// `None` if all others have connected less than [`LEAST_STAY`] ago.
    pub(super) fn enter(self: &Arc<Self>, stream: &Stream, kept: Option<Id>, now: Nanos) -> Option<Place> {
        let stream = stream.try_clone().ok()?;
        let mut taken = self.taken();
        if taken.len() >= MOST {
            let idle =
                |entry: &&Entry| Some(entry.id) != kept && now.saturating_sub(entry.active) >= LEAST_STAY;
            let idlest = taken.iter().filter(idle).min_by_key(|entry| entry.active)?.id;
            taken.retain(|entry| {
                let stays = entry.id != idlest;
                if !stays {
                    entry.stream.shut();
                }
                stays
            });
        }
        let id = self.next.fetch_add(1, Ordering::Relaxed);
        taken.push(Entry { id, stream, active: now });
        Some(Place { places: Arc::clone(self), id })
    }

    /// Number of places that are in use.
    #[cfg(test)]
    pub(super) fn count(&self) -> usize {
        self.taken().len()
    }
}

impl Place {
    /// Notes that its client has sent a complete line.
    pub(super) fn touch(&self, now: Nanos) {
        if let Some(entry) = self.places.taken().iter_mut().find(|entry| entry.id == self.id) {
            entry.active = now;
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.places.taken().retain(|entry| entry.id != self.id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{io::Read, os::unix::net::UnixStream};

    fn pair() -> (Stream, UnixStream) {
        let (ours, theirs) = UnixStream::pair().expect("a pair");
        (Stream::Unix(ours), theirs)
    }

    #[test]
    fn the_idlest_gives_way_and_whoever_holds_the_controls_stays() {
        let places = Arc::new(Places::default());
        let mut peers = Vec::new();
        let mut held = Vec::new();
        for i in 0..MOST as u64 {
            let (ours, theirs) = pair();
            held.push(places.enter(&ours, None, i).expect("room"));
            peers.push((ours, theirs));
        }
        let holder = held[0].id;
        held[1].touch(LEAST_STAY);
        let (ours, _theirs) = pair();
        assert!(places.enter(&ours, Some(holder), LEAST_STAY).is_none(), "all have just come");
        let _new = places.enter(&ours, Some(holder), 2 * LEAST_STAY - 1).expect("the idlest gives way");
        assert_eq!(places.count(), MOST);
        // The third one ends: the first holds the controls, and the second has sent a line since.
        let mut byte = [0];
        assert_eq!(peers[2].1.read(&mut byte).expect("an end"), 0);
        for i in [0, 1, 3] {
            peers[i].1.set_nonblocking(true).expect("set");
            assert!(peers[i].1.read(&mut byte).is_err(), "{i} is still connected");
        }
    }

    #[test]
    fn a_panic_gives_its_place_back() {
        let places = Arc::new(Places::default());
        let (ours, _theirs) = pair();
        let place = places.enter(&ours, None, 0).expect("room");
        assert_eq!(places.count(), 1);
        let panicked = std::thread::spawn(move || {
            let _place = place;
            panic!("on purpose");
        });
        assert!(panicked.join().is_err());
        assert_eq!(places.count(), 0);
    }
}
