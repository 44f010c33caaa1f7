//! The simulated vehicle in real time: its pseudo-terminal ([`Server`]), its motion capture ([`Capture`]), pushes of its
//! tool ([`Hand`]), and its world in another process ([`World`]).

mod capture;
mod hand;
mod server;
pub mod world;

use tilthex_config::Config;
use tilthex_link::px4::board::{Client, ClientParams};
use tilthex_sim::SimulationParams;

use crate::Failure;

pub use capture::{CAPTURE_EVERY, CAPTURE_RATE, Capture};
pub use hand::Hand;
pub use server::{Observer, Report, Server};
pub use world::World;

/// A board that behaves like PX4. Its motors need the throttles of the configuration, and its streams have the configured
/// rates.
///
/// # Errors
/// If the configuration has no valid throttle map.
pub fn px4_board(config: &Config, params: &SimulationParams) -> Result<Client, Failure> {
    let link = config.linked_params(false)?.link;
    let periods = (u64::from(link.imu_period_us), u64::from(link.motor_period_us));
    let battery = params.firmware.battery;
    let board = ClientParams { battery, throttle: link.throttle, periods, without: None };
    Ok(Client::new(params.plant.vehicle(), board))
}
