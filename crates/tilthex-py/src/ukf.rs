//! `tilthex.Ukf`.

use crate::{
    config::Config,
    convert::{self, array1, array2, value_error},
    ukf_run::{Tracks, UkfRun},
    units, value,
};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use tilthex_core::{
    Matrix3, PoseSample, Vector3,
    estimator::{Estimator, Outcome, PoseReport},
};

/// The state estimator: an unscented Kalman filter on SO(3) x R^12 for inertial samples and late poses.
#[pyclass(module = "tilthex")]
#[derive(Clone)]
pub(crate) struct Ukf {
    block: Box<Estimator>,
}

#[pymethods]
impl Ukf {
    #[new]
    fn new(config: &Config) -> PyResult<Self> {
        let params = config.checked.estimator_params().map_err(convert::config_error)?;
        Ok(Self { block: Box::new(Estimator::new(params).map_err(value_error)?) })
    }

    /// Starts from a pose of the captured body: time in s, position in m (3,), rotation (3, 3).
    fn initialize(
        &mut self,
        time: f64,
        position: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let (position, rotation) =
            (convert::vector("position", position)?, convert::near_rotation("rotation", rotation)?);
        self.block.initialize(time, &position, &rotation).map_err(value_error)
    }

    /// Starts from a pose of a vehicle at rest, with the biases that the samples up to now show.
    fn initialize_at_rest(
        &mut self,
        time: f64,
        position: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let (position, rotation) =
            (convert::vector("position", position)?, convert::near_rotation("rotation", rotation)?);
        let started = self.block.initialize_at_rest(time, &position, &rotation);
        started.map_err(|e| PyValueError::new_err(e.to_string()))
    }

    /// Takes an inertial sample in IMU coordinates: time in s, gyro in rad/s (3,), specific force in m/s^2 (3,).
    fn predict(
        &mut self,
        time: f64,
        gyro: &Bound<'_, PyAny>,
        specific_force: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let gyro = convert::vector("gyro", gyro)?;
        let specific_force = convert::vector("specific_force", specific_force)?;
        self.block.predict(convert::finite("time", time)?, &gyro, &specific_force);
        Ok(())
    }

