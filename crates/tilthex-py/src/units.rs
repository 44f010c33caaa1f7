//! Recognises values that are probably in other units than the expected ones.

use crate::convert;
use pyo3::{exceptions::PyValueError, prelude::*};
use tilthex_core::{Matrix3, Vector3, so3};

/// Above this rate, rad/s, the unit is probably wrong: the fastest gyro measures 2000 degrees per second, 35 rad/s.
const FASTEST: f64 = 40.0;
/// Specific forces in g are about 1 if a vehicle rests or hovers; specific forces in m/s^2 are rarely in this range.
const IN_G: (f64, f64) = (0.7, 1.4);
/// The longest period of an IMU, s.
const LONGEST: f64 = 1.0;
/// The longest period of poses, s.
const LONGEST_OF_POSES: f64 = 10.0;
/// Inertial samples and poses that are further apart than this, s, have different clocks or units.
const APART: f64 = 0.1;
/// At least one of so many poses lies in the time of the samples.
const FEW: usize = 100;
/// Rates and speeds are means over at least the first time and at most the second one, s.
const SPAN: (f64, f64) = (0.2, 1.0);
/// Mean rates and speeds are compared at this quantile: a few wrong poses do not count.
const OFTEN: f64 = 0.9;
/// Below this rate, rad/s, poses do not show whether a gyro counts in degrees.
const TURNS: f64 = 0.05;
/// A gyro in degrees per second reads this many times the rate of the poses, within `ABOUT`.
const DEGREES: f64 = 180.0 / core::f64::consts::PI;
/// The factor within which a ratio counts as `DEGREES`.
const ABOUT: f64 = 1.5;
/// Above this speed, m/s, positions are probably not in m.
const FASTEST_FLIGHT: f64 = 40.0;

