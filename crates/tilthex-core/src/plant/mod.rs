//! The simulated vehicle: a rigid body on SO(3) with rotor lag, other effects on a real vehicle, and its sensors;
//! (3)-(10).
//!
//! [`Effects`] holds the effects that the model of the controller leaves out. Each has a module, and each is off by
//! default.
//!
//! The integrator is a fourth-order Runge-Kutta-Munthe-Kaas method on (position, velocity, rotation, angular momentum in
//! axes that do not turn during a step: those of the body at its start). The rotation stays a rotation, and without torque
//! the angular momentum in W is constant to rounding.

mod age;
mod battery;
mod body_drag;
mod effects;
mod rod;
mod rotor_drag;
mod rotor_inertia;
mod sensors;
mod surface;
mod vibration;
mod wind;

pub use age::{LARGEST as LARGEST_ROTOR_SPEED_AGE, Past};
pub use battery::{Battery, rotor_current};
pub use body_drag::BodyDrag;
pub use effects::{Effects, EffectsState, Rotors};
pub use rod::Rod;
pub use rotor_drag::RotorDrag;
pub use rotor_inertia::{momentum as rotor_momentum, torque as rotor_torque};
pub use sensors::{ImuSample, SensorParams, Sensors};
pub use surface::{Influence, NEAREST, Surface, induced_velocity};
pub use vibration::Angles;
pub use wind::{RISES, Wind, WindState};

use crate::{
    Error, GRAVITY, Vehicle, so3,
    types::{Matrix3, RobotState, RotorVector, Vector3, Wrench},
    wrench_observer::robot_wrench,
};

/// The rigid body, its rotors, and the effects on them.
///
/// ```
/// use tilthex_core::{RotorVector, Vector3, Wrench, examples, plant::Plant};
///
/// let plant = Plant::new(examples::tilt_hex()?);
/// let mut state = plant.hover(Vector3::new(0.0, 0.0, 1.0));
/// let hover = state.rotor_speeds;
/// for _ in 0..500 {
///     plant.step(&mut state, &hover, &Wrench::ZERO, 0.002);
/// }
/// assert!((state.robot.position_w.z - 1.0).abs() < 1e-9);
/// // Without its rotors it falls.
/// plant.step(&mut state, &RotorVector::zeros(), &Wrench::ZERO, 0.5);
/// assert!(state.robot.velocity_w.z < -3.0);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant {
    vehicle: Vehicle,
    effects: Effects,
    /// Whether no effect changes the wrench on the airframe.
    bare: bool,
}

/// The length of a step, and how far the rotors come towards a command in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeStep {
    dt: f64,
    /// The parts of the way from a speed to the commanded one after half of the step and after all of it.
    half_lag: f64,
    lag: f64,
}

impl TimeStep {
    /// Its length, s.
    #[must_use]
    pub fn dt(&self) -> f64 {
        self.dt
    }
}

/// Pose, twist, rotor speeds, and the state of the effects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantState {
    /// Pose and twist.
    pub robot: RobotState,
    /// Rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
    /// Wind, battery and the rotors' acceleration.
    pub effects: EffectsState,
}

/// What acts on the body from outside during a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loads {
    /// A wrench at the centre of mass: force W, torque R. Its torque turns with the body.
    pub external: Wrench,
    /// A wrench at the tool tip, W. It is constant in W, and its lever turns with the body.
    pub tool_w: Wrench,
}

impl PlantState {
    /// A state in calm air, with a full battery and rotors at constant speeds.
    #[must_use]
    pub fn new(robot: RobotState, rotor_speeds: RotorVector) -> Self {
        Self { robot, rotor_speeds, effects: EffectsState::default() }
    }
}

/// What changes the state at one time of a step, in the axes that the body has at the start of the step.
#[derive(Clone, Copy)]
struct Rates {
    /// Velocity, m/s, world.
    velocity_w: Vector3,
    /// Force of the rotors and the effects, N.
    force: Vector3,
    /// Rate of the rotation vector since the start, rad/s.
    turn: Vector3,
    /// Torque, N m.
    torque: Vector3,
}

impl Plant {
    /// The plant of a vehicle: rigid body and rotor lag, without effects.
    #[must_use]
    pub fn new(vehicle: Vehicle) -> Self {
        Self { vehicle, effects: Effects::OFF, bare: true }
    }

