//! The inputs, the state and the outputs of the controller.

use super::{
    AdmittanceState, Allocation, AllocatorState, AttitudeState, BiasEstimator, Contact, ContactState,
    FreeWrenchState, LowPassState, ObserverInput, PoseCommand, Reference, RobotState, RotorVector, Setpoint,
    Vector3, Vector6, Vehicle, Wrench, WrenchObserverState, tool_wrench,
};

/// The state of the controller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ControllerState {
    /// The wrench observer's.
    pub observer: WrenchObserverState,
    /// Observed force, N, world, that an unyielding flight compensates.
    pub lasting_force_w: Vector3,
    /// The estimate of wind and contact.
    pub contact: ContactState,
    /// The low-pass filter's.
    pub low_pass: LowPassState,
    /// The admittance filter's.
    pub admittance: AdmittanceState,
    /// The distance by which a wrench set-point has moved the tool.
    pub free_wrench: FreeWrenchState,
    /// Energy that the reference may still give to what the tool touches, J; zero at the start.
    pub energy_tank: f64,
    /// Wrench (force and torque in R) observed in a contact-free hover; it counts as no contact.
    pub bias_r: Wrench,
    /// The estimator of the bias, active while [`ControllerInput::learn_bias`] is set.
    pub bias_estimator: BiasEstimator,
    /// The attitude selector's.
    pub attitude: AttitudeState,
    /// The allocator's.
    pub allocator: AllocatorState,
}

impl ControllerState {
    /// Changes to another model of the vehicle without a jump of the commanded wrench: the part of the present
    /// sample that the new model explains is no longer observed as an external wrench.
    pub fn change_model(&mut self, before: &Vehicle, after: &Vehicle, now: &ObserverInput) {
        let explained = |vehicle: &Vehicle| {
            let given = vehicle.body_wrench(&now.rotor_speeds);
            Wrench {
                force: now.rotation_wr * (vehicle.mass() * now.specific_force_r - given.force),
                torque: -given.torque,
            }
        };
        let at_tool = |observed: &Wrench, vehicle: &Vehicle| {
            tool_wrench(observed, &now.rotation_wr, &vehicle.tool().position_r).to_vector()
        };
        let observed = self.observer.wrench + explained(after) - explained(before);
        if observed.is_finite() {
            self.low_pass.output += at_tool(&observed, after) - at_tool(&self.observer.wrench, before);
            self.observer.wrench = observed;
        }
        self.observer.forget_sample();
    }

    /// Forgets the bias and the wind, which explained errors of the model that a calibration has corrected.
    pub fn forget_errors(&mut self, vehicle: &Vehicle, now: &ObserverInput) {
        let tool_w = tool_wrench(&self.observer.wrench, &now.rotation_wr, &vehicle.tool().position_r);
        self.low_pass.output = tool_w.to_vector();
        self.bias_r = Wrench::ZERO;
        self.bias_estimator = BiasEstimator::default();
        self.contact = ContactState::default();
    }
}

/// The inputs of a tick.
///
/// ```
/// use tilthex_core::{
///     GRAVITY, Matrix3, RobotState, Setpoint, Vector3,
///     controller::{Controller, ControllerInput, ControllerParams, ControllerState}, examples,
/// };
///
/// let vehicle = examples::tilt_hex()?;
/// let controller = Controller::new(vehicle, ControllerParams::default())?;
/// let mut state = ControllerState::default();
/// // A hover that is held in its place while something pulls with 3 N along x.
/// let mut input = ControllerInput {
///     state: RobotState::at_rest(Vector3::zeros()),
///     specific_force_r: Vector3::new(0.0, 0.0, GRAVITY),
///     rotor_speeds: vehicle.hover_speeds(&Matrix3::identity()),
///     setpoint: Setpoint::hold(vehicle.tool().position_r, vehicle.tool().rotation_r),
///     compliant: true,
///     unyielding: None,
///     learn_bias: false,
///     lost_rotors: 0,
///     fixed_attitude: false,
/// };
/// controller.step(&mut state, &input, 0.002);
/// input.specific_force_r.x = 3.0 / vehicle.mass();
/// for _ in 0..1000 {
///     controller.step(&mut state, &input, 0.002);
/// }
/// let out = controller.step(&mut state, &input, 0.002);
/// assert!((out.wrench_robot.force.x - 3.0).abs() < 1e-6);
/// // The reference of the tool yields in the direction of the force.
/// assert!(out.reference.position_w.x > input.setpoint.position_w.x);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerInput {
    /// Pose and twist of the robot.
    pub state: RobotState,
    /// Specific force at the centre of mass, m/s^2, robot.
    pub specific_force_r: Vector3,
    /// Measured rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
    /// The commanded set-point of the tool.
    pub setpoint: Setpoint,
    /// Whether contact moves the reference. If not, the spring and damper of the admittance filter return the
    /// reference to the set-point. The reference never jumps.
    pub compliant: bool,
    /// Set if the reference must not yield (take-off, the hover to learn from, landing, emergency): the smallest and
    /// the largest vertical force of the rotors, N. Then the observed wrench is compensated only as far as errors of
    /// the model explain it, so that the tool does not press harder and harder on what it touches. A separate filter
    /// returns the reference, whatever the configured admittance is.
    pub unyielding: Option<[f64; 2]>,
    /// Whether this is a contact-free hover to learn the bias from. The mean becomes the bias when it ends.
    pub learn_bias: bool,
    /// Bit `i` is set if rotor `i` (from 0) is lost: it counts as standing still.
    pub lost_rotors: u16,
    /// Whether the reference's attitude is flown unchanged, even if lateral force is missing.
    pub fixed_attitude: bool,
}

/// The command, and the values from which it follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerOutput {
    /// Commanded rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
    /// External wrench at the centre of mass as observed (force W, torque R), bias included.
    pub wrench_robot: Wrench,
    /// External wrench at the tool, W, bias removed, before low-pass and dead zone.
    pub wrench_tool_w: Wrench,
    /// The part of it that is no drag of the wind, W.
    pub wrench_contact_w: Wrench,
    /// Input of the admittance filter: after low-pass and dead zone, without the wind.
    pub wrench_admittance_w: Wrench,
    /// The parts of the observed wrench: wind and contact.
    pub told: Contact,
    /// The commanded set-point of the tool.
    pub setpoint: Setpoint,
    /// Whether contact moves the reference.
    pub compliant: bool,
    /// Reference of the tool.
    pub reference: Setpoint,
    /// Reference of the centre of mass, turned if the force needs it.
    pub robot_reference: Reference,
    /// Errors and wanted accelerations of the pose controller.
    pub pose: PoseCommand,
    /// Wanted body wrench `[force_r; torque_r]`.
    pub wanted_wrench_r: Vector6,
    /// The result of the allocator.
    pub allocation: Allocation,
    /// Whether the admittance filter's excursion limit is active.
    pub excursion_limited: bool,
    /// Level of the energy tank, J.
    pub energy_tank: f64,
}

impl ControllerOutput {
    /// The external wrench at the centre of mass without the bias: force and torque in R.
    #[must_use]
    pub fn contact(&self, robot: &RobotState, bias_r: &Wrench) -> Wrench {
        let force_r = robot.rotation_wr.transpose() * self.wrench_robot.force;
        Wrench { force: force_r - bias_r.force, torque: self.wrench_robot.torque - bias_r.torque }
    }
}
