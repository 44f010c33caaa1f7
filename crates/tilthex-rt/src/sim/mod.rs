//! The simulated vehicle in real time: its pseudo-terminal ([`Server`]), its motion capture ([`Capture`]), pushes of its
//! tool ([`Hand`]), and its world in another process ([`World`]).

mod capture;
mod hand;
mod server;
pub mod world;

use tilthex_config::Config;
use tilthex_link::board::{BoardParams, LinkBoard};
use tilthex_sim::SimulationParams;

use crate::Failure;

pub use capture::{CAPTURE_EVERY, CAPTURE_RATE, Capture};
pub use hand::Hand;
pub use server::{Observer, Report, Server};
pub use world::World;

/// The flight board of the simulated vehicle: that of the configured link, with its throttles unless the truth has other
/// ones.
///
/// # Errors
/// If the configuration has no valid link.
pub fn board(config: &Config, params: &SimulationParams) -> Result<LinkBoard, Failure> {
    let linked = config.linked_params(false)?;
    let mut link = linked.link;
    link.throttle.exponent = params.throttle_exponent.unwrap_or(link.throttle.exponent);
    let board = BoardParams { battery: params.firmware.battery, link };
    Ok(LinkBoard::new(linked.kind, params.plant.vehicle(), board))
}