    /// Takes a pose of the captured body that was captured at `time` and arrived at `arrival` (s; equal to `time` if
    /// not given). Returns the outcome.
    #[pyo3(signature = (time, position, rotation, *, arrival=None))]
    fn update_pose(
        &mut self,
        time: f64,
        position: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
        arrival: Option<f64>,
    ) -> PyResult<&'static str> {
        let pose = PoseSample {
            time: convert::finite("time", time)?,
            arrival: convert::finite("arrival", arrival.unwrap_or(time))?,
            position_w: convert::vector("position", position)?,
            rotation_wr: convert::near_rotation("rotation", rotation)?,
            tracking_valid: true,
        };
        Ok(self.block.update_pose(&pose).name())
    }

    /// Runs a whole recording in the order in which a vehicle would have seen it: samples in their order, each pose
    /// as soon as it has arrived. If the filter has not started, the first pose starts it.
    ///
    /// imu_time (n,) s, gyro (n, 3) rad/s, specific_force (n, 3) m/s^2; pose_time (m,) s, position (m, 3) m, rotation
    /// (m, 3, 3); pose_arrival_time (m,) s, equal to pose_time if not given. Poses with NaN count as invalid.
    /// A matrix within 1 % of a rotation counts as the nearest rotation. Values that look like other units, and poses
    /// and samples without a common time, are refused with a question.
    /// `covariance=False` saves the memory of n 15x15 matrices.
    #[pyo3(signature = (imu_time, gyro, specific_force, pose_time, position, rotation,
                        pose_arrival_time=None, *, covariance=true))]
    #[allow(clippy::too_many_arguments)]
    fn run(
        &mut self,
        py: Python<'_>,
        imu_time: &Bound<'_, PyAny>,
        gyro: &Bound<'_, PyAny>,
        specific_force: &Bound<'_, PyAny>,
        pose_time: &Bound<'_, PyAny>,
        position: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
        pose_arrival_time: Option<&Bound<'_, PyAny>>,
        covariance: bool,
    ) -> PyResult<UkfRun> {
        let imu_time = convert::rows("imu_time", imu_time, None, &[])?;
        let n = imu_time.len();
        if let Some(k) = (1..n).find(|&k| imu_time[k] <= imu_time[k - 1] || imu_time[k].is_nan()) {
            let (before, after) = (imu_time[k - 1], imu_time[k]);
            let message = format!("imu_time[{k}] is {after} after {before}; expected times that increase");
            return Err(PyValueError::new_err(message));
        }
        let gyro = convert::rows("gyro", gyro, Some(n), &[3])?;
        let specific_force = convert::rows("specific_force", specific_force, Some(n), &[3])?;
        let pose_time = convert::rows("pose_time", pose_time, None, &[])?;
        let m = pose_time.len();
        let position = convert::rows("position", position, Some(m), &[3])?;
        let rotation = convert::rows("rotation", rotation, Some(m), &[3, 3])?;
        let arrival = match pose_arrival_time {
            Some(times) => convert::rows("pose_arrival_time", times, Some(m), &[])?,
            None => pose_time.clone(),
        };
        units::question(&imu_time, &gyro, &specific_force)?;
        let given = units::Poses { time: &pose_time, position: &position, rotation: &rotation };
        units::question_poses(&imu_time, &gyro, &given)?;
        let pose = |k: usize| -> PyResult<PoseSample> {
            let rotation = Matrix3::from_row_slice(&rotation[9 * k..9 * k + 9]);
            // A pose with a NaN is not a pose.
            let known = rotation.iter().all(|x| x.is_finite());
            Ok(PoseSample {
                time: pose_time[k],
                arrival: arrival[k],
                position_w: Vector3::from_column_slice(&position[3 * k..3 * k + 3]),
                rotation_wr: if known {
                    convert::near_rotation_of(&format!("rotation[{k}]"), &rotation)?
                } else {
                    rotation
                },
                tracking_valid: true,
            })
        };
        let poses = (0..m).map(pose).collect::<PyResult<Vec<_>>>()?;
        let samples = Samples { time: &imu_time, gyro: &gyro, specific_force: &specific_force };
        let block = &mut self.block;
        let tracks = py.detach(|| run(block, &samples, &poses, covariance));
        UkfRun::of(py, tracks, n, m)
    }

    /// Time of the newest sample, s.
    #[getter]
    fn time(&self) -> f64 {
        self.block.time()
    }

    /// Position of the centre of mass at the newest sample, m, world, (3,).
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.block.robot_state().position_w.as_slice())
    }

    /// Velocity of the centre of mass, m/s, world, (3,).
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.block.robot_state().velocity_w.as_slice())
    }

    /// Rotation R_WR, (3, 3).
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, &self.block.robot_state().rotation_wr)
    }

    /// Angular velocity, rad/s, robot, (3,).
    #[getter]
    fn angular_velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.block.robot_state().angular_velocity_r.as_slice())
    }

    /// Specific force at the centre of mass without bias, m/s^2, robot, (3,).
    #[getter]
    fn specific_force<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.block.specific_force_r().as_slice())
    }

    /// Bias of the gyro, rad/s, IMU, (3,).
    #[getter]
    fn gyro_bias<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.block.gyro_bias().as_slice())
    }

    /// Bias of the accelerometer, m/s^2, IMU, (3,).
    #[getter]
    fn accelerometer_bias<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.block.accelerometer_bias().as_slice())
    }

    /// Covariance of (position, velocity, rotation, gyro bias, accelerometer bias), (15, 15). Position, velocity and
    /// rotation are in world axes.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, &self.block.covariance())
    }

    /// Status, age of the newest pose, innovation consistency, deviations and counters.
    #[getter]
    fn health<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let health = self.block.health();
        let dict = PyDict::new(py);
        dict.set_item("status", health.status.name())?;
        for (name, value) in [
            ("pose_age", health.pose_age),
            ("position_age", health.position_age),
            ("latency", health.latency),
            ("latency_deviation", health.latency_deviation),
            ("nis", health.nis),
            ("nis_mean", health.nis_mean),
            ("position_deviation", health.position_deviation),
            ("velocity_deviation", health.velocity_deviation),
            ("rotation_deviation", health.rotation_deviation),
            ("lag", health.lag),
        ] {
            dict.set_item(name, value)?;
        }
        dict.set_item("at_rest", health.at_rest)?;
        dict.set_item("recoveries", health.recoveries)?;
        let c = health.counts;
        for (name, count) in [
            ("accepted", c.accepted),
            ("weighed", c.weighed),
            ("position_only", c.position_only),
            ("rejected", c.rejected),
            ("flipped", c.flipped),
            ("disordered", c.disordered),
            ("too_old", c.too_old),
            ("duplicate", c.duplicate),
            ("invalid", c.invalid),
            ("imu_rejected", c.imu_rejected),
            ("imu_gaps", c.imu_gaps),
        ] {
            dict.set_item(name, count)?;
        }
        Ok(dict)
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        value::not_pickled("Ukf", "its configuration")
    }

    fn __repr__(&self) -> String {
        format!("Ukf({} at {} s)", self.block.health().status.name(), self.block.time())
    }
}