    /// The plant of a vehicle with effects.
    ///
    /// # Errors
    /// [`Error`], which names the parameter of an effect that is out of range.
    pub fn with_effects(vehicle: Vehicle, effects: Effects) -> Result<Self, Error> {
        effects.check()?;
        Ok(Self { vehicle, effects, bare: effects.are_off() })
    }

    /// The effects on the vehicle in addition to rotors and weight.
    #[must_use]
    pub fn effects(&self) -> &Effects {
        &self.effects
    }

    /// The vehicle.
    #[must_use]
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// A level hover at a position, with the rotors at their hover speeds.
    #[must_use]
    pub fn hover(&self, position_w: Vector3) -> PlantState {
        PlantState::new(RobotState::at_rest(position_w), self.vehicle.hover_speeds(&Matrix3::identity()))
    }

    /// A step of `dt` seconds for [`Self::step_by`].
    #[must_use]
    pub fn time_step(&self, dt: f64) -> TimeStep {
        let constant = self.vehicle.rotor_time_constant();
        let part =
            |dt: f64| if constant == 0.0 { 1.0 } else { crate::filters::lag_fraction(1.0 / constant, dt) };
        TimeStep { dt, half_lag: part(0.5 * dt), lag: part(dt) }
    }

    /// Moves by `dt` under commanded speeds (Hz) and an external wrench (force in W, torque in R about the centre of
    /// mass), both constant over the step.
    pub fn step(&self, state: &mut PlantState, command: &RotorVector, external: &Wrench, dt: f64) {
        self.step_under(state, command, &Loads { external: *external, tool_w: Wrench::ZERO }, dt);
    }

    /// [`Self::step`] with a wrench at the tool, too.
    pub fn step_under(&self, state: &mut PlantState, command: &RotorVector, loads: &Loads, dt: f64) {
        let mut rotors = self.vehicle.body_wrench(&state.rotor_speeds);
        self.step_by(&self.time_step(dt), state, &mut rotors, command, loads);
    }

    /// [`Self::step_under`] for many steps. `rotors` is the nominal wrench of the rotors ([`Vehicle::body_wrench`]) at the
    /// speeds of the state, before and after the step.
    pub fn step_by(
        &self,
        step: &TimeStep,
        state: &mut PlantState,
        rotors: &mut Wrench,
        command: &RotorVector,
        loads: &Loads,
    ) {
        let (start, dt) = (&state.robot, step.dt);
        let outer_w = loads.external.force + loads.tool_w.force;
        let tool_torque = self.tool_torque(&start.rotation_wr, &loads.tool_w);
        let (inertia, inverse) = (self.vehicle.inertia(), self.vehicle.inertia_inverse());
        let momentum = inertia * start.angular_velocity_r;
        let command = &self.effects.reached(&state.effects, command);
        let middle_speeds = self.lag(&state.rotor_speeds, command, step.half_lag);
        let acceleration = |speeds: &RotorVector| self.acceleration(&state.rotor_speeds, speeds, command, dt);
        let end_speeds = self.lag(&state.rotor_speeds, command, step.lag);
        let wind_w =
            if self.bare { Vector3::zeros() } else { self.effects.wind.velocity(&state.effects.wind) };
        let middle_wrench = self.vehicle.body_wrench(&middle_speeds);

        // A wrench of the rotors, with that of the effects.
        let with_effects = |nominal: Wrench, robot: &RobotState, speeds: &RotorVector| {
            let motion = Rotors { speeds: *speeds, accelerations: acceleration(speeds) };
            nominal + self.effects.wrench(&self.vehicle, robot, &motion, &wind_w)
        };
        // The rates after a time at constant rates.
        let after = |k: &Rates, h: f64, nominal: &Wrench, speeds: &RotorVector| -> Rates {
            let turn = h * k.turn;
            let rotation = so3::exp(&turn);
            let omega = inverse * (rotation.transpose() * (momentum + h * k.torque));
            let (mut wrench, mut velocity_w) = (*nominal, start.velocity_w);
            if !self.bare {
                velocity_w += h * self.acceleration_w(&start.rotation_wr, &k.force, &outer_w);
                let robot = RobotState {
                    position_w: start.position_w + h * k.velocity_w,
                    velocity_w,
                    rotation_wr: start.rotation_wr * rotation,
                    angular_velocity_r: omega,
                };
                wrench = with_effects(wrench, &robot, speeds);
            }
            let c = turn.cross(&omega);
            Rates {
                velocity_w,
                force: rotation * wrench.force,
                turn: omega + 0.5 * c + turn.cross(&c) * (1.0 / 12.0),
                torque: rotation * (wrench.torque + loads.external.torque) + tool_torque(&rotation),
            }
        };
        let mut wrench = *rotors;
        if !self.bare {
            wrench = with_effects(wrench, start, &state.rotor_speeds);
        }
        let k1 = Rates {
            velocity_w: start.velocity_w,
            force: wrench.force,
            turn: start.angular_velocity_r,
            torque: wrench.torque + loads.external.torque + tool_torque(&Matrix3::identity()),
        };
        let k2 = after(&k1, 0.5 * dt, &middle_wrench, &middle_speeds);
        let k3 = after(&k2, 0.5 * dt, &middle_wrench, &middle_speeds);
        *rotors = self.vehicle.body_wrench(&end_speeds);
        let k4 = after(&k3, dt, rotors, &end_speeds);
        let mean = |f: fn(&Rates) -> Vector3| (1.0 / 6.0) * (f(&k1) + 2.0 * (f(&k2) + f(&k3)) + f(&k4));

        let turned = so3::exp(&(dt * mean(|k| k.turn)));
        let momentum = momentum + dt * mean(|k| k.torque);
        // The velocities of the stages are those of their accelerations.
        let early = (1.0 / 3.0) * (k1.force + k2.force + k3.force);
        let early_w = self.acceleration_w(&start.rotation_wr, &early, &outer_w);
        let mean_w = self.acceleration_w(&start.rotation_wr, &mean(|k| k.force), &outer_w);
        state.robot = RobotState {
            position_w: start.position_w + dt * (start.velocity_w + 0.5 * dt * early_w),
            velocity_w: start.velocity_w + dt * mean_w,
            // The rounding errors are removed before they accumulate.
            rotation_wr: so3::unrounded(&(start.rotation_wr * turned)),
            angular_velocity_r: inverse * (turned.transpose() * momentum),
        };
        let accelerations = if self.bare { RotorVector::zeros() } else { acceleration(&end_speeds) };
        let end = Rotors { speeds: end_speeds, accelerations };
        state.rotor_speeds = end.speeds;
        self.effects.step(&mut state.effects, &state.robot, &end, dt);
    }

