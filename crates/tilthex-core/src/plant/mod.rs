//! The simulated vehicle: a rigid body on SO(3) with rotor lag, other effects on a real vehicle, and its sensors;
//! (3)-(10).
//!
//! [`Effects`] holds the effects that the model of the controller leaves out. Each has a module, and each is off by
//! default.
//!
//! The integrator is a fourth-order Runge-Kutta-Munthe-Kaas method on (position, velocity, rotation, angular momentum
//! in W). The rotation stays a rotation, and without torque the angular momentum is constant to rounding.

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

impl PlantState {
    /// A state in calm air, with a full battery and rotors at constant speeds.
    #[must_use]
    pub fn new(robot: RobotState, rotor_speeds: RotorVector) -> Self {
        Self { robot, rotor_speeds, effects: EffectsState::default() }
    }
}

/// Rates of change of (position, velocity, rotation since the start of the step, momentum).
#[derive(Clone, Copy)]
struct Rates {
    position: Vector3,
    velocity: Vector3,
    turn: Vector3,
    momentum: Vector3,
}

impl Plant {
    /// The plant of a vehicle: rigid body and rotor lag, without effects.
    #[must_use]
    pub fn new(vehicle: Vehicle) -> Self {
        Self { vehicle, effects: Effects::OFF }
    }