/// The inertial samples of a run, row by row.
struct Samples<'a> {
    time: &'a [f64],
    gyro: &'a [f64],
    specific_force: &'a [f64],
}

impl Tracks {
    fn push_state(&mut self, estimator: &Estimator) {
        let started = estimator.is_initialized();
        let known = |x: f64| if started { x } else { f64::NAN };
        let state = estimator.robot_state();
        self.position.extend(state.position_w.iter().map(|x| known(*x)));
        self.velocity.extend(state.velocity_w.iter().map(|x| known(*x)));
        self.rotation.extend(state.rotation_wr.transpose().iter().map(|x| known(*x)));
        self.gyro_bias.extend(estimator.gyro_bias().iter().map(|x| known(*x)));
        self.accelerometer_bias.extend(estimator.accelerometer_bias().iter().map(|x| known(*x)));
        if let Some(covariance) = &mut self.covariance {
            // Symmetric: its order does not matter.
            covariance.extend(estimator.covariance().iter().map(|x| known(*x)));
        }
    }

    fn set_report(&mut self, k: usize, report: &PoseReport) {
        self.innovation[6 * k..6 * k + 6].copy_from_slice(&report.innovation);
        self.deviation[6 * k..6 * k + 6].copy_from_slice(&report.deviation);
        self.nis[k] = report.nis;
        self.outcome[k] = report.outcome.name();
    }
}

fn run(estimator: &mut Estimator, samples: &Samples<'_>, poses: &[PoseSample], covariance: bool) -> Tracks {
    let (n, m) = (samples.time.len(), poses.len());
    let mut tracks = Tracks {
        innovation: vec![f64::NAN; 6 * m],
        deviation: vec![f64::NAN; 6 * m],
        nis: vec![f64::NAN; m],
        outcome: vec![Outcome::Pending.name(); m],
        covariance: covariance.then(|| Vec::with_capacity(225 * n)),
        ..Tracks::default()
    };
    let mut order: Vec<usize> = (0..m).collect();
    order.sort_by(|a, b| poses[*a].arrival.total_cmp(&poses[*b].arrival));
    let mut waiting = order.into_iter().peekable();
    // Poses that have arrived but not been applied yet.
    let mut pending: Vec<usize> = Vec::new();
    let mut reports: Vec<PoseReport> = Vec::new();
    let latency = estimator.latency();
    for k in 0..n {
        let row = |all: &[f64]| Vector3::from_column_slice(&all[3 * k..3 * k + 3]);
        let time = samples.time[k];
        let (gyro, force) = (row(samples.gyro), row(samples.specific_force));
        estimator.predict_observed(time, &gyro, &force, &mut |report| reports.push(*report));
        while let Some(p) = waiting.next_if(|p| poses[*p].arrival <= time || poses[*p].arrival.is_nan()) {
            let pose = &poses[p];
            let starts = !estimator.is_initialized()
                && estimator.initialize(pose.time, &pose.position_w, &pose.rotation_wr).is_ok();
            let outcome = if starts {
                Outcome::Accepted
            } else {
                estimator.update_pose_observed(pose, &mut |report| reports.push(*report))
            };
            tracks.outcome[p] = outcome.name();
            pending.push(p);
        }
        for report in reports.drain(..) {
            if let Some(place) = pending.iter().position(|p| poses[*p].time - latency == report.time) {
                tracks.set_report(pending.swap_remove(place), &report);
            }
        }
        pending.retain(|p| tracks.outcome[*p] == Outcome::Pending.name());
        tracks.push_state(estimator);
    }
    tracks
}
