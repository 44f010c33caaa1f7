//! `tilthex.UkfRun`.

use crate::{convert, value};
use numpy::{IntoPyArray, PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

const RUN: [&str; 10] = [
    "position",
    "velocity",
    "rotation",
    "gyro_bias",
    "accelerometer_bias",
    "covariance",
    "innovation",
    "innovation_deviation",
    "nis",
    "outcome",
];

/// The estimates of a run, row by row.
#[derive(Default)]
pub(crate) struct Tracks {
    pub(crate) position: Vec<f64>,
    pub(crate) velocity: Vec<f64>,
    pub(crate) rotation: Vec<f64>,
    pub(crate) gyro_bias: Vec<f64>,
    pub(crate) accelerometer_bias: Vec<f64>,
    pub(crate) covariance: Option<Vec<f64>>,
    pub(crate) innovation: Vec<f64>,
    pub(crate) deviation: Vec<f64>,
    pub(crate) nis: Vec<f64>,
    pub(crate) outcome: Vec<&'static str>,
}

/// The estimates of a run at every inertial sample, and the innovation and outcome of every pose.
#[pyclass(frozen, get_all, module = "tilthex")]
pub(crate) struct UkfRun {
    /// Position of the centre of mass, m, world, (n, 3).
    position: Py<PyArrayDyn<f64>>,
    /// Velocity of the centre of mass, m/s, world, (n, 3).
    velocity: Py<PyArrayDyn<f64>>,
    /// Rotations R_WR, (n, 3, 3).
    rotation: Py<PyArrayDyn<f64>>,
    /// Bias of the gyro, rad/s, IMU, (n, 3).
    gyro_bias: Py<PyArrayDyn<f64>>,
    /// Bias of the accelerometer, m/s^2, IMU, (n, 3).
    accelerometer_bias: Py<PyArrayDyn<f64>>,
    /// Covariances as of `Ukf.covariance`, (n, 15, 15), or None.
    covariance: Option<Py<PyArrayDyn<f64>>>,
    /// Innovations of the IMU's pose: position in m, rotation in rad, world, (m, 6); NaN where not applied.
    innovation: Py<PyArrayDyn<f64>>,
    /// Predicted standard deviations of the innovations, (m, 6).
    innovation_deviation: Py<PyArrayDyn<f64>>,
    /// Normalised innovation squared, chi-square with 6 degrees of freedom, (m,).
    nis: Py<PyArrayDyn<f64>>,
    /// The outcome of each pose.
    outcome: Vec<String>,
}

impl UkfRun {
    pub(crate) fn of(py: Python<'_>, tracks: Tracks, n: usize, m: usize) -> PyResult<Self> {
        let shaped = |values: Vec<f64>, shape: Vec<usize>| -> PyResult<Py<PyArrayDyn<f64>>> {
            Ok(values.into_pyarray(py).reshape(shape)?.unbind())
        };
        Ok(Self {
            position: shaped(tracks.position, vec![n, 3])?,
            velocity: shaped(tracks.velocity, vec![n, 3])?,
            rotation: shaped(tracks.rotation, vec![n, 3, 3])?,
            gyro_bias: shaped(tracks.gyro_bias, vec![n, 3])?,
            accelerometer_bias: shaped(tracks.accelerometer_bias, vec![n, 3])?,
            covariance: tracks.covariance.map(|c| shaped(c, vec![n, 15, 15])).transpose()?,
            innovation: shaped(tracks.innovation, vec![m, 6])?,
            innovation_deviation: shaped(tracks.deviation, vec![m, 6])?,
            nis: shaped(tracks.nis, vec![m])?,
            outcome: tracks.outcome.into_iter().map(str::to_owned).collect(),
        })
    }
}

#[pymethods]
impl UkfRun {
    #[new]
    #[pyo3(signature = (
        *, position, velocity, rotation, gyro_bias, accelerometer_bias, innovation, innovation_deviation, nis, outcome,
        covariance=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments in Python")]
    fn new(
        position: &Bound<'_, PyAny>,
        velocity: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
        gyro_bias: &Bound<'_, PyAny>,
        accelerometer_bias: &Bound<'_, PyAny>,
        innovation: &Bound<'_, PyAny>,
        innovation_deviation: &Bound<'_, PyAny>,
        nis: &Bound<'_, PyAny>,
        outcome: Vec<String>,
        covariance: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let samples = convert::rows("position", position, None, &[3])?.len() / 3;
        let poses = outcome.len();
        let rows = |name: &str, given: &Bound<'_, PyAny>, count: usize, inner: &[usize]| {
            let values = convert::rows(name, given, Some(count), inner)?;
            let shape: Vec<usize> = std::iter::once(count).chain(inner.iter().copied()).collect();
            Ok::<_, PyErr>(PyArray1::from_vec(given.py(), values).reshape(shape)?.unbind())
        };
        Ok(Self {
            position: rows("position", position, samples, &[3])?,
            velocity: rows("velocity", velocity, samples, &[3])?,
            rotation: rows("rotation", rotation, samples, &[3, 3])?,
            gyro_bias: rows("gyro_bias", gyro_bias, samples, &[3])?,
            accelerometer_bias: rows("accelerometer_bias", accelerometer_bias, samples, &[3])?,
            covariance: covariance.map(|c| rows("covariance", c, samples, &[15, 15])).transpose()?,
            innovation: rows("innovation", innovation, poses, &[6])?,
            innovation_deviation: rows("innovation_deviation", innovation_deviation, poses, &[6])?,
            nis: rows("nis", nis, poses, &[])?,
            outcome,
        })
    }

    fn __getnewargs_ex__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        value::arguments(this, &RUN)
    }

    fn __eq__(this: &Bound<'_, Self>, other: &Bound<'_, Self>) -> PyResult<bool> {
        value::equal(this, other, &RUN)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let samples = self.position.bind(py).len()?;
        Ok(format!("UkfRun({samples} inertial samples, {} poses)", self.outcome.len()))
    }
}
