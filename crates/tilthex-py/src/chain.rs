//! `tilthex.Loop`: estimator and controller as one call a control period, for
//! worlds that are simulated elsewhere.

use crate::{
    config::Config,
    convert::{self, array1},
    setpoint::Setpoint,
};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use tilthex_core::{
    RobotState,
    controller::{Controller, ControllerInput, ControllerOutput, ControllerState},
    estimator::Estimator,
    types::PoseSample,
};

/// What is kept of every period: name and width of each column.
const COLUMNS: [(&str, usize); 14] = [
    ("setpoint_position", 3),
    ("setpoint_rotation", 9),
    ("reference_position", 3),
    ("reference_rotation", 9),
    ("reference_velocity", 3),
    ("estimated_position", 3),
    ("estimated_velocity", 3),
    ("estimated_rotation", 9),
    ("position_error", 3),
    ("rotation_error", 3),
    ("wrench_robot", 6),
    ("wrench_tool", 6),
    ("wrench_admittance", 6),
    ("saturated", 1),
];

/// A pose as it arrives: when it arrived, when it was taken (s), position (3,), rotation (3, 3).
type ArrivedPose<'py> = (f64, f64, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// The chain from measurements to rotor speeds with its own record: state
/// estimator and controller, one call a control period.
#[pyclass(module = "tilthex")]
pub(crate) struct Loop {
    controller: Controller,
    state: ControllerState,
    estimator: Box<Estimator>,
    count: usize,
    last: Option<f64>,
    rows: Vec<f64>,
}

#[pymethods]
impl Loop {
    #[new]
    fn new(config: &Config) -> PyResult<Self> {
        let vehicle = *config.checked.vehicle.vehicle();
        let estimator = config.checked.estimator_params().map_err(convert::config_error)?;
        Ok(Self {
            controller: Controller::new(vehicle, *config.checked.controller())
                .map_err(convert::value_error)?,
            state: ControllerState::default(),
            estimator: Box::new(Estimator::new(estimator).map_err(convert::value_error)?),
            count: vehicle.rotor_count(),
            last: None,
            rows: Vec::new(),
        })
    }

    /// Starts the estimator from a pose: position (3,), m, world; rotation `R_WR`, (3, 3).
    fn initialize(
        &mut self,
        time: f64,
        position: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let (position, rotation) =
            (convert::vector("position", position)?, convert::rotation("rotation", rotation)?);
        self.last = Some(time);
        self.estimator.initialize(time, &position, &rotation).map_err(convert::value_error)
    }

