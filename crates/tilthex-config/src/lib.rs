//! Configuration: one TOML file describes the vehicle and how it is flown.
//!
//! Each section is declared once, with `section!`, which makes its struct, its defaults, its list of keys and the comments of
//! the printed file. To add a key, add a line to its section.

mod control;
mod estimator;
pub mod files;
mod flight;
pub mod margins;
pub mod orders;
mod plausible;
mod retired;
mod section;
mod sections;
mod time_scales;
pub mod truth;
mod values;
mod vehicle;

pub use control::{
    AdmittanceSection, AllocationSection, AttitudeSection, ContactSection, PoseControlSection,
    WrenchObserverSection,
};
pub use estimator::EstimatorSection;
pub use section::{ConfigError, Described, Key, Section, one_line};
pub use sections::{LinkSection, LogSection, MissionSection, MocapSection, OrdersSection, SupervisorSection};
use std::path::Path;
use tilthex_core::{controller::ControllerParams, flight::Flight};
use toml::{Table, Value};
pub use truth::{TrueVehicle, TruthSection};
pub use values::{Axes, Square};
pub use vehicle::{PRESETS, VehicleSection};

/// Applies a macro to every section but the vehicle's: field, type.
macro_rules! each_section {
    ($apply:ident) => {
        $apply! {
            pose_control: PoseControlSection,
            wrench_observer: WrenchObserverSection,
            admittance: AdmittanceSection,
            contact: ContactSection,
            allocation: AllocationSection,
            attitude: AttitudeSection,
            estimator: EstimatorSection,
            link: LinkSection,
            mocap: MocapSection,
            mission: MissionSection,
            supervisor: SupervisorSection,
            orders: OrdersSection,
            log: LogSection,
        }
    };
}

/// Declares [`Config`]: a field and a getter for each section. All changes are made by [`Config::overlaid`], so that the values
/// that are derived from the sections are always up to date.
macro_rules! config {
    ($($name:ident: $section:ty,)*) => {
        /// A checked configuration.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Config {
            vehicle: VehicleSection,
            $( $name: $section, )*
            controller: ControllerParams,
            /// The warnings about keys that no longer exist.
            retired: Vec<String>,
        }

        impl Config {
            $(
                #[doc = concat!("The section `[", stringify!($name), "]`.")]
                #[must_use]
                pub fn $name(&self) -> &$section {
                    &self.$name
                }
            )*
        }
    };
}
each_section!(config);

impl Config {
    /// The default configuration of a vehicle.
    ///
    /// # Panics
    /// Never: a test shows that every vehicle accepts the defaults.
    #[must_use]
    pub fn default_for(vehicle: VehicleSection) -> Self {
        Self::complete(vehicle, Table::new()).expect("the defaults hold for every vehicle")
    }

