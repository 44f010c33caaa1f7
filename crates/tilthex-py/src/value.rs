//! What Python expects of a value: it shows how to make it, it is equal to its copy, and it goes to other processes.
//! The names of its attributes are those of the constructor's arguments; `tilthex._copied` reads them.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

fn call<'py, A>(of: &Bound<'py, PyAny>, function: &str, arguments: A) -> PyResult<Bound<'py, PyAny>>
where
    A: pyo3::call::PyCallArgs<'py>,
{
    of.py().import("tilthex._copied")?.getattr(function)?.call1(arguments)
}

/// `__getnewargs_ex__`: the attributes with these names, as arguments of the constructor.
pub(crate) fn arguments<'py>(of: &Bound<'py, PyAny>, names: &[&str]) -> PyResult<Bound<'py, PyAny>> {
    call(of, "arguments", (of, names))
}

/// `__repr__`: the call of the constructor. Attributes after the first `needed` ones are left out if they have the default.
pub(crate) fn shown(of: &Bound<'_, PyAny>, names: &[&str], needed: usize) -> PyResult<String> {
    call(of, "shown", (of, names, needed))?.extract()
}

/// `__eq__` of two values of one class.
pub(crate) fn equal(a: &Bound<'_, PyAny>, b: &Bound<'_, PyAny>, names: &[&str]) -> PyResult<bool> {
    call(a, "equal", (a, b, names))?.extract()
}

/// `__hash__`.
pub(crate) fn hash(of: &Bound<'_, PyAny>, names: &[&str]) -> PyResult<isize> {
    call(of, "hashed", (of, names))?.extract()
}

/// `__reduce__` of a block with a state: the refusal. `from` are the arguments that make a new one.
pub(crate) fn not_pickled<T>(name: &str, from: &str) -> PyResult<T> {
    Err(PyTypeError::new_err(format!(
        "{name} has a state that cannot be pickled; copy it with copy.copy, or pickle {from} and make a new one"
    )))
}
