//! `tilthex.Config`.

use crate::{convert, vehicle::Vehicle};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};
use tilthex_config::Config as Checked;

/// A position, (3,), and a rotation, (3, 3).
type Place<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// A checked configuration: the vehicle, and the parameters of every block.
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct Config {
    pub(crate) checked: Checked,
}

#[pymethods]
impl Config {
    /// The default configuration of a vehicle.
    #[staticmethod]
    #[pyo3(name = "default")]
    fn of_vehicle(vehicle: &Vehicle) -> Self {
        Self { checked: Checked::default_for(vehicle.section.clone()) }
    }

    /// The configuration in a TOML file.
    #[staticmethod]
    fn from_toml(path: PathBuf) -> PyResult<Self> {
        Ok(Self { checked: Checked::from_file(&path).map_err(convert::config_error)? })
    }

    /// The configuration in a text of TOML, as `to_toml` writes it.
    #[staticmethod]
    fn from_text(text: &str) -> PyResult<Self> {
        Ok(Self { checked: Checked::from_text(text, Path::new("")).map_err(convert::config_error)? })
    }

    /// A copy with some keys changed: `config.replace(admittance={"stiffness": [6, 6, 6, 10, 10, 5]})`.
    #[pyo3(signature = (**sections))]
    fn replace(&self, sections: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let changes = sections.map(|s| convert::table("config", s)).transpose()?.unwrap_or_default();
        Ok(Self { checked: self.checked.overlaid(changes).map_err(convert::config_error)? })
    }

    /// The complete configuration as TOML, every key with its meaning and unit.
    fn to_toml(&self) -> String {
        self.checked.to_toml()
    }

    /// The values of all keys: a dict for each section, with the names and units of `to_toml`. Numbers are `float` or `int`,
    /// matrices are lists of rows. Sections of it can be given to `replace`.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("tilthex._toml")?.getattr("tomllib")?.call_method1("loads", (self.checked.to_toml(),))
    }

    /// Its vehicle.
    #[getter]
    fn vehicle(&self) -> Vehicle {
        Vehicle { section: self.checked.vehicle().clone() }
    }

    /// The constant latency that is subtracted from the time of every pose, s.
    #[getter]
    fn pose_latency(&self) -> f64 {
        self.checked.estimator().latency
    }

    /// The pose of the captured body on the robot: position, m, (3,), and rotation, (3, 3).
    #[getter]
    fn captured_body<'py>(&self, py: Python<'py>) -> PyResult<Place<'py>> {
        let params = self.checked.estimator_params().map_err(convert::config_error)?;
        let rotation = convert::array2(py, &params.body_rotation_rc)?;
        Ok((convert::array1(py, params.body_position_r.as_slice()), rotation))
    }

    /// Raises `ValueError` if the rotors cannot carry the weight within their limits, in any attitude.
    fn check_hover(&self) -> PyResult<()> {
        self.checked.check_hover().map_err(convert::config_error)
    }

    /// One sentence for each pair of blocks whose poles are too close to each other.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.checked.warnings()
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.checked == other.checked
    }

    fn __hash__(&self) -> u64 {
        convert::hash(&self.to_toml())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<convert::Copied<'py>> {
        convert::copied(py, "config", self.to_toml())
    }

    fn __repr__(&self) -> String {
        format!("Config(vehicle='{}')", self.checked.vehicle().name())
    }
}
