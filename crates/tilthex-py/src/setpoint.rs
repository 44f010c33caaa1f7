//! `tilthex.Setpoint` and `tilthex.Reference`.

use crate::{
    convert::{self, array1, array2, wrench_array},
    value,
};
use numpy::{PyArray1, PyArray2};
use pyo3::{exceptions::PyValueError, prelude::*};
use tilthex_config::orders::force_axes;
use tilthex_core::{Wrench, force_axes::ForceAxes};

const SETPOINT: [&str; 9] = [
    "position",
    "rotation",
    "velocity",
    "angular_velocity",
    "acceleration",
    "angular_acceleration",
    "wrench",
    "force_axes",
    "surface",
];
const REFERENCE: [&str; 6] =
    ["position", "rotation", "velocity", "angular_velocity", "acceleration", "angular_acceleration"];

type Any<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// The axes of a set-point along which force is controlled.
pub(crate) fn chosen(names: &[String], surface: Any<'_, '_>) -> PyResult<ForceAxes> {
    let surface_ws = surface.map(|s| convert::rotation("surface", s)).transpose()?;
    force_axes(names, surface_ws).map_err(PyValueError::new_err)
}

/// The commanded set-point of the tool: pose, twist and acceleration of the tool frame, all in world coordinates, and
/// the wrench that the tool must exert on the environment (force N, torque N m, world, about the tip). `force_axes` names axes of
/// x, y, z (force) and rx, ry, rz (torque) along which that wrench is controlled instead of the pose: those of the tool, or
/// those of a `surface`, (3, 3), which maps its coordinates to world coordinates.
#[pyclass(frozen, module = "tilthex", from_py_object)]
#[derive(Clone, Copy)]
pub(crate) struct Setpoint(pub(crate) tilthex_core::Setpoint);

#[pymethods]
impl Setpoint {
    #[new]
    #[pyo3(signature = (
        position, rotation, velocity=None, angular_velocity=None, acceleration=None,
        angular_acceleration=None, wrench=None, force_axes=None, surface=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "Python names them")]
    fn new(
        position: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
        velocity: Any<'_, '_>,
        angular_velocity: Any<'_, '_>,
        acceleration: Any<'_, '_>,
        angular_acceleration: Any<'_, '_>,
        wrench: Any<'_, '_>,
        force_axes: Option<Vec<String>>,
        surface: Any<'_, '_>,
    ) -> PyResult<Self> {
        Ok(Self(tilthex_core::Setpoint {
            position_w: convert::vector("position", position)?,
            rotation_we: convert::rotation("rotation", rotation)?,
            velocity_w: convert::or_zero("velocity", velocity)?,
            angular_velocity_w: convert::or_zero("angular_velocity", angular_velocity)?,
            acceleration_w: convert::or_zero("acceleration", acceleration)?,
            angular_acceleration_w: convert::or_zero("angular_acceleration", angular_acceleration)?,
            wrench_w: wrench.map_or(Ok(Wrench::ZERO), |w| convert::wrench("wrench", w))?,
            force_axes: chosen(&force_axes.unwrap_or_default(), surface)?,
        }))
    }

    /// Position of the tool tip, m, world, (3,).
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.position_w.as_slice())
    }

    /// Maps tool coordinates to world coordinates, (3, 3).
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, &self.0.rotation_we)
    }

    /// Velocity of the tool tip, m/s, world, (3,).
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.velocity_w.as_slice())
    }

    /// Angular velocity, rad/s, world, (3,).
    #[getter]
    fn angular_velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.angular_velocity_w.as_slice())
    }

    /// Acceleration of the tool tip, m/s^2, world, (3,).
    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.acceleration_w.as_slice())
    }

    /// Angular acceleration, rad/s^2, world, (3,).
    #[getter]
    fn angular_acceleration<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.angular_acceleration_w.as_slice())
    }

    /// The wrench that the tool must exert on the environment, world, (6,).
    #[getter]
    fn wrench<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        wrench_array(py, &self.0.wrench_w)
    }

    /// Names of the axes along which that wrench is controlled instead of the pose.
    #[getter]
    fn force_axes(&self) -> Vec<&'static str> {
        self.0.force_axes.names().collect()
    }

    /// Maps coordinates of the surface, whose axes these are, to world coordinates, (3, 3); None for the tool's axes.
    #[getter]
    fn surface<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.0.force_axes.surface_ws.map(|surface_ws| array2(py, &surface_ws)).transpose()
    }

    fn __getnewargs_ex__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        value::arguments(this, &SETPOINT)
    }

    fn __eq__(this: &Bound<'_, Self>, other: &Bound<'_, Self>) -> PyResult<bool> {
        value::equal(this, other, &SETPOINT)
    }

    fn __hash__(this: &Bound<'_, Self>) -> PyResult<isize> {
        value::hash(this, &SETPOINT)
    }

    fn __repr__(this: &Bound<'_, Self>) -> PyResult<String> {
        value::shown(this, &SETPOINT, 2)
    }
}

/// The reference of the centre of mass, which the pose controller follows. Angular rates are in the body coordinates
/// of the reference.
#[pyclass(frozen, module = "tilthex", from_py_object)]
#[derive(Clone, Copy)]
pub(crate) struct Reference(pub(crate) tilthex_core::Reference);

#[pymethods]
impl Reference {
    #[new]
    #[pyo3(signature = (
        position, rotation, velocity=None, angular_velocity=None, acceleration=None, angular_acceleration=None
    ))]
    fn new(
        position: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
        velocity: Any<'_, '_>,
        angular_velocity: Any<'_, '_>,
        acceleration: Any<'_, '_>,
        angular_acceleration: Any<'_, '_>,
    ) -> PyResult<Self> {
        Ok(Self(tilthex_core::Reference {
            position_w: convert::vector("position", position)?,
            rotation_wr: convert::rotation("rotation", rotation)?,
            velocity_w: convert::or_zero("velocity", velocity)?,
            angular_velocity_r: convert::or_zero("angular_velocity", angular_velocity)?,
            acceleration_w: convert::or_zero("acceleration", acceleration)?,
            angular_acceleration_r: convert::or_zero("angular_acceleration", angular_acceleration)?,
        }))
    }

    /// Position of the centre of mass, m, world, (3,).
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.position_w.as_slice())
    }

    /// Maps robot coordinates to world coordinates, (3, 3).
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, &self.0.rotation_wr)
    }

    /// Velocity of the centre of mass, m/s, world, (3,).
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.velocity_w.as_slice())
    }

    /// Angular velocity, rad/s, reference body, (3,).
    #[getter]
    fn angular_velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.angular_velocity_r.as_slice())
    }

    /// Acceleration of the centre of mass, m/s^2, world, (3,).
    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.acceleration_w.as_slice())
    }

    /// Angular acceleration, rad/s^2, reference body, (3,).
    #[getter]
    fn angular_acceleration<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.angular_acceleration_r.as_slice())
    }

    fn __getnewargs_ex__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        value::arguments(this, &REFERENCE)
    }

    fn __eq__(this: &Bound<'_, Self>, other: &Bound<'_, Self>) -> PyResult<bool> {
        value::equal(this, other, &REFERENCE)
    }

    fn __hash__(this: &Bound<'_, Self>) -> PyResult<isize> {
        value::hash(this, &REFERENCE)
    }

    fn __repr__(this: &Bound<'_, Self>) -> PyResult<String> {
        value::shown(this, &REFERENCE, 2)
    }
}
