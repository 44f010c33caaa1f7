//! `tilthex._core.simulate` and `simulate_many`: closed loops, simulated with the GIL released.

use crate::{config::Config, convert, setpoint::Setpoint, trajectory::Trajectory, truth};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::{num::NonZeroUsize, ops::ControlFlow, thread};
use tilthex_config::{Config as Checked, TruthSection};
use tilthex_core::{flight::Route, plant::SensorParams};
use tilthex_sim::{
    pushes::{Push, Pushes},
    simulate::{NAMES, Outcome, Record, Scenario, Start, Summary, run, run_many, run_recording},
};

type Columns<'py> = Bound<'py, PyDict>;
/// The time of each, s, its name, and whether it begins.
type FaultChanges = Vec<(f64, &'static str, bool)>;

/// The arguments of `tilthex.simulate` that are equal for flights with different configurations, truths and seeds.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Common<'py> {
    duration: f64,
    setpoint: Option<Setpoint>,
    trajectory: Option<Trajectory>,
    pushes: Vec<Bound<'py, PyDict>>,
    noise: f64,
    gyro_bias: Option<Bound<'py, PyAny>>,
    accelerometer_bias: Option<Bound<'py, PyAny>>,
    estimator: bool,
    pose_delay: f64,
    start: String,
}

impl Common<'_> {
    fn scenario<'c>(&self, config: &'c Checked, truth: TruthSection, seed: u64) -> PyResult<Scenario<'c>> {
        let trajectory = match (self.setpoint, self.trajectory) {
            (Some(Setpoint(s)), None) => {
                tilthex_core::trajectory::Trajectory::hold(s.position_w, s.rotation_we)
            }
            (None, Some(Trajectory(t))) => t,
            _ => {
                return Err(PyValueError::new_err(
                    "setpoint and trajectory are both given or both missing; expected exactly one of them",
                ));
            }
        };
        let start = match self.start.as_str() {
            "air" => Start::Air(trajectory),
            "ground" => {
                let limits = config.mission().limits();
                Start::Ground(Some(Route::of(&trajectory, &limits).map_err(convert::value_error)?))
            }
            other => {
                return Err(PyValueError::new_err(format!(
                    "start is \"{other}\"; expected \"air\" or \"ground\""
                )));
            }
        };
        let pushes = self.pushes.iter().enumerate().map(|(i, p)| push(i, p));
        let (gyro, accelerometer) = (self.gyro_bias.as_ref(), self.accelerometer_bias.as_ref());
        Ok(Scenario {
            config,
            start,
            pushes: Pushes::new(pushes.collect::<PyResult<_>>()?),
            truth,
            duration: convert::number("duration", self.duration, 0.0, 1e5)?,
            sensors: sensors(convert::number("noise", self.noise, 0.0, 1e3)?, gyro, accelerometer)?,
            seed,
            estimate: self.estimator,
            pose_delay: convert::number("pose_delay", self.pose_delay, 0.0, 0.25)?,
        })
    }
}

/// Simulates a whole flight: the vehicle, its noisy sensors, and the flight of `tilthex-rt`. `flight` has the other arguments
/// of `tilthex.simulate`; `record` names the columns, all if it is missing. Returns a dict of (N, k) arrays, one row per control
/// period of 2 ms, and the faults that began (true) or ended (false), each with its time, s, and its name.
#[pyfunction]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    config: &Config,
    truth: Option<&Bound<'py, PyAny>>,
    seed: &Bound<'py, PyAny>,
    flight: Common<'py>,
    record: Option<Vec<String>>,
) -> PyResult<(Columns<'py>, FaultChanges)> {
    known(record.as_deref().unwrap_or_default())?;
    let scenario = flight.scenario(&config.checked, truth::section(truth)?, convert::seed(seed)?)?;
    let fly = || record.as_ref().map_or_else(|| run(&scenario), |wanted| run_recording(&scenario, wanted));
    let record = py.detach(fly).map_err(convert::config_error)?;
    let faults = record.faults().iter().map(|change| (change.time, change.name, change.begins)).collect();
    Ok((columns(py, &[&record], false)?, faults))
}

/// Refuses the name of a column that there is not.
fn known(record: &[String]) -> PyResult<()> {
    let unknown = record.iter().find(|name| !NAMES.contains(&name.as_str()));
    unknown.map_or(Ok(()), |unknown| {
        let known = NAMES.join(", ");
        Err(PyValueError::new_err(format!("record has {unknown:?}; expected any of {known}")))
    })
}

