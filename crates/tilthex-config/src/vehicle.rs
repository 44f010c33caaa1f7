//! The `[vehicle]` section: a preset, a file, or a vehicle described in place.

use super::{
    plausible,
    section::{self, ConfigError, Described, Section, section},
    values::{Axes, Square},
};
use std::path::{Path, PathBuf};
use tilthex_core::{
    Rotor, Vehicle,
    plant::RotorDrag,
    so3,
    vehicle::{Mounting, TiltedHexarotor},
};
use toml::{Table, Value};

/// The built-in vehicles: name and file.
pub const PRESETS: &[(&str, &str)] = &[
    ("tilt-hex", include_str!("../../../vehicles/tilt-hex.toml")),
    ("tilt-hex-light", include_str!("../../../vehicles/tilt-hex-light.toml")),
    ("hexarotor", include_str!("../../../vehicles/hexarotor.toml")),
    ("quadrotor", include_str!("../../../vehicles/quadrotor.toml")),
    ("omnidirectional-octorotor", include_str!("../../../vehicles/omnidirectional-octorotor.toml")),
    ("coaxial-tilt-hex", include_str!("../../../vehicles/coaxial-tilt-hex.toml")),
];

/// Longest chain of files in which each names the next.
const MAX_CHAIN: usize = 100;

section! {
    /// The vehicle. `preset = "NAME"` or `file = "PATH"` (relative to the folder of this file) takes
    /// the keys of another vehicle; the keys that stand beside it override these.
    pub(super) Body as "vehicle" {
        /// Name of the vehicle.
        name: String = "unnamed".into(),
        /// Mass of vehicle and tool.
        mass: f64 = f64::NAN => "kg",
        /// Inertia about the centre of mass, robot frame: 3 principal moments or 3x3.
        inertia: Square<3> = Square::diagonal([f64::NAN; 3]) => "kg m^2",
        /// Time constant of the rotor speed's first-order lag.
        rotor_time_constant: f64 = 0.0 => "s" from 0.0 to 1.0,
        /// Drag of the rotors: force against the airspeed in a rotor's disc, per Hz of its speed.
        rotor_drag: f64 = 0.0 => "N s/m per Hz" from 0.0 to 1.0,
        /// Flapping of the rotors: torque that lifts the leading edge of a rotor's disc, by the airspeed in it and per Hz of its speed.
        flapping: f64 = 0.0 => "N m s/m per Hz" from -1.0 to 1.0,
        /// Tool tip from the centre of mass, robot frame.
        tool_position: Axes<3> = Axes([0.0; 3]) => "m",
        /// Tool frame in the robot frame: roll, pitch, yaw (Rz(yaw) Ry(pitch) Rx(roll)); z points from the tip along the rod.
        tool_rotation_deg: Axes<3> = Axes([0.0; 3]) => "degrees",
        /// IMU from the centre of mass, robot frame.
        imu_position: Axes<3> = Axes([0.0; 3]) => "m",
        /// IMU frame in the robot frame: roll, pitch, yaw.
        imu_rotation_deg: Axes<3> = Axes([0.0; 3]) => "degrees",
    }
}

section! {
    /// Six rotors on arms 60 degrees apart, each tilted about its arm; (4)-(5).
    pub(super) HexarotorSection as "vehicle.tilted_hexarotor" {
        /// Tilt about the arm; its sign alternates from rotor to rotor.
        alpha_deg: f64 = 0.0 => "degrees",
        /// Tilt towards the centre.
        beta_deg: f64 = 0.0 => "degrees",
        /// From the centre to each tilting centre.
        arm: f64 = f64::NAN => "m",
        /// From the tilting centre to the rotor, in the rotor's own tilted frame.
        rotor_offset: Axes<3> = Axes([0.0; 3]) => "m",
        /// Thrust coefficient c_f.
        thrust_coefficient: f64 = f64::NAN => "N/Hz^2",
        /// Drag-moment coefficient c_tau.
        drag_coefficient: f64 = f64::NAN => "N m/Hz^2",
        /// Lowest speed.
        min_speed: f64 = f64::NAN => "Hz",
        /// Highest speed.
        max_speed: f64 = f64::NAN => "Hz",
    }
}

