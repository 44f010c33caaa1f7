//! `tilthex.Loop`: the flight, with one call per control period, for worlds that are simulated elsewhere.

use crate::{
    config::Config,
    convert::{self, array1},
    setpoint::Setpoint,
    value,
    vehicle::Vehicle,
};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::{exceptions::PyValueError, prelude::*, types::PyDict};
use std::collections::VecDeque;
use tilthex_config::VehicleSection;
use tilthex_core::{
    RobotState,
    flight::{
        AirborneStart, Command, Commanded, Flight, HostFacts, Inertial, KnownState, MAX_POSES, Measured,
        Record, Telemetry,
    },
    model_learning::{EXCITED, ModelDeviation},
    trajectory::Limits,
    types::PoseSample,
};

/// The columns of the record: name and width.
const COLUMNS: [(&str, usize); 17] = [
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
    ("wrench_contact", 6),
    ("wind", 3),
    ("contact_likelihood", 1),
    ("saturated", 1),
];

/// A pose as it arrives: when it arrived, when it was taken (s), position (3,), rotation (3, 3).
type ArrivedPose<'py> = (f64, f64, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// The flight of `tilthex-rt`, from measurements to rotor speeds, with its record. It has one call per control
/// period, begins in the air, and follows the set-points that it gets.
#[pyclass(module = "tilthex")]
#[derive(Clone)]
pub(crate) struct Loop {
    configured: VehicleSection,
    flight: Box<Flight>,
    telemetry: Telemetry,
    commanded: Box<Commanded>,
    poses: VecDeque<PoseSample>,
    count: usize,
    last: Option<f64>,
    rows: Vec<f64>,
}

#[pymethods]
impl Loop {
    #[new]
    fn new(config: &Config) -> PyResult<Self> {
        let mut params = config.checked.flight_params(true).map_err(convert::config_error)?;
        // The caller gives every set-point, so that a set-point may jump.
        let none = f64::INFINITY;
        params.guidance.max_setpoint_jump = none;
        params.guidance.stream =
            Limits { velocity: none, acceleration: none, angular_velocity: none, angular_acceleration: none };
        let count = params.vehicle.rotor_count();
        Ok(Self {
            configured: config.checked.vehicle().clone(),
            flight: Box::new(Flight::new(params, None).map_err(convert::value_error)?),
            telemetry: Telemetry::new(count),
            commanded: Box::default(),
            poses: VecDeque::new(),
            count,
            last: None,
            rows: Vec::new(),
        })
    }

    /// Begins in the air, at rest, with the estimator at a pose of the captured body: position (3,), m, world;
    /// rotation `R_WR`, (3, 3). time: a time before the first step, s.
    fn initialize(
        &mut self,
        time: f64,
        position: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let start = AirborneStart {
            time,
            position_w: convert::vector("position", position)?,
            rotation_wc: convert::rotation("rotation", rotation)?,
            trajectory: None,
        };
        self.flight.begin_in_air(&start).map_err(convert::value_error)?;
        self.last = Some(time);
        Ok(())
    }

