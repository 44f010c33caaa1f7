//! `tilthex.LoopModel`.

use crate::{
    config::Config,
    convert,
    truth::{self, Truth},
    vehicle::Vehicle,
};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use tilthex_config::{
    Config as Checked, TruthSection,
    margins::{AXES, Contact, Hold, LARGEST_PEAK, LEAST_PHASE_MARGIN_DEG, LoopModel as Model},
};

/// Stiffness, N/m, and damping, N s/m, at the tip of a tool that is held against turning.
const TIP: (f64, f64) = (5e3, 5.0);

/// A direction, (3,), and stable ranges.
type DirectedRange<'py> = (Bound<'py, PyArray1<f64>>, Vec<(f64, f64)>);

/// Linear model of the closed loop of a hovering vehicle: six axes, rotor lag, delays, sampling.
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct LoopModel {
    model: Model,
    config: Checked,
    truth: Option<TruthSection>,
    seed: u64,
}

#[pymethods]
impl LoopModel {
    /// The model of a configuration; with `truth`, the model of a vehicle that is drawn from it with `seed`. Delays,
    /// s, and control period are those of the configuration unless they are given.
    #[new]
    #[pyo3(signature = (config, *, truth=None, seed=None, loop_delay=None, rotor_speed_age=None, period=None))]
    fn new(
        config: &Config,
        truth: Option<&Bound<'_, PyAny>>,
        seed: Option<&Bound<'_, PyAny>>,
        loop_delay: Option<f64>,
        rotor_speed_age: Option<f64>,
        period: Option<f64>,
    ) -> PyResult<Self> {
        let seed = seed.map_or(Ok(0), convert::seed)?;
        let truth = truth.map(|given| truth::section(Some(given))).transpose()?;
        let mut model = match &truth {
            None => Model::of(&config.checked),
            Some(section) => {
                let drawn = section.draw(config.checked.vehicle(), seed);
                Model::of_true(&config.checked, &drawn.map_err(convert::config_error)?)
            }
        };
        if let Some(delay) = loop_delay {
            model.delays.line = convert::number("loop_delay", delay, 0.0, 0.5)?;
        }
        if let Some(age) = rotor_speed_age {
            model.delays.rotor_speeds = convert::number("rotor_speed_age", age, 0.0, 0.5)?;
        }
        if let Some(period) = period {
            model.delays.period = convert::number("period", period, 1e-6, 0.1)?;
        }
        Ok(Self { model, config: config.checked.clone(), truth, seed })
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<((Config,), Bound<'py, PyDict>)> {
        let (named, delays) = (PyDict::new(py), self.model.delays);
        let vehicle = Vehicle { section: self.config.vehicle().clone() };
        let truth = self.truth.clone().map(|section| Truth::of(vehicle, section));
        named.set_item("truth", truth)?;
        named.set_item("seed", self.seed)?;
        named.set_item("loop_delay", delays.line)?;
        named.set_item("rotor_speed_age", delays.rotor_speeds)?;
        named.set_item("period", delays.period)?;
        Ok(((Config { checked: self.config.clone() },), named))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.config == other.config
            && self.truth == other.truth
            && self.seed == other.seed
            && self.model.delays == other.model.delays
    }

    fn __hash__(&self) -> u64 {
        convert::hash(&self.config.to_toml())
    }

    fn __repr__(&self) -> String {
        let truth = self.truth.as_ref().map_or("exact", |t| t.name());
        format!("LoopModel(vehicle='{}', truth='{truth}', seed={})", self.config.vehicle().name(), self.seed)
    }

    /// The axes' names, in the order of all arrays.
    #[classattr]
    fn axes() -> Vec<&'static str> {
        AXES.to_vec()
    }

    /// The smallest phase margin of any axis that `derive` allows, degrees.
    #[classattr]
    fn least_phase_margin_deg() -> f64 {
        LEAST_PHASE_MARGIN_DEG
    }

    /// The largest sensitivity peak of any axis that `derive` allows.
    #[classattr]
    fn largest_peak() -> f64 {
        LARGEST_PEAK
    }