    /// One control period with the estimator, from measurements to rotor speeds, Hz, (n,).
    ///
    /// time: of the inertial sample, s. gyro, specific_force: (3,), rad/s and m/s^2, IMU axes.
    /// rotor_speeds: measured, (n,), Hz. poses: those that arrived since the last call, each
    /// (arrival, time, position, rotation). compliant: whether contact moves the reference.
    /// learn_bias: whether this is a contact-free hover whose mean wrench is the bias.
    #[pyo3(signature = (
        time, gyro, specific_force, rotor_speeds, poses, setpoint, *, compliant=true, learn_bias=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "one call a period")]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        time: f64,
        gyro: &Bound<'py, PyAny>,
        specific_force: &Bound<'py, PyAny>,
        rotor_speeds: &Bound<'py, PyAny>,
        poses: Vec<ArrivedPose<'py>>,
        setpoint: &Setpoint,
        compliant: bool,
        learn_bias: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let gyro = convert::vector("gyro", gyro)?;
        let specific_force = convert::vector("specific_force", specific_force)?;
        self.estimator.predict(time, &gyro, &specific_force);
        for (arrival, taken, position, rotation) in &poses {
            self.estimator.update_pose(&PoseSample {
                time: *taken,
                arrival: *arrival,
                position_w: convert::vector("position of a pose", position)?,
                rotation_wr: convert::rotation("rotation of a pose", rotation)?,
                tracking_valid: true,
            });
        }
        let input = ControllerInput {
            state: self.estimator.robot_state(),
            specific_force_r: self.estimator.specific_force_r(),
            rotor_speeds: convert::rotors("rotor_speeds", rotor_speeds, self.count)?,
            setpoint: setpoint.0,
            compliant,
            learn_bias,
            lost_rotors: 0,
            fixed_attitude: false,
        };
        self.control(py, time, &input)
    }

    /// One control period without the estimator: as [`Controller.step`], for a state that is known.
    #[pyo3(signature = (
        time, *, position, velocity, rotation, angular_velocity, specific_force, rotor_speeds, setpoint,
        compliant=true, learn_bias=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments in Python")]
    fn step_from<'py>(
        &mut self,
        py: Python<'py>,
        time: f64,
        position: &Bound<'py, PyAny>,
        velocity: &Bound<'py, PyAny>,
        rotation: &Bound<'py, PyAny>,
        angular_velocity: &Bound<'py, PyAny>,
        specific_force: &Bound<'py, PyAny>,
        rotor_speeds: &Bound<'py, PyAny>,
        setpoint: &Setpoint,
        compliant: bool,
        learn_bias: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let input = ControllerInput {
            state: RobotState {
                position_w: convert::vector("position", position)?,
                velocity_w: convert::vector("velocity", velocity)?,
                rotation_wr: convert::rotation("rotation", rotation)?,
                angular_velocity_r: convert::vector("angular_velocity", angular_velocity)?,
            },
            specific_force_r: convert::vector("specific_force", specific_force)?,
            rotor_speeds: convert::rotors("rotor_speeds", rotor_speeds, self.count)?,
            setpoint: setpoint.0,
            compliant,
            learn_bias,
            lost_rotors: 0,
            fixed_attitude: false,
        };
        self.control(py, time, &input)
    }

    /// The record as a dict of arrays, (N, k), one row a period; rotations row by row.
    ///
    /// `setpoint_*`, `reference_*`: of the tool, world. `estimated_*`: the robot's state as the
    /// controller was given it. `position_error`, `rotation_error`: of the pose controller.
    /// `wrench_robot` (force W, torque R), `wrench_tool` (W) as observed, `wrench_admittance`
    /// (W) behind low-pass and dead zone. `saturated`: 0 or 1.
    fn record<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let width: usize = COLUMNS.iter().map(|c| c.1).sum();
        let columns = PyDict::new(py);
        let mut begin = 0;
        for (name, size) in COLUMNS {
            let values: Vec<f64> =
                self.rows.chunks_exact(width).flat_map(|row| &row[begin..begin + size]).copied().collect();
            columns.set_item(name, array1(py, &values).reshape([values.len() / size, size])?)?;
            begin += size;
        }
        Ok(columns)
    }
}

impl Loop {
    fn control<'py>(
        &mut self,
        py: Python<'py>,
        time: f64,
        input: &ControllerInput,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let dt = convert::period(time - self.last.unwrap_or(time - 0.002))?;
        self.last = Some(time);
        let output = self.controller.step(&mut self.state, input, dt);
        self.keep(input, &output);
        Ok(array1(py, &output.rotor_speeds.as_slice()[..self.count]))
    }

    fn keep(&mut self, input: &ControllerInput, output: &ControllerOutput) {
        let (asked, given, robot) = (&input.setpoint, &output.reference, &input.state);
        let rows = &mut self.rows;
        rows.extend(&asked.position_w);
        rows.extend(&asked.rotation_we.transpose());
        rows.extend(&given.position_w);
        rows.extend(&given.rotation_we.transpose());
        rows.extend(&given.velocity_w);
        rows.extend(&robot.position_w);
        rows.extend(&robot.velocity_w);
        rows.extend(&robot.rotation_wr.transpose());
        rows.extend(&output.pose.position_error_w);
        rows.extend(&output.pose.rotation_error_r);
        rows.extend(&output.wrench_robot.to_vector());
        rows.extend(&output.wrench_tool_w.to_vector());
        rows.extend(&output.wrench_admittance_w.to_vector());
        rows.push(f64::from(u8::from(output.allocation.saturated)));
    }
}
