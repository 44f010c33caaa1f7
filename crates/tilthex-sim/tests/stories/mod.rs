//! What the tests of the campaign share.

use std::path::Path;

use tilthex_config::Config;
use tilthex_sim::campaign::{Injection, Kind};

/// A fault of a flight.
pub(crate) fn fault(kind: Kind, begin: f64, duration: f64, strength: f64, index: usize) -> Injection {
    Injection { kind, begin, duration, strength, index }
}

/// The configuration with which they fly.
pub(crate) fn config() -> Config {
    Config::from_text("vehicle.preset = \"tilt-hex\"", Path::new("")).expect("valid")
}