    /// Margins in a contact-free hover, (6,) each: `phase_margin_deg`, `gain_margin`, `delay_margin` s,
    /// `sensitivity_peak`, `crossover` rad/s; and whether the loop is `stable`.
    fn hover<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let found = py.detach(|| self.model.hover());
        let out = PyDict::new(py);
        let column = |of: fn(&tilthex_config::margins::AxisMargins) -> f64| {
            PyArray1::from_iter(py, found.axes.iter().map(of))
        };
        out.set_item("phase_margin_deg", column(|a| a.phase_margin_deg))?;
        out.set_item("gain_margin", column(|a| a.gain_margin))?;
        out.set_item("delay_margin", column(|a| a.delay_margin))?;
        out.set_item("sensitivity_peak", column(|a| a.sensitivity_peak))?;
        out.set_item("crossover", column(|a| a.crossover))?;
        out.set_item("stable", found.stable)?;
        Ok(out)
    }

    /// The fastest gains with a phase margin of 45 degrees and a sensitivity peak of at most 2 in every axis, as
    /// sections for `Config.replace`. They depend only on the vehicle, the delays and the turn's bandwidth of the
    /// configuration.
    fn derive<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (derived, out) = (self.model.derive(), PyDict::new(py));
        for (section, keys) in derived.sections() {
            let of_section = PyDict::new(py);
            for (key, values) in keys {
                of_section.set_item(key, values.to_vec())?;
            }
            out.set_item(section, of_section)?;
        }
        Ok(out)
    }

    /// The loops in hover: `frequency`, (N,), rad/s, and real and imaginary part of the loop gain of each axis,
    /// `real` and `imaginary`, (6, N), with the loops of all other axes closed.
    fn loops<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let found = py.detach(|| self.model.loops());
        let out = PyDict::new(py);
        let count = found.frequencies.len();
        let all = || found.gains.iter().flatten();
        out.set_item("real", PyArray1::from_iter(py, all().map(|l| l.re)).reshape([6, count])?)?;
        out.set_item("imaginary", PyArray1::from_iter(py, all().map(|l| l.im)).reshape([6, count])?)?;
        out.set_item("frequency", PyArray1::from_vec(py, found.frequencies))?;
        Ok(out)
    }

    /// Where contact is stable: pairs (from, to) of stiffnesses, rising; 1e6 stands for any stiffness. `along` (3,):
    /// the normal of a surface without friction at the tip, world; N/m. Or `about` (3,): the axis about which the
    /// environment holds the tool against turning, while a spring, N/m, and a damper, N s/m, `tip` (5e3 and 5), hold
    /// its tip; N m/rad. `damping_time`, s: the damping of the environment divided by its stiffness.
    #[pyo3(signature = (*, along=None, about=None, tip=None, damping_time=0.0))]
    fn contact(
        &self,
        py: Python<'_>,
        along: Option<&Bound<'_, PyAny>>,
        about: Option<&Bound<'_, PyAny>>,
        tip: Option<(f64, f64)>,
        damping_time: f64,
    ) -> PyResult<Vec<(f64, f64)>> {
        let direction = |name: &str, given: &Bound<'_, PyAny>| {
            let found: tilthex_core::Vector3 = convert::vector(name, given)?;
            if found.norm() > 1e-9 {
                Ok(found)
            } else {
                Err(PyValueError::new_err(format!("{name} is zero; expected a direction")))
            }
        };
        let hold = match (along, about) {
            (Some(given), None) => Hold::Along(direction("along", given)?),
            (None, Some(given)) => {
                let tip = tip.unwrap_or(TIP);
                let [stiffness, damping] = [("tip stiffness", tip.0), ("tip damping", tip.1)]
                    .map(|(name, value)| convert::number(name, value, 0.0, 1e7));
                Hold::About(direction("about", given)?, [stiffness?, damping?])
            }
            _ => {
                return Err(PyValueError::new_err(
                    "along and about are both given or both missing; expected exactly one of them",
                ));
            }
        };
        let damping_time = convert::number("damping_time", damping_time, 0.0, 10.0)?;
        Ok(py.detach(|| self.model.contact(Contact { hold, damping_time })).stable)
    }

    /// Of 13 directions, (3,), the one in which the range of `contact` is smallest, and that range.
    #[pyo3(signature = (*, damping_time=0.0))]
    fn worst_contact<'py>(&self, py: Python<'py>, damping_time: f64) -> PyResult<DirectedRange<'py>> {
        let damping_time = convert::number("damping_time", damping_time, 0.0, 10.0)?;
        let (direction, range) = py.detach(|| self.model.worst_contact(damping_time));
        Ok((convert::array1(py, direction.as_slice()), range.stable))
    }

    /// The smallest apparent mass, kg, along x, y or z (0, 1, 2) with which contact along that axis is stable at
    /// every stiffness up to this one, N/m. Infinite if contact is unstable with the configured mass.
    #[pyo3(signature = (axis, stiffness, *, damping_time=0.0))]
    fn least_apparent_mass(
        &self,
        py: Python<'_>,
        axis: i64,
        stiffness: f64,
        damping_time: f64,
    ) -> PyResult<f64> {
        let known = usize::try_from(axis).ok().filter(|axis| *axis <= 2);
        let axis =
            known.ok_or_else(|| PyValueError::new_err(format!("axis is {axis}; expected 0, 1 or 2")))?;
        let stiffness = convert::number("stiffness", stiffness, 0.0, 1e6)?;
        let damping_time = convert::number("damping_time", damping_time, 0.0, 10.0)?;
        Ok(py.detach(|| self.model.least_apparent_mass(axis, stiffness, damping_time)))
    }
}