    /// One control period with the estimator, from measurements to rotor speeds, Hz, (n,).
    ///
    /// time: of the inertial sample, s. gyro, specific_force: (3,), rad/s and m/s^2, IMU axes. rotor_speeds:
    /// measured, (n,), Hz. poses: the poses that arrived since the last call, each (arrival, time, position,
    /// rotation). learn_bias: whether this is a contact-free hover whose mean wrench is the bias; then contact does
    /// not move the reference. learn_model: whether this is the contact-free `calibration_flight`; after the last
    /// step with `learn_model` the corrected model replaces the configured one.
    #[pyo3(signature = (
        time, gyro, specific_force, rotor_speeds, poses, setpoint, *, learn_bias=false, learn_model=false
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
        learn_bias: bool,
        learn_model: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let sample = Inertial {
            time,
            gyro_i: convert::vector("gyro", gyro)?,
            specific_force_i: convert::vector("specific_force", specific_force)?,
            shaken: false,
        };
        for (k, (arrival, taken, position, rotation)) in poses.iter().enumerate() {
            self.poses.push_back(PoseSample {
                time: *taken,
                arrival: *arrival,
                position_w: convert::vector(&format!("position of poses[{k}]"), position)?,
                rotation_wr: convert::rotation(&format!("rotation of poses[{k}]"), rotation)?,
                tracking_valid: true,
            });
        }
        self.telemetry.begin_tick();
        self.telemetry.inertial.push(time, sample);
        self.tick(py, time, rotor_speeds, setpoint, (learn_bias, learn_model), None)
    }

    /// One control period without the estimator, for a known state; the arguments are those of [`Controller.step`].
    #[pyo3(signature = (
        time, *, position, velocity, rotation, angular_velocity, specific_force, rotor_speeds, setpoint,
        learn_bias=false, learn_model=false
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
        learn_bias: bool,
        learn_model: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let robot = RobotState {
            position_w: convert::vector("position", position)?,
            velocity_w: convert::vector("velocity", velocity)?,
            rotation_wr: convert::rotation("rotation", rotation)?,
            angular_velocity_r: convert::vector("angular_velocity", angular_velocity)?,
        };
        let specific_force_r = convert::vector("specific_force", specific_force)?;
        self.telemetry.begin_tick();
        self.telemetry.inertial.heard = time;
        let known = KnownState { robot, specific_force_r };
        self.tick(py, time, rotor_speeds, setpoint, (learn_bias, learn_model), Some(known))
    }

    /// Phase of the flight after the last step: "flying", "holding", "landing", "emergency".
    #[getter]
    fn phase(&self) -> &'static str {
        self.flight.supervisor().phase().name()
    }

    /// Names of the active faults.
    #[getter]
    fn faults(&self) -> Vec<&'static str> {
        self.flight.supervisor().active().rows().map(|row| row.name).collect()
    }

    /// The vehicle model that the loop uses now: the configured one, or the one that a calibration flight corrected.
    #[getter]
    fn model(&self) -> Vehicle {
        if self.flight.model_hovers() == 0 {
            return Vehicle { section: self.configured.clone() };
        }
        let name = format!("{}, calibrated", self.configured.name());
        Vehicle { section: VehicleSection::of(&name, *self.flight.model(), self.configured.rotor_drag()) }
    }

    /// Standard deviations of the remaining errors of the model: `mass`, `thrust` (n,) and `drag_moment` as fractions
    /// of the model's values, `rotor_axis` (n,), rad, `centre_of_mass` (3,), m, robot, `accelerometer_bias` (3,),
    /// m/s^2 (the part that the estimator does not remove). `false_force`, N, and `false_torque` about the centre of
    /// mass, N m: the contact that the observer reports although there is none, in hovers tilted by 15 degrees.
    ///
    /// `excited` says for each of them whether the flight determined more than half of the uncertainty before the
    /// flight (for tuples and arrays: their mean). `hovers`: the number of hovers from which the model was learnt; 0
    /// before a calibration flight.
    #[getter]
    fn model_deviation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let now = *self.flight.model_deviation();
        let prior = ModelDeviation::prior(self.configured.vehicle(), self.flight.model_prior());
        let (keys, excited) = (PyDict::new(py), PyDict::new(py));
        let numbers = |d: &ModelDeviation| {
            [
                ("mass", vec![d.mass]),
                ("thrust", d.thrust.as_slice()[..self.count].to_vec()),
                ("rotor_axis", d.rotor_axis.as_slice()[..self.count].to_vec()),
                ("drag_moment", vec![d.drag_moment]),
                ("centre_of_mass", d.centre_of_mass_r.as_slice().to_vec()),
                ("accelerometer_bias", d.accelerometer_bias_r.as_slice().to_vec()),
                ("false_force", vec![d.false_force]),
                ("false_torque", vec![d.false_torque]),
            ]
        };
        for ((name, found), (_, before)) in numbers(&now).into_iter().zip(numbers(&prior)) {
            let (sum, first) = (found.iter().sum::<f64>(), before.iter().sum::<f64>());
            excited.set_item(name, sum <= (1.0 - EXCITED) * first && first > 0.0)?;
            match found.as_slice() {
                [one] => keys.set_item(name, one)?,
                several => keys.set_item(name, array1(py, several))?,
            }
        }
        keys.set_item("excited", excited)?;
        keys.set_item("hovers", self.flight.model_hovers())?;
        Ok(keys)
    }

    /// Why the last calibration flight did not change the model. None if it did, or if there was none.
    #[getter]
    fn model_refused(&self) -> Option<String> {
        self.flight.model_refused().map(|refusal| refusal.to_string())
    }

    /// The record as a dict of arrays, (N, k), one row per period; rotations row by row.
    ///
    /// `setpoint_*`, `reference_*`: of the tool, world. `estimated_*`: the state of the robot that the controller
    /// got. `position_error`, `rotation_error`: of the pose controller. `wrench_robot` (force W, torque R) and
    /// `wrench_tool` (W): observed. `wrench_contact` (W): its part that is no drag of the wind. `wrench_admittance`
    /// (W): after low-pass and dead zone. `wind`: estimated velocity of the air, m/s, and `contact_likelihood`, 0 to
    /// 1 (both with `[contact] discrimination`). `saturated`: 0 or 1.
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

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        value::not_pickled("Loop", "its configuration")
    }

    fn __repr__(&self) -> String {
        let name = self.configured.name();
        let Some(time) = self.last else { return format!("Loop(vehicle='{name}', not initialized)") };
        format!("Loop(vehicle='{name}', {} at {time} s, faults={:?})", self.phase(), self.faults())
    }
}

