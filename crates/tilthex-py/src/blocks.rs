//! The blocks of the controller, each for use alone.

use crate::{
    config::Config,
    convert::{self, array1, wrench_array},
    setpoint::{Reference, Setpoint},
    vehicle::Vehicle,
};
use numpy::PyArray1;
use pyo3::prelude::*;
use tilthex_core::{
    Matrix3, RobotState, Wrench,
    admittance::{self, AdmittanceOutput, AdmittanceState},
    allocation::{self, AllocatorState, RotorStatus},
    pose_control::{self, PoseCommand as Command},
    vehicle::speeds,
    wrench_observer::{self, ObserverInput, WrenchObserverState},
};

/// The pose controller; (14)-(17).
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct PoseController(pose_control::PoseController);

#[pymethods]
impl PoseController {
    #[new]
    fn new(config: &Config) -> PyResult<Self> {
        let gains = config.checked.controller().pose;
        Ok(Self(pose_control::PoseController::new(gains).map_err(convert::value_error)?))
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
        Ok(PoseCommand(self.0.step(&state, &reference.0)))
    }
}

/// The wanted accelerations, and the errors from which they follow.
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct PoseCommand(Command);

#[pymethods]
impl PoseCommand {
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
}

/// The observer of the external wrench; (18)-(24).
#[pyclass(module = "tilthex")]
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
}

/// The admittance filter: it moves the tool's reference under a wrench; (27)-(28).
#[pyclass(module = "tilthex")]
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
}

/// From a wanted body wrench to rotor speeds within their limits; (12), (26).
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct Allocator {
    block: allocation::Allocator,
    count: usize,
}

#[pymethods]
impl Allocator {
    #[new]
    #[pyo3(signature = (vehicle, config=None))]
    fn new(vehicle: &Vehicle, config: Option<&Config>) -> PyResult<Self> {
        let params = config.map_or_else(Default::default, |c| c.checked.controller().allocation);
        let block =
            allocation::Allocator::with_params(vehicle.core(), params).map_err(convert::value_error)?;
        Ok(Self { block, count: vehicle.core().rotor_count() })
    }

    /// Rotor speeds for a body wrench, (6,), robot: force N, torque N m.
    /// rotor_speeds: measured, (n,), Hz, used with a horizon. lost: rotors, from 0, that stand still. rotation:
    /// `R_WR`, (3, 3); it matters for a vehicle that can hover in every attitude; level if it is not given.
    #[pyo3(signature = (wrench, rotor_speeds=None, lost=None, rotation=None))]
    fn allocate(
        &self,
        wrench: &Bound<'_, PyAny>,
        rotor_speeds: Option<&Bound<'_, PyAny>>,
        lost: Option<Vec<usize>>,
        rotation: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Allocation> {
        let wrench = convert::vector("wrench", wrench)?;
        let mut status = RotorStatus::default();
        if let Some(measured) = rotor_speeds {
            status.speeds = convert::rotors("rotor_speeds", measured, self.count)?;
        }
        status.lost = convert::rotor_set("lost", lost, self.count)?;
        let rotation_wr = rotation.map_or(Ok(Matrix3::identity()), |r| convert::rotation("rotation", r))?;
        let found = self.block.step(&mut AllocatorState::default(), &wrench, &rotation_wr, &status);
        Ok(Allocation { found, count: self.count })
    }
}

/// The commanded rotor speeds, and the parts of the wrench that they do not produce.
#[pyclass(frozen, module = "tilthex")]
pub(crate) struct Allocation {
    found: allocation::Allocation,
    count: usize,
}

#[pymethods]
impl Allocation {
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
    fn shortfall(&self) -> std::collections::HashMap<&'static str, f64> {
        allocation::Priority::ORDER
            .map(allocation::Priority::name)
            .into_iter()
            .zip(self.found.shortfall)
            .collect()
    }

    /// Steps of the search; 0 if no limit was active.
    #[getter]
    fn iterations(&self) -> u32 {
        self.found.iterations
    }

    /// The most important part of the wrench that is not met, or None.
    #[getter]
    fn given_up(&self) -> Option<&'static str> {
        self.found.given_up.map(allocation::Priority::name)
    }
}
