//! What goes into the controller, what moves in it, and what comes out.

use super::{
    AdmittanceState, Allocation, AllocatorState, AttitudeState, BiasEstimator, Contact, ContactState,
    FreeWrenchState, LowPassState, ObserverInput, PoseCommand, Reference, RobotState, RotorVector, Setpoint,
    Vector3, Vector6, Vehicle, Wrench, WrenchObserverState, tool_wrench,
};

/// What moves in the controller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ControllerState {
    /// The wrench observer's.
    pub observer: WrenchObserverState,
    /// Observed force, N, world, as an unyielding flight compensates it.
    pub lasting_force_w: Vector3,
    /// What is believed of wind and contact.
    pub contact: ContactState,
    /// The low-pass filter's.
    pub low_pass: LowPassState,
    /// The admittance filter's.
    pub admittance: AdmittanceState,
    /// How far a wrench set-point has carried the tool.
    pub free_wrench: FreeWrenchState,
    /// Energy that the reference may put into what the tool touches, J: empty at the begin.
    pub energy_tank: f64,
    /// Wrench (force and torque in R) observed in a contact-free hover: no contact.
    pub bias_r: Wrench,
    /// Its estimator, running while [`ControllerInput::learn_bias`] is set.
    pub bias_estimator: BiasEstimator,
    /// The attitude selector's.
    pub attitude: AttitudeState,
    /// The allocator's.
    pub allocator: AllocatorState,
}

impl ControllerState {
    /// Changes to another model of the vehicle without a jump of the commanded wrench: the part of the present
    /// sample that the new model explains is no longer observed as an external wrench. A learnt bias explained
    /// the same part, and is removed.
    pub fn change_model(&mut self, before: &Vehicle, after: &Vehicle, now: &ObserverInput) {
        let explained = |vehicle: &Vehicle| {
            let given = vehicle.body_wrench(&now.rotor_speeds);
            Wrench {
                force: now.rotation_wr * (vehicle.mass() * now.specific_force_r - given.force),
                torque: -given.torque,
            }
        };
        let observed = self.observer.wrench + explained(after) - explained(before);
        if observed.is_finite() {
            self.observer.wrench = observed;
        }
        self.observer.forget_sample();
        // The filter has seen what is no longer there.
        let tool_w = tool_wrench(&self.observer.wrench, &now.rotation_wr, &after.tool().position_r);
        self.low_pass.output = tool_w.to_vector();
        self.bias_r = Wrench::ZERO;
        self.bias_estimator = BiasEstimator::default();
    }
}

/// What is known at the start of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerInput {
    /// Pose and twist of the robot.
    pub state: RobotState,
    /// Specific force at the centre of mass, m/s^2, robot.
    pub specific_force_r: Vector3,
    /// Measured rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
    /// What the tool is asked to do.
    pub setpoint: Setpoint,
    /// Whether contact moves the reference. Without it the reference returns
    /// to the set-point as the admittance filter's spring and damper let it:
    /// neither way does it jump.
    pub compliant: bool,
    /// Where the reference must not yield (take-off, the hover to learn from, landing, emergency): the vertical force
    /// that the rotors are asked for, N, at least and at most. Then the observed wrench is compensated only as far as
    /// errors of the model explain it, so that nothing that is touched is pushed harder and harder, and a filter of its
    /// own brings the reference back, whatever the admittance is.
    pub unyielding: Option<[f64; 2]>,
    /// Whether this is a contact-free hover to learn the bias from; the mean
    /// is taken over when it ends.
    pub learn_bias: bool,
    /// Bit `i` is set where rotor `i` (from 0) is lost: it counts as standing still.
    pub lost_rotors: u16,
    /// Whether the reference's attitude is flown as it is, whatever lateral force that leaves.
    pub fixed_attitude: bool,
}

/// The command, and all that led to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerOutput {
    /// Commanded rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
    /// External wrench at the centre of mass as observed (force W, torque R), bias included.
    pub wrench_robot: Wrench,
    /// External wrench at the tool, W, bias removed, before low-pass and dead zone.
    pub wrench_tool_w: Wrench,
    /// What entered the admittance filter: behind low-pass and dead zone, without what is wind.
    pub wrench_admittance_w: Wrench,
    /// What of the observed wrench is wind, and what contact.
    pub told: Contact,
    /// What the tool is asked to do.
    pub setpoint: Setpoint,
    /// Whether contact moves the reference.
    pub compliant: bool,
    /// Reference of the tool.
    pub reference: Setpoint,
    /// Reference of the centre of mass, turned where the force needs it.
    pub robot_reference: Reference,
    /// Errors and wanted accelerations of the pose controller.
    pub pose: PoseCommand,
    /// Wanted body wrench `[force_r; torque_r]`.
    pub wanted_wrench_r: Vector6,
    /// What the allocator made of it.
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
