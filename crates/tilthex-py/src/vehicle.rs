//! `tilthex.Vehicle`.

use crate::{
    convert::{self, array1, array2},
    setpoint::{Reference, Setpoint},
};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};
use tilthex_config::{PRESETS, VehicleSection};
use tilthex_core::{
    Matrix3,
    admittance::centre_of_mass_reference,
    wrench_observer::{robot_wrench, tool_wrench},
};

/// A validated vehicle: mass, rotors, tool and IMU; (3)-(10).
#[pyclass(frozen, module = "tilthex", from_py_object)]
#[derive(Clone)]
pub(crate) struct Vehicle {
    pub(crate) section: VehicleSection,
}

impl Vehicle {
    pub(crate) fn core(&self) -> &tilthex_core::Vehicle {
        self.section.vehicle()
    }
}

#[pymethods]
impl Vehicle {
    /// The preset with this name; `Vehicle.presets()` lists the names.
    #[staticmethod]
    fn preset(name: &str) -> PyResult<Self> {
        Ok(Self { section: VehicleSection::preset(name).map_err(convert::config_error)? })
    }

    /// A preset by its name, or the vehicle in a file whose name ends in `.toml`.
    #[staticmethod]
    fn named(name: &str) -> PyResult<Self> {
        if name.ends_with(".toml") { Self::from_toml(PathBuf::from(name)) } else { Self::preset(name) }
    }

