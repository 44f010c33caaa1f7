//! The blocks of the controller, each for use alone.

use crate::{
    allocation::Allocation,
    config::Config,
    convert::{self, array1, wrench_array},
    setpoint::{Reference, Setpoint},
    value,
    vehicle::Vehicle,
};
use numpy::PyArray1;
use pyo3::prelude::*;
use tilthex_config::{Config as Checked, VehicleSection};
use tilthex_core::{
    Matrix3, RobotState, Wrench,
    admittance::{self, AdmittanceOutput, AdmittanceState},
    allocation::{self, AllocatorState, RotorStatus},
    pose_control::{self, PoseCommand as Command},
    wrench_observer::{self, ObserverInput, WrenchObserverState},
};

/// The pose controller; (14)-(17).
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct PoseController {
    block: pose_control::PoseController,
    config: Checked,
}

#[pymethods]
impl PoseController {
    #[new]
    fn new(config: &Config) -> PyResult<Self> {
        let gains = config.checked.controller().pose;
        let block = pose_control::PoseController::new(gains).map_err(convert::value_error)?;
        Ok(Self { block, config: config.checked.clone() })
    }

    /// The accelerations that make the pose converge to the reference.
    ///
    /// position, velocity: (3,), m and m/s, world. rotation: `R_WR`, (3, 3).
    /// angular_velocity: (3,), rad/s, robot.
    #[pyo3(signature = (*, position, velocity, rotation, angular_velocity, reference))]
    fn step(
        &self,
        position: &Bound<'_, PyAny>,
        velocity: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
        angular_velocity: &Bound<'_, PyAny>,
        reference: &Reference,
    ) -> PyResult<PoseCommand> {
        let state = RobotState {
            position_w: convert::vector("position", position)?,
            velocity_w: convert::vector("velocity", velocity)?,
            rotation_wr: convert::rotation("rotation", rotation)?,
            angular_velocity_r: convert::vector("angular_velocity", angular_velocity)?,
        };
        Ok(PoseCommand(self.block.step(&state, &reference.0)))
    }

    fn __getnewargs__(&self) -> (Config,) {
        (Config { checked: self.config.clone() },)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.config == other.config
    }

    fn __hash__(&self) -> u64 {
        convert::hash(&self.config.to_toml())
    }

    fn __repr__(&self) -> String {
        format!("PoseController(vehicle='{}')", self.config.vehicle().name())
    }
}

const COMMAND: [&str; 6] = [
    "acceleration",
    "angular_acceleration",
    "position_error",
    "velocity_error",
    "rotation_error",
    "angular_velocity_error",
];

/// The wanted accelerations, and the errors from which they follow; zero if they are not given.
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct PoseCommand(Command);

#[pymethods]
impl PoseCommand {
    #[new]
    #[pyo3(signature = (
        acceleration, angular_acceleration, *, position_error=None, velocity_error=None, rotation_error=None,
        angular_velocity_error=None
    ))]
    fn new(
        acceleration: &Bound<'_, PyAny>,
        angular_acceleration: &Bound<'_, PyAny>,
        position_error: Option<&Bound<'_, PyAny>>,
        velocity_error: Option<&Bound<'_, PyAny>>,
        rotation_error: Option<&Bound<'_, PyAny>>,
        angular_velocity_error: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        Ok(Self(Command {
            acceleration_w: convert::vector("acceleration", acceleration)?,
            angular_acceleration_r: convert::vector("angular_acceleration", angular_acceleration)?,
            position_error_w: convert::or_zero("position_error", position_error)?,
            velocity_error_w: convert::or_zero("velocity_error", velocity_error)?,
            rotation_error_r: convert::or_zero("rotation_error", rotation_error)?,
            angular_velocity_error_r: convert::or_zero("angular_velocity_error", angular_velocity_error)?,
        }))
    }

    /// v_p, m/s^2, world, (3,); (14).
    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.acceleration_w.as_slice())
    }

    /// v_w, rad/s^2, robot, (3,); (17) with the exact feed-forward.
    #[getter]
    fn angular_acceleration<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.angular_acceleration_r.as_slice())
    }

    /// e_p, m, world, (3,).
    #[getter]
    fn position_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.position_error_w.as_slice())
    }

    /// v_r - v, m/s, world, (3,).
    #[getter]
    fn velocity_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.velocity_error_w.as_slice())
    }

    /// e_R, robot, (3,); (15).
    #[getter]
    fn rotation_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.rotation_error_r.as_slice())
    }

    /// e_w, rad/s, robot, (3,); (16).
    #[getter]
    fn angular_velocity_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.0.angular_velocity_error_r.as_slice())
    }

    fn __getnewargs_ex__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        value::arguments(this, &COMMAND)
    }

    fn __eq__(this: &Bound<'_, Self>, other: &Bound<'_, Self>) -> PyResult<bool> {
        value::equal(this, other, &COMMAND)
    }

    fn __hash__(this: &Bound<'_, Self>) -> PyResult<isize> {
        value::hash(this, &COMMAND)
    }

    fn __repr__(this: &Bound<'_, Self>) -> PyResult<String> {
        value::shown(this, &COMMAND, 2)
    }
}

