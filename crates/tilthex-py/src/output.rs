//! `tilthex.Output`.

use crate::{
    convert::{self, array1, wrench_array},
    setpoint::{Reference, Setpoint},
    value,
};
use numpy::PyArray1;
use pyo3::prelude::*;
use tilthex_core::{
    RotorVector, Vector3, Vector6, Wrench, controller::ControllerOutput, pose_control::PoseCommand,
};

const OUTPUT: [&str; 14] = [
    "rotor_speeds",
    "wrench_robot",
    "wrench_tool",
    "wrench_admittance",
    "reference",
    "robot_reference",
    "position_error",
    "velocity_error",
    "rotation_error",
    "angular_velocity_error",
    "wanted_wrench",
    "allocated_wrench",
    "saturated",
    "excursion_limited",
];

/// The command of a tick, and the values from which it follows. The arguments of the constructor are the attributes.
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct Output {
    count: usize,
    rotor_speeds: RotorVector,
    wrench_robot: Wrench,
    wrench_tool_w: Wrench,
    wrench_admittance_w: Wrench,
    reference: tilthex_core::Setpoint,
    robot_reference: tilthex_core::Reference,
    pose: PoseCommand,
    wanted_wrench_r: Vector6,
    allocated_wrench_r: Vector6,
    saturated: bool,
    excursion_limited: bool,
}

impl Output {
    pub(crate) fn of(output: &ControllerOutput, count: usize) -> Self {
        Self {
            count,
            rotor_speeds: output.rotor_speeds,
            wrench_robot: output.wrench_robot,
            wrench_tool_w: output.wrench_tool_w,
            wrench_admittance_w: output.wrench_admittance_w,
            reference: output.reference,
            robot_reference: output.robot_reference,
            pose: output.pose,
            wanted_wrench_r: output.wanted_wrench_r,
            allocated_wrench_r: output.allocation.wrench,
            saturated: output.allocation.saturated,
            excursion_limited: output.excursion_limited,
        }
    }
}

#[pymethods]
impl Output {
    #[new]
    #[pyo3(signature = (
        *, rotor_speeds, wrench_robot, wrench_tool, wrench_admittance, reference, robot_reference, position_error,
        velocity_error, rotation_error, angular_velocity_error, wanted_wrench, allocated_wrench, saturated=false,
        excursion_limited=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments in Python")]
    fn new(
        rotor_speeds: &Bound<'_, PyAny>,
        wrench_robot: &Bound<'_, PyAny>,
        wrench_tool: &Bound<'_, PyAny>,
        wrench_admittance: &Bound<'_, PyAny>,
        reference: &Setpoint,
        robot_reference: &Reference,
        position_error: &Bound<'_, PyAny>,
        velocity_error: &Bound<'_, PyAny>,
        rotation_error: &Bound<'_, PyAny>,
        angular_velocity_error: &Bound<'_, PyAny>,
        wanted_wrench: &Bound<'_, PyAny>,
        allocated_wrench: &Bound<'_, PyAny>,
        saturated: bool,
        excursion_limited: bool,
    ) -> PyResult<Self> {
        let (rotor_speeds, count) = convert::all_rotors("rotor_speeds", rotor_speeds)?;
        Ok(Self {
            count,
            rotor_speeds,
            wrench_robot: convert::wrench("wrench_robot", wrench_robot)?,
            wrench_tool_w: convert::wrench("wrench_tool", wrench_tool)?,
            wrench_admittance_w: convert::wrench("wrench_admittance", wrench_admittance)?,
            reference: reference.0,
            robot_reference: robot_reference.0,
            pose: PoseCommand {
                acceleration_w: Vector3::zeros(),
                angular_acceleration_r: Vector3::zeros(),
                position_error_w: convert::vector("position_error", position_error)?,
                velocity_error_w: convert::vector("velocity_error", velocity_error)?,
                rotation_error_r: convert::vector("rotation_error", rotation_error)?,
                angular_velocity_error_r: convert::vector("angular_velocity_error", angular_velocity_error)?,
            },
            wanted_wrench_r: convert::vector("wanted_wrench", wanted_wrench)?,
            allocated_wrench_r: convert::vector("allocated_wrench", allocated_wrench)?,
            saturated,
            excursion_limited,
        })
    }

    /// Commanded rotor speeds, Hz, (n,).
    #[getter]
    fn rotor_speeds<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.rotor_speeds.as_slice()[..self.count])
    }

    /// External wrench at the centre of mass: force in world, torque in robot coordinates, (6,); (18)-(24).
    #[getter]
    fn wrench_robot<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wrench_array(py, &self.wrench_robot)
    }

    /// External wrench at the tool tip, world, bias removed, (6,); (25).
    #[getter]
    fn wrench_tool<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wrench_array(py, &self.wrench_tool_w)
    }

    /// External wrench at the tool tip, world, (6,), after low-pass and dead zone: the input of the admittance
    /// filter.
    #[getter]
    fn wrench_admittance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wrench_array(py, &self.wrench_admittance_w)
    }

    /// Reference of the tool: pose, twist and acceleration; (27)-(28).
    #[getter]
    fn reference(&self) -> Setpoint {
        Setpoint(self.reference)
    }

    /// Reference of the centre of mass; (29)-(30).
    #[getter]
    fn robot_reference(&self) -> Reference {
        Reference(self.robot_reference)
    }

    /// e_p = p_r - p, m, world, (3,).
    #[getter]
    fn position_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.pose.position_error_w.as_slice())
    }

    /// v_r - v, m/s, world, (3,).
    #[getter]
    fn velocity_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.pose.velocity_error_w.as_slice())
    }

    /// e_R, robot, (3,); (15).
    #[getter]
    fn rotation_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.pose.rotation_error_r.as_slice())
    }

    /// e_w, rad/s, robot, (3,); (16).
    #[getter]
    fn angular_velocity_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.pose.angular_velocity_error_r.as_slice())
    }

    /// Wanted body wrench, robot, (6,).
    #[getter]
    fn wanted_wrench<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.wanted_wrench_r.as_slice())
    }

    /// Body wrench that the commanded speeds produce, robot, (6,).
    #[getter]
    fn allocated_wrench<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wrench_array(py, &Wrench::from_vector(&self.allocated_wrench_r))
    }

    /// Whether a rotor limit changes the command.
    #[getter]
    fn saturated(&self) -> bool {
        self.saturated
    }

    /// Whether the admittance filter's excursion limit is active.
    #[getter]
    fn excursion_limited(&self) -> bool {
        self.excursion_limited
    }

    fn __getnewargs_ex__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        value::arguments(this, &OUTPUT)
    }

    fn __eq__(this: &Bound<'_, Self>, other: &Bound<'_, Self>) -> PyResult<bool> {
        value::equal(this, other, &OUTPUT)
    }

    fn __hash__(this: &Bound<'_, Self>) -> PyResult<isize> {
        value::hash(this, &OUTPUT)
    }

    fn __repr__(this: &Bound<'_, Self>) -> PyResult<String> {
        value::shown(this, &OUTPUT, 12)
    }
}
