//! `tilthex.Controller`.

use crate::{
    config::Config,
    convert::{self, wrench_array},
    output::Output,
    setpoint::Setpoint,
    value,
    vehicle::Vehicle,
};
use numpy::PyArray1;
use pyo3::prelude::*;
use tilthex_core::{
    RobotState,
    controller::{Controller as Block, ControllerInput, ControllerState},
};

/// The controller of the paper's figure 5 without the estimator: wrench
/// observer, admittance filter, pose controller, compensation, allocation.
#[pyclass(module = "tilthex")]
#[derive(Clone)]
pub(crate) struct Controller {
    block: Block,
    state: ControllerState,
}

#[pymethods]
impl Controller {
    #[new]
    fn new(vehicle: &Vehicle, config: &Config) -> PyResult<Self> {
        let block =
            Block::new(*vehicle.core(), *config.checked.controller()).map_err(convert::value_error)?;
        Ok(Self { block, state: ControllerState::default() })
    }

    /// One tick, from measurements to rotor speeds.
    ///
    /// position, velocity: of the centre of mass, (3,), m and m/s, world. rotation: `R_WR`, (3, 3). angular_velocity:
    /// (3,), rad/s, robot. specific_force: at the centre of mass, (3,), m/s^2, robot. rotor_speeds: measured, (n,),
    /// Hz. dt: measured time since the last tick, s. compliant: whether contact moves the reference. learn_bias:
    /// whether this is a contact-free hover whose mean wrench is the bias. lost_rotors: rotors, from 0, that stand
    /// still.
    #[pyo3(signature = (
        *, position, velocity, rotation, angular_velocity, specific_force, rotor_speeds, setpoint,
        dt=0.002, compliant=true, learn_bias=false, lost_rotors=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments in Python")]
    fn step(
        &mut self,
        position: &Bound<'_, PyAny>,
        velocity: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
        angular_velocity: &Bound<'_, PyAny>,
        specific_force: &Bound<'_, PyAny>,
        rotor_speeds: &Bound<'_, PyAny>,
        setpoint: &Setpoint,
        dt: f64,
        compliant: bool,
        learn_bias: bool,
        lost_rotors: Option<Vec<i64>>,
    ) -> PyResult<Output> {
        let count = self.block.vehicle().rotor_count();
        let input = ControllerInput {
            state: RobotState {
                position_w: convert::vector("position", position)?,
                velocity_w: convert::vector("velocity", velocity)?,
                rotation_wr: convert::rotation("rotation", rotation)?,
                angular_velocity_r: convert::vector("angular_velocity", angular_velocity)?,
            },
            specific_force_r: convert::vector("specific_force", specific_force)?,
            rotor_speeds: convert::rotors("rotor_speeds", rotor_speeds, count)?,
            setpoint: setpoint.0,
            compliant,
            unyielding: None,
            learn_bias,
            lost_rotors: convert::rotor_set("lost_rotors", lost_rotors, count)?,
            fixed_attitude: false,
        };
        let dt = convert::period(dt)?;
        self.block.prepare(dt);
        let output = self.block.step(&mut self.state, &input, dt);
        Ok(Output::of(&output, count))
    }

    /// Resets the controller to its initial state.
    fn reset(&mut self) {
        self.state = ControllerState::default();
    }

    /// The wrench that counts as no contact, robot coordinates, (6,). It can be set.
    #[getter]
    fn bias<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wrench_array(py, &self.state.bias_r)
    }

    #[setter]
    fn set_bias(&mut self, bias: &Bound<'_, PyAny>) -> PyResult<()> {
        self.state.bias_r = convert::wrench("bias", bias)?;
        Ok(())
    }

    /// Uses the admittance filter of another configuration from now on. The reference does not jump.
    fn set_admittance(&mut self, config: &Config) -> PyResult<()> {
        let filter = tilthex_core::admittance::AdmittanceFilter::new(config.checked.controller().admittance)
            .map_err(convert::value_error)?;
        self.block.set_admittance(filter);
        Ok(())
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        value::not_pickled("Controller", "its vehicle and configuration")
    }

    fn __repr__(&self) -> String {
        let vehicle = self.block.vehicle();
        format!("Controller({} rotors, mass={} kg)", vehicle.rotor_count(), vehicle.mass())
    }
}
