//! `tilthex.Effects` and `tilthex.SensorErrors`: what acts on a drawn vehicle, and the errors of its sensors.

use crate::{
    convert::{self, array1},
    value,
};
use numpy::PyArray1;
use pyo3::prelude::*;
use tilthex_core::{
    RobotState,
    plant::{
        Effects as EffectsBlock, EffectsState, ImuSample, Plant as PlantBlock, PlantState, Rotors,
        SensorParams, Sensors,
    },
};

/// The effects on a vehicle in addition to the nominal wrench of its rotors and its weight.
#[pyclass(module = "tilthex")]
#[derive(Clone)]
pub(crate) struct Effects {
    pub(crate) vehicle: tilthex_core::Vehicle,
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

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        value::not_pickled("Effects", "the Drawn vehicle")
    }

    fn __repr__(&self) -> String {
        if self.off() {
            return "Effects(off)".to_owned();
        }
        let wind_w = self.block.wind.velocity(&self.state.wind);
        format!("Effects(wind={:?} m/s, voltage={} V)", wind_w.as_slice(), self.voltage())
    }
}

/// The errors of a vehicle's sensors, apart from noise: biases, scale and axes of the gyroscope, vibration, the age
/// of the rotor speeds, and the place of the captured body.
#[pyclass(module = "tilthex")]
#[derive(Clone)]
pub(crate) struct SensorErrors {
    pub(crate) plant: PlantBlock,
    pub(crate) state: PlantState,
    pub(crate) params: SensorParams,
    pub(crate) sensors: Sensors,
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

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        value::not_pickled("SensorErrors", "the Drawn vehicle")
    }

    fn __repr__(&self) -> String {
        let p = &self.params;
        format!("SensorErrors(captured={:?} m, vibration={} m/s^2)", p.captured_r.as_slice(), p.vibration)
    }
}
