//! `tilthex.Controller` and its output.

use crate::{
    config::Config,
    convert::{self, array1, wrench_array},
    setpoint::{Reference, Setpoint},
    vehicle::Vehicle,
};
use numpy::PyArray1;
use pyo3::prelude::*;
use tilthex_core::{
    RobotState, Wrench,
    controller::{Controller as Block, ControllerInput, ControllerOutput, ControllerState},
};

/// The controller of the paper's figure 5 without the estimator: wrench
/// observer, admittance filter, pose controller, compensation, allocation.
#[pyclass(module = "tilthex")]
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
        lost_rotors: Option<Vec<usize>>,
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
        Ok(Output { output, count })
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
}

/// The command of a tick, and the values from which it follows.
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct Output {
    output: ControllerOutput,
    count: usize,
}

#[pymethods]
impl Output {
    /// Commanded rotor speeds, Hz, (n,).
    #[getter]
    fn rotor_speeds<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.output.rotor_speeds.as_slice()[..self.count])
    }

    /// External wrench at the centre of mass: force in world, torque in robot coordinates, (6,); (18)-(24).
    #[getter]
    fn wrench_robot<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wrench_array(py, &self.output.wrench_robot)
    }

    /// External wrench at the tool tip, world, bias removed, (6,); (25).
    #[getter]
    fn wrench_tool<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wrench_array(py, &self.output.wrench_tool_w)
    }

    /// External wrench at the tool tip, world, (6,), after low-pass and dead zone: the input of the admittance
    /// filter.
    #[getter]
    fn wrench_admittance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wrench_array(py, &self.output.wrench_admittance_w)
    }

    /// Reference of the tool: pose, twist and acceleration; (27)-(28).
    #[getter]
    fn reference(&self) -> Setpoint {
        Setpoint(self.output.reference)
    }

    /// Reference of the centre of mass; (29)-(30).
    #[getter]
    fn robot_reference(&self) -> Reference {
        Reference(self.output.robot_reference)
    }

    /// e_p = p_r - p, m, world, (3,).
    #[getter]
    fn position_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.output.pose.position_error_w.as_slice())
    }

    /// v_r - v, m/s, world, (3,).
    #[getter]
    fn velocity_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.output.pose.velocity_error_w.as_slice())
    }

    /// e_R, robot, (3,); (15).
    #[getter]
    fn rotation_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.output.pose.rotation_error_r.as_slice())
    }

    /// e_w, rad/s, robot, (3,); (16).
    #[getter]
    fn angular_velocity_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.output.pose.angular_velocity_error_r.as_slice())
    }

    /// Wanted body wrench, robot, (6,).
    #[getter]
    fn wanted_wrench<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.output.wanted_wrench_r.as_slice())
    }

    /// Body wrench that the commanded speeds produce, robot, (6,).
    #[getter]
    fn allocated_wrench<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wrench_array(py, &Wrench::from_vector(&self.output.allocation.wrench))
    }

    /// Whether a rotor limit changes the command.
    #[getter]
    fn saturated(&self) -> bool {
        self.output.allocation.saturated
    }

    /// Whether the admittance filter's excursion limit is active.
    #[getter]
    fn excursion_limited(&self) -> bool {
        self.output.excursion_limited
    }
}
