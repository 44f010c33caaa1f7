//! `tilthex.Trajectory`.

use crate::{
    convert::{self, array1, array2},
    setpoint::{Setpoint, chosen},
    value,
    vehicle::Vehicle,
};
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};
use tilthex_core::{
    Matrix3, Wrench, model_learning,
    trajectory::{Limits, Trajectory as Checked, Waypoint},
};

/// The arguments of the constructor: the way-points, and the limits by name.
type Made<'py> = ((Vec<Bound<'py, PyDict>>,), Bound<'py, PyDict>);

/// Way-points of the tool in six dimensions, joined by quintic polynomials that begin and end at rest.
///
/// Each way-point is a dict with `position` (3,), m, world. These keys are optional: `rotation` (3, 3); `wrench` (6,)
/// that the tool must exert; `force_axes` and `surface`, as those of `Setpoint`, which hold until the next way-point is
/// reached; `duration`, the shortest time of the motion to the way-point, s; `hold`, s. A motion
/// takes longer than its duration if a limit, m/s, m/s^2, rad/s or rad/s^2, demands it. Trajectories with the same motion are equal.
#[pyclass(frozen, module = "tilthex", from_py_object)]
#[derive(Clone, Copy)]
pub(crate) struct Trajectory(pub(crate) Checked);

impl Trajectory {
    /// The limits of a trajectory whose motions have their durations: they make none of them longer.
    const WIDEST: [(&str, f64); 4] = [
        ("velocity", 100.0),
        ("acceleration", 1e3),
        ("angular_velocity", 100.0),
        ("angular_acceleration", 1e4),
    ];

    /// The first way-point, whose own duration does not count, and the others.
    fn points(&self) -> impl Iterator<Item = Waypoint> + '_ {
        std::iter::once(Waypoint { duration: 0.0, ..*self.0.start() }).chain(self.0.waypoints())
    }
}

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

    /// Time of the end, with the last hold, s.
    #[getter]
    fn duration(&self) -> f64 {
        self.0.duration()
    }

    /// Times at which the motions to the second and all later way-points begin, s.
    #[getter]
    fn begins<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.0.begins().collect::<Vec<_>>())
    }

    /// The way-points, each a dict as the constructor takes it; `duration` is that of the motion to it.
    #[getter]
    fn waypoints<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let point = |p: Waypoint| {
            let keys = PyDict::new(py);
            keys.set_item("position", array1(py, p.position_w.as_slice()))?;
            keys.set_item("rotation", array2(py, &p.rotation_we)?)?;
            keys.set_item("wrench", convert::wrench_array(py, &p.wrench_w))?;
            keys.set_item("force_axes", p.force_axes.names().collect::<Vec<_>>())?;
            if let Some(surface_ws) = &p.force_axes.surface_ws {
                keys.set_item("surface", array2(py, surface_ws)?)?;
            }
            keys.set_item("duration", p.duration)?;
            keys.set_item("hold", p.hold)?;
            Ok(keys)
        };
        self.points().map(point).collect()
    }

    /// The set-point at `time` seconds from the start. Before the start it is the first one, after the end the last
    /// one.
    fn sample(&self, time: f64) -> PyResult<Setpoint> {
        Ok(Setpoint(self.0.sample(convert::number("time", time, -1e12, 1e12)?)))
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        Ok(((self.waypoints(py)?,), Self::WIDEST.into_py_dict(py)?))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.points().eq(other.points())
    }

    fn __hash__(this: &Bound<'_, Self>) -> PyResult<isize> {
        value::hash(this, &["duration", "begins"])
    }

    fn __repr__(&self) -> String {
        format!("Trajectory({} way-points, {} s)", self.points().count(), self.0.duration())
    }
}

/// The contact-free flight that shows the errors of a vehicle's model. It begins and ends with a level hover with the
/// tool at `position` (3,), m, world, and a `heading`, rad. Between them are three hovers about the same centre of
/// mass, tilted by 10 to 15 degrees in directions 120 degrees apart.
///
/// Fly it with `learn_model=True` in every `Loop.step`, at least half a metre from anything that the tool could
/// touch. A vehicle that hovers only level, or whose rotors cannot produce a tilt, gets the hovers that it can fly.
#[pyfunction]
#[pyo3(signature = (vehicle, position, heading=0.0))]
pub(crate) fn calibration_flight(
    vehicle: &Vehicle,
    position: &Bound<'_, PyAny>,
    heading: f64,
) -> PyResult<Trajectory> {
    let limits = Limits {
        velocity: 0.4,
        acceleration: 0.8,
        angular_velocity: 30f64.to_radians(),
        angular_acceleration: 60f64.to_radians(),
    };
    let position_w = convert::vector("position", position)?;
    let heading = convert::number("heading", heading, -1e3, 1e3)?;
    let kind = model_learning::Calibration::Tilts;
    let made = model_learning::calibration_flight(vehicle.core(), kind, position_w, heading, &limits);
    Ok(Trajectory(made.map_err(convert::value_error)?))
}

fn waypoint(index: usize, keys: &Bound<'_, PyDict>) -> PyResult<Waypoint> {
    let place = |key: &str| format!("waypoints[{index}][{key:?}]");
    let known = ["position", "rotation", "wrench", "force_axes", "surface", "duration", "hold"];
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
        force_axes: chosen(
            &get("force_axes")?.map_or(Ok(Vec::<String>::new()), |names| names.extract())?,
            get("surface")?.as_ref(),
        )?,
        duration: seconds("duration")?,
        hold: seconds("hold")?,
    })
}