    /// The names of the presets.
    #[staticmethod]
    fn presets() -> Vec<&'static str> {
        PRESETS.iter().map(|p| p.0).collect()
    }

    /// The vehicle in the `[vehicle]` section of a TOML file.
    #[staticmethod]
    fn from_toml(path: PathBuf) -> PyResult<Self> {
        Ok(Self { section: VehicleSection::from_file(&path).map_err(convert::config_error)? })
    }

    /// The vehicle of a dict with the keys of a TOML file's `[vehicle]` section.
    #[staticmethod]
    fn from_dict(keys: &Bound<'_, PyDict>) -> PyResult<Self> {
        let table = convert::table("keys", keys)?;
        Ok(Self { section: VehicleSection::from_table(table, Path::new("")).map_err(convert::config_error)? })
    }

    /// The name of the vehicle.
    #[getter]
    fn name(&self) -> &str {
        self.section.name()
    }

    /// Mass of the vehicle with its tool, kg.
    #[getter]
    fn mass(&self) -> f64 {
        self.core().mass()
    }

    /// Weight of vehicle and tool, N.
    #[getter]
    fn weight(&self) -> f64 {
        self.core().weight()
    }

    /// Inertia about the centre of mass, robot frame, kg m^2, (3, 3).
    #[getter]
    fn inertia<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.core().inertia())
    }

    /// Allocation matrix, (6, n): body wrench = A u with u = w |w|, w in Hz; (8)-(9).
    #[getter]
    fn allocation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let count = self.core().rotor_count();
        let rows = self.core().allocation().row_iter();
        let numbers: Vec<f64> =
            rows.flat_map(|row| row.iter().take(count).copied().collect::<Vec<_>>()).collect();
        array1(py, &numbers).reshape([6, count])
    }

    /// Position of the tool tip from the centre of mass, robot frame, m, (3,).
    #[getter]
    fn tool_position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.core().tool().position_r.as_slice())
    }

    /// Maps tool coordinates to robot coordinates, (3, 3).
    #[getter]
    fn tool_rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, &self.core().tool().rotation_r)
    }

    /// Position of the IMU from the centre of mass, robot frame, m, (3,).
    #[getter]
    fn imu_position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.core().imu().position_r.as_slice())
    }

    /// Maps IMU coordinates to robot coordinates, (3, 3).
    #[getter]
    fn imu_rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, &self.core().imu().rotation_r)
    }

    /// Number of rotors, n.
    #[getter]
    fn rotor_count(&self) -> usize {
        self.core().rotor_count()
    }

    /// Lowest and highest speed of each rotor, Hz, (n, 2).
    #[getter]
    fn rotor_speed_limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rotors = self.core().rotors();
        let limits: Vec<f64> = rotors.iter().flat_map(|r| [r.min_speed, r.max_speed]).collect();
        array1(py, &limits).reshape([rotors.len(), 2])
    }

    /// Each rotor as a dict of the keys of `[[vehicle.rotors]]`: `position`, m, and `axis` in robot coordinates,
    /// `spin`, `thrust_coefficient`, N/Hz^2, `drag_coefficient`, N m/Hz^2, `min_speed` and `max_speed`, Hz.
    #[getter]
    fn rotors<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let rotor = |r: &tilthex_core::Rotor| {
            let keys = PyDict::new(py);
            keys.set_item("position", <[f64; 3]>::from(r.position_r))?;
            keys.set_item("axis", <[f64; 3]>::from(r.axis_r))?;
            keys.set_item("spin", r.spin)?;
            keys.set_item("thrust_coefficient", r.thrust_coefficient)?;
            keys.set_item("drag_coefficient", r.drag_coefficient)?;
            keys.set_item("min_speed", r.min_speed)?;
            keys.set_item("max_speed", r.max_speed)?;
            Ok(keys)
        };
        self.core().rotors().iter().map(rotor).collect()
    }

    /// The complete `[vehicle]` section as TOML, every key with its meaning and unit. `from_toml` reads it.
    fn to_toml(&self) -> String {
        self.section.to_toml()
    }

    /// A copy with some keys changed: `vehicle.replace(mass=2.5, tool_position=[0.1, 0.0, -0.4])`.
    #[pyo3(signature = (**keys))]
    fn replace(&self, keys: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let table = keys.map_or_else(|| Ok(toml::Table::new()), |k| convert::table("keys", k))?;
        Ok(Self { section: self.section.overlaid(table).map_err(convert::config_error)? })
    }

    /// What the vehicle can track, by the rank of the allocation matrix: "position and attitude" (6),
    /// "position, heading and the tilt about one axis" (5), "position and heading" (4).
    #[getter]
    fn tracks(&self) -> &'static str {
        self.core().actuation().name()
    }

    /// Time constant of the rotor speed's first-order lag, s.
    #[getter]
    fn rotor_time_constant(&self) -> f64 {
        self.core().rotor_time_constant()
    }

    /// Drag of the rotors: force against the airspeed in a rotor's disc, N s/m per Hz of its speed.
    #[getter]
    fn rotor_drag(&self) -> f64 {
        self.section.rotor_drag().drag
    }

    /// Flapping of the rotors: torque that lifts the leading edge of a rotor's disc, N m s/m per Hz of its speed.
    #[getter]
    fn flapping(&self) -> f64 {
        self.section.rotor_drag().flapping
    }

    /// Rotor speeds, Hz, (n,), that hold the vehicle still at an orientation
    /// `R_WR` without contact, before any limit.
    #[pyo3(signature = (rotation=None))]
    fn hover_speeds<'py>(
        &self,
        py: Python<'py>,
        rotation: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let r = rotation.map_or(Ok(Matrix3::identity()), |r| convert::rotation("rotation", r))?;
        Ok(array1(py, &self.core().hover_speeds(&r).as_slice()[..self.core().rotor_count()]))
    }

    /// The wrench at the tool tip, world, (6,), that is equal to a wrench at the centre of mass (force in world,
    /// torque in robot coordinates) at an orientation `R_WR`; (25).
    fn tool_wrench<'py>(
        &self,
        wrench: &Bound<'py, PyAny>,
        rotation: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (w, r) = (convert::wrench("wrench", wrench)?, convert::rotation("rotation", rotation)?);
        Ok(convert::wrench_array(wrench.py(), &tool_wrench(&w, &r, &self.core().tool().position_r)))
    }

    /// The wrench at the centre of mass, (6,), that is equal to a wrench at the tool tip, world; (18).
    fn robot_wrench<'py>(
        &self,
        wrench: &Bound<'py, PyAny>,
        rotation: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (w, r) = (convert::wrench("wrench", wrench)?, convert::rotation("rotation", rotation)?);
        Ok(convert::wrench_array(wrench.py(), &robot_wrench(&w, &r, &self.core().tool().position_r)))
    }

    /// The reference of the centre of mass that follows from a reference of the tool; (29)-(30).
    fn robot_reference(&self, reference: &Setpoint) -> Reference {
        Reference(centre_of_mass_reference(&reference.0, self.core().tool()))
    }

    /// The vehicle as a MuJoCo model, XML text: rotors as actuators with u = w |w|, Hz^2, as control.
    ///
    /// It calls `tilthex.mjcf.to_mjcf`, which can also place the vehicle in a world.
    fn to_mjcf(this: Bound<'_, Self>) -> PyResult<String> {
        this.py().import("tilthex.mjcf")?.call_method1("to_mjcf", (this,))?.extract()
    }

    /// The body wrenches that the rotors can produce within their limits, or a section of them.
    ///
    /// It calls `tilthex.polytope.wrench_polytope` with these arguments.
    #[pyo3(signature = (hover=false, fix=None, lost=None, rotation=None))]
    fn wrench_polytope<'py>(
        this: Bound<'py, Self>,
        hover: bool,
        fix: Option<Bound<'py, PyAny>>,
        lost: Option<Bound<'py, PyAny>>,
        rotation: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = this.py();
        let arguments = PyDict::new(py);
        arguments.set_item("hover", hover)?;
        arguments.set_item("fix", fix)?;
        arguments.set_item("rotation", rotation)?;
        if let Some(lost) = lost {
            arguments.set_item("lost", lost)?;
        }
        py.import("tilthex.polytope")?.call_method("wrench_polytope", (this,), Some(&arguments))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.section == other.section
    }

    fn __hash__(&self) -> u64 {
        convert::hash(&self.to_toml())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<convert::Copied<'py>> {
        convert::copied(py, "vehicle", self.to_toml())
    }

    fn __repr__(&self) -> String {
        let v = self.core();
        let (name, mass, rotors) = (self.name(), v.mass(), v.rotor_count());
        format!("Vehicle('{name}', mass={mass} kg, {rotors} rotors, tracks {})", v.actuation().name())
    }
}
