//! `tilthex.Allocation`.

use crate::{
    convert::{self, array1},
    value,
};
use numpy::PyArray1;
use pyo3::{
    exceptions::PyValueError,
    prelude::*,
    types::{IntoPyDict, PyDict},
};
use std::collections::HashMap;
use tilthex_core::{
    allocation::{self, Priority},
    vehicle::speeds,
};

const ALLOCATION: [&str; 6] = ["inputs", "wrench", "saturated", "given_up", "shortfall", "iterations"];

/// The part of the wrench with this name.
fn part(argument: &str, name: &str) -> PyResult<Priority> {
    Priority::from_name(name).ok_or_else(|| {
        let known = Priority::ORDER.map(Priority::name).join(", ");
        PyValueError::new_err(format!("{argument} has {name:?}; expected one of {known}"))
    })
}

/// The commanded rotor speeds, and the parts of the wrench that they do not produce. The rotor
/// speeds follow from the `inputs`; what is not given is zero or missing.
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct Allocation {
    pub(crate) found: allocation::Allocation,
    pub(crate) count: usize,
}

#[pymethods]
impl Allocation {
    #[new]
    #[pyo3(signature = (inputs, wrench, *, saturated=false, given_up=None, shortfall=None, iterations=0))]
    fn new(
        inputs: &Bound<'_, PyAny>,
        wrench: &Bound<'_, PyAny>,
        saturated: bool,
        given_up: Option<&str>,
        shortfall: Option<HashMap<String, f64>>,
        iterations: u32,
    ) -> PyResult<Self> {
        let (inputs, count) = convert::all_rotors("inputs", inputs)?;
        let mut errors = [0.0; 4];
        for (name, error) in shortfall.unwrap_or_default() {
            let part = part("shortfall", &name)?;
            let error = convert::number(&format!("shortfall[{name:?}]"), error, 0.0, f64::MAX)?;
            if let Some((_, of_part)) = Priority::ORDER.iter().zip(&mut errors).find(|(p, _)| **p == part) {
                *of_part = error;
            }
        }
        let found = allocation::Allocation {
            inputs,
            wrench: convert::vector("wrench", wrench)?,
            saturated,
            given_up: given_up.map(|name| part("given_up", name)).transpose()?,
            shortfall: errors,
            at_lower: 0,
            at_upper: 0,
            iterations,
        };
        Ok(Self { found, count })
    }

    /// Rotor speeds, Hz, (n,).
    #[getter]
    fn rotor_speeds<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &speeds(&self.found.inputs).as_slice()[..self.count])
    }

    /// Rotor inputs u = w |w|, Hz^2, (n,).
    #[getter]
    fn inputs<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.found.inputs.as_slice()[..self.count])
    }

    /// The body wrench that the inputs produce, robot, (6,).
    #[getter]
    fn wrench<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.found.wrench.as_slice())
    }

    /// Whether a limit changes the inputs.
    #[getter]
    fn saturated(&self) -> bool {
        self.found.saturated
    }

    /// Error of each part of the wrench by its name: N or N m.
    #[getter]
    fn shortfall<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        Priority::ORDER.map(Priority::name).into_iter().zip(self.found.shortfall).into_py_dict(py)
    }

    /// Steps of the search; 0 if no limit was active.
    #[getter]
    fn iterations(&self) -> u32 {
        self.found.iterations
    }

    /// The most important part of the wrench that is not met, or None.
    #[getter]
    fn given_up(&self) -> Option<&'static str> {
        self.found.given_up.map(Priority::name)
    }

    fn __getnewargs_ex__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        value::arguments(this, &ALLOCATION)
    }

    fn __eq__(this: &Bound<'_, Self>, other: &Bound<'_, Self>) -> PyResult<bool> {
        value::equal(this, other, &ALLOCATION)
    }

    fn __hash__(this: &Bound<'_, Self>) -> PyResult<isize> {
        value::hash(this, &ALLOCATION)
    }

    fn __repr__(this: &Bound<'_, Self>) -> PyResult<String> {
        value::shown(this, &ALLOCATION, 2)
    }
}
