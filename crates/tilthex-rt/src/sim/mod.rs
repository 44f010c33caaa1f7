//! The simulated vehicle in real time: behind a pseudo-terminal ([`Server`]), before cameras ([`Capture`]), with
//! a hand on its tool ([`Hand`]), in a world of another process ([`World`]).

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

/// A board that speaks as PX4 does; its motors need the configured throttles, its streams come at the configured rates.
///
/// # Errors
/// Where the configuration is of no vehicle that takes throttles.
pub fn px4_board(config: &Config, params: &SimulationParams) -> Result<Client, Failure> {
    let link = config.linked_params(false)?.link;
    let periods = (u64::from(link.imu_period_us), u64::from(link.motor_period_us));
    let battery = params.firmware.battery;
    let board = ClientParams { battery, throttle: link.throttle, periods, without: None };
    Ok(Client::new(params.plant.vehicle(), board))
}
