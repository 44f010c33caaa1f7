//! The `[truth]` table: the differences between the simulated vehicle and the controller's model.
//!
//! ```toml
//! [truth]
//! level = "measured"            # the values of all other keys: "exact", "measured", "cad", "outdoors"
//! [truth.vehicle]               # any key of [vehicle]
//! mass = { mean = 2.5, std = 0.05 }
//! [truth.aerodynamics]
//! wind_speed = 3.0
//! ```
//!
//! The controller does not know this table. For each seed, a vehicle is drawn from it.

mod draw;
mod levels;
mod sections;
mod spread;

use super::{
    section::{self, ConfigError, Described, Section},
    vehicle::VehicleSection,
};
pub use levels::LEVELS;
pub use sections::{AerodynamicsSection, DelaysSection, ErrorSection, SensorsSection, StructureSection};
pub use spread::Spread;
use std::path::Path;
use tilthex_core::{
    Vector3,
    plant::{Battery, BodyDrag, Effects, Plant, Rod, RotorDrag, SensorParams, Surface, Wind},
    so3,
};
use toml::{Table, Value};

/// Its sections, for the documentation.
pub(super) fn described() -> Vec<Described> {
    vec![
        Described::of::<ErrorSection>(),
        Described::of::<AerodynamicsSection>(),
        Described::of::<StructureSection>(),
        Described::of::<SensorsSection>(),
        Described::of::<DelaysSection>(),
    ]
}

/// A checked `[truth]` table. It does not belong to a vehicle yet.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthSection {
    name: String,
    vehicle: Table,
    errors: ErrorSection,
    aerodynamics: Table,
    structure: Table,
    sensors: Table,
    delays: Table,
}

/// The true vehicle for one seed.
#[derive(Clone, Debug, PartialEq)]
pub struct TrueVehicle {
    /// The seed it was drawn with.
    pub seed: u64,
    /// The true vehicle.
    pub vehicle: VehicleSection,
    /// Its centre of mass in the model's robot frame, m.
    pub centre_of_mass_r: Vector3,
    /// What acts on it in addition to rotors and weight.
    pub effects: Effects,
    /// Its delays.
    pub delays: DelaysSection,
    aerodynamics: AerodynamicsSection,
    structure: StructureSection,
    sensors: SensorsSection,
}

impl Default for TruthSection {
    /// The model is exact.
    fn default() -> Self {
        Self {
            name: "exact".into(),
            vehicle: Table::new(),
            errors: ErrorSection::default(),
            aerodynamics: Table::new(),
            structure: Table::new(),
            sensors: Table::new(),
            delays: Table::new(),
        }
    }
}

impl TruthSection {
    /// One of [`LEVELS`], or the `[truth]` of a TOML file.
    ///
    /// # Errors
    /// Names the error, and the levels that exist.
    pub fn named(name: &str) -> Result<Self, ConfigError> {
        if name.ends_with(".toml") {
            Self::from_file(Path::new(name))
        } else {
            Self::from_table(levels::level(name)?)
        }
    }

    /// The `[truth]` of a TOML file.
    ///
    /// # Errors
    /// Says what is wrong, with the file's name.
    pub fn from_file(path: &Path) -> Result<Self, ConfigError> {
        let read = || {
            let mut found = Self::from_text(&super::read_file(path)?)?;
            found.name = path.display().to_string();
            Ok(found)
        };
        read().map_err(|e: ConfigError| e.within(path.display()))
    }

    /// The `[truth]` of a text of TOML.
    ///
    /// # Errors
    /// Says what is wrong.
    pub fn from_text(text: &str) -> Result<Self, ConfigError> {
        Self::from_table(levels::truth_of_text(text)?)
    }

