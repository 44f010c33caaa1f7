//! `tilthex.Trajectory`.

use crate::{
    convert::{self, array1},
    setpoint::Setpoint,
};
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use tilthex_core::{
    Matrix3, Wrench,
    trajectory::{Limits, Trajectory as Checked, Waypoint},
};

/// 6-D way-points of the tool, joined by quintics from rest to rest.
///
/// Each way-point is a dict: `position` (3,), m, world; and where they are
/// not the default: `rotation` (3, 3), `wrench` (6,) that the tool shall exert,
/// `duration`, the shortest time of the way there, s, and `hold`, s. Limits in
/// m/s, m/s^2, rad/s and rad/s^2 make a way longer than its duration.
#[pyclass(frozen, module = "tilthex", from_py_object)]
#[derive(Clone, Copy)]
pub(crate) struct Trajectory(pub(crate) Checked);

#[pymethods]
impl Trajectory {
    #[new]
    #[pyo3(signature = (
        waypoints, *, velocity=0.5, acceleration=1.0, angular_velocity=0.5, angular_acceleration=2.0
    ))]
    fn new(
        waypoints: Vec<Bound<'_, PyDict>>,
        velocity: f64,
        acceleration: f64,
        angular_velocity: f64,
        angular_acceleration: f64,
    ) -> PyResult<Self> {
        let limits = Limits { velocity, acceleration, angular_velocity, angular_acceleration };
        let points =
            waypoints.iter().enumerate().map(|(i, w)| waypoint(i, w)).collect::<PyResult<Vec<_>>>()?;
        let Some((start, rest)) = points.split_first() else {
            return Err(PyValueError::new_err(
                "waypoints is empty; expected at least one dict with `position`",
            ));
        };
        Ok(Self(Checked::new(*start, rest, &limits).map_err(convert::value_error)?))
    }

    /// Time of its end, the last hold included, s.
    #[getter]
    fn duration(&self) -> f64 {
        self.0.duration()
    }

    /// Times at which the ways to the second way-point and those after it begin, s.
    #[getter]
    fn begins<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.0.begins().collect::<Vec<_>>())
    }

    /// The set-point at `time` seconds from its start; its ends are held.
    fn sample(&self, time: f64) -> PyResult<Setpoint> {
        Ok(Setpoint(self.0.sample(convert::number("time", time, -1e12, 1e12)?)))
    }
}

fn waypoint(index: usize, keys: &Bound<'_, PyDict>) -> PyResult<Waypoint> {
    let place = |key: &str| format!("waypoints[{index}][{key:?}]");
    let known = ["position", "rotation", "wrench", "duration", "hold"];
    for key in keys.keys() {
        let key: String = key.extract()?;
        if !known.contains(&key.as_str()) {
            let message = format!("{} is unknown; expected one of {}", place(&key), known.join(", "));
            return Err(PyValueError::new_err(message));
        }
    }
    let get = |key: &str| keys.get_item(key);
    let position = get("position")?
        .ok_or_else(|| PyValueError::new_err(format!("{} is missing; expected (3,)", place("position"))))?;
    let seconds = |key: &str| -> PyResult<f64> {
        get(key)?.map_or(Ok(0.0), |v| convert::number(&place(key), v.extract()?, 0.0, 1e6))
    };
    Ok(Waypoint {
        position_w: convert::vector(&place("position"), &position)?,
        rotation_we: get("rotation")?
            .map_or(Ok(Matrix3::identity()), |r| convert::rotation(&place("rotation"), &r))?,
        wrench_w: get("wrench")?.map_or(Ok(Wrench::ZERO), |w| convert::wrench(&place("wrench"), &w))?,
        duration: seconds("duration")?,
        hold: seconds("hold")?,
    })
}