    /// Reads a TOML file.
    ///
    /// # Errors
    /// One sentence with the file, the section and the key.
    pub fn from_file(path: &Path) -> Result<Self, ConfigError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::from_text(&read_file(path)?, folder).map_err(|e| e.within(path.display()))
    }

    /// Reads TOML. The paths of files that it names are relative to `folder`.
    ///
    /// # Errors
    /// One sentence with the section and the key.
    pub fn from_text(text: &str, folder: &Path) -> Result<Self, ConfigError> {
        let mut table = parse(text)?;
        match table.remove("vehicle") {
            Some(Value::Table(vehicle)) => {
                Self::complete(VehicleSection::from_table(vehicle, folder)?, table)
            }
            _ => Err(ConfigError::new(
                "no [vehicle] section; expected one, for example with preset = \"tilt-hex\"",
            )),
        }
    }

    /// A copy with some keys changed. `changes` has the tables and keys of a file.
    ///
    /// # Errors
    /// The same as those of [`Self::from_text`].
    pub fn overlaid(&self, changes: Table) -> Result<Self, ConfigError> {
        let mut table = parse(&self.to_toml())?;
        // Another vehicle replaces this one completely. Further keys in the table belong to the new vehicle.
        if let Some(Value::Table(vehicle)) = changes.get("vehicle")
            && (vehicle.contains_key("preset") || vehicle.contains_key("file"))
        {
            table.remove("vehicle");
        }
        overlay(&mut table, changes);
        match table.remove("vehicle") {
            Some(Value::Table(vehicle)) => {
                let vehicle = VehicleSection::from_table(vehicle, Path::new(""))?;
                let mut config = Self::complete(vehicle, table)?;
                config.retired.extend(self.retired.iter().cloned());
                Ok(config)
            }
            _ => Err(ConfigError::new("vehicle is not a table; expected its keys")),
        }
    }

    fn complete(vehicle: VehicleSection, mut table: Table) -> Result<Self, ConfigError> {
        let retired = retired::take(&mut table);
        macro_rules! names {
            ($($name:ident: $section:ty,)*) => { ["vehicle", $(stringify!($name)),*] };
        }
        for name in table.keys() {
            section::check_known("section", name, each_section!(names))?;
        }
        let mut defaults = control::defaults(vehicle.vehicle(), &table)?;
        overlay(&mut defaults, table);
        let mut table = defaults;
        let pose_control = section::take(&mut table)?;
        let wrench_observer = section::take(&mut table)?;
        let admittance = section::take(&mut table)?;
        let contact = section::take(&mut table)?;
        let allocation = section::take(&mut table)?;
        let attitude = section::take(&mut table)?;
        let controller = control::ControllerSections {
            pose: &pose_control,
            observer: &wrench_observer,
            admittance: &admittance,
            contact: &contact,
            allocation: &allocation,
            attitude: &attitude,
            rotor_drag: vehicle.rotor_drag(),
        }
        .checked(vehicle.vehicle())?;
        let config = Self {
            vehicle,
            pose_control,
            wrench_observer,
            admittance,
            contact,
            allocation,
            attitude,
            estimator: section::take(&mut table)?,
            link: section::take(&mut table)?,
            mocap: section::take(&mut table)?,
            mission: section::take(&mut table)?,
            supervisor: section::take(&mut table)?,
            orders: section::take(&mut table)?,
            log: section::take(&mut table)?,
            controller,
            retired,
        };
        Flight::new(config.flight_params(false)?, None)?;
        config.check_latency()?;
        config.check_line(config.link.params()?)?;
        Ok(config)
    }

    /// The complete effective configuration as TOML, every key with its meaning and unit. If it is read again, it gives the
    /// same configuration.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let mut out = String::new();
        self.vehicle.print(&mut out);
        macro_rules! print {
            ($($name:ident: $section:ty,)*) => { $( section::print(&self.$name, &mut out); )* };
        }
        each_section!(print);
        out
    }

    /// The vehicle.
    #[must_use]
    pub fn vehicle(&self) -> &VehicleSection {
        &self.vehicle
    }

    /// The controller's parameters.
    #[must_use]
    pub fn controller(&self) -> &ControllerParams {
        &self.controller
    }

    /// One sentence for each pair of blocks whose poles are too close, for a spring without a potential, for numbers
    /// that are probably in another unit, and for keys that no longer exist.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = self.retired.clone();
        warnings.extend(plausible::questions(self.vehicle.vehicle()));
        warnings.extend(margins::warning(&margins::LoopModel::of(self)));
        warnings.extend(time_scales::warnings(&self.controller));
        warnings.extend(control::spring_warning(&self.controller));
        warnings
    }
}

/// Every section of a configuration and of a `[truth]` table, for the documentation.
#[must_use]
pub fn described() -> Vec<Described> {
    macro_rules! all {
        ($($name:ident: $section:ty,)*) => { vec![$( Described::of::<$section>() ),*] };
    }
    [vehicle::described(), each_section!(all), truth::described()].concat()
}

fn read_file(path: &Path) -> Result<String, ConfigError> {
    files::read_text(path)
        .map_err(|e| ConfigError::new(format!("cannot read the file {}: {e}", path.display())))
}

/// Parses TOML; an error says the line.
fn parse(text: &str) -> Result<Table, ConfigError> {
    text.parse().map_err(|error: toml::de::Error| {
        let line = error.span().map_or(1, |span| 1 + text[..span.start].matches('\n').count());
        ConfigError::new(format!("line {line}: {}", section::one_line(error.message())))
    })
}

/// Replaces the keys of `base` by those of `upper`, table by table.
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

#[cfg(test)]
mod tests;