    /// The complete table as TOML, from which [`from_text`](Self::from_text) reads the same.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let mut table = Table::new();
        table.insert("name".into(), Value::String(self.name.clone()));
        let errors = Table::try_from(&self.errors).expect("numbers and tables of them are TOML");
        let parts = [
            ("vehicle", &self.vehicle),
            ("error", &errors),
            ("aerodynamics", &self.aerodynamics),
            ("structure", &self.structure),
            ("sensors", &self.sensors),
            ("delays", &self.delays),
        ];
        for (key, part) in parts {
            table.insert(key.into(), Value::Table(part.clone()));
        }
        let mut whole = Table::new();
        whole.insert("truth".into(), Value::Table(table));
        whole.to_string()
    }

    /// Reads the table.
    ///
    /// # Errors
    /// Names the error and the key.
    pub fn from_table(table: Table) -> Result<Self, ConfigError> {
        let named = table.get("level").and_then(Value::as_str).unwrap_or("exact").to_owned();
        let alone = table.len() == usize::from(table.contains_key("level"));
        let mut table = levels::resolve(table, 0)?;
        let name = match table.remove("name") {
            Some(Value::String(name)) => name,
            _ if alone => named,
            _ => format!("{named} with own keys"),
        };
        let known = ["level", "name", "vehicle", "error", "aerodynamics", "structure", "sensors", "delays"];
        for key in table.keys() {
            section::check_known("key", key, known).map_err(|e| e.within("[truth]"))?;
        }
        let mut take = |key: &str| match table.remove(key) {
            None => Ok(Table::new()),
            Some(Value::Table(t)) => Ok(t),
            Some(other) => Err(ConfigError::new(format!(
                "[truth.{key}]: found an {}; expected a table",
                other.type_str()
            ))),
        };
        let errors: ErrorSection = section::read(&take("error")?)?;
        check_errors(&errors)?;
        let section = Self {
            name,
            vehicle: take("vehicle")?,
            errors,
            aerodynamics: take("aerodynamics")?,
            structure: take("structure")?,
            sensors: take("sensors")?,
            delays: take("delays")?,
        };
        // Every draw checks its values. This draw finds wrong keys and shapes before a flight.
        section.drawn_sections(0)?;
        Ok(section)
    }

    /// Its name: its level, its file, or its key `name`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The true vehicle of a model for a seed.
    ///
    /// # Errors
    /// Names the impossible value of the draw.
    pub fn draw(&self, model: &VehicleSection, seed: u64) -> Result<TrueVehicle, ConfigError> {
        let (aerodynamics, structure, sensors, delays) = self.drawn_sections(seed)?;
        let keys = spread::drawn(&self.vehicle, "truth.vehicle", seed)?;
        let base = if keys.is_empty() { model.clone() } else { model.overlaid(keys)? };
        let (vehicle, centre_of_mass_r) =
            draw::vehicle(&self.errors, base.vehicle(), seed).map_err(|e| self.refused(seed, e))?;
        let effects = effects(&aerodynamics, &structure, base.rotor_drag());
        effects.check().map_err(|e| self.refused(seed, e))?;
        let vehicle = if vehicle == *base.vehicle() {
            base
        } else {
            VehicleSection::of(model.name(), vehicle, base.rotor_drag())
        };
        let drawn = TrueVehicle {
            seed,
            vehicle,
            centre_of_mass_r,
            effects,
            delays,
            aerodynamics,
            structure,
            sensors,
        };
        drawn.sensors(&SensorParams::IDEAL).check().map_err(|e| self.refused(seed, e))?;
        for (name, value) in [("pose", drawn.delays.pose), ("pose_jitter", drawn.delays.pose_jitter)] {
            tilthex_core::error::check_range(name, value.unwrap_or(0.0), 0.0, 0.25)
                .map_err(|e| self.refused(seed, e))?;
        }
        Ok(drawn)
    }

    fn refused(&self, seed: u64, error: tilthex_core::Error) -> ConfigError {
        ConfigError::from(error).within(format!("[truth] {}, seed {seed}", self.name))
    }

    fn drawn_sections(
        &self,
        seed: u64,
    ) -> Result<(AerodynamicsSection, StructureSection, SensorsSection, DelaysSection), ConfigError> {
        fn read<S: Section>(table: &Table, seed: u64) -> Result<S, ConfigError> {
            for key in table.keys() {
                section::check_known("key", key, S::KEYS.iter().map(|k| k.name))
                    .map_err(|e| e.within(format!("[{}]", S::NAME)))?;
            }
            section::read(&spread::drawn(table, S::NAME, seed)?)
        }
        Ok((
            read(&self.aerodynamics, seed)?,
            read(&self.structure, seed)?,
            read(&self.sensors, seed)?,
            read(&self.delays, seed)?,
        ))
    }
}

