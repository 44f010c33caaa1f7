//! Orders to a flight as text: JSON lines of the control socket, and TOML trajectory files. The control socket, the program
//! and the replay of a log use the same parser.

mod place;
#[cfg(test)]
mod schema;
#[cfg(test)]
mod tests;
mod text;

use std::{path::Path, sync::Arc};

use serde::de::DeserializeOwned;
use tilthex_core::{
    Error, Matrix3, Setpoint, Vector3,
    admittance::AdmittanceFilter,
    flight::{Command, Route},
    force_axes::ForceAxes,
    order_bounds::{Beyond, OrderBounds},
    so3,
    trajectory::Limits,
};

use crate::{AdmittanceSection, Config, ConfigError, files, section};
use place::Geofence;
pub use place::Place;
use text::{FollowText, Nothing, RouteText, WrenchText, matrix3};

/// Parses the orders that go through the loop's ring (`kill` and `land` do not), and refuses what the vehicle cannot do.
/// Keeps the section `[admittance]`, because an order may change a part of it.
#[derive(Clone, Debug)]
pub struct Orders {
    config: Arc<Config>,
    limits: Limits,
    admittance: AdmittanceSection,
    bounds: OrderBounds,
    geofence: Geofence,
}

impl Orders {
    /// A parser for a configuration.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self {
            config: Arc::new(config.clone()),
            limits: config.mission().limits(),
            admittance: config.admittance().clone(),
            bounds: OrderBounds::new(
                config.vehicle().vehicle(),
                config.controller(),
                &config.orders().limits(),
                &config.supervisor().params(),
            ),
            geofence: Geofence::of(config),
        }
    }

    /// The complete configuration as TOML, with `[admittance]` as the orders have changed it.
    #[must_use]
    pub fn configuration(&self) -> String {
        Config { admittance: self.admittance.clone(), ..(*self.config).clone() }.to_toml()
    }

    /// Parses an order from a line of JSON: an object with `command` and the arguments of the command.
    ///
    /// # Errors
    /// One sentence: what is wrong with the line, and what was expected.
    pub fn parse(&mut self, line: &str) -> Result<Command, String> {
        let mut object: serde_json::Map<String, serde_json::Value> =
            serde_json::from_str(line).map_err(|e| format!("not a JSON object: {e}"))?;
        let name = match object.remove("command") {
            Some(serde_json::Value::String(name)) => name,
            _ => return Err("no command; expected a string such as \"land\"".into()),
        };
        let rest = serde_json::Value::Object(object);
        self.command(&name, rest).map_err(|e| format!("{name}: {e}"))
    }

    /// Refuses an order that would lead the vehicle out of the geofence.
    ///
    /// # Errors
    /// One sentence: where it would lead, and the bounds.
    pub fn check_place(&self, command: &Command, place: &Place) -> Result<(), String> {
        self.geofence.check(command, place)
    }

    fn command(&mut self, name: &str, rest: serde_json::Value) -> Result<Command, String> {
        let nothing = |command| take::<Nothing>(rest.clone()).map(|_| command);
        match name {
            "take_off" => nothing(Command::TakeOff),
            "release_wrench" => nothing(Command::ReleaseWrench),
            "zero_bias" => nothing(Command::ZeroBias),
            "play" => {
                let route = take::<RouteText>(rest)?.route(&self.limits)?;
                self.bounds.check_route(&route).map_err(sentence)?;
                Ok(Command::Play(route))
            }
            "follow" => {
                let setpoint = setpoint(&take(rest)?)?;
                self.bounds.check_setpoint(&setpoint).map_err(sentence)?;
                Ok(Command::Follow(setpoint))
            }
            "set_wrench" => {
                let text = take::<WrenchText>(rest)?;
                let (wrench_w, force_axes) = (text.wrench(), text.force_axes()?);
                // The attitude in which the tool will exert the wrench is not known here.
                self.bounds.check_wrench(&Matrix3::identity(), &wrench_w).map_err(sentence)?;
                Ok(Command::SetWrench(wrench_w, force_axes))
            }
            "set_admittance" => self.set_admittance(take(rest)?),
            _ => Err("no such command; expected take_off, play, follow, set_admittance, set_wrench, \
                      release_wrench, zero_bias, land, kill, take_controls, heartbeat, configuration, state or stream"
                .into()),
        }
    }

    /// Changes keys of `[admittance]`. They have the names of the configuration.
    fn set_admittance(&mut self, changes: toml::Table) -> Result<Command, String> {
        let names = |key: &str| changes.contains_key(key);
        let (names_mass, names_damping) = (names("mass"), names("damping"));
        let section =
            section::changed(&self.admittance, "set_admittance", changes).map_err(|e| e.to_string())?;
        let params = section.params().map_err(|e| e.to_string())?;
        self.bounds.check_admittance(&params, names_mass, names_damping).map_err(sentence)?;
        let filter = AdmittanceFilter::new(params).map_err(|e: Error| e.to_string())?;
        self.admittance = section;
        Ok(Command::SetAdmittance(filter))
    }
}

/// Reads a file that a person wrote.
///
/// # Errors
/// One sentence: the file, and why it cannot be read.
pub fn read_file(path: &Path) -> Result<String, ConfigError> {
    files::read_text(path).map_err(|e| ConfigError::new(format!("{}: cannot be read: {e}", path.display())))
}

/// Parses the route in the text of a trajectory file: `[limits]` and `[[waypoint]]` tables.
///
/// # Errors
/// One sentence: the line, and what is wrong with it.
pub fn parse_route(text: &str, base: &Limits) -> Result<Route, String> {
    let route: RouteText = toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
        format!("line {line}: {}", crate::one_line(e.message()))
    })?;
    route.route(base)
}

/// The force axes with these names. They are axes of the tool, or of a surface if its rotation `surface_ws` is given, which
/// maps the surface's coordinates to world coordinates.
///
/// # Errors
/// If a name is unknown, or `surface_ws` is not a rotation.
pub fn force_axes(names: &[String], surface_ws: Option<Matrix3>) -> Result<ForceAxes, String> {
    let mut axes = ForceAxes { surface_ws, ..ForceAxes::NONE };
    for name in names {
        if !axes.choose(name) {
            let known = ForceAxes::NAMES.join(", ");
            return Err(format!("force_axes: found {name:?}, expected any of {known}"));
        }
    }
    axes.check().map_err(|e| e.to_string())?;
    Ok(axes)
}

fn take<T: DeserializeOwned>(value: serde_json::Value) -> Result<T, String> {
    serde_json::from_value(value).map_err(|e| e.to_string())
}

fn setpoint(text: &FollowText) -> Result<Setpoint, String> {
    let rotation_we = matrix3(&text.rotation);
    so3::check_rotation("rotation", &rotation_we).map_err(|e| e.to_string())?;
    let vector = |v: &[f64; 3]| Vector3::from(*v);
    let setpoint = Setpoint {
        position_w: vector(&text.position),
        rotation_we,
        velocity_w: vector(&text.velocity),
        angular_velocity_w: vector(&text.angular_velocity),
        acceleration_w: vector(&text.acceleration),
        angular_acceleration_w: vector(&text.angular_acceleration),
        wrench_w: text.wrench.wrench(),
        force_axes: text.wrench.force_axes()?,
    };
    if setpoint.is_finite() { Ok(setpoint) } else { Err(not_finite()) }
}

fn sentence(beyond: Beyond) -> String {
    beyond.to_string()
}

fn not_finite() -> String {
    "holds a number that is not finite".into()
}
