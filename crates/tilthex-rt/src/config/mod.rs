//! Configuration: one TOML file describes one set-up.
//!
//! Each section is declared once, which makes its struct, its defaults, its
//! list of keys and the comments of the printed file.

mod section;
mod values;
mod vehicle;

pub use section::{ConfigError, Key, Section};
use std::path::Path;
use toml::{Table, Value};
pub use values::{Axes, Square};
pub use vehicle::{PRESETS, VehicleSection};

fn read_file(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path)
        .map_err(|e| ConfigError::new(format!("can not read the file {}: {e}", path.display())))
}

/// Parses TOML; an error says the line.
fn parse(text: &str) -> Result<Table, ConfigError> {
    text.parse().map_err(|error: toml::de::Error| {
        let line = error.span().map_or(1, |span| text[..span.start].lines().count().max(1));
        ConfigError::new(format!("line {line}: {}", section::one_line(error.message())))
    })
}

/// Lays `upper` over `base`, table by table.
fn overlay(base: &mut Table, upper: Table) {
    for (key, value) in upper {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => overlay(below, above),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}
