//! `tilthex.VehicleLink` and `tilthex.PoseClient`: the ends of the lines to a vehicle and to motion capture.

use crate::{
    config::Config,
    convert::{self, array1, array2},
    value,
};
use numpy::{PyArray1, PyArray2};
use pyo3::{
    exceptions::{PyOSError, PyTypeError, PyValueError},
    prelude::*,
    types::PyBytes,
};
use std::sync::Mutex;
use tilthex_core::{
    PoseSample, RotorVector,
    flight::{MAX_SAMPLES, MotorCommand},
};
use tilthex_link::{Link, Outgoing, VehicleLink as _};
use tilthex_mocap::net::{Client, MocapUri};

/// Number of bytes that the link takes at once: fewer than [`MAX_SAMPLES`] inertial samples of any link, so that none is lost.
const CHUNK: usize = 8 * MAX_SAMPLES;

/// An inertial sample: time, s; gyro (3,), rad/s, and specific force (3,), m/s^2, IMU axes.
type Sample<'py> = (f64, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);
/// A pose: when it arrived and when it was taken, s; position (3,), m; rotation (3, 3).
type Pose<'py> = (f64, f64, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// The host's end of the link to a vehicle: the protocol that `[link]` of a configuration names, with its checks. It turns
/// bytes into measurements, and commands into bytes; the caller reads and writes them. Times are those of
/// `time.monotonic`.
#[pyclass(module = "tilthex")]
#[derive(Clone)]
pub(crate) struct VehicleLink {
    link: Link,
    rotors: usize,
    now: f64,
}

#[pymethods]
impl VehicleLink {
    #[new]
    fn new(config: &Config) -> PyResult<Self> {
        let params = config.checked.linked_params(false).map_err(convert::config_error)?;
        let rotors = params.flight.vehicle.rotor_count();
        let link = Link::new(params.kind, params.link, rotors).map_err(convert::value_error)?;
        Ok(Self { link, rotors, now: 0.0 })
    }

    /// Takes bytes of the vehicle that were read at `time`, s. Returns the inertial samples in them, each (time, gyro,
    /// specific_force) in IMU axes.
    fn receive<'py>(&mut self, py: Python<'py>, time: f64, data: &[u8]) -> PyResult<Vec<Sample<'py>>> {
        self.now = convert::finite("time", time)?;
        let mut samples = Vec::new();
        // Without bytes too, the link looks at its clock.
        let chunks = data.chunks(CHUNK).chain(data.is_empty().then_some(data));
        for chunk in chunks {
            for sample in self.link.receive(chunk, time).inertial.samples() {
                let (gyro, force) = (sample.gyro_i, sample.specific_force_i);
                samples.push((sample.time, array1(py, gyro.as_slice()), array1(py, force.as_slice())));
            }
        }
        Ok(samples)
    }

    /// The bytes of a command to the motors at `time`, s, with everything else that the protocol needs then: call it in
    /// every period. Without `rotor_speeds` the motors stop. `rotor_speeds`, (n,), Hz: motors that spin turn at these
    /// speeds; with `start`, the others start.
    #[pyo3(signature = (time, rotor_speeds=None, *, start=false))]
    fn command<'py>(
        &mut self,
        py: Python<'py>,
        time: f64,
        rotor_speeds: Option<&Bound<'py, PyAny>>,
        start: bool,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let time = convert::finite("time", time)?;
        let speeds =
            rotor_speeds.map(|speeds| convert::rotors("rotor_speeds", speeds, self.rotors)).transpose()?;
        let command = match speeds {
            None => MotorCommand::Stop,
            Some(speeds) if start => MotorCommand::Start(speeds),
            Some(speeds) => MotorCommand::Turn(speeds),
        };
        let mut out = Outgoing::default();
        self.link.command(&command, time, &mut out);
        Ok(PyBytes::new(py, out.bytes()))
    }

    /// The bytes that end the conversation: the streams stop. They neither stop nor start motors.
    fn part<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let mut out = Outgoing::default();
        self.link.part(&mut out);
        PyBytes::new(py, out.bytes())
    }

    /// Whether all streams run.
    #[getter]
    fn ready(&self) -> bool {
        self.link.telemetry().link.ready
    }

    /// Whether no vehicle that the link knows has answered.
    #[getter]
    fn refused(&self) -> bool {
        self.link.refused()
    }

    /// Measured rotor speeds, Hz, (n,); 0 for a motor that does not spin.
    #[getter]
    fn rotor_speeds<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let mut speeds = RotorVector::zeros();
        for (speed, motor) in speeds.iter_mut().zip(self.link.telemetry().motors()) {
            *speed = motor.speed;
        }
        array1(py, &speeds.as_slice()[..self.rotors])
    }

    /// Whether each motor spins.
    #[getter]
    fn spinning(&self) -> Vec<bool> {
        self.link.telemetry().motors().iter().map(|motor| motor.spinning).collect()
    }

    /// Time since the last byte of the vehicle, s, at the last `receive`.
    #[getter]
    fn silence(&self) -> f64 {
        self.link.telemetry().silence(self.now)
    }

    /// Voltage of the battery, V; None before it is known.
    #[getter]
    fn battery(&self) -> Option<f64> {
        self.link.telemetry().battery
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        value::not_pickled("VehicleLink", "its configuration")
    }

    fn __repr__(&self) -> String {
        let state = match () {
            () if self.ready() => "ready",
            () if self.refused() => "refused",
            () => "not ready",
        };
        format!("VehicleLink({} rotors, {state})", self.rotors)
    }
}

/// A client of motion capture at an address as `tilthex-rt --mocap` takes it, for the body that the address names. It
/// connects at once, and receives poses in a thread of its own until it is deleted.
#[pyclass(module = "tilthex")]
pub(crate) struct PoseClient {
    address: String,
    client: Client,
    /// Python may call from any thread.
    poses: Mutex<rtrb::Consumer<PoseSample>>,
}

#[pymethods]
impl PoseClient {
    #[new]
    fn new(py: Python<'_>, config: &Config, address: &str) -> PyResult<Self> {
        let uri: MocapUri = address.parse().map_err(|e| PyValueError::new_err(format!("{e}")))?;
        let params = config.checked.mocap().client().map_err(convert::config_error)?;
        let (client, poses) =
            py.detach(|| Client::start(&uri, params)).map_err(|e| PyOSError::new_err(e.to_string()))?;
        Ok(Self { address: uri.to_string(), client, poses: Mutex::new(poses) })
    }

    /// The poses of the tracked body that have arrived since the last call, each (arrival, time, position, rotation): s on
    /// the clock of `time.monotonic`, m and world axes.
    fn receive<'py>(&mut self, py: Python<'py>) -> PyResult<Vec<Pose<'py>>> {
        let mut poses = Vec::new();
        let ring = self.poses.get_mut().map_err(|_| PyOSError::new_err("the client has failed"))?;
        while let Ok(pose) = ring.pop() {
            if pose.tracking_valid {
                let position = array1(py, pose.position_w.as_slice());
                poses.push((pose.arrival, pose.time, position, array2(py, &pose.rotation_wr)?));
            }
        }
        Ok(poses)
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(PyTypeError::new_err("PoseClient is a connection; make a new one from its address"))
    }

    fn __repr__(&self) -> String {
        format!("PoseClient({}, {} poses)", self.address, self.client.status().poses)
    }
}
