//! The control chain with which a recorded flight is replayed, on the host and on a Cortex-M7, and the form of the
//! recording: for each tick, numbers of 64 bits.
#![no_std]
#![forbid(unsafe_code)]

use tilthex_core::{
    Error, Matrix3, PoseSample, RotorVector, Setpoint, Vector3, Vector6, Vehicle,
    admittance::{AdmittanceFilter, AdmittanceState},
    allocation::{Allocator, AllocatorState, RotorStatus},
    controller::{Controller, ControllerInput, ControllerOutput, ControllerParams, ControllerState},
    estimator::{Estimator, EstimatorParams},
    examples,
    types::Wrench,
    wrench_observer::{ObserverInput, WrenchObserver, WrenchObserverState},
};

/// Period of the ticks, s.
pub const PERIOD: f64 = 0.002;
/// Numbers of an [`Input`].
pub const INPUT_WORDS: usize = 44;
/// Numbers of an [`Output`].
pub const OUTPUT_WORDS: usize = 72;

/// What the sensors give in one tick, and the set-point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// Angular velocity, rad/s, IMU coordinates.
    pub gyro_i: Vector3,
    /// Specific force, m/s^2, IMU coordinates.
    pub specific_force_i: Vector3,
    /// Rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
    /// A captured pose that has arrived: its time, s, position (m, world) and rotation (robot to world).
    pub pose: Option<(f64, Vector3, Matrix3)>,
    /// Position of the set-point, m, world.
    pub position_w: Vector3,
    /// Its rotation: tool to world coordinates.
    pub rotation_we: Matrix3,
}

/// Numbers that are written one after the other.
struct Words<const N: usize> {
    words: [f64; N],
    used: usize,
}

impl<const N: usize> Words<N> {
    fn put(&mut self, values: &[f64]) {
        for (place, value) in self.words.iter_mut().skip(self.used).zip(values) {
            *place = *value;
        }
        self.used += values.len();
    }
}

/// Numbers that are read one after the other.
struct Reader<'a>(core::slice::Iter<'a, f64>);

impl Reader<'_> {
    fn one(&mut self) -> f64 {
        self.0.next().copied().unwrap_or(f64::NAN)
    }

    fn vector(&mut self) -> Vector3 {
        Vector3::from_fn(|_, _| self.one())
    }

    fn matrix(&mut self) -> Matrix3 {
        Matrix3::from_fn(|_, _| self.one())
    }
}

impl Input {
    /// The input as numbers.
    #[must_use]
    pub fn to_words(&self) -> [f64; INPUT_WORDS] {
        let mut out = Words { words: [0.0; INPUT_WORDS], used: 0 };
        out.put(self.gyro_i.as_slice());
        out.put(self.specific_force_i.as_slice());
        out.put(self.rotor_speeds.as_slice());
        let (time, position_w, rotation_wr) =
            self.pose.unwrap_or((0.0, Vector3::zeros(), Matrix3::identity()));
        out.put(&[f64::from(u8::from(self.pose.is_some())), time]);
        out.put(position_w.as_slice());
        out.put(rotation_wr.as_slice());
        out.put(self.position_w.as_slice());
        out.put(self.rotation_we.as_slice());
        out.words
    }

    /// The input of numbers.
    #[must_use]
    pub fn from_words(words: &[f64; INPUT_WORDS]) -> Self {
        let mut read = Reader(words.iter());
        let (gyro_i, specific_force_i) = (read.vector(), read.vector());
        let rotor_speeds = RotorVector::from_fn(|_, _| read.one());
        let (arrived, time) = (read.one() != 0.0, read.one());
        let pose = (time, read.vector(), read.matrix());
        let (position_w, rotation_we) = (read.vector(), read.matrix());
        let pose = arrived.then_some(pose);
        Self { gyro_i, specific_force_i, rotor_speeds, pose, position_w, rotation_we }
    }
}

/// What the blocks give in one tick.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// The controller's.
    pub controller: ControllerOutput,
    /// The observer's, alone.
    pub observed: Wrench,
    /// The admittance filter's, alone.
    pub reference: Setpoint,
    /// The allocator's, alone: rotor inputs, Hz^2.
    pub inputs: RotorVector,
}

/// The parts of a tick whose instructions are counted: the first two are the tick, the others are repeated alone.
pub const PARTS: [&str; 5] = ["estimator", "controller", "- observer", "- admittance filter", "- allocator"];

/// The chain: estimator and controller, and the controller's blocks alone.
#[derive(Clone, Copy, Debug)]
pub struct Chain {
    vehicle: Vehicle,
    time: f64,
    estimator: Estimator,
    controller: (Controller, ControllerState),
    observer: (WrenchObserver, WrenchObserverState),
    admittance: (AdmittanceFilter, AdmittanceState),
    allocator: (Allocator, AllocatorState),
}

