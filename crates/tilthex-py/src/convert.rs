//! Converts arrays. An argument that is refused gives one sentence with its name, what was found and what was
//! expected.

use std::hash::{DefaultHasher, Hash, Hasher};

use nalgebra::{SMatrix, SVector};
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBool, PyDict};
use tilthex_config::ConfigError;
use tilthex_core::{Error, MAX_ROTORS, Matrix3, RotorVector, Vector3, Wrench, so3};
use toml::{Table, Value};

/// A `ValueError` with the sentence of the core.
pub(crate) fn value_error(error: Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// A `ValueError` with the sentence of the configuration.
pub(crate) fn config_error(error: ConfigError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The return value of `__reduce__`: the function that makes a copy, and its argument.
pub(crate) type Copied<'py> = (Bound<'py, PyAny>, (String,));

/// `__reduce__` of an object that its TOML defines: a function of `tilthex._copied`, and the text.
pub(crate) fn copied<'py>(py: Python<'py>, maker: &str, toml: String) -> PyResult<Copied<'py>> {
    Ok((py.import("tilthex._copied")?.getattr(maker)?, (toml,)))
}

/// The hash of a text.
pub(crate) fn hash(text: &str) -> u64 {
    let mut hasher = DefaultHasher::new();
    text.hash(&mut hasher);
    hasher.finish()
}

/// A shape as Python prints it.
fn shape_text(shape: &[usize]) -> String {
    match shape {
        [n] => format!("({n},)"),
        _ => format!("({})", shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// Any array-like of numbers as a float64 array. An array of float64 is not copied. A mask is not an array of
/// numbers.
fn float_array<'py>(name: &str, object: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    if let Ok(array) = object.cast::<PyArrayDyn<f64>>() {
        return Ok(array.clone());
    }
    static ASARRAY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = object.py();
    let asarray = ASARRAY.import(py, "numpy", "asarray")?;
    let refused =
        |what: String| PyValueError::new_err(format!("{name} is {what}; expected an array of numbers"));
    let no_array = |_| {
        let kind = object.get_type().name().map_or_else(|_| "an object".into(), |n| n.to_string());
        refused(format!("a {kind}"))
    };
    let found = asarray.call1((object,)).map_err(no_array)?;
    let kind: String = found.getattr("dtype")?.getattr("kind")?.extract()?;
    match kind.as_str() {
        "b" => return Err(refused("an array of truth values".into())),
        "c" => return Err(refused("an array of complex numbers".into())),
        _ => {}
    }
    Ok(asarray.call1((found, "float64")).map_err(no_array)?.cast_into::<PyArrayDyn<f64>>()?)
}

/// The unit of the argument that a name names, in place of the name's own words: "waypoints[0][\"position\"]" is m.
fn unit(name: &str) -> Option<&'static str> {
    let known = |word: &str| match word {
        "position" | "position_error" => Some("m"),
        "velocity" | "velocity_error" => Some("m/s"),
        "acceleration" | "specific_force" | "accelerometer_bias" => Some("m/s^2"),
        "angular_velocity" | "angular_velocity_error" | "gyro" | "gyro_bias" => Some("rad/s"),
        "angular_acceleration" => Some("rad/s^2"),
        "wrench" | "tool_wrench" | "bias" | "wrench_robot" | "wrench_tool" | "wrench_admittance"
        | "wanted_wrench" | "allocated_wrench" => Some("N and N m"),
        "rotor_speeds" | "rotor_command" => Some("Hz"),
        "rotor_accelerations" => Some("Hz/s"),
        "inputs" => Some("Hz^2"),
        "heading" => Some("rad"),
        "time" | "arrival" | "duration" | "hold" | "pose_delay" | "loop_delay" | "rotor_speed_age"
        | "period" | "damping_time" | "imu_time" | "pose_time" | "pose_arrival_time" => Some("s"),
        _ => None,
    };
    name.split(|c: char| !c.is_alphanumeric() && c != '_').find_map(known)
}

/// What was expected, with the unit of the argument.
fn with_unit(name: &str, expected: &str) -> String {
    unit(name).map_or_else(|| expected.to_owned(), |unit| format!("{expected}, {unit}"))
}