section! {
    /// One rotor: a table `[[vehicle.rotors]]` for each.
    pub(super) RotorSection as "vehicle.rotors" {
        /// Centre of rotation from the centre of mass, robot frame.
        position: Axes<3> = Axes([f64::NAN; 3]) => "m",
        /// Direction of the thrust, unit vector, robot frame.
        axis: Axes<3> = Axes([f64::NAN; 3]),
        /// +1 or -1: the sign of the drag moment about the axis.
        spin: f64 = f64::NAN,
        /// Thrust coefficient c_f.
        thrust_coefficient: f64 = f64::NAN => "N/Hz^2",
        /// Drag-moment coefficient c_tau.
        drag_coefficient: f64 = f64::NAN => "N m/Hz^2",
        /// Lowest speed.
        min_speed: f64 = f64::NAN => "Hz",
        /// Highest speed.
        max_speed: f64 = f64::NAN => "Hz",
    }
}

/// Its sections, for the documentation.
pub(super) fn described() -> Vec<Described> {
    vec![Described::of::<Body>(), Described::of::<HexarotorSection>(), Described::of::<RotorSection>()]
}

/// How the rotors are given.
#[derive(Clone, Debug, PartialEq)]
enum Rotors {
    Hexarotor(HexarotorSection),
    List(Vec<RotorSection>),
}

/// A vehicle as its file describes it, and the core's vehicle that is made from it.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleSection {
    body: Body,
    rotors: Rotors,
    vehicle: Vehicle,
}

impl VehicleSection {
    /// One of [`PRESETS`].
    ///
    /// # Errors
    /// Names the nearest preset.
    pub fn preset(name: &str) -> Result<Self, ConfigError> {
        Self::from_table(preset(name)?, Path::new(""))
    }