/// The observer of the external wrench; (18)-(24).
#[pyclass(module = "tilthex")]
#[derive(Clone)]
pub(crate) struct WrenchObserver {
    block: wrench_observer::WrenchObserver,
    state: WrenchObserverState,
    count: usize,
}

#[pymethods]
impl WrenchObserver {
    #[new]
    fn new(vehicle: &Vehicle, config: &Config) -> PyResult<Self> {
        let gains = config.checked.controller().observer;
        let block =
            wrench_observer::WrenchObserver::new(vehicle.core(), gains).map_err(convert::value_error)?;
        Ok(Self { block, state: WrenchObserverState::default(), count: vehicle.core().rotor_count() })
    }

    /// Takes the sample at the end of a period of `dt` seconds. Returns the estimate, (6,): force in world, torque in
    /// robot coordinates about the centre of mass. The first sample only marks the begin of the first period.
    ///
    /// rotation: `R_WR`, (3, 3). angular_velocity: (3,), rad/s, robot.
    /// specific_force: at the centre of mass, (3,), m/s^2, robot.
    /// rotor_speeds: measured, (n,), Hz.
    #[pyo3(signature = (*, rotation, angular_velocity, specific_force, rotor_speeds, dt=0.002))]
    fn step<'py>(
        &mut self,
        rotation: &Bound<'py, PyAny>,
        angular_velocity: &Bound<'py, PyAny>,
        specific_force: &Bound<'py, PyAny>,
        rotor_speeds: &Bound<'py, PyAny>,
        dt: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let input = ObserverInput {
            rotation_wr: convert::rotation("rotation", rotation)?,
            angular_velocity_r: convert::vector("angular_velocity", angular_velocity)?,
            specific_force_r: convert::vector("specific_force", specific_force)?,
            rotor_speeds: convert::rotors("rotor_speeds", rotor_speeds, self.count)?,
        };
        let wrench = self.block.step(&mut self.state, &input, convert::period(dt)?);
        Ok(wrench_array(rotation.py(), &wrench))
    }

    /// Resets the observer to its initial state.
    fn reset(&mut self) {
        self.state = WrenchObserverState::default();
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        value::not_pickled("WrenchObserver", "its vehicle and configuration")
    }

    fn __repr__(&self) -> String {
        format!("WrenchObserver({} rotors)", self.count)
    }
}

/// The admittance filter: it moves the tool's reference under a wrench; (27)-(28).
#[pyclass(module = "tilthex")]
#[derive(Clone)]
pub(crate) struct AdmittanceFilter {
    block: admittance::AdmittanceFilter,
    state: AdmittanceState,
    output: Option<AdmittanceOutput>,
}

#[pymethods]
impl AdmittanceFilter {
    #[new]
    fn new(config: &Config) -> PyResult<Self> {
        let params = config.checked.controller().admittance;
        let block = admittance::AdmittanceFilter::new(params).map_err(convert::value_error)?;
        Ok(Self { block, state: AdmittanceState::default(), output: None })
    }

    /// Moves the reference by `dt` seconds under the observed plus the commanded wrench at the tool, (6,), world. It is
    /// constant over the period; `setpoint` is the set-point at its end.
    #[pyo3(signature = (setpoint, wrench, dt=0.002))]
    fn step(&mut self, setpoint: &Setpoint, wrench: &Bound<'_, PyAny>, dt: f64) -> PyResult<Setpoint> {
        let wrench = convert::wrench("wrench", wrench)?;
        let dt = convert::period(dt)?;
        self.block.prepare(dt);
        let output = self.block.step(&mut self.state, &setpoint.0, &wrench, dt);
        self.output = Some(output);
        Ok(Setpoint(output.reference))
    }

