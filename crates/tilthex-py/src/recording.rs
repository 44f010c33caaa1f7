//! The functions of the wire format that `tilthex.recording` needs.

use crate::{config::Config, convert};
use numpy::{PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use tilthex_link::{Link, VehicleLink};

/// The inertial samples in the recorded bytes of the link. Takes chunks of bytes, each with the time at which it was
/// read. Returns rows of time (s), gyro (rad/s), specific force (m/s^2), IMU axes, (n, 7).
#[pyfunction]
pub(crate) fn read_imu<'py>(
    py: Python<'py>,
    config: &Config,
    times: Vec<f64>,
    chunks: Vec<Vec<u8>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let params = config.checked.linked_params(false).map_err(convert::config_error)?;
    let rotors = params.flight.vehicle.rotor_count();
    let mut link = Link::new(params.kind, params.link, rotors).map_err(convert::value_error)?;
    let mut rows = Vec::new();
    for (time, chunk) in times.iter().zip(&chunks) {
        for sample in link.receive(chunk, *time).inertial.samples() {
            rows.push(sample.time);
            rows.extend(sample.gyro_i.iter().chain(&sample.specific_force_i));
        }
    }
    convert::array1(py, &rows).reshape([rows.len() / 7, 7])
}
