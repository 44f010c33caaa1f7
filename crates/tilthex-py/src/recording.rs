//! The functions of the wire format that `tilthex.recording` needs.

use crate::{config::Config, convert};
use numpy::{PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use tilthex_link::{
    Link, VehicleLink,
    px4::{ActuatorMotors, CLIENT, Decoder, FromAgent, MOTORS, Message, TopicMessage},
};

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

/// The throttles in the recorded bytes to a vehicle with PX4. Takes the bytes of ticks. Returns rows of the number of a
/// tick and the throttles of the rotors, 0 to 1, NaN for a motor that stands, (m, 1 + n).
#[pyfunction]
pub(crate) fn read_throttles<'py>(
    py: Python<'py>,
    config: &Config,
    chunks: Vec<Vec<u8>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rotors = config.checked.vehicle().vehicle().rotor_count();
    let (mut decoder, mut rows) = (Decoder::new(CLIENT), Vec::new());
    // No other message to PX4 has this length.
    let length = ActuatorMotors { control: [0.0; MOTORS] }.write(&mut [0; 128]);
    for (tick, chunk) in chunks.iter().enumerate() {
        for byte in chunk {
            let Some(message) = decoder.push(*byte).and_then(Message::parse) else { continue };
            for said in message.from_agent().flatten() {
                if let FromAgent::Data(_, data) = said
                    && data.len() == length
                    && let Some(motors) = ActuatorMotors::read(data)
                {
                    rows.push(tick as f64);
                    rows.extend(motors.control.iter().take(rotors).map(|throttle| f64::from(*throttle)));
                }
            }
        }
    }
    convert::array1(py, &rows).reshape([rows.len() / (1 + rotors), 1 + rotors])
}