    /// The `[vehicle]` of a TOML file.
    ///
    /// # Errors
    /// Says what is wrong, with the file's name.
    pub fn from_file(path: &Path) -> Result<Self, ConfigError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::from_table(table_of_file(path)?, folder).map_err(|e| e.within(path.display()))
    }

    /// Name of the vehicle.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.body.name
    }

    /// The vehicle.
    #[must_use]
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// Drag and flapping of its rotors.
    #[must_use]
    pub fn rotor_drag(&self) -> RotorDrag {
        RotorDrag { drag: self.body.rotor_drag, flapping: self.body.flapping }
    }

    /// Reads the section. A relative path in `file` begins at `folder`.
    ///
    /// # Errors
    /// Names the error and the key.
    pub fn from_table(table: Table, folder: &Path) -> Result<Self, ConfigError> {
        let here = |e: ConfigError| e.within("[vehicle]");
        let mut table = resolve(table, folder, &mut Vec::new())?;
        let hexarotor = table.remove("tilted_hexarotor");
        let list = table.remove("rotors");
        let known = Body::KEYS.iter().map(|k| k.name);
        for key in table.keys() {
            let known = known.clone().chain(["preset", "file", "tilted_hexarotor", "rotors"]);
            section::check_known("key", key, known).map_err(here)?;
        }
        require(&table, "[vehicle]", &["mass", "inertia"])?;
        let rotors = match (hexarotor, list) {
            (Some(Value::Table(t)), None) => {
                Rotors::Hexarotor(read_complete(&t, "[vehicle.tilted_hexarotor]")?)
            }
            (None, Some(Value::Array(all))) => {
                let rotor = |(i, value): (usize, Value)| match value {
                    Value::Table(t) => read_complete(&t, &format!("[[vehicle.rotors]] {}", i + 1)),
                    _ => Err(ConfigError::new("[vehicle]: rotors is not a list of tables")),
                };
                Rotors::List(all.into_iter().enumerate().map(rotor).collect::<Result<_, _>>()?)
            }
            (None, None) => {
                let sentence =
                    "no rotors; expected [vehicle.tilted_hexarotor], [[vehicle.rotors]], `preset` or `file`";
                return Err(here(ConfigError::new(sentence)));
            }
            _ => {
                let sentence =
                    "expected one table [vehicle.tilted_hexarotor] or tables [[vehicle.rotors]], not both";
                return Err(here(ConfigError::new(sentence)));
            }
        };
        let body: Body = section::read(&table)?;
        for (key, place) in [("tool_position", &body.tool_position), ("imu_position", &body.imu_position)] {
            plausible::check_place(key, &place.vector()).map_err(here)?;
        }
        plausible::check_mass(body.mass).map_err(here)?;
        let vehicle = build(&body, &rotors).map_err(|e| here(e.into()))?;
        plausible::check_body(&vehicle).map_err(here)?;
        Ok(Self { body, rotors, vehicle })
    }

    /// Describes an existing vehicle, each rotor by itself.
    #[must_use]
    pub fn of(name: &str, vehicle: Vehicle, rotor_drag: RotorDrag) -> Self {
        let angles = |m: &Mounting| Axes(yaw_pitch_roll(&m.rotation_r).map(f64::to_degrees));
        let (tool, imu) = (vehicle.tool(), vehicle.imu());
        let body = Body {
            name: name.into(),
            mass: vehicle.mass(),
            inertia: Square(*vehicle.inertia()),
            rotor_time_constant: vehicle.rotor_time_constant(),
            rotor_drag: rotor_drag.drag,
            flapping: rotor_drag.flapping,
            tool_position: Axes(tool.position_r.into()),
            tool_rotation_deg: angles(tool),
            imu_position: Axes(imu.position_r.into()),
            imu_rotation_deg: angles(imu),
        };
        let rotors = vehicle.rotors().iter().map(|r| RotorSection {
            position: Axes(r.position_r.into()),
            axis: Axes(r.axis_r.into()),
            spin: r.spin,
            thrust_coefficient: r.thrust_coefficient,
            drag_coefficient: r.drag_coefficient,
            min_speed: r.min_speed,
            max_speed: r.max_speed,
        });
        Self { body, rotors: Rotors::List(rotors.collect()), vehicle }
    }

    /// A copy with some keys changed. `changes` has the keys of a `[vehicle]` table.
    ///
    /// # Errors
    /// The same as those of [`Self::from_table`].
    pub fn overlaid(&self, changes: Table) -> Result<Self, ConfigError> {
        let mut table = vehicle_of_text(&self.to_toml())?;
        if changes.contains_key("preset") || changes.contains_key("file") {
            table.clear();
        }
        for (given, replaced) in [("rotors", "tilted_hexarotor"), ("tilted_hexarotor", "rotors")] {
            if changes.contains_key(given) {
                table.remove(replaced);
            }
        }
        super::overlay(&mut table, changes);
        Self::from_table(table, Path::new(""))
    }

    /// The complete section as TOML, every key with its meaning and unit. If it is read again, it gives the same vehicle.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let mut out = String::new();
        self.print(&mut out);
        out
    }

    /// Writes the section, complete.
    pub(super) fn print(&self, out: &mut String) {
        section::print(&self.body, out);
        match &self.rotors {
            Rotors::Hexarotor(hexarotor) => section::print(hexarotor, out),
            Rotors::List(list) => {
                list.iter().for_each(|rotor| section::print_under("[[vehicle.rotors]]", rotor, out));
            }
        }
    }
}

fn preset(name: &str) -> Result<Table, ConfigError> {
    section::check_known("preset", name, PRESETS.iter().map(|p| p.0))?;
    let text = PRESETS.iter().find(|p| p.0 == name).map_or("", |p| p.1);
    vehicle_of_text(text)
}

fn table_of_file(path: &Path) -> Result<Table, ConfigError> {
    vehicle_of_text(&super::read_file(path)?).map_err(|e| e.within(path.display()))
}

fn vehicle_of_text(text: &str) -> Result<Table, ConfigError> {
    match super::parse(text)?.remove("vehicle") {
        Some(Value::Table(table)) => Ok(table),
        _ => Err(ConfigError::new("no [vehicle] section; expected one")),
    }
}

