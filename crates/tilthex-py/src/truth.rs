//! `tilthex.Truth`, and the vehicle that is drawn from it.

use crate::{
    convert::{self, array1},
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
    plant::{
        Effects as EffectsBlock, EffectsState, ImuSample, Plant as PlantBlock, PlantState, Rotors,
        SensorParams, Sensors,
    },
};

/// How the simulated vehicle differs from the model of the controller.
#[pyclass(frozen, module = "tilthex")]
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

#[pymethods]
impl Truth {
    #[new]
    #[pyo3(signature = (vehicle, truth=None))]
    fn new(vehicle: &Vehicle, truth: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        Ok(Self { model: vehicle.clone(), section: section(truth)? })
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
    fn draw(&self, seed: u64) -> PyResult<Drawn> {
        Ok(Drawn { is: self.section.draw(&self.model.section, seed).map_err(convert::config_error)? })
    }

    fn __repr__(&self) -> String {
        format!("Truth(vehicle='{}', '{}')", self.model.section.name(), self.section.name())
    }
}

/// The properties that were drawn for one seed: the vehicle, the effects on it, its sensors and delays.
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct Drawn {
    pub(crate) is: TrueVehicle,
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

    fn __repr__(&self) -> String {
        let v = self.is.vehicle.vehicle();
        format!("Drawn(vehicle='{}', seed={}, mass={:.4} kg)", self.is.vehicle.name(), self.is.seed, v.mass())
    }
}

/// The effects on a vehicle in addition to the nominal wrench of its rotors and its weight.
#[pyclass(module = "tilthex")]
pub(crate) struct Effects {
    vehicle: tilthex_core::Vehicle,
    pub(crate) block: EffectsBlock,
    pub(crate) state: EffectsState,
}

#[pymethods]
impl Effects {
    /// Whether there is no effect, neither on the airframe nor on the motors.
    #[getter]
    fn off(&self) -> bool {
        self.block.are_off() && self.block.throttle_voltage == 0.0
    }

    /// Velocity of the air at the vehicle, m/s, world, (3,).
    #[getter]
    fn wind<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.block.wind.velocity(&self.state.wind).as_slice())
    }

    /// Voltage of the battery, V.
    #[getter]
    fn voltage(&self) -> f64 {
        self.state.battery.voltage()
    }

    /// The speeds to which the motors drive their rotors under a command, Hz, (n,).
    fn reached<'py>(
        &self,
        py: Python<'py>,
        rotor_command: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let count = self.vehicle.rotor_count();
        let command = convert::rotors("rotor_command", rotor_command, count)?;
        Ok(array1(py, &self.block.reached(&self.state, &command).as_slice()[..count]))
    }

    /// The wrench on the airframe in a state, in addition to the nominal wrench of the rotors, (6,): force in world,
    /// torque in robot coordinates, at the centre of mass. Then `dt` seconds pass.
    #[expect(clippy::too_many_arguments, reason = "a state")]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        position: &Bound<'py, PyAny>,
        velocity: &Bound<'py, PyAny>,
        rotation: &Bound<'py, PyAny>,
        angular_velocity: &Bound<'py, PyAny>,
        rotor_speeds: &Bound<'py, PyAny>,
        rotor_accelerations: &Bound<'py, PyAny>,
        dt: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let count = self.vehicle.rotor_count();
        let robot = RobotState {
            position_w: convert::vector("position", position)?,
            velocity_w: convert::vector("velocity", velocity)?,
            rotation_wr: convert::rotation("rotation", rotation)?,
            angular_velocity_r: convert::vector("angular_velocity", angular_velocity)?,
        };
        let rotors = Rotors {
            speeds: convert::rotors("rotor_speeds", rotor_speeds, count)?,
            accelerations: convert::rotors("rotor_accelerations", rotor_accelerations, count)?,
        };
        let dt = convert::period(dt)?;
        let wind_w = self.block.wind.velocity(&self.state.wind);
        let mut wrench = self.block.wrench(&self.vehicle, &robot, &rotors, &wind_w);
        wrench.force = robot.rotation_wr * wrench.force;
        self.block.step(&mut self.state, &robot, &rotors, dt);
        Ok(convert::wrench_array(py, &wrench))
    }
}

/// The errors of a vehicle's sensors, apart from noise: biases, scale and axes of the gyroscope, vibration, the age
/// of the rotor speeds, and the place of the captured body.
#[pyclass(module = "tilthex")]
pub(crate) struct SensorErrors {
    plant: PlantBlock,
    state: PlantState,
    params: SensorParams,
    sensors: Sensors,
}

type Sample<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl SensorErrors {
    /// The captured point from the true centre of mass, m, robot, (3,).
    #[getter]
    fn captured<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.params.captured_r.as_slice())
    }

    /// The constant errors, (17,): bias of the gyroscope, rad/s, and of the accelerometer, m/s^2, scale and
    /// misalignment of the gyroscope (3 each, IMU axes), vibration, m/s^2, the captured point (3), m, the age of the
    /// rotor speeds, s.
    #[getter]
    fn constants<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let p = &self.params;
        let mut all = Vec::with_capacity(17);
        for v in [p.gyro_bias_i, p.accelerometer_bias_i, p.gyro_scale_i, p.gyro_misalignment_i] {
            all.extend(v.iter());
        }
        all.push(p.vibration);
        all.extend(p.captured_r.iter());
        all.push(p.rotor_speed_age);
        array1(py, &all)
    }

    /// Whether the errors depend on earlier rotor speeds, so that [`SensorErrors.step`] is needed.
    #[getter]
    fn remembers(&self) -> bool {
        self.params.vibration != 0.0 || self.params.rotor_speed_age != 0.0
    }

    /// Lets `dt` seconds pass, at the end of which the rotors have these speeds, Hz, (n,).
    fn step(&mut self, rotor_speeds: &Bound<'_, PyAny>, dt: f64) -> PyResult<()> {
        let count = self.plant.vehicle().rotor_count();
        self.state.rotor_speeds = convert::rotors("rotor_speeds", rotor_speeds, count)?;
        self.sensors.pass(&self.plant, &self.state, convert::period(dt)?);
        Ok(())
    }

    /// The values of gyroscope, rad/s, and accelerometer, m/s^2, if perfect sensors have these values; IMU axes,
    /// (3,).
    fn imu<'py>(
        &mut self,
        py: Python<'py>,
        gyro: &Bound<'py, PyAny>,
        specific_force: &Bound<'py, PyAny>,
    ) -> PyResult<Sample<'py>> {
        let truth = ImuSample {
            gyro_i: convert::vector("gyro", gyro)?,
            specific_force_i: convert::vector("specific_force", specific_force)?,
        };
        let said = self.sensors.imu(&truth);
        Ok((array1(py, said.gyro_i.as_slice()), array1(py, said.specific_force_i.as_slice())))
    }

    /// Measured rotor speeds without noise, Hz, (n,).
    fn rotor_speeds<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let measured = self.sensors.rotor_speeds(&self.plant, &self.state);
        array1(py, &measured.as_slice()[..self.plant.vehicle().rotor_count()])
    }
}