/// Returns an error with a question if times (s), rates (rad/s) or specific forces (m/s^2) are probably in other
/// units.
pub(crate) fn question(time: &[f64], gyro: &[f64], specific_force: &[f64]) -> PyResult<()> {
    let steps = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let ask = |text: String| Err(PyValueError::new_err(text));
    if let Some(step) = quantile(steps, 0.5).filter(|step| *step >= LONGEST) {
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

/// Poses: times (m,) s, positions (m, 3) m, rotations (m, 3, 3). They may have NaN.
pub(crate) struct Poses<'a> {
    pub time: &'a [f64],
    pub position: &'a [f64],
    pub rotation: &'a [f64],
}

/// Returns an error with a question if poses and inertial samples have no time in common, if the gyro reads degrees per
/// second in comparison with the rates of the poses, or if positions are probably not in m.
pub(crate) fn question_poses(time: &[f64], gyro: &[f64], poses: &Poses<'_>) -> PyResult<()> {
    let ask = |text: String| Err(PyValueError::new_err(text));
    let steps = poses.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if let Some(step) = quantile(steps, 0.5).filter(|step| *step >= LONGEST_OF_POSES) {
        let unit = if step > 1e5 { "nanoseconds" } else { "milliseconds or microseconds" };
        return ask(format!("pose_time rises by {step:.4} each pose; is it in {unit}? expected seconds"));
    }
    let (Some((begin, end)), Some((first, last))) = (range(time), range(poses.time)) else { return Ok(()) };
    let inside = |time: &&f64| (begin - APART..=end + APART).contains(*time);
    let known = poses.time.iter().filter(|time| time.is_finite()).count();
    if FEW * poses.time.iter().filter(inside).count() < known {
        return ask(format!(
            "imu_time is {begin} to {end} s and pose_time is {first} to {last} s, with hardly any time in common; expected \
             one clock, in seconds"
        ));
    }
    let (rates, speeds) = motion(poses);
    if let Some(speed) = quantile(speeds, OFTEN).filter(|speed| *speed > FASTEST_FLIGHT) {
        return ask(format!(
            "position changes by {speed:.4} each second and more; is it in millimetres? expected m"
        ));
    }
    let Some(rate) = quantile(rates, OFTEN).filter(|rate| *rate > TURNS) else { return Ok(()) };
    let read = quantile(means(time, gyro, first, last), OFTEN);
    match read.filter(|read| (DEGREES / ABOUT..DEGREES * ABOUT).contains(&(read / rate))) {
        Some(read) => ask(format!(
            "gyro reads {read:.4} where the poses turn with {rate:.4} rad/s; is it in degrees per second? expected rad/s"
        )),
        None => Ok(()),
    }
}

/// Mean rates, rad/s, and speeds, m/s, between poses that are `SPAN` apart.
fn motion(poses: &Poses<'_>) -> (Vec<f64>, Vec<f64>) {
    let place = |k: usize| Vector3::from_column_slice(&poses.position[3 * k..3 * k + 3]);
    let turned = |k: usize| Matrix3::from_row_slice(&poses.rotation[9 * k..9 * k + 9]);
    let pairs = spans(poses.time);
    let rate = |&(a, b, span): &(usize, usize, f64)| {
        so3::log(&so3::straightened(&(turned(a).transpose() * turned(b)))).norm() / span
    };
    let speed = |&(a, b, span): &(usize, usize, f64)| (place(b) - place(a)).norm() / span;
    (pairs.iter().map(rate).collect(), pairs.iter().map(speed).collect())
}

/// Norms of the gyro's means over `SPAN`, between two times.
fn means(time: &[f64], gyro: &[f64], first: f64, last: f64) -> Vec<f64> {
    let mean = |&(a, b, _): &(usize, usize, f64)| {
        let sum = gyro[3 * a..3 * b]
            .chunks_exact(3)
            .fold(Vector3::zeros(), |s, w| s + Vector3::new(w[0], w[1], w[2]));
        sum.norm() / (b - a) as f64
    };
    let inside = |&&(a, b, _): &&(usize, usize, f64)| time[a] >= first && time[b] <= last;
    spans(time).iter().filter(inside).map(mean).collect()
}

/// First and last place of successive spans of time, and their length.
fn spans(time: &[f64]) -> Vec<(usize, usize, f64)> {
    let mut found = Vec::new();
    let mut begin = 0;
    for end in 1..time.len() {
        let span = time[end] - time[begin];
        if span < SPAN.0 {
            continue;
        }
        if span <= SPAN.1 {
            found.push((begin, end, span));
        }
        begin = end;
    }
    found
}

/// The smallest and the largest finite value.
fn range(values: &[f64]) -> Option<(f64, f64)> {
    let finite = values.iter().copied().filter(|x| x.is_finite());
    finite.fold(None, |known, x| {
        Some(known.map_or((x, x), |(low, high): (f64, f64)| (low.min(x), high.max(x))))
    })
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

/// Raises `ValueError` with a question if poses and inertial samples have no time in common, or if times (s), rates
/// (rad/s) or positions (m) are probably in other units.
#[pyfunction]
#[pyo3(name = "question_poses")]
pub(crate) fn question_poses_of(
    imu_time: &Bound<'_, PyAny>,
    gyro: &Bound<'_, PyAny>,
    pose_time: &Bound<'_, PyAny>,
    position: &Bound<'_, PyAny>,
    rotation: &Bound<'_, PyAny>,
) -> PyResult<()> {
    let time = convert::rows("imu_time", imu_time, None, &[])?;
    let gyro = convert::rows("gyro", gyro, Some(time.len()), &[3])?;
    let taken = convert::rows("pose_time", pose_time, None, &[])?;
    let position = convert::rows("position", position, Some(taken.len()), &[3])?;
    let rotation = convert::rows("rotation", rotation, Some(taken.len()), &[3, 3])?;
    question_poses(&time, &gyro, &Poses { time: &taken, position: &position, rotation: &rotation })
}