impl Chain {
    /// The chain of the Tilt-Hex, which begins at rest in a pose (m, world; robot to world).
    ///
    /// # Errors
    /// A pose that is not finite or not a rotation. The parameters are the defaults, and are accepted.
    pub fn new(position_w: &Vector3, rotation_wr: &Matrix3) -> Result<Self, Error> {
        let (vehicle, params) = (examples::tilt_hex()?, ControllerParams::default());
        let mut estimator = Estimator::new(EstimatorParams::default())?;
        estimator.initialize(0.0, position_w, rotation_wr)?;
        let mut controller = Controller::new(vehicle, params)?;
        controller.prepare(PERIOD);
        let mut admittance = AdmittanceFilter::new(params.admittance)?;
        admittance.prepare(PERIOD);
        Ok(Self {
            time: 0.0,
            estimator,
            controller: (controller, ControllerState::default()),
            observer: (WrenchObserver::new(&vehicle, params.observer)?, WrenchObserverState::default()),
            admittance: (admittance, AdmittanceState::default()),
            allocator: (Allocator::new(&vehicle), AllocatorState::default()),
            vehicle,
        })
    }

    /// The vehicle.
    #[must_use]
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// The state that the estimator gives.
    #[must_use]
    pub fn estimator(&self) -> &Estimator {
        &self.estimator
    }

    /// The input of the controller: the estimate, and what is measured.
    fn controller_input(&self, input: &Input) -> ControllerInput {
        ControllerInput {
            state: self.estimator.robot_state(),
            specific_force_r: self.estimator.specific_force_r(),
            rotor_speeds: input.rotor_speeds,
            setpoint: Setpoint::hold(input.position_w, input.rotation_we),
            compliant: true,
            unyielding: None,
            learn_bias: false,
            lost_rotors: 0,
            fixed_attitude: false,
        }
    }

    /// The first part of a tick: the inertial sample, and the pose if one has arrived.
    pub fn estimate(&mut self, input: &Input) {
        self.time += PERIOD;
        self.estimator.predict(self.time, &input.gyro_i, &input.specific_force_i);
        if let Some((time, position_w, rotation_wr)) = input.pose {
            let arrival = self.time;
            let pose = PoseSample { time, arrival, position_w, rotation_wr, tracking_valid: true };
            let _ = self.estimator.update_pose(&pose);
        }
    }

    /// The second part of a tick.
    pub fn control(&mut self, input: &Input) -> ControllerOutput {
        let given = self.controller_input(input);
        let (controller, state) = &mut self.controller;
        controller.step(state, &given, PERIOD)
    }

    /// The observer alone.
    pub fn observe(&mut self, input: &Input) -> Wrench {
        let robot = self.estimator.robot_state();
        let given = ObserverInput {
            rotation_wr: robot.rotation_wr,
            angular_velocity_r: robot.angular_velocity_r,
            specific_force_r: self.estimator.specific_force_r(),
            rotor_speeds: input.rotor_speeds,
        };
        let (observer, state) = &mut self.observer;
        observer.step(state, &given, PERIOD)
    }

    /// The admittance filter alone, under the wrench that the controller gave its own.
    pub fn yield_to(&mut self, input: &Input, wrench_w: &Wrench) -> Setpoint {
        let setpoint = Setpoint::hold(input.position_w, input.rotation_we);
        let (filter, state) = &mut self.admittance;
        filter.step(state, &setpoint, wrench_w, PERIOD).reference
    }

    /// The allocator alone, for the wrench that the controller wanted.
    pub fn allocate(&mut self, wanted_r: &Vector6) -> RotorVector {
        let rotation_wr = self.estimator.robot_state().rotation_wr;
        let (allocator, state) = &mut self.allocator;
        allocator.step(state, wanted_r, &rotation_wr, &RotorStatus::default()).inputs
    }

    /// One whole tick. `around` runs each part of [`PARTS`] and may count it.
    pub fn tick(&mut self, input: &Input, around: &mut impl FnMut(usize, &mut dyn FnMut())) -> Output {
        around(0, &mut || self.estimate(input));
        let mut controller = None;
        around(1, &mut || controller = Some(self.control(input)));
        let controller = controller.unwrap_or_else(|| self.control(input));
        let mut output = Output {
            controller,
            observed: Wrench::ZERO,
            reference: controller.reference,
            inputs: RotorVector::zeros(),
        };
        around(2, &mut || output.observed = self.observe(input));
        around(3, &mut || output.reference = self.yield_to(input, &controller.wrench_admittance_w));
        around(4, &mut || output.inputs = self.allocate(&controller.wanted_wrench_r));
        output
    }

    /// The state and an output as numbers.
    #[must_use]
    pub fn words(&self, output: &Output) -> [f64; OUTPUT_WORDS] {
        let (robot, c) = (self.estimator.robot_state(), &output.controller);
        let mut out = Words { words: [0.0; OUTPUT_WORDS], used: 0 };
        out.put(robot.position_w.as_slice());
        out.put(robot.velocity_w.as_slice());
        out.put(robot.rotation_wr.as_slice());
        out.put(robot.angular_velocity_r.as_slice());
        out.put(self.estimator.specific_force_r().as_slice());
        out.put(c.wrench_tool_w.to_vector().as_slice());
        out.put(c.reference.position_w.as_slice());
        out.put(c.reference.rotation_we.as_slice());
        out.put(c.rotor_speeds.as_slice());
        out.put(output.observed.to_vector().as_slice());
        out.put(output.reference.position_w.as_slice());
        out.put(output.inputs.as_slice());
        out.words
    }
}
