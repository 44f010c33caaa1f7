//! `tilthex.Plant`.

use crate::{
    convert::{self, array1, array2},
    effects::Effects,
    value,
    vehicle::Vehicle,
};
use numpy::{PyArray1, PyArray2};
use pyo3::{prelude::*, types::PyDict};
use tilthex_core::{
    GRAVITY, Vector3, Wrench,
    plant::{Loads, Plant as Block, PlantState},
};

/// The simulated vehicle: a rigid body on SO(3) with rotor lag; (3)-(10). It begins in a level hover. `effects` of a
/// `Truth.draw` act on it if they are given.
#[pyclass(module = "tilthex")]
#[derive(Clone)]
pub(crate) struct Plant {
    block: Block,
    state: PlantState,
    external: Wrench,
}

#[pymethods]
impl Plant {
    #[new]
    #[pyo3(signature = (vehicle, position=None, *, effects=None))]
    fn new(
        vehicle: &Vehicle,
        position: Option<&Bound<'_, PyAny>>,
        effects: Option<PyRef<'_, Effects>>,
    ) -> PyResult<Self> {
        let position = convert::or_zero("position", position)?;
        let Some(effects) = effects else {
            let block = Block::new(*vehicle.core());
            return Ok(Self { block, state: block.hover(position), external: Wrench::ZERO });
        };
        let block = Block::with_effects(*vehicle.core(), effects.block).map_err(convert::value_error)?;
        let mut state = block.hover(position);
        state.effects = effects.state;
        Ok(Self { block, state, external: Wrench::ZERO })
    }

    /// Moves by `dt` seconds under commanded rotor speeds, (n,), Hz, and external wrenches that are constant over the
    /// step: `wrench`, (6,), force in world and torque in robot coordinates at the centre of mass; `tool_wrench`,
    /// (6,), world, at the tool tip. The lever of `tool_wrench` turns with the body inside the step.
    #[pyo3(signature = (rotor_speeds, *, wrench=None, tool_wrench=None, dt=0.001))]
    fn step(
        &mut self,
        rotor_speeds: &Bound<'_, PyAny>,
        wrench: Option<&Bound<'_, PyAny>>,
        tool_wrench: Option<&Bound<'_, PyAny>>,
        dt: f64,
    ) -> PyResult<()> {
        let command = convert::rotors("rotor_speeds", rotor_speeds, self.block.vehicle().rotor_count())?;
        let given = |name, wrench: Option<&Bound<'_, PyAny>>| {
            wrench.map_or(Ok(Wrench::ZERO), |w| convert::wrench(name, w))
        };
        let loads = Loads { external: given("wrench", wrench)?, tool_w: given("tool_wrench", tool_wrench)? };
        self.block.step_under(&mut self.state, &command, &loads, convert::period(dt)?);
        self.external = loads.external + self.block.from_tool(&self.state, &loads.tool_w);
        Ok(())
    }

    /// Sets the given parts of the state; the others stay.
    #[pyo3(signature = (*, position=None, velocity=None, rotation=None, angular_velocity=None, rotor_speeds=None))]
    fn set_state(
        &mut self,
        position: Option<&Bound<'_, PyAny>>,
        velocity: Option<&Bound<'_, PyAny>>,
        rotation: Option<&Bound<'_, PyAny>>,
        angular_velocity: Option<&Bound<'_, PyAny>>,
        rotor_speeds: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let mut next = self.state;
        if let Some(p) = position {
            next.robot.position_w = convert::vector("position", p)?;
        }
        if let Some(v) = velocity {
            next.robot.velocity_w = convert::vector("velocity", v)?;
        }
        if let Some(r) = rotation {
            next.robot.rotation_wr = convert::rotation("rotation", r)?;
        }
        if let Some(w) = angular_velocity {
            next.robot.angular_velocity_r = convert::vector("angular_velocity", w)?;
        }
        if let Some(w) = rotor_speeds {
            next.rotor_speeds = convert::rotors("rotor_speeds", w, self.block.vehicle().rotor_count())?;
        }
        self.state = next;
        Ok(())
    }

    /// Position of the centre of mass, m, world, (3,).
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.state.robot.position_w.as_slice())
    }

    /// Velocity of the centre of mass, m/s, world, (3,).
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.state.robot.velocity_w.as_slice())
    }

    /// Rotation `R_WR`, (3, 3).
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, &self.state.robot.rotation_wr)
    }

    /// Angular velocity, rad/s, robot, (3,).
    #[getter]
    fn angular_velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.state.robot.angular_velocity_r.as_slice())
    }

    /// Rotor speeds, Hz, (n,).
    #[getter]
    fn rotor_speeds<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.state.rotor_speeds.as_slice()[..self.block.vehicle().rotor_count()])
    }

    /// Specific force at the centre of mass under the last step's wrench, m/s^2, robot, (3,).
    #[getter]
    fn specific_force<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let (acceleration_w, _) = self.block.accelerations(&self.state, &self.external);
        let free_w = acceleration_w + Vector3::new(0.0, 0.0, GRAVITY);
        array1(py, (self.state.robot.rotation_wr.transpose() * free_w).as_slice())
    }

    /// What exact sensors measure: the arguments of `Controller.step` and `Loop.step` that describe the robot, by their names.
    #[getter]
    fn measured<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let measured = PyDict::new(py);
        measured.set_item("position", self.position(py))?;
        measured.set_item("velocity", self.velocity(py))?;
        measured.set_item("rotation", self.rotation(py)?)?;
        measured.set_item("angular_velocity", self.angular_velocity(py))?;
        measured.set_item("specific_force", self.specific_force(py))?;
        measured.set_item("rotor_speeds", self.rotor_speeds(py))?;
        Ok(measured)
    }

    /// Position of the tool tip, m, world, (3,).
    #[getter]
    fn tool_position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.block.tool_pose(&self.state).0.as_slice())
    }

    /// Maps tool coordinates to world coordinates, (3, 3).
    #[getter]
    fn tool_rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, &self.block.tool_pose(&self.state).1)
    }

    /// The wrench of the effects on the airframe, (6,): force and torque in robot coordinates, at the centre of mass.
    #[getter]
    fn effects_wrench<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        convert::wrench_array(py, &self.block.effects_wrench(&self.state))
    }

    /// Kinetic energy, J.
    #[getter]
    fn kinetic_energy(&self) -> f64 {
        self.block.kinetic_energy(&self.state)
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        value::not_pickled("Plant", "its vehicle and position")
    }

    fn __repr__(&self) -> String {
        let (p, v) = (self.state.robot.position_w, self.state.robot.velocity_w);
        format!("Plant(position={:?} m, velocity={:?} m/s)", p.as_slice(), v.as_slice())
    }
}