    /// Linear acceleration (m/s^2, W) and angular acceleration (rad/s^2, R) of the centre of mass.
    #[must_use]
    pub fn accelerations(&self, state: &PlantState, external: &Wrench) -> (Vector3, Vector3) {
        let actuation = self.actuation(state, &self.vehicle.body_wrench(&state.rotor_speeds));
        (
            self.acceleration_w(&state.robot.rotation_wr, &actuation.force, &external.force),
            self.angular_acceleration(state, &actuation, external),
        )
    }

    fn angular_acceleration(&self, state: &PlantState, actuation: &Wrench, external: &Wrench) -> Vector3 {
        let omega = state.robot.angular_velocity_r;
        let torque = actuation.torque + external.torque - omega.cross(&(self.vehicle.inertia() * omega));
        self.vehicle.inertia_inverse() * torque
    }

    /// The wrench of the rotors, of which `rotors` is nominal, and of the effects.
    fn actuation(&self, state: &PlantState, rotors: &Wrench) -> Wrench {
        if self.bare { *rotors } else { *rotors + self.effects_wrench(state) }
    }

    /// The wrench of the effects on the airframe: force and torque about the centre of mass, robot coordinates.
    #[must_use]
    pub fn effects_wrench(&self, state: &PlantState) -> Wrench {
        if self.bare {
            return Wrench::ZERO;
        }
        let rotors = Rotors { speeds: state.rotor_speeds, accelerations: state.effects.rotor_accelerations };
        let wind_w = self.effects.wind.velocity(&state.effects.wind);
        self.effects.wrench(&self.vehicle, &state.robot, &rotors, &wind_w)
    }

    /// The wrench at the centre of mass (force W, torque R) that is equal to a wrench at the tool in W.
    #[must_use]
    pub fn from_tool(&self, state: &PlantState, tool_w: &Wrench) -> Wrench {
        robot_wrench(tool_w, &state.robot.rotation_wr, &self.vehicle.tool().position_r)
    }

    /// Tool pose: tip position (m, W) and orientation (E to W).
    #[must_use]
    #[inline(always)]
    pub fn tool_pose(&self, state: &PlantState) -> (Vector3, Matrix3) {
        let (r, tool) = (&state.robot, self.vehicle.tool());
        (r.position_w + r.rotation_wr * tool.position_r, r.rotation_wr * tool.rotation_r)
    }

