//! The simulated vehicle in real time: behind a pseudo-terminal ([`Server`]), before cameras ([`Capture`]), with
//! a hand on its tool ([`Hand`]), in a world of another process ([`World`]).

mod capture;
mod hand;
mod server;
pub mod world;

pub use capture::{CAPTURE_EVERY, CAPTURE_RATE, Capture};
pub use hand::Hand;
pub use server::{Observer, Report, Server};
pub use world::World;
