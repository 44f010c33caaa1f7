//! The simulated vehicle: a rigid body on SO(3) with rotor lag, and its sensors; (3)-(10).
//!
//! The integrator is a fourth-order Runge-Kutta-Munthe-Kaas method on
//! (position, velocity, rotation, angular momentum in W): the rotation stays
//! one, and without torque the angular momentum is constant to rounding.

use crate::{
    GRAVITY, Vehicle,
    random::Random,
    so3,
    types::{Matrix3, RobotState, RotorVector, Vector3, Wrench},
    wrench_observer::robot_wrench,
};

/// The rigid body and its rotors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant {
    vehicle: Vehicle,
}

/// Pose, twist and rotor speeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantState {
    /// Pose and twist.
    pub robot: RobotState,
    /// Rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
}

/// Rates of (position, velocity, turn since the start of the step, momentum).
#[derive(Clone, Copy)]
struct Rates {
    position: Vector3,
    velocity: Vector3,
    turn: Vector3,
    momentum: Vector3,
}

impl Plant {
    /// A plant for one vehicle.
    #[must_use]
    pub fn new(vehicle: Vehicle) -> Self {
        Self { vehicle }
    }

    /// The vehicle.
    #[must_use]
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// Level hover at a place, rotors at their hover speeds.
    #[must_use]
    pub fn hover(&self, position_w: Vector3) -> PlantState {
        PlantState {
            robot: RobotState::at_rest(position_w),
            rotor_speeds: self.vehicle.hover_speeds(&Matrix3::identity()),
        }
    }

    /// Moves on by `dt` under commanded speeds (Hz) and an external wrench
    /// (force in W, torque in R about the centre of mass), both held over the step.
    pub fn step(&self, state: &mut PlantState, command: &RotorVector, external: &Wrench, dt: f64) {
        let start = state.robot;
        let inertia = self.vehicle.inertia();
        let momentum_w = start.rotation_wr * (inertia * start.angular_velocity_r);
        let middle_speeds = self.lag(&state.rotor_speeds, command, 0.5 * dt);
        let end_speeds = self.lag(&state.rotor_speeds, command, dt);
        let actuation = |speeds: &RotorVector| self.vehicle.body_wrench(speeds);
        let (w0, w1, w2) =
            (actuation(&state.rotor_speeds), actuation(&middle_speeds), actuation(&end_speeds));

        let rates = |k: &Rates, h: f64, actuation: &Wrench| -> Rates {
            let turn = h * k.turn;
            let rotation = start.rotation_wr * so3::exp(&turn);
            let momentum = momentum_w + h * k.momentum;
            let omega = self.vehicle.inertia_inverse() * (rotation.transpose() * momentum);
            let c = turn.cross(&omega);
            Rates {
                position: start.velocity_w + h * k.velocity,
                velocity: self.acceleration_w(&rotation, actuation, external),
                turn: omega + 0.5 * c + turn.cross(&c) / 12.0,
                momentum: rotation * (actuation.torque + external.torque),
            }
        };
        let zero = Vector3::zeros();
        let none = Rates { position: zero, velocity: zero, turn: zero, momentum: zero };
        let k1 = rates(&none, 0.0, &w0);
        let k2 = rates(&k1, 0.5 * dt, &w1);
        let k3 = rates(&k2, 0.5 * dt, &w1);
        let k4 = rates(&k3, dt, &w2);
        let sum = |f: fn(&Rates) -> Vector3| dt / 6.0 * (f(&k1) + 2.0 * (f(&k2) + f(&k3)) + f(&k4));

        let turned = start.rotation_wr * so3::exp(&sum(|k| k.turn));
        // One Newton step takes off what rounding adds up to.
        let rotation_wr = turned * (1.5 * Matrix3::identity() - 0.5 * turned.transpose() * turned);
        let momentum = momentum_w + sum(|k| k.momentum);
        state.robot = RobotState {
            position_w: start.position_w + sum(|k| k.position),
            velocity_w: start.velocity_w + sum(|k| k.velocity),
            rotation_wr,
            angular_velocity_r: self.vehicle.inertia_inverse() * (rotation_wr.transpose() * momentum),
        };
        state.rotor_speeds = end_speeds;
    }

