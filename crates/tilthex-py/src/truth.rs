//! `tilthex.Truth`, and the vehicle that is drawn from it.

use crate::{
    convert::{self, array1},
    effects::{Effects, SensorErrors},
    vehicle::Vehicle,
};
use numpy::PyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use tilthex_config::{TrueVehicle, TruthSection};
use tilthex_core::{
    RobotState, RotorVector, Vector3,
    plant::{EffectsState, Plant as PlantBlock, PlantState, SensorParams, Sensors},
};

/// How the simulated vehicle differs from the model of the controller.
#[pyclass(frozen, module = "tilthex")]
#[derive(Clone)]
pub(crate) struct Truth {
    model: Vehicle,
    section: TruthSection,
}

/// The `[truth]` table of an argument: nothing, a level, the path of a TOML file, or a dict.
pub(crate) fn section(truth: Option<&Bound<'_, PyAny>>) -> PyResult<TruthSection> {
    let Some(given) = truth else { return Ok(TruthSection::default()) };
    if let Ok(dict) = given.cast::<PyDict>() {
        return TruthSection::from_table(convert::table("truth", dict)?).map_err(convert::config_error);
    }
    if let Ok(whole) = given.cast::<Truth>() {
        return Ok(whole.get().section.clone());
    }
    if let Ok(name) = given.extract::<String>() {
        return TruthSection::named(&name).map_err(convert::config_error);
    }
    if let Ok(path) = given.extract::<PathBuf>() {
        return TruthSection::from_file(&path).map_err(convert::config_error);
    }
    let kind = given.get_type().name()?;
    let sentence = format!("truth is a {kind}; expected a level such as 'measured', a TOML file, or a dict");
    Err(PyTypeError::new_err(sentence))
}

impl Truth {
    pub(crate) fn of(model: Vehicle, section: TruthSection) -> Self {
        Self { model, section }
    }
}

#[pymethods]
impl Truth {
    #[new]
    #[pyo3(signature = (vehicle, truth=None))]
    fn new(vehicle: &Vehicle, truth: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        Ok(Self { model: vehicle.clone(), section: section(truth)? })
    }

    /// The truth in the output of `to_toml`.
    #[staticmethod]
    fn from_text(vehicle: &Vehicle, text: &str) -> PyResult<Self> {
        let section = TruthSection::from_text(text).map_err(convert::config_error)?;
        Ok(Self { model: vehicle.clone(), section })
    }

    /// The complete `[truth]` table as TOML, without its vehicle.
    fn to_toml(&self) -> String {
        self.section.to_toml()
    }

    /// The vehicle of the controller, from which the true one differs.
    #[getter]
    fn vehicle(&self) -> Vehicle {
        self.model.clone()
    }

    /// The names of the levels.
    #[staticmethod]
    fn levels() -> Vec<&'static str> {
        tilthex_config::truth::LEVELS.iter().map(|l| l.0).collect()
    }

    /// The name of the truth.
    #[getter]
    fn name(&self) -> &str {
        self.section.name()
    }

    /// Draws a vehicle with a seed.
    fn draw(&self, seed: &Bound<'_, PyAny>) -> PyResult<Drawn> {
        let seed = convert::seed(seed)?;
        let is = self.section.draw(&self.model.section, seed).map_err(convert::config_error)?;
        Ok(Drawn { is, truth: self.clone() })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Vehicle, String))> {
        Ok((py.get_type::<Self>().getattr("from_text")?, (self.model.clone(), self.to_toml())))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.model.section == other.model.section && self.section == other.section
    }

    fn __hash__(&self) -> u64 {
        convert::hash(&self.to_toml())
    }

    fn __repr__(&self) -> String {
        format!("Truth(vehicle='{}', '{}')", self.model.section.name(), self.section.name())
    }
}

/// The properties that were drawn for one seed: the vehicle, the effects on it, its sensors and delays.
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct Drawn {
    pub(crate) is: TrueVehicle,
    truth: Truth,
}