    /// Restarts at rest on the set-point, or from a given reference, so that the reference does not jump.
    #[pyo3(signature = (reference=None, setpoint=None))]
    fn reset(&mut self, reference: Option<&Setpoint>, setpoint: Option<&Setpoint>) -> PyResult<()> {
        self.state = match (reference, setpoint) {
            (None, None) => AdmittanceState::default(),
            (Some(reference), Some(setpoint)) => AdmittanceState::at(&reference.0, &setpoint.0),
            _ => {
                let message = "reference and setpoint must be given together; expected both or neither";
                return Err(pyo3::exceptions::PyValueError::new_err(message));
            }
        };
        self.output = None;
        Ok(())
    }

    /// Deviation of the last reference from the set-point, (6,): m, and rad (sine of the angle), world.
    #[getter]
    fn deviation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let deviation = self.output.map_or(Wrench::ZERO.to_vector(), |o| o.deviation_w);
        array1(py, deviation.as_slice())
    }

    /// Whether the excursion limit limited the last reference.
    #[getter]
    fn limited(&self) -> bool {
        self.output.is_some_and(|o| o.limited)
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        value::not_pickled("AdmittanceFilter", "its configuration")
    }

    fn __repr__(&self) -> String {
        let deviation = self.output.map_or(Wrench::ZERO.to_vector(), |o| o.deviation_w);
        format!("AdmittanceFilter(deviation={:?})", deviation.as_slice())
    }
}

/// From a wanted body wrench to rotor speeds within their limits; (12), (26).
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct Allocator {
    block: allocation::Allocator,
    vehicle: VehicleSection,
    config: Option<Checked>,
}

#[pymethods]
impl Allocator {
    #[new]
    #[pyo3(signature = (vehicle, config=None))]
    fn new(vehicle: &Vehicle, config: Option<&Config>) -> PyResult<Self> {
        let params = config.map_or_else(Default::default, |c| c.checked.controller().allocation);
        let block =
            allocation::Allocator::with_params(vehicle.core(), params).map_err(convert::value_error)?;
        Ok(Self { block, vehicle: vehicle.section.clone(), config: config.map(|c| c.checked.clone()) })
    }

    /// Rotor speeds for a body wrench, (6,), robot: force N, torque N m.
    /// rotor_speeds: measured, (n,), Hz, used with a horizon. lost: rotors, from 0, that stand still. rotation:
    /// `R_WR`, (3, 3); it matters for a vehicle that can hover in every attitude; level if it is not given.
    #[pyo3(signature = (wrench, rotor_speeds=None, lost=None, rotation=None))]
    fn allocate(
        &self,
        wrench: &Bound<'_, PyAny>,
        rotor_speeds: Option<&Bound<'_, PyAny>>,
        lost: Option<Vec<i64>>,
        rotation: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Allocation> {
        let count = self.vehicle.vehicle().rotor_count();
        let wrench = convert::vector("wrench", wrench)?;
        let mut status = RotorStatus::default();
        if let Some(measured) = rotor_speeds {
            status.speeds = convert::rotors("rotor_speeds", measured, count)?;
        }
        status.lost = convert::rotor_set("lost", lost, count)?;
        let rotation_wr = rotation.map_or(Ok(Matrix3::identity()), |r| convert::rotation("rotation", r))?;
        let found = self.block.step(&mut AllocatorState::default(), &wrench, &rotation_wr, &status);
        Ok(Allocation { found, count })
    }

    fn __getnewargs__(&self) -> (Vehicle, Option<Config>) {
        let config = self.config.clone().map(|checked| Config { checked });
        (Vehicle { section: self.vehicle.clone() }, config)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.vehicle == other.vehicle && self.config == other.config
    }

    fn __hash__(&self) -> u64 {
        convert::hash(&self.vehicle.to_toml())
    }

    fn __repr__(&self) -> String {
        format!("Allocator(vehicle='{}')", self.vehicle.name())
    }
}
