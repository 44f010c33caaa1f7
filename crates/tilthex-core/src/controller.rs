//! One tick of the paper's figure 5, without the estimator: observer,
//! admittance filter, pose controller, compensation, allocation.

mod gains;
mod signals;

use crate::{
    Error, GRAVITY, Vehicle,
    admittance::{AdmittanceFilter, AdmittanceParams, AdmittanceState, centre_of_mass_reference},
    allocation::{Allocation, Allocator, AllocatorParams, AllocatorState, RotorStatus},
    attitude::{Attitude, AttitudeParams, AttitudeSelector, AttitudeState},
    bias::BiasEstimator,
    contact::{Contact, ContactParams, ContactState, Seen},
    error::check_range,
    filters::{LowPass, LowPassState, lag_fraction},
    force_axes::{ForceAxes, Forced},
    free_wrench::{FreeWrenchParams, FreeWrenchState},
    pose_control::{PoseCommand, PoseController, PoseGains},
    reference_bounds::ReferenceBounds,
    rotor_room::RotorRoom,
    types::{Matrix3, Reference, RobotState, RotorVector, Setpoint, Vector3, Vector6, Wrench},
    vehicle::speeds_of,
    wrench_observer::{ObserverGains, ObserverInput, WrenchObserver, WrenchObserverState, tool_wrench},
};
pub use signals::{ControllerInput, ControllerOutput, ControllerState};

/// Limits of the wrench that errors of the model can explain, with a margin: the first is a part of the weight for
/// forces; the second is a part of the weight at the farthest rotor's distance for torques, which keep the attitude
/// during a push.
const MODEL_ERROR: (f64, f64) = (0.2, 0.3);
/// Errors of the model are constant: rate with which the force that an unyielding flight compensates follows the
/// observed force, 1/s.
const MODEL_ERROR_RATE: f64 = 3.0;
/// The largest bias that is learnt, and the largest deviation from it meanwhile: parts as in `MODEL_ERROR`.
const LARGEST_BIAS: (f64, f64) = (0.35, 0.2);
const BIAS_SPREAD: (f64, f64) = (0.06, 0.06);
/// Torque about every axis divided by the weight, m, without which a hover is not possible.
const LEAST_TORQUE: f64 = 1e-2;

/// Parameters of every block of the controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerParams {
    /// Gains of the pose controller.
    pub pose: PoseGains,
    /// Gains of the wrench observer.
    pub observer: ObserverGains,
    /// The admittance filter.
    pub admittance: AdmittanceParams,
    /// Tool forces up to this norm, N, do not move the reference.
    pub force_dead_zone: f64,
    /// Tool torques up to this norm, N m, do not turn the reference.
    pub torque_dead_zone: f64,
    /// Cut-off of the low-pass before the dead zone, Hz; 0 for none.
    pub low_pass_hz: f64,
    /// Largest torque about the tool's axis that turns the reference towards attitudes in which the rotors have more
    /// room, N m; 0 for none.
    pub room_torque: f64,
    /// How wind and contact are distinguished.
    pub contact: ContactParams,
    /// Limits of the motion by a wrench set-point if nothing resists the tool.
    pub free_wrench: FreeWrenchParams,
    /// Speed of the reference, and the energy that it may put into what the tool touches.
    pub bounds: ReferenceBounds,
    /// The order in which parts of the wrench are given up at the rotors' limits.
    pub allocation: AllocatorParams,
    /// The attitude of the vehicle if the lateral force does not suffice.
    pub attitude: AttitudeParams,
}

impl Default for ControllerParams {
    /// The parameters of the Tilt-Hex.
    fn default() -> Self {
        Self {
            pose: PoseGains {
                position: Vector3::repeat(100.0),
                velocity: Vector3::repeat(20.0),
                rotation: Vector3::repeat(225.0),
                angular_velocity: Vector3::repeat(30.0),
            },
            observer: ObserverGains { force: Vector3::repeat(30.0), torque: Vector3::repeat(30.0) },
            admittance: AdmittanceParams { max_rotation: 60f64.to_radians(), ..AdmittanceParams::default() },
            force_dead_zone: 0.2,
            torque_dead_zone: 0.2,
            low_pass_hz: 20.0,
            room_torque: 0.0,
            contact: ContactParams::default(),
            free_wrench: FreeWrenchParams::default(),
            bounds: ReferenceBounds::default(),
            allocation: AllocatorParams::default(),
            attitude: AttitudeParams::default(),
        }
    }
}