/// Reads the numbers of an array of exactly this shape, row by row, into `out`.
fn read(name: &str, object: &Bound<'_, PyAny>, expected: &[usize], out: &mut [f64]) -> PyResult<()> {
    let array = float_array(name, object)?;
    let shape = array.shape();
    if shape != expected {
        let (found, expected) = (shape_text(shape), with_unit(name, &shape_text(expected)));
        return Err(PyValueError::new_err(format!("{name} has shape {found}; expected {expected}")));
    }
    // One by one: a view of so few numbers takes longer than they do.
    let columns = expected.get(1).copied().unwrap_or(1);
    for (k, to) in out.iter_mut().enumerate() {
        let place = [k / columns, k % columns];
        *to = array.get_owned(&place[..expected.len().min(2)]).unwrap_or(f64::NAN);
    }
    if out.iter().all(|x| x.is_finite()) { Ok(()) } else { Err(not_finite(name, out)) }
}

/// Reads the numbers of an array whose rows have this inner shape (empty: single numbers), row by row. `count` is the
/// expected number of rows, if it is known. NaN is allowed.
pub(crate) fn rows(
    name: &str,
    object: &Bound<'_, PyAny>,
    count: Option<usize>,
    inner: &[usize],
) -> PyResult<Vec<f64>> {
    let array = float_array(name, object)?;
    let shape = array.shape();
    let fits = shape.split_first().is_some_and(|(n, rest)| rest == inner && count.is_none_or(|c| c == *n));
    if !fits {
        let first = count.map_or_else(|| "n".to_owned(), |c| c.to_string());
        let rest = inner.iter().map(|n| format!(", {n}")).collect::<String>();
        let expected = if inner.is_empty() { format!("({first},)") } else { format!("({first}{rest})") };
        let (found, expected) = (shape_text(shape), with_unit(name, &expected));
        return Err(PyValueError::new_err(format!("{name} has shape {found}; expected {expected}")));
    }
    let view = array.try_readonly().map_err(|e| PyValueError::new_err(format!("{name}: {e}")))?;
    Ok(view.as_array().iter().copied().collect())
}

fn not_finite(name: &str, values: &[f64]) -> PyErr {
    let worst = values.iter().find(|x| !x.is_finite()).copied().unwrap_or(f64::NAN);
    PyValueError::new_err(format!("{name} holds {worst}; expected {}", with_unit(name, "finite numbers")))
}

/// `N` finite numbers.
pub(crate) fn vector<const N: usize>(name: &str, object: &Bound<'_, PyAny>) -> PyResult<SVector<f64, N>> {
    let mut out = SVector::<f64, N>::zeros();
    read(name, object, &[N], out.as_mut_slice())?;
    Ok(out)
}

/// Three finite numbers; zero if they are not given.
pub(crate) fn or_zero(name: &str, given: Option<&Bound<'_, PyAny>>) -> PyResult<Vector3> {
    given.map_or(Ok(Vector3::zeros()), |v| vector(name, v))
}

/// An `R` by `C` matrix of finite numbers.
pub(crate) fn matrix<const R: usize, const C: usize>(
    name: &str,
    object: &Bound<'_, PyAny>,
) -> PyResult<SMatrix<f64, R, C>> {
    // Read row by row into the columns of the transpose.
    let mut rows = SMatrix::<f64, C, R>::zeros();
    read(name, object, &[R, C], rows.as_mut_slice())?;
    Ok(rows.transpose())
}

/// A rotation matrix.
pub(crate) fn rotation(name: &str, object: &Bound<'_, PyAny>) -> PyResult<Matrix3> {
    let r = matrix::<3, 3>(name, object)?;
    let defect = so3::rotation_defect(&r);
    if defect > 1e-6 { Err(not_rotation(name, defect)) } else { Ok(r) }
}

/// Largest `rotation_defect` of a measured rotation: each axis may be off by 1 %, and the defect is the error of squares,
/// or of the determinant.
const MEASURED: f64 = 0.035;

/// A measured matrix, which is a rotation to 1 %, as those of files: the nearest rotation.
pub(crate) fn near_rotation(name: &str, object: &Bound<'_, PyAny>) -> PyResult<Matrix3> {
    let r = matrix::<3, 3>(name, object)?;
    near_rotation_of(name, &r)
}

/// [`near_rotation`] for a matrix that was read before.
pub(crate) fn near_rotation_of(name: &str, r: &Matrix3) -> PyResult<Matrix3> {
    let defect = so3::rotation_defect(r);
    if defect > MEASURED {
        return Err(not_rotation(name, defect));
    }
    // Newton's steps to the polar factor: each squares the defect. Those of the core follow.
    let steps = if defect > so3::NEAR_ROTATION { 2 } else { 0 };
    let near = (0..steps).fold(*r, |r, _| 1.5 * r - 0.5 * r * (r.transpose() * r));
    Ok(so3::straightened(&near))
}

fn not_rotation(name: &str, defect: f64) -> PyErr {
    PyValueError::new_err(format!(
        "{name} is {defect:.1e} away from a rotation; expected an orthonormal 3x3 matrix with determinant +1"
    ))
}