#[pymethods]
impl Drawn {
    /// The seed with which it was drawn.
    #[getter]
    fn seed(&self) -> u64 {
        self.is.seed
    }

    /// The true vehicle.
    #[getter]
    fn vehicle(&self) -> Vehicle {
        Vehicle { section: self.is.vehicle.clone() }
    }

    /// The true centre of mass in the model's robot frame, m, (3,).
    #[getter]
    fn centre_of_mass<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.is.centre_of_mass_r.as_slice())
    }

    /// The effects on the vehicle, at its start, with the gusts of the seed.
    fn effects(&self) -> Effects {
        let block = self.is.effects;
        let vehicle = *self.is.vehicle.vehicle();
        Effects { vehicle, block, state: EffectsState::new(&block, self.is.seed) }
    }

    /// The errors of its sensors, apart from noise, at its start.
    fn sensor_errors(&self) -> SensorErrors {
        let params = self.is.sensors(&SensorParams::IDEAL);
        let noiseless = SensorParams {
            gyro_bias_i: params.gyro_bias_i,
            accelerometer_bias_i: params.accelerometer_bias_i,
            gyro_scale_i: params.gyro_scale_i,
            gyro_misalignment_i: params.gyro_misalignment_i,
            vibration: params.vibration,
            captured_r: params.captured_r,
            rotor_speed_age: params.rotor_speed_age,
            ..SensorParams::IDEAL
        };
        SensorErrors {
            plant: PlantBlock::new(*self.is.vehicle.vehicle()),
            state: PlantState::new(RobotState::at_rest(Vector3::zeros()), RotorVector::zeros()),
            params: noiseless,
            sensors: Sensors::new(noiseless, self.is.seed),
        }
    }

    /// Noise and delays that the truth sets, as a dict: `position`, `orientation`, `gyro`, `accelerometer`,
    /// `rotor_speed`, `pose_delay`, `pose_jitter`. For a missing key the simulating program uses its own value.
    #[getter]
    fn noise<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let unset = SensorParams {
            position: f64::NAN,
            orientation: f64::NAN,
            gyro: f64::NAN,
            accelerometer: f64::NAN,
            rotor_speed: f64::NAN,
            ..SensorParams::IDEAL
        };
        let s = self.is.sensors(&unset);
        let out = PyDict::new(py);
        for (name, value) in [
            ("position", s.position),
            ("orientation", s.orientation),
            ("gyro", s.gyro),
            ("accelerometer", s.accelerometer),
            ("rotor_speed", s.rotor_speed),
            ("pose_delay", self.is.delays.pose.unwrap_or(f64::NAN)),
            ("pose_jitter", self.is.delays.pose_jitter.unwrap_or(f64::NAN)),
        ] {
            if !value.is_nan() {
                out.set_item(name, value)?;
            }
        }
        Ok(out)
    }

    /// Stiffness, N/m, and length, m, of the tool's rod. A stiffness of 0 stands for a rigid rod.
    #[getter]
    fn rod(&self) -> (f64, f64) {
        (self.is.effects.rod.stiffness, self.is.effects.rod.length)
    }

    /// The drawn properties as TOML: the vehicle and every section, each key with its meaning and unit.
    fn to_toml(&self) -> String {
        self.is.to_toml()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Truth, u64))> {
        Ok((py.import("tilthex._copied")?.getattr("drawn")?, (self.truth.clone(), self.is.seed)))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.is == other.is && self.truth.__eq__(&other.truth)
    }

    fn __hash__(&self) -> u64 {
        self.is.seed
    }

    fn __repr__(&self) -> String {
        let v = self.is.vehicle.vehicle();
        format!("Drawn(vehicle='{}', seed={}, mass={:.4} kg)", self.is.vehicle.name(), self.is.seed, v.mass())
    }
}