/// The controller of one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Controller {
    vehicle: Vehicle,
    params: ControllerParams,
    observer: WrenchObserver,
    low_pass: LowPass,
    admittance: AdmittanceFilter,
    /// Moves an unyielding reference back to the set-point.
    firm: AdmittanceFilter,
    /// Largest force, N, and torque, N m, beyond the bias that an unyielding flight compensates.
    model_error: (f64, f64),
    /// Force and torque that count as the weight.
    scale: (f64, f64),
    room: Option<RotorRoom>,
    pose: PoseController,
    attitude: AttitudeSelector,
    allocator: Allocator,
}

impl Controller {
    /// Combines the blocks for one vehicle.
    ///
    /// # Errors
    /// The first parameter that a block refuses.
    pub fn new(vehicle: Vehicle, params: ControllerParams) -> Result<Self, Error> {
        check_range("force_dead_zone", params.force_dead_zone, 0.0, 100.0)?;
        check_range("torque_dead_zone", params.torque_dead_zone, 0.0, 100.0)?;
        params.free_wrench.checked()?;
        params.bounds.check()?;
        params.contact.checked()?;
        let room = RotorRoom::new(&vehicle, params.room_torque)?;
        let arm = vehicle.rotors().iter().map(|r| r.position_r.norm()).fold(0.0, f64::max);
        let scale = (vehicle.weight(), vehicle.weight() * arm);
        Ok(Self {
            scale,
            firm: AdmittanceFilter::new(AdmittanceParams::firm(&params.admittance))?,
            model_error: (MODEL_ERROR.0 * scale.0, MODEL_ERROR.1 * scale.1),
            room: Some(room).filter(|_| params.room_torque > 0.0),
            observer: WrenchObserver::new(&vehicle, params.observer)?,
            low_pass: LowPass::new(params.low_pass_hz)?,
            admittance: AdmittanceFilter::new(params.admittance)?,
            pose: PoseController::new(params.pose)?,
            attitude: AttitudeSelector::new(&vehicle, params.attitude)?,
            allocator: Allocator::with_params(&vehicle, params.allocation)?,
            vehicle,
            params,
        })
    }

    /// The vehicle.
    #[must_use]
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// The parameters.
    #[must_use]
    pub fn params(&self) -> &ControllerParams {
        &self.params
    }

    /// Uses another admittance filter from now on. The reference does not jump.
    pub fn set_admittance(&mut self, filter: AdmittanceFilter) {
        self.params.admittance = *filter.params();
        self.firm = self.firm.reaching(filter.params());
        self.admittance = filter;
    }

    /// The same laws for a vehicle whose model has been corrected.
    #[must_use]
    pub fn for_vehicle(&self, vehicle: &Vehicle) -> Self {
        Self {
            vehicle: *vehicle,
            observer: self.observer.for_vehicle(vehicle),
            room: self.room.as_ref().map(|room| room.for_vehicle(vehicle)),
            attitude: self.attitude.for_vehicle(vehicle),
            allocator: self.allocator.for_vehicle(vehicle),
            ..*self
        }
    }

    /// Prepares for ticks of about `period` seconds, if it is not prepared for them. A tick with another period takes
    /// longer.
    pub fn prepare(&mut self, period: f64) {
        self.admittance.prepare(period);
    }

    /// Whether the vehicle can hover level and at rest without some rotors, and turn in every direction from there:
    /// bit `i` of `lost` is rotor `i`.
    #[must_use]
    pub fn hovers_without(&self, lost: u16) -> bool {
        let weight = self.vehicle.weight();
        let rotors = RotorStatus { lost, ..RotorStatus::default() };
        let possible = |torque: Vector3| {
            let wrench = Wrench { force: Vector3::new(0.0, 0.0, weight), torque }.to_vector();
            let found =
                self.allocator.step(&mut AllocatorState::default(), &wrench, &Matrix3::identity(), &rotors);
            // The attitude can replace lateral force.
            let [roll_pitch, vertical, yaw, _lateral] = found.shortfall;
            roll_pitch.max(vertical).max(yaw) < 1e-4 * weight
        };
        let least = LEAST_TORQUE * weight;
        [Vector3::x(), Vector3::y(), Vector3::z()]
            .iter()
            .all(|axis| possible(axis * least) && possible(-axis * least))
    }

