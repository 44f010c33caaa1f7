//! Python bindings: registers classes, checks shapes and converts arrays. One
//! file a class; no control law lives here.

mod convert;
mod so3;
mod vehicle;

use pyo3::prelude::*;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("GRAVITY", tilthex_core::GRAVITY)?;
    so3::register(module)?;
    module.add_class::<vehicle::Vehicle>()?;
    Ok(())
}