    /// Tool pose if a wrench (W) at the tip bends its rod.
    #[must_use]
    #[inline(always)]
    pub fn loaded_tool_pose(&self, state: &PlantState, tool_w: &Wrench) -> (Vector3, Matrix3) {
        if self.effects.rod.is_rigid() { self.tool_pose(state) } else { self.bent_tool_pose(state, tool_w) }
    }

    fn bent_tool_pose(&self, state: &PlantState, tool_w: &Wrench) -> (Vector3, Matrix3) {
        let (r, tool) = (&state.robot, self.vehicle.tool());
        let force_e = (r.rotation_wr * tool.rotation_r).transpose() * tool_w.force;
        let bent = self.effects.rod.bent(tool, &force_e);
        (r.position_w + r.rotation_wr * bent.position_r, r.rotation_wr * bent.rotation_r)
    }

    /// The values of a perfect IMU at its mounting.
    #[must_use]
    pub fn imu(&self, state: &PlantState, external: &Wrench) -> ImuSample {
        self.imu_by(state, &self.vehicle.body_wrench(&state.rotor_speeds), external).0
    }

    /// The values of a perfect IMU at its mounting, and the specific force at the centre of mass, m/s^2, robot coordinates.
    /// `rotors` is the nominal wrench of the rotors.
    #[must_use]
    pub fn imu_by(&self, state: &PlantState, rotors: &Wrench, external: &Wrench) -> (ImuSample, Vector3) {
        let (imu, robot) = (self.vehicle.imu(), &state.robot);
        let actuation = self.actuation(state, rotors);
        // Of all forces, those that are no weight.
        let external_r = robot.rotation_wr.transpose() * external.force;
        let at_centre_r = (actuation.force + external_r) / self.vehicle.mass();
        let (mut specific_force_r, omega) = (at_centre_r, robot.angular_velocity_r);
        if imu.position_r != Vector3::zeros() {
            let alpha = self.angular_acceleration(state, &actuation, external);
            specific_force_r += alpha.cross(&imu.position_r) + omega.cross(&omega.cross(&imu.position_r));
        }
        let to_imu = imu.rotation_r.transpose();
        let sample = ImuSample { gyro_i: to_imu * omega, specific_force_i: to_imu * specific_force_r };
        (sample, at_centre_r)
    }

    /// Kinetic energy, J.
    #[must_use]
    pub fn kinetic_energy(&self, state: &PlantState) -> f64 {
        let (v, w) = (state.robot.velocity_w, state.robot.angular_velocity_r);
        0.5 * (self.vehicle.mass() * v.norm_squared() + w.dot(&(self.vehicle.inertia() * w)))
    }

    /// Linear acceleration, m/s^2, W, by a force in axes of an orientation and one in W.
    fn acceleration_w(&self, rotation_w: &Matrix3, force: &Vector3, outer_w: &Vector3) -> Vector3 {
        (rotation_w * force + outer_w) / self.vehicle.mass() - Vector3::new(0.0, 0.0, GRAVITY)
    }

    /// The torque of a wrench at the tool (W) about the centre of mass, in the axes of an orientation, after a rotation of the
    /// body in these axes.
    fn tool_torque(&self, rotation_w: &Matrix3, tool_w: &Wrench) -> impl Fn(&Matrix3) -> Vector3 + use<> {
        let touched = *tool_w != Wrench::ZERO;
        let (force, torque) = (rotation_w.transpose() * tool_w.force, rotation_w.transpose() * tool_w.torque);
        let lever = self.vehicle.tool().position_r;
        move |turned| if touched { torque + (turned * lever).cross(&force) } else { Vector3::zeros() }
    }

    /// Acceleration of the rotors, Hz/s, at speeds that follow a command; without lag, the mean over the step.
    fn acceleration(
        &self,
        start: &RotorVector,
        speeds: &RotorVector,
        command: &RotorVector,
        dt: f64,
    ) -> RotorVector {
        let constant = self.vehicle.rotor_time_constant();
        if constant > 0.0 { (command - speeds) / constant } else { (command - start) / dt }
    }

    fn lag(&self, speeds: &RotorVector, command: &RotorVector, part: f64) -> RotorVector {
        if self.vehicle.rotor_time_constant() == 0.0 {
            return *command;
        }
        speeds + (command - speeds) * part
    }
}