    /// Linear acceleration (m/s^2, W) and angular acceleration (rad/s^2, R) of the centre of mass.
    #[must_use]
    pub fn accelerations(&self, state: &PlantState, external: &Wrench) -> (Vector3, Vector3) {
        let actuation = self.vehicle.body_wrench(&state.rotor_speeds);
        let omega = state.robot.angular_velocity_r;
        let inertia = self.vehicle.inertia();
        let torque = actuation.torque + external.torque - omega.cross(&(inertia * omega));
        (
            self.acceleration_w(&state.robot.rotation_wr, &actuation, external),
            self.vehicle.inertia_inverse() * torque,
        )
    }

    /// The wrench at the centre of mass (force W, torque R) of a tool wrench in W.
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

    /// What a perfect IMU says at its mounting.
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

    fn lag(&self, speeds: &RotorVector, command: &RotorVector, dt: f64) -> RotorVector {
        let constant = self.vehicle.rotor_time_constant();
        if constant == 0.0 {
            return *command;
        }
        speeds + (command - speeds) * crate::filters::lag_fraction(1.0 / constant, dt)
    }
}

/// Standard deviations of the sensors' noise, and the IMU's constant biases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorParams {
    /// Captured position, m.
    pub position: f64,
    /// Captured orientation, rad.
    pub orientation: f64,
    /// Gyroscope, rad/s a sample.
    pub gyro: f64,
    /// Accelerometer, m/s^2 a sample.
    pub accelerometer: f64,
    /// Rotor speed, Hz.
    pub rotor_speed: f64,
    /// Constant gyroscope bias, rad/s, IMU axes.
    pub gyro_bias_i: Vector3,
    /// Constant accelerometer bias, m/s^2, IMU axes.
    pub accelerometer_bias_i: Vector3,
}

impl SensorParams {
    /// No noise and no bias.
    pub const IDEAL: Self = Self {
        position: 0.0,
        orientation: 0.0,
        gyro: 0.0,
        accelerometer: 0.0,
        rotor_speed: 0.0,
        gyro_bias_i: Vector3::new(0.0, 0.0, 0.0),
        accelerometer_bias_i: Vector3::new(0.0, 0.0, 0.0),
    };

    /// The noise that the experiments are judged with.
    pub const EXPERIMENTS: Self = Self {
        position: 0.3e-3,
        orientation: 2e-3,
        gyro: 5e-3,
        accelerometer: 0.15,
        rotor_speed: 0.1,
        ..Self::IDEAL
    };
}

/// An inertial sample, IMU axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Angular velocity, rad/s.
    pub gyro_i: Vector3,
    /// Specific force, m/s^2.
    pub specific_force_i: Vector3,
}

/// The sensors, with a noise of their own for every seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensors {
    params: SensorParams,
    random: Random,
}

impl Sensors {
    /// Sensors whose noise is the same for the same seed.
    #[must_use]
    pub fn new(params: SensorParams, seed: u64) -> Self {
        Self { params, random: Random::new(seed) }
    }

    /// What the IMU says where a perfect one says `truth`.
    pub fn imu(&mut self, truth: &ImuSample) -> ImuSample {
        let p = &self.params;
        ImuSample {
            gyro_i: truth.gyro_i + p.gyro_bias_i + self.random.normal3(p.gyro),
            specific_force_i: truth.specific_force_i
                + p.accelerometer_bias_i
                + self.random.normal3(p.accelerometer),
        }
    }

    /// The captured pose of the robot: position (m, W), rotation (R to W).
    pub fn pose(&mut self, state: &PlantState) -> (Vector3, Matrix3) {
        let turn = self.random.normal3(self.params.orientation);
        (
            state.robot.position_w + self.random.normal3(self.params.position),
            state.robot.rotation_wr * so3::exp(&turn),
        )
    }

    /// Measured rotor speeds, Hz.
    pub fn rotor_speeds(&mut self, plant: &Plant, state: &PlantState) -> RotorVector {
        let mut measured = state.rotor_speeds;
        for i in 0..plant.vehicle().rotor_count() {
            measured[i] += self.params.rotor_speed * self.random.normal();
        }
        measured
    }
}