    /// The plant of a vehicle with effects.
    ///
    /// # Errors
    /// [`Error`], which names the parameter of an effect that is out of range.
    pub fn with_effects(vehicle: Vehicle, effects: Effects) -> Result<Self, Error> {
        effects.check()?;
        Ok(Self { vehicle, effects })
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

    /// Moves by `dt` under commanded speeds (Hz) and an external wrench (force in W, torque in R about the centre of
    /// mass), both constant over the step.
    pub fn step(&self, state: &mut PlantState, command: &RotorVector, external: &Wrench, dt: f64) {
        let start = state.robot;
        let inertia = self.vehicle.inertia();
        let momentum_w = start.rotation_wr * (inertia * start.angular_velocity_r);
        let command = &self.effects.reached(&state.effects, command);
        let middle_speeds = self.lag(&state.rotor_speeds, command, 0.5 * dt);
        let end_speeds = self.lag(&state.rotor_speeds, command, dt);
        let rotors = |speeds: &RotorVector| Rotors {
            speeds: *speeds,
            accelerations: self.acceleration(&state.rotor_speeds, speeds, command, dt),
        };
        let (start_rotors, middle, end) =
            (rotors(&state.rotor_speeds), rotors(&middle_speeds), rotors(&end_speeds));
        let actuation = |rotors: &Rotors| self.vehicle.body_wrench(&rotors.speeds);
        let (w0, w1, w2) = (actuation(&start_rotors), actuation(&middle), actuation(&end));
        let wind_w = self.effects.wind.velocity(&state.effects.wind);

        let rates = |k: &Rates, h: f64, actuation: &Wrench, rotors: &Rotors| -> Rates {
            let turn = h * k.turn;
            let rotation = start.rotation_wr * so3::exp(&turn);
            let momentum = momentum_w + h * k.momentum;
            let omega = self.vehicle.inertia_inverse() * (rotation.transpose() * momentum);
            let c = turn.cross(&omega);
            let velocity_w = start.velocity_w + h * k.velocity;
            let mut actuation = *actuation;
            if !self.effects.are_off() {
                let position_w = start.position_w + h * k.position;
                let robot =
                    RobotState { position_w, velocity_w, rotation_wr: rotation, angular_velocity_r: omega };
                actuation = actuation + self.effects.wrench(&self.vehicle, &robot, rotors, &wind_w);
            }
            Rates {
                position: velocity_w,
                velocity: self.acceleration_w(&rotation, &actuation, external),
                turn: omega + 0.5 * c + turn.cross(&c) / 12.0,
                momentum: rotation * (actuation.torque + external.torque),
            }
        };
        let zero = Vector3::zeros();
        let none = Rates { position: zero, velocity: zero, turn: zero, momentum: zero };
        let k1 = rates(&none, 0.0, &w0, &start_rotors);
        let k2 = rates(&k1, 0.5 * dt, &w1, &middle);
        let k3 = rates(&k2, 0.5 * dt, &w1, &middle);
        let k4 = rates(&k3, dt, &w2, &end);
        let sum = |f: fn(&Rates) -> Vector3| dt / 6.0 * (f(&k1) + 2.0 * (f(&k2) + f(&k3)) + f(&k4));

        // The rounding errors are removed before they accumulate.
        let rotation_wr = so3::unrounded(&(start.rotation_wr * so3::exp(&sum(|k| k.turn))));
        let momentum = momentum_w + sum(|k| k.momentum);
        state.robot = RobotState {
            position_w: start.position_w + sum(|k| k.position),
            velocity_w: start.velocity_w + sum(|k| k.velocity),
            rotation_wr,
            angular_velocity_r: self.vehicle.inertia_inverse() * (rotation_wr.transpose() * momentum),
        };
        state.rotor_speeds = end_speeds;
        self.effects.step(&mut state.effects, &state.robot, &end, dt);
    }

    /// Linear acceleration (m/s^2, W) and angular acceleration (rad/s^2, R) of the centre of mass.
    #[must_use]
    pub fn accelerations(&self, state: &PlantState, external: &Wrench) -> (Vector3, Vector3) {
        let actuation = self.vehicle.body_wrench(&state.rotor_speeds) + self.effects_wrench(state);
        let omega = state.robot.angular_velocity_r;
        let inertia = self.vehicle.inertia();
        let torque = actuation.torque + external.torque - omega.cross(&(inertia * omega));
        (
            self.acceleration_w(&state.robot.rotation_wr, &actuation, external),
            self.vehicle.inertia_inverse() * torque,
        )
    }

    /// The wrench of the effects on the airframe: force and torque about the centre of mass, robot coordinates.
    #[must_use]
    pub fn effects_wrench(&self, state: &PlantState) -> Wrench {
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
    pub fn tool_pose(&self, state: &PlantState) -> (Vector3, Matrix3) {
        let (r, tool) = (&state.robot, self.vehicle.tool());
        (r.position_w + r.rotation_wr * tool.position_r, r.rotation_wr * tool.rotation_r)
    }

    /// Tool pose if a wrench (W) at the tip bends its rod.
    #[must_use]
    pub fn loaded_tool_pose(&self, state: &PlantState, tool_w: &Wrench) -> (Vector3, Matrix3) {
        let (r, tool) = (&state.robot, self.vehicle.tool());
        let force_e = (r.rotation_wr * tool.rotation_r).transpose() * tool_w.force;
        let bent = self.effects.rod.bent(tool, &force_e);
        (r.position_w + r.rotation_wr * bent.position_r, r.rotation_wr * bent.rotation_r)
    }

    /// The values of a perfect IMU at its mounting.
    #[must_use]
    pub fn imu(&self, state: &PlantState, external: &Wrench) -> ImuSample {
        let imu = self.vehicle.imu();
        let (acceleration_w, alpha_r) = self.accelerations(state, external);
        let omega = state.robot.angular_velocity_r;
        let free_w = acceleration_w + Vector3::new(0.0, 0.0, GRAVITY);
        let specific_force_r = state.robot.rotation_wr.transpose() * free_w
            + alpha_r.cross(&imu.position_r)
            + omega.cross(&omega.cross(&imu.position_r));
        let to_imu = imu.rotation_r.transpose();
        ImuSample { gyro_i: to_imu * omega, specific_force_i: to_imu * specific_force_r }
    }

    /// Kinetic energy, J.
    #[must_use]
    pub fn kinetic_energy(&self, state: &PlantState) -> f64 {
        let (v, w) = (state.robot.velocity_w, state.robot.angular_velocity_r);
        0.5 * (self.vehicle.mass() * v.norm_squared() + w.dot(&(self.vehicle.inertia() * w)))
    }

    fn acceleration_w(&self, rotation_wr: &Matrix3, actuation: &Wrench, external: &Wrench) -> Vector3 {
        (rotation_wr * actuation.force + external.force) / self.vehicle.mass()
            - Vector3::new(0.0, 0.0, GRAVITY)
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

    fn lag(&self, speeds: &RotorVector, command: &RotorVector, dt: f64) -> RotorVector {
        let constant = self.vehicle.rotor_time_constant();
        if constant == 0.0 {
            return *command;
        }
        speeds + (command - speeds) * crate::filters::lag_fraction(1.0 / constant, dt)
    }
}