/// Simulates many flights in `workers` threads: one flight for each of `configs`, `truths` and `seeds`, which have
/// equal lengths. `progress` is called with the number of flights that have ended. Returns two dicts: the figures of
/// the flights, (N,) each, and the columns of `record`, (N, rows, k) each.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "called by tilthex.simulate_many alone")]
pub(crate) fn simulate_many<'py>(
    py: Python<'py>,
    configs: Vec<PyRef<'py, Config>>,
    truths: Vec<Option<Bound<'py, PyAny>>>,
    seeds: Vec<Bound<'py, PyAny>>,
    flight: Common<'py>,
    record: Vec<String>,
    workers: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<(Columns<'py>, Columns<'py>)> {
    known(&record)?;
    let configs: Vec<Checked> = configs.iter().map(|config| config.checked.clone()).collect();
    let scenarios = configs.iter().zip(&truths).zip(&seeds);
    let scenarios = scenarios.map(|((config, truth), seed)| {
        flight.scenario(config, truth::section(truth.as_ref())?, convert::seed(seed)?)
    });
    let scenarios = scenarios.collect::<PyResult<Vec<_>>>()?;
    let processors = thread::available_parallelism().map_or(1, NonZeroUsize::get);
    let progress = progress.map(Bound::unbind);
    let mut raised = None;
    let flown = py.detach(|| {
        run_many(&scenarios, &record, workers.unwrap_or(processors), |ended| {
            let told = Python::attach(|py| {
                py.check_signals()?;
                progress.as_ref().map_or(Ok(()), |call| call.call1(py, (ended,)).map(drop))
            });
            told.map_or_else(
                |error| {
                    raised = Some(error);
                    ControlFlow::Break(())
                },
                ControlFlow::Continue,
            )
        })
    });
    if let Some(error) = raised {
        return Err(error);
    }
    let flown = flown.map_err(|(number, why)| PyValueError::new_err(format!("flight {number}: {why}")))?;
    let flown = flown.unwrap_or_default();
    let records: Vec<&Record> = flown.iter().map(|outcome| &outcome.record).collect();
    Ok((figures(py, &flown)?, columns(py, &records, true)?))
}

/// The figures of many flights, one column per figure.
fn figures<'py>(py: Python<'py>, flown: &[Outcome]) -> PyResult<Columns<'py>> {
    type Figure = fn(&Summary) -> f64;
    let figures: [(&str, Figure); 8] = [
        ("position_error_rms", |s| s.position_error.0),
        ("position_error_largest", |s| s.position_error.1),
        ("rotation_error_largest", |s| s.rotation_error),
        ("tool_deviation_largest", |s| s.tool_deviation),
        ("tool_force_largest", |s| s.tool_force),
        ("tilt_largest", |s| s.tilt),
        ("saturated", |s| s.saturated),
        ("phase", |s| f64::from(s.phase as u8)),
    ];
    let dict = PyDict::new(py);
    for (name, of) in figures {
        dict.set_item(name, PyArray1::from_iter(py, flown.iter().map(|outcome| of(&outcome.summary))))?;
    }
    Ok(dict)
}

/// The columns of records of equal length: (N, rows, k) if they are stacked, otherwise (rows, k) of the only record.
fn columns<'py>(py: Python<'py>, records: &[&Record], stacked: bool) -> PyResult<Columns<'py>> {
    let dict = PyDict::new(py);
    let Some(first) = records.first() else { return Ok(dict) };
    for (number, column) in first.columns().iter().enumerate() {
        let rows = column.values.len() / column.width;
        let same = records.iter().filter_map(|record| record.columns().get(number));
        let values: Vec<f64> = same.flat_map(|column| column.values.iter().copied()).collect();
        let array = PyArray1::from_vec(py, values);
        if stacked {
            dict.set_item(column.name, array.reshape([records.len(), rows, column.width])?)?;
        } else {
            dict.set_item(column.name, array.reshape([rows, column.width])?)?;
        }
    }
    Ok(dict)
}

fn push(index: usize, keys: &Bound<'_, PyDict>) -> PyResult<Push> {
    let name = format!("pushes[{index}]");
    let push: Push = convert::table(&name, keys)?.try_into().map_err(|e| {
        PyValueError::new_err(format!("{name}: {}", tilthex_config::one_line(&e.to_string())))
    })?;
    for number in [push.at, push.duration].iter().chain(&push.force).chain(&push.torque) {
        convert::number(&name, *number, -1e5, 1e5)?;
    }
    Ok(push)
}

/// The noise of the experiments times `scale`, and biases.
fn sensors(
    scale: f64,
    gyro_bias: Option<&Bound<'_, PyAny>>,
    accelerometer_bias: Option<&Bound<'_, PyAny>>,
) -> PyResult<SensorParams> {
    let n = SensorParams::EXPERIMENTS;
    Ok(SensorParams {
        position: scale * n.position,
        orientation: scale * n.orientation,
        gyro: scale * n.gyro,
        accelerometer: scale * n.accelerometer,
        rotor_speed: scale * n.rotor_speed,
        gyro_bias_i: convert::or_zero("gyro_bias", gyro_bias)?,
        accelerometer_bias_i: convert::or_zero("accelerometer_bias", accelerometer_bias)?,
        ..n
    })
}
