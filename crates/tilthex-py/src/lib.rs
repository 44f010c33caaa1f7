//! Python bindings: they register classes, check shapes and convert arrays. They contain no control law.

mod allocation;
mod blocks;
mod chain;
mod config;
mod controller;
mod convert;
mod effects;
mod margins;
mod output;
mod plant;
mod recording;
mod setpoint;
mod simulate;
mod so3;
mod trajectory;
mod truth;
mod ukf;
mod ukf_run;
mod units;
mod value;
mod vehicle;
mod wire;

use pyo3::prelude::*;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("GRAVITY", tilthex_core::GRAVITY)?;
    so3::register(module)?;
    module.add_function(wrap_pyfunction!(simulate::simulate, module)?)?;
    module.add_function(wrap_pyfunction!(simulate::simulate_many, module)?)?;
    module.add_class::<blocks::AdmittanceFilter>()?;
    module.add_class::<allocation::Allocation>()?;
    module.add_class::<blocks::Allocator>()?;
    module.add_class::<blocks::PoseCommand>()?;
    module.add_class::<blocks::PoseController>()?;
    module.add_class::<blocks::WrenchObserver>()?;
    module.add_class::<chain::Loop>()?;
    module.add_class::<config::Config>()?;
    module.add_class::<controller::Controller>()?;
    module.add_class::<output::Output>()?;
    module.add_class::<margins::LoopModel>()?;
    module.add_class::<plant::Plant>()?;
    module.add_class::<setpoint::Reference>()?;
    module.add_class::<setpoint::Setpoint>()?;
    module.add_class::<trajectory::Trajectory>()?;
    module.add_class::<truth::Drawn>()?;
    module.add_class::<effects::Effects>()?;
    module.add_class::<effects::SensorErrors>()?;
    module.add_class::<truth::Truth>()?;
    module.add_function(wrap_pyfunction!(trajectory::calibration_flight, module)?)?;
    module.add_function(wrap_pyfunction!(recording::read_imu, module)?)?;
    module.add_function(wrap_pyfunction!(recording::read_throttles, module)?)?;
    module.add_function(wrap_pyfunction!(units::question_units, module)?)?;
    module.add_function(wrap_pyfunction!(units::question_poses_of, module)?)?;
    module.add_class::<ukf::Ukf>()?;
    module.add_class::<ukf_run::UkfRun>()?;
    module.add_class::<vehicle::Vehicle>()?;
    module.add_class::<wire::PoseClient>()?;
    module.add_class::<wire::VehicleLink>()?;
    Ok(())
}
