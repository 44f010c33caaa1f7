//! `tilthex._core.simulate`: a closed loop, simulated with the GIL released.

use crate::{config::Config, convert, setpoint::Setpoint, trajectory::Trajectory, truth};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use tilthex_core::{Vector3, flight::Route, plant::SensorParams};
use tilthex_sim::{
    pushes::{Push, Pushes},
    simulate::{Scenario, Start, run},
};

/// Simulates a whole flight: the vehicle, its noisy sensors, and the flight of `tilthex-rt`. Returns a dict of (N, k)
/// arrays, one row per control period of 2 ms.
#[pyfunction]
#[pyo3(signature = (
    config, *, duration, setpoint=None, trajectory=None, pushes=None, noise=1.0, gyro_bias=None,
    accelerometer_bias=None, seed=0, estimator=true, pose_delay=0.015, start="air",
    truth=None
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments in Python")]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    config: &Config,
    duration: f64,
    setpoint: Option<Setpoint>,
    trajectory: Option<Trajectory>,
    pushes: Option<Vec<Bound<'py, PyDict>>>,
    noise: f64,
    gyro_bias: Option<&Bound<'py, PyAny>>,
    accelerometer_bias: Option<&Bound<'py, PyAny>>,
    seed: u64,
    estimator: bool,
    pose_delay: f64,
    start: &str,
    truth: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let trajectory = match (setpoint, trajectory) {
        (Some(Setpoint(s)), None) => tilthex_core::trajectory::Trajectory::hold(s.position_w, s.rotation_we),
        (None, Some(Trajectory(t))) => t,
        _ => {
            return Err(PyValueError::new_err(
                "setpoint and trajectory are both given or both missing; expected exactly one of them",
            ));
        }
    };
    let start = match start {
        "air" => Start::Air(trajectory),
        "ground" => {
            let limits = config.checked.mission().limits();
            Start::Ground(Some(Route::of(&trajectory, &limits).map_err(convert::value_error)?))
        }
        other => {
            return Err(PyValueError::new_err(format!(
                "start is \"{other}\"; expected \"air\" or \"ground\""
            )));
        }
    };
    let pushes = pushes.unwrap_or_default();
    let pushes = pushes.iter().enumerate().map(|(i, p)| push(i, p));
    let scenario = Scenario {
        config: &config.checked,
        start,
        pushes: Pushes::new(pushes.collect::<PyResult<_>>()?),
        truth: truth::section(truth)?,
        duration: convert::number("duration", duration, 0.0, 1e5)?,
        sensors: sensors(convert::number("noise", noise, 0.0, 1e3)?, gyro_bias, accelerometer_bias)?,
        seed,
        estimate: estimator,
        pose_delay: convert::number("pose_delay", pose_delay, 0.0, 0.25)?,
    };
    let record = py.detach(|| run(&scenario)).map_err(convert::config_error)?;
    let columns = PyDict::new(py);
    for column in record.columns() {
        let rows = column.values.len() / column.width;
        let array = PyArray1::from_slice(py, &column.values).reshape([rows, column.width])?;
        columns.set_item(column.name, array)?;
    }
    Ok(columns)
}

fn push(index: usize, keys: &Bound<'_, PyDict>) -> PyResult<Push> {
    let name = format!("pushes[{index}]");
    let push: Push = convert::table(&name, keys)?
        .try_into()
        .map_err(|e| PyValueError::new_err(format!("{name}: {}", e.to_string().trim())))?;
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
    let bias = |name: &str, given: Option<&Bound<'_, PyAny>>| {
        given.map_or(Ok(Vector3::zeros()), |b| convert::vector(name, b))
    };
    Ok(SensorParams {
        position: scale * n.position,
        orientation: scale * n.orientation,
        gyro: scale * n.gyro,
        accelerometer: scale * n.accelerometer,
        rotor_speed: scale * n.rotor_speed,
        gyro_bias_i: bias("gyro_bias", gyro_bias)?,
        accelerometer_bias_i: bias("accelerometer_bias", accelerometer_bias)?,
        ..n
    })
}