/// Adds the keys of `preset` or `file`. Keys in the table itself override them. `seen` are the files that have led to this
/// table.
fn resolve(mut table: Table, folder: &Path, seen: &mut Vec<PathBuf>) -> Result<Table, ConfigError> {
    let here = |e: ConfigError| e.within("[vehicle]");
    let (mut base, folder) = match (table.remove("preset"), table.remove("file")) {
        (None, None) => return Ok(table),
        (Some(Value::String(name)), None) => (preset(&name).map_err(here)?, folder.to_owned()),
        (None, Some(Value::String(file))) => {
            let path = folder.join(file);
            let known = path.canonicalize().unwrap_or_else(|_| path.clone());
            if seen.contains(&known) {
                let sentence =
                    format!("the files name one another in a circle: {} names itself", path.display());
                return Err(here(ConfigError::new(sentence)));
            }
            if seen.len() == MAX_CHAIN {
                let sentence = format!(
                    "the files name one another {MAX_CHAIN} times, up to {}; expected fewer",
                    path.display()
                );
                return Err(here(ConfigError::new(sentence)));
            }
            seen.push(known);
            (table_of_file(&path).map_err(here)?, path.parent().unwrap_or(Path::new("")).to_owned())
        }
        _ => return Err(here(ConfigError::new("expected one of `preset` and `file`, a text"))),
    };
    base = resolve(base, &folder, seen)?;
    // Rotors that are described in one way replace those of the other way.
    for (given, replaced) in [("rotors", "tilted_hexarotor"), ("tilted_hexarotor", "rotors")] {
        if table.contains_key(given) {
            base.remove(replaced);
        }
    }
    super::overlay(&mut base, table);
    Ok(base)
}

fn require(table: &Table, place: &str, keys: &[&str]) -> Result<(), ConfigError> {
    match keys.iter().find(|key| !table.contains_key(**key)) {
        Some(key) => Err(ConfigError::new(format!("{place}: `{key}` is missing; expected it to be given"))),
        None => Ok(()),
    }
}

/// Reads a table in which every key must be given, except for the rotor offset.
fn read_complete<S: Section>(table: &Table, place: &str) -> Result<S, ConfigError> {
    let section = section::read_at(place, table)?;
    let needed: Vec<_> = S::KEYS.iter().map(|k| k.name).filter(|k| *k != "rotor_offset").collect();
    require(table, place, &needed)?;
    Ok(section)
}

pub(super) fn mounting(position: &Axes<3>, rotation_deg: &Axes<3>) -> Mounting {
    let [roll, pitch, yaw] = rotation_deg.0.map(f64::to_radians);
    Mounting {
        position_r: position.vector(),
        rotation_r: so3::rot_z(yaw) * so3::rot_y(pitch) * so3::rot_x(roll),
    }
}

/// Roll, pitch and yaw, rad, of `Rz(yaw) Ry(pitch) Rx(roll)`.
fn yaw_pitch_roll(r: &tilthex_core::Matrix3) -> [f64; 3] {
    let pitch = (0.0 - r[(2, 0)]).clamp(-1.0, 1.0).asin();
    // At a pitch of 90 degrees only the sum of roll and yaw is known. All of it is written as yaw.
    if r[(2, 0)].abs() > 1.0 - 1e-12 {
        return [0.0, pitch, (-r[(0, 1)]).atan2(r[(1, 1)])];
    }
    [r[(2, 1)].atan2(r[(2, 2)]), pitch, r[(1, 0)].atan2(r[(0, 0)])]
}

fn build(body: &Body, rotors: &Rotors) -> Result<Vehicle, tilthex_core::Error> {
    let rotors: Vec<Rotor> = match rotors {
        Rotors::Hexarotor(h) => TiltedHexarotor {
            arm: h.arm,
            rotor_offset: h.rotor_offset.vector(),
            alpha: h.alpha_deg.to_radians(),
            beta: h.beta_deg.to_radians(),
            thrust_coefficient: h.thrust_coefficient,
            drag_coefficient: h.drag_coefficient,
            min_speed: h.min_speed,
            max_speed: h.max_speed,
        }
        .rotors()
        .to_vec(),
        Rotors::List(list) => list
            .iter()
            .map(|r| Rotor {
                position_r: r.position.vector(),
                axis_r: r.axis.vector(),
                spin: r.spin,
                thrust_coefficient: r.thrust_coefficient,
                drag_coefficient: r.drag_coefficient,
                min_speed: r.min_speed,
                max_speed: r.max_speed,
            })
            .collect(),
    };
    let tool = mounting(&body.tool_position, &body.tool_rotation_deg);
    let imu = mounting(&body.imu_position, &body.imu_rotation_deg);
    Vehicle::new(body.mass, body.inertia.0, &rotors, body.rotor_time_constant, tool, imu)
}

#[cfg(test)]
mod tests;