    /// The weight at the farthest rotor's distance, N m.
    #[must_use]
    pub fn weight_at_arm(&self) -> f64 {
        self.scale.1
    }

    /// Whether the norm of a wrench is so small that a bias can be learnt meanwhile.
    #[must_use]
    pub fn is_small(&self, wrench: &Wrench) -> bool {
        wrench.force.norm() < BIAS_SPREAD.0 * self.scale.0
            && wrench.torque.norm() < BIAS_SPREAD.1 * self.scale.1
    }

    /// Whether the learnt wrench can be a bias: it is not larger than errors of the model explain, and not as
    /// unsteady as contact.
    #[must_use]
    pub fn can_be_bias(&self, estimator: &BiasEstimator) -> bool {
        let (mean, _) = estimator.mean();
        let (force, torque) = estimator.spread();
        let largest = (LARGEST_BIAS.0 * self.scale.0, LARGEST_BIAS.1 * self.scale.1);
        let spread = (BIAS_SPREAD.0 * self.scale.0, BIAS_SPREAD.1 * self.scale.1);
        mean.force.norm() < largest.0
            && mean.torque.norm() < largest.1
            && force < spread.0
            && torque < spread.1
    }

    /// One tick: `dt` is the measured time since the last, s.
    pub fn step(&self, state: &mut ControllerState, input: &ControllerInput, dt: f64) -> ControllerOutput {
        let robot = &input.state;
        let observed = self.observer.step(
            &mut state.observer,
            &ObserverInput {
                rotation_wr: robot.rotation_wr,
                angular_velocity_r: robot.angular_velocity_r,
                specific_force_r: input.specific_force_r,
                rotor_speeds: input.rotor_speeds,
            },
            dt,
        );
        Self::learn(state, &observed, input, dt);
        let contact = Wrench {
            force: observed.force - robot.rotation_wr * state.bias_r.force,
            torque: observed.torque - state.bias_r.torque,
        };
        let tool = self.vehicle.tool();
        let wrench_tool_w = tool_wrench(&contact, &robot.rotation_wr, &tool.position_r);
        let seen = Seen {
            vehicle: &self.vehicle,
            robot,
            rotor_speeds: &input.rotor_speeds,
            wrench_tool_w: &wrench_tool_w,
        };
        let told = self.params.contact.step(&mut state.contact, &seen, dt);
        let wrench_contact_w = wrench_tool_w - told.drag_tool_w;
        let smooth = self.low_pass.step(&mut state.low_pass, &wrench_contact_w.to_vector(), dt);
        let smooth = Wrench::from_vector(&smooth);
        // A reference that does not yield controls no force.
        let unforced;
        let setpoint = if input.compliant || !input.setpoint.force_axes.any() {
            &input.setpoint
        } else {
            unforced = Setpoint { force_axes: ForceAxes::NONE, ..input.setpoint };
            &unforced
        };
        let forced = state.admittance.forced(setpoint).unwrap_or(Forced::NONE);
        let dead_zones = (self.params.force_dead_zone, self.params.torque_dead_zone);
        let contact_w = forced.beyond(&smooth, &setpoint.wrench_w, dead_zones);
        let wrench_admittance_w =
            Wrench { force: contact_w.force * told.part, torque: contact_w.torque * told.part };
        let mut drive = Wrench::ZERO;
        if input.compliant {
            let (free, admittance) = (&mut state.free_wrench, (&self.admittance, setpoint));
            let felt_w = &wrench_admittance_w;
            drive = wrench_admittance_w
                + self.params.free_wrench.step(free, admittance, &state.admittance, felt_w, dt);
        }
        // Without all of its rotors the vehicle has other limits.
        if let Some(room) = self.room.as_ref().filter(|_| input.compliant && input.lost_rotors == 0) {
            let rotation_we = state.admittance.rotation * input.setpoint.rotation_we;
            drive.torque += room.torque(&rotation_we, tool);
        }
        let share = if input.unyielding.is_some() { lag_fraction(MODEL_ERROR_RATE, dt) } else { 1.0 };
        state.lasting_force_w += (observed.force - state.lasting_force_w) * share;
        let (filter, compensated) = match input.unyielding {
            None => (&self.admittance, observed),
            // The rotors carry exactly this force, and the legs carry the rest of the weight.
            Some([least, most]) if least >= most => (&self.firm, observed - contact),
            Some(_) => (&self.firm, self.explained(&observed, &contact, &state.lasting_force_w)),
        };
        let mut yielded = filter.step(&mut state.admittance, setpoint, &drive, dt);
        if input.compliant {
            let twist_w = filter.own_twist_w(&state.admittance, setpoint);
            let impulse_w = filter.impulse_w(&wrench_admittance_w, setpoint);
            self.params.bounds.step(
                &mut state.energy_tank,
                (&mut state.admittance, &mut yielded.reference),
                &twist_w,
                (&wrench_admittance_w, &impulse_w),
                dt,
            );
        }
        let rotors = RotorStatus { speeds: input.rotor_speeds, lost: input.lost_rotors };
        let unturned = if input.fixed_attitude {
            state.attitude = AttitudeState::default();
            centre_of_mass_reference(&yielded.reference, tool)
        } else {
            self.attitude.reference(&mut state.attitude, &yielded.reference, dt)
        };
        let mut pose = self.pose.translation(robot, &unturned);
        let mut force_w = self.wanted_force(&pose, &compensated);
        if let Some([least, most]) = input.unyielding {
            // Reduces the whole force, and keeps its direction.
            if force_w.z > most {
                force_w *= most.max(0.0) / force_w.z;
            }
            force_w.z = force_w.z.max(least).min(most);
        }
        let attitude = if input.fixed_attitude {
            Attitude { reference: unturned, lead_r: Vector3::zeros(), force_w }
        } else {
            self.attitude.step(&mut state.attitude, &unturned, &force_w, &rotors, dt)
        };
        self.pose.rotation(&mut pose, robot, &attitude.reference, &attitude.lead_r);
        let force_r = robot.rotation_wr.transpose() * attitude.force_w;
        let wanted_wrench_r =
            Wrench { force: force_r, torque: self.wanted_torque(robot, &pose, &compensated) }.to_vector();
        let allocation =
            self.allocator.step(&mut state.allocator, &wanted_wrench_r, &robot.rotation_wr, &rotors);
        ControllerOutput {
            rotor_speeds: speeds_of(&allocation.inputs, self.vehicle.rotor_count()),
            wrench_robot: observed,
            wrench_tool_w,
            wrench_contact_w,
            wrench_admittance_w,
            told,
            setpoint: input.setpoint,
            compliant: input.compliant,
            reference: yielded.reference,
            robot_reference: attitude.reference,
            pose,
            wanted_wrench_r,
            allocation,
            excursion_limited: yielded.limited,
            energy_tank: state.energy_tank,
        }
    }