impl TrueVehicle {
    /// The simulated body of this vehicle, with all that acts on it.
    ///
    /// # Errors
    /// Never for a drawn vehicle, because its effects were checked.
    pub fn plant(&self) -> Result<Plant, tilthex_core::Error> {
        Plant::with_effects(*self.vehicle.vehicle(), self.effects)
    }

    /// The sensors of this vehicle for a program whose sensors have the parameters `own`. Noise in `[truth.sensors]` replaces
    /// the noise of `own`; biases, scales and misalignments are added. The captured point stays on the airframe.
    #[must_use]
    pub fn sensors(&self, own: &SensorParams) -> SensorParams {
        let s = &self.sensors;
        SensorParams {
            position: s.position.unwrap_or(own.position),
            orientation: s.orientation.unwrap_or(own.orientation),
            gyro: s.gyro.unwrap_or(own.gyro),
            accelerometer: s.accelerometer.unwrap_or(own.accelerometer),
            rotor_speed: s.rotor_speed.unwrap_or(own.rotor_speed),
            gyro_bias_i: own.gyro_bias_i + s.gyro_bias.vector(),
            accelerometer_bias_i: own.accelerometer_bias_i + s.accelerometer_bias.vector(),
            gyro_scale_i: own.gyro_scale_i + s.gyro_scale.vector(),
            gyro_misalignment_i: own.gyro_misalignment_i + s.gyro_misalignment.vector(),
            vibration: own.vibration + s.vibration,
            captured_r: own.captured_r - self.centre_of_mass_r,
            rotor_speed_age: own.rotor_speed_age + self.delays.rotor_speeds,
        }
    }

    /// The power of the battery's voltage with which the speed at a throttle grows; `None` for that of the link.
    #[must_use]
    pub fn throttle_exponent(&self) -> Option<f64> {
        self.structure.throttle_exponent
    }

    /// The drawn values as TOML: the vehicle and every section, each key with its meaning and unit.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let mut out = format!("# Drawn with seed {}.\n\n", self.seed);
        self.vehicle.print(&mut out);
        section::print(&self.aerodynamics, &mut out);
        section::print(&self.structure, &mut out);
        section::print(&self.sensors, &mut out);
        section::print(&self.delays, &mut out);
        out
    }
}

fn effects(a: &AerodynamicsSection, s: &StructureSection, rotors: RotorDrag) -> Effects {
    let direction = |degrees: f64| so3::rot_z(degrees.to_radians()) * Vector3::x();
    let ground = a.ground.map(|height| Surface { normal_w: Vector3::z(), offset: height });
    // The normal of the wall points towards the vehicle.
    let wall =
        a.wall.map(|distance| Surface { normal_w: -direction(a.wall_direction_deg), offset: -distance });
    Effects {
        air_density: a.air_density,
        wind: Wind {
            mean_w: a.wind_speed * direction(a.wind_direction_deg) + a.wind_up * Vector3::z(),
            gust_deviation: a.gust_deviation,
            gust_length: a.gust_length,
            begin: a.wind_begin,
        },
        rotor_drag: RotorDrag {
            drag: a.rotor_drag.unwrap_or(rotors.drag),
            flapping: a.flapping.unwrap_or(rotors.flapping),
        },
        body_drag: BodyDrag { area_r: a.drag_area.vector(), centre_r: a.centre_of_pressure.vector() },
        rotor_radius: a.rotor_radius,
        surfaces: [ground, wall],
        rotor_inertia: s.rotor_inertia,
        throttle_voltage: s.throttle_voltage,
        battery: Battery::new(s.battery_capacity, s.battery_charge),
        rod: Rod { stiffness: s.tool_stiffness, length: s.tool_length },
    }
}

fn check_errors(errors: &ErrorSection) -> Result<(), ConfigError> {
    let ErrorSection {
        mass,
        thrust,
        thrust_each,
        drag_moment,
        rotor_axis_deg,
        centre_of_mass,
        inertia,
        rotor_lag,
        tool_tip,
    } = errors;
    let all = [
        mass,
        thrust,
        thrust_each,
        drag_moment,
        rotor_axis_deg,
        centre_of_mass,
        inertia,
        rotor_lag,
        tool_tip,
    ];
    for (key, spread) in ErrorSection::KEYS.iter().zip(all) {
        spread.check().map_err(|e| e.within(format!("[truth.error] {}", key.name)))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
