//! Rotations as Python functions.

use crate::convert::{array1, array2, matrix, rotation, vector};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tilthex_core::so3;

/// The skew matrix with `hat(a) @ b == cross(a, b)`, (3, 3).
#[pyfunction]
fn hat<'py>(a: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    array2(a.py(), &so3::hat(&vector("a", a)?))
}

/// Inverse of `hat`, (3,). For a matrix that is not skew-symmetric, the inverse of `hat` for its skew-symmetric part.
#[pyfunction]
fn vee<'py>(m: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray1<f64>>> {
    Ok(array1(m.py(), so3::vee(&matrix("m", m)?).as_slice()))
}

/// The rotation by the angle `|v|`, rad, about `v`, (3, 3).
#[pyfunction]
fn exp<'py>(v: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    array2(v.py(), &so3::exp(&vector("v", v)?))
}

/// The rotation vector of a rotation, rad, (3,), with a norm in [0, pi].
#[pyfunction]
fn log<'py>(r: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray1<f64>>> {
    Ok(array1(r.py(), so3::log(&rotation("r", r)?).as_slice()))
}

/// The rotation nearest to `m` (Frobenius norm), (3, 3), for `m` near a rotation.
#[pyfunction]
fn project<'py>(m: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let found = so3::project(&matrix("m", m)?).ok_or_else(|| {
        PyValueError::new_err("m is singular or reflects; expected a 3x3 matrix near a rotation")
    })?;
    array2(m.py(), &found)
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(hat, module)?)?;
    module.add_function(wrap_pyfunction!(vee, module)?)?;
    module.add_function(wrap_pyfunction!(exp, module)?)?;
    module.add_function(wrap_pyfunction!(log, module)?)?;
    module.add_function(wrap_pyfunction!(project, module)?)
}