/// A wrench (force, torque) given as six numbers.
pub(crate) fn wrench(name: &str, object: &Bound<'_, PyAny>) -> PyResult<Wrench> {
    Ok(Wrench::from_vector(&vector::<6>(name, object)?))
}

/// One finite number per rotor.
pub(crate) fn rotors(name: &str, object: &Bound<'_, PyAny>, count: usize) -> PyResult<RotorVector> {
    let mut out = RotorVector::zeros();
    read(name, object, &[count], &mut out.as_mut_slice()[..count])?;
    Ok(out)
}

/// One finite number for each rotor of a vehicle that is not known, and their count.
pub(crate) fn all_rotors(name: &str, object: &Bound<'_, PyAny>) -> PyResult<(RotorVector, usize)> {
    let given = rows(name, object, None, &[])?;
    let count = given.len();
    if count > MAX_ROTORS {
        let expected = with_unit(name, &format!("(n,) with n up to {MAX_ROTORS}"));
        return Err(PyValueError::new_err(format!("{name} has shape ({count},); expected {expected}")));
    }
    Ok((rotors(name, object, count)?, count))
}

/// Rotors, from 0, as a set of bits.
pub(crate) fn rotor_set(name: &str, rotors: Option<Vec<i64>>, count: usize) -> PyResult<u16> {
    let mut set = 0;
    for rotor in rotors.unwrap_or_default() {
        number(name, rotor as f64, 0.0, count as f64 - 1.0)?;
        set |= 1 << rotor;
    }
    Ok(set)
}

/// A seed.
pub(crate) fn seed(given: &Bound<'_, PyAny>) -> PyResult<u64> {
    given.extract().map_err(|_| {
        let expected = "expected a whole number from 0 to 2^64 - 1";
        PyValueError::new_err(given.repr().map_or_else(
            |_| format!("seed is no number; {expected}"),
            |found| format!("seed is {found}; {expected}"),
        ))
    })
}

/// A finite number within `min..=max`.
pub(crate) fn number(name: &str, value: f64, min: f64, max: f64) -> PyResult<f64> {
    if value.is_nan() || value < min || value > max {
        let expected = with_unit(name, &format!("a number from {min} to {max}"));
        return Err(PyValueError::new_err(format!("{name} is {value}; expected {expected}")));
    }
    Ok(value)
}

/// A finite number.
pub(crate) fn finite(name: &str, value: f64) -> PyResult<f64> {
    if value.is_finite() { Ok(value) } else { Err(not_finite(name, &[value])) }
}

/// A period, s: positive, up to one second.
pub(crate) fn period(dt: f64) -> PyResult<f64> {
    if dt > 0.0 && dt <= 1.0 {
        Ok(dt)
    } else {
        Err(PyValueError::new_err(format!("dt is {dt}; expected seconds above 0, up to 1")))
    }
}

/// A dict as a TOML table.
pub(crate) fn table(name: &str, dict: &Bound<'_, PyDict>) -> PyResult<Table> {
    dict.iter()
        .map(|(key, value)| {
            let key: String = key.extract()?;
            let value = toml_value(&format!("{name}[{key:?}]"), &value)?;
            Ok((key, value))
        })
        .collect()
}

fn toml_value(name: &str, object: &Bound<'_, PyAny>) -> PyResult<Value> {
    if let Ok(dict) = object.cast::<PyDict>() {
        table(name, dict).map(Value::Table)
    } else if let Ok(flag) = object.cast::<PyBool>() {
        Ok(Value::Boolean(flag.is_true()))
    } else if let Ok(text) = object.extract() {
        Ok(Value::String(text))
    } else if let Ok(whole) = object.extract() {
        Ok(Value::Integer(whole))
    } else if let Ok(number) = object.extract() {
        Ok(Value::Float(number))
    } else if let Ok(items) = object.try_iter() {
        items.map(|item| toml_value(name, &item?)).collect::<PyResult<_>>().map(Value::Array)
    } else {
        let kind = object.get_type().name()?;
        let message = format!("{name} is a {kind}; expected a number, a text, a list or a dict");
        Err(PyTypeError::new_err(message))
    }
}

/// A new 1-D array.
pub(crate) fn array1<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, values)
}

/// A new 2-D array.
pub(crate) fn array2<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    m: &SMatrix<f64, R, C>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    array1(py, m.transpose().as_slice()).reshape([R, C])
}

/// The six numbers of a wrench.
pub(crate) fn wrench_array<'py>(py: Python<'py>, w: &Wrench) -> Bound<'py, PyArray1<f64>> {
    array1(py, w.to_vector().as_slice())
}