    /// The part of an observed wrench that errors of the model explain: the bias, and the part of the contact that
    /// such errors can cause.
    fn explained(&self, observed: &Wrench, contact: &Wrench, lasting_force_w: &Vector3) -> Wrench {
        let (force, torque) = self.model_error;
        let excess = |v: Vector3, limit: f64| v * (1.0 - limit / v.norm().max(limit));
        let bias_w = observed.force - contact.force;
        Wrench {
            force: lasting_force_w - excess(lasting_force_w - bias_w, force),
            torque: observed.torque - excess(contact.torque, torque),
        }
    }

    /// Inverse dynamics with the external force compensated, N, world; (12), (26).
    ///
    /// The bias is compensated too: it is a wrench that the model does not
    /// explain. (26) prints a wrench subtracted from accelerations.
    fn wanted_force(&self, pose: &PoseCommand, observed: &Wrench) -> Vector3 {
        self.vehicle.mass() * (pose.acceleration_w + Vector3::new(0.0, 0.0, GRAVITY)) - observed.force
    }

    /// The wanted torque with the external torque compensated, N m, robot.
    fn wanted_torque(&self, robot: &RobotState, pose: &PoseCommand, observed: &Wrench) -> Vector3 {
        let inertia = self.vehicle.inertia();
        let omega = robot.angular_velocity_r;
        inertia * pose.angular_acceleration_r + omega.cross(&(inertia * omega)) - observed.torque
    }

    fn learn(state: &mut ControllerState, observed: &Wrench, input: &ControllerInput, dt: f64) {
        if input.learn_bias {
            state.bias_estimator.add(observed, &input.state.rotation_wr, dt);
        } else {
            let (mean, time) = state.bias_estimator.mean();
            if time > 0.0 {
                state.bias_r = mean;
                // The wind explained a part of it before.
                state.contact = ContactState::default();
                state.bias_estimator = BiasEstimator::default();
            }
        }
    }
}