impl Loop {
    fn tick<'py>(
        &mut self,
        py: Python<'py>,
        time: f64,
        rotor_speeds: &Bound<'py, PyAny>,
        setpoint: &Setpoint,
        (learn_bias, learn_model): (bool, bool),
        known: Option<KnownState>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        convert::finite("time", time)?;
        let Some(last) = self.last.replace(time) else {
            return Err(PyValueError::new_err("the loop has not begun; call initialize first"));
        };
        convert::period(time - last)?;
        self.telemetry.hear_motors(time, &convert::rotors("rotor_speeds", rotor_speeds, self.count)?);
        let arrived = self.poses.len().min(MAX_POSES);
        let poses: Vec<_> = self.poses.drain(..arrived).collect();
        let measured = Measured {
            time,
            telemetry: &self.telemetry,
            poses: &poses,
            command: Some(&Command::Follow(setpoint.0)),
            host: HostFacts::default(),
            known,
        };
        self.flight.set_learning(learn_bias);
        self.flight.set_model_learning(learn_model);
        self.flight.tick(&measured, &mut self.commanded);
        self.keep();
        Ok(array1(py, &self.commanded.record.rotor_command.as_slice()[..self.count]))
    }

    fn keep(&mut self) {
        let Record { setpoint, reference, state, .. } = &self.commanded.record;
        let (record, rows) = (&self.commanded.record, &mut self.rows);
        rows.extend(&setpoint.position_w);
        rows.extend(&setpoint.rotation_we.transpose());
        rows.extend(&reference.position_w);
        rows.extend(&reference.rotation_we.transpose());
        rows.extend(&reference.velocity_w);
        rows.extend(&state.position_w);
        rows.extend(&state.velocity_w);
        rows.extend(&state.rotation_wr.transpose());
        rows.extend(&record.position_error_w);
        rows.extend(&record.rotation_error_r);
        rows.extend(&record.wrench_robot.to_vector());
        rows.extend(&record.wrench_tool_w.to_vector());
        rows.extend(&record.wrench_admittance_w.to_vector());
        rows.extend(&record.wrench_contact_w.to_vector());
        rows.extend(&record.wind_w);
        rows.push(record.contact_likelihood());
        rows.push(f64::from(u8::from(record.saturated)));
    }
}
