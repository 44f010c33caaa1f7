//! Recognises values that are probably in other units than the expected ones.

use crate::convert;
use pyo3::{exceptions::PyValueError, prelude::*};

/// Above this rate, rad/s, the unit is probably wrong: the fastest gyro measures 2000 degrees per second, 35 rad/s.
const FASTEST: f64 = 40.0;
/// Specific forces in g are about 1 if a vehicle rests or hovers; specific forces in m/s^2 are rarely in this range.
const IN_G: (f64, f64) = (0.7, 1.4);
/// The longest period of an IMU, s.
const LONGEST: f64 = 1.0;

/// Returns an error with a question if times (s), rates (rad/s) or specific forces (m/s^2) are probably in other
/// units.
pub(crate) fn question(time: &[f64], gyro: &[f64], specific_force: &[f64]) -> PyResult<()> {
    let steps = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let ask = |text: String| Err(PyValueError::new_err(text));
    if let Some(step) = quantile(steps, 0.5).filter(|step| *step > LONGEST) {
        let unit = if step > 1e5 { "nanoseconds" } else { "milliseconds or microseconds" };
        return ask(format!("imu_time rises by {step:.4} each sample; is it in {unit}? expected seconds"));
    }
    if let Some(rate) = quantile(norms(gyro), 0.99).filter(|rate| *rate > FASTEST) {
        return ask(format!("gyro reads {rate:.4} and more; is it in degrees per second? expected rad/s"));
    }
    if let Some(force) = quantile(norms(specific_force), 0.5).filter(|f| (IN_G.0..IN_G.1).contains(f)) {
        return ask(format!("specific_force is {force:.4} for half of the time; is it in g? expected m/s^2"));
    }
    Ok(())
}

/// Norms of the rows of three.
fn norms(rows: &[f64]) -> Vec<f64> {
    rows.chunks_exact(3).map(|row| row.iter().map(|x| x * x).sum::<f64>().sqrt()).collect()
}

/// The quantile of the finite values at a share from 0 to 1. None if there is no finite value.
fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    values.retain(|x| x.is_finite());
    values.sort_by(f64::total_cmp);
    let place = (share * values.len() as f64) as usize;
    values.get(place.min(values.len().saturating_sub(1))).copied()
}

/// Raises `ValueError` with a question if times (s), rates (rad/s) or specific forces (m/s^2) are probably in other
/// units.
#[pyfunction]
pub(crate) fn question_units(
    imu_time: &Bound<'_, PyAny>,
    gyro: &Bound<'_, PyAny>,
    specific_force: &Bound<'_, PyAny>,
) -> PyResult<()> {
    let time = convert::rows("imu_time", imu_time, None, &[])?;
    let gyro = convert::rows("gyro", gyro, Some(time.len()), &[3])?;
    question(&time, &gyro, &convert::rows("specific_force", specific_force, Some(time.len()), &[3])?)
}
