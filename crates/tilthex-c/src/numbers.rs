//! The quantities that pass between blocks, as plain numbers. Matrices are `[row][column]`.

use crate::{TILTHEX_MAX_ROTORS, status::TilthexStatus};
use tilthex_core::{
    Matrix3, Matrix6, RobotState, Setpoint, Vector3, Wrench, controller::ControllerParams,
    force_axes::ForceAxes, so3,
};

/// Rows as a matrix.
pub(crate) fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3 {
    Matrix3::from(*rows).transpose()
}

/// A matrix as rows.
pub(crate) fn rows(matrix: &Matrix3) -> [[f64; 3]; 3] {
    matrix.transpose().into()
}

/// Rows as a matrix of 6x6.
pub(crate) fn matrix6(rows: &[[f64; 6]; 6]) -> Matrix6 {
    Matrix6::from(*rows).transpose()
}

/// Refuses a condition that does not hold.
pub(crate) fn require(holds: bool, status: TilthexStatus) -> Result<(), TilthexStatus> {
    if holds { Ok(()) } else { Err(status) }
}

/// Refuses a time of a step that is not from 0 to 1 s.
pub(crate) fn check_period(dt: f64) -> Result<(), TilthexStatus> {
    require((0.0..=1.0).contains(&dt), TilthexStatus::Period)
}

/// A rotation from its rows.
pub(crate) fn rotation(rows: &[[f64; 3]; 3]) -> Result<Matrix3, TilthexStatus> {
    let found = matrix(rows);
    require(found.iter().all(|x| x.is_finite()), TilthexStatus::NotFinite)?;
    so3::check_rotation("rotation", &found).map_err(|_| TilthexStatus::NotRotation)?;
    Ok(found)
}

/// Speeds of which all are finite.
pub(crate) fn speeds(speeds: &[f64; TILTHEX_MAX_ROTORS]) -> Result<tilthex_core::RotorVector, TilthexStatus> {
    require(speeds.iter().all(|x| x.is_finite()), TilthexStatus::NotFinite)?;
    Ok((*speeds).into())
}

/// A force and a torque. The field or the argument that holds it says the coordinates and the point of the torque.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexWrench {
    /// Force, N.
    pub force: [f64; 3],
    /// Torque, N m.
    pub torque: [f64; 3],
}

impl From<Wrench> for TilthexWrench {
    fn from(w: Wrench) -> Self {
        Self { force: w.force.into(), torque: w.torque.into() }
    }
}

impl TilthexWrench {
    pub(crate) fn wrench(&self) -> Result<Wrench, TilthexStatus> {
        let wrench = Wrench { force: self.force.into(), torque: self.torque.into() };
        require(wrench.is_finite(), TilthexStatus::NotFinite)?;
        Ok(wrench)
    }
}

/// What is measured of the robot: the output of estimator and plant, and the input of observer and controller.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexMeasured {
    /// Position of the centre of mass, m, world.
    pub position_w: [f64; 3],
    /// Its velocity, m/s, world.
    pub velocity_w: [f64; 3],
    /// Orientation: maps robot coordinates to world coordinates.
    pub rotation_wr: [[f64; 3]; 3],
    /// Angular velocity, rad/s, robot coordinates.
    pub angular_velocity_r: [f64; 3],
    /// Specific force (acceleration minus gravity) at the centre of mass, m/s^2, robot coordinates.
    pub specific_force_r: [f64; 3],
    /// Rotor speeds, Hz; those after the vehicle's count are zero. The estimator leaves them as they are.
    pub rotor_speeds: [f64; TILTHEX_MAX_ROTORS],
}

impl TilthexMeasured {
    pub(crate) fn robot(&self) -> Result<RobotState, TilthexStatus> {
        let state = RobotState {
            position_w: self.position_w.into(),
            velocity_w: self.velocity_w.into(),
            rotation_wr: rotation(&self.rotation_wr)?,
            angular_velocity_r: self.angular_velocity_r.into(),
        };
        require(state.is_finite(), TilthexStatus::NotFinite)?;
        Ok(state)
    }

    pub(crate) fn specific_force(&self) -> Result<Vector3, TilthexStatus> {
        let force_r = Vector3::from(self.specific_force_r);
        require(force_r.iter().all(|x| x.is_finite()), TilthexStatus::NotFinite)?;
        Ok(force_r)
    }

    pub(crate) fn set(&mut self, robot: &RobotState, specific_force_r: &Vector3) {
        self.position_w = robot.position_w.into();
        self.velocity_w = robot.velocity_w.into();
        self.rotation_wr = rows(&robot.rotation_wr);
        self.angular_velocity_r = robot.angular_velocity_r.into();
        self.specific_force_r = (*specific_force_r).into();
    }
}

/// A pose of the tool with its motion, and the wrench that the tool exerts: a set-point, or the reference that has
/// yielded from it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexSetpoint {
    /// Position of the tool tip, m, world.
    pub position_w: [f64; 3],
    /// Orientation of the tool: maps tool coordinates to world coordinates.
    pub rotation_we: [[f64; 3]; 3],
    /// Velocity of the tool tip, m/s, world.
    pub velocity_w: [f64; 3],
    /// Angular velocity, rad/s, world.
    pub angular_velocity_w: [f64; 3],
    /// Acceleration of the tool tip, m/s^2, world.
    pub acceleration_w: [f64; 3],
    /// Angular acceleration, rad/s^2, world.
    pub angular_acceleration_w: [f64; 3],
    /// Wrench that the tool exerts on the environment, world, about the tool tip.
    pub wrench_w: TilthexWrench,
    /// Bits 0 to 5: along x, y, z or about x, y, z of the tool, this wrench is controlled instead of the pose.
    pub force_axes: u32,
}

impl From<&Setpoint> for TilthexSetpoint {
    fn from(s: &Setpoint) -> Self {
        let chosen = s.force_axes.force.into_iter().chain(s.force_axes.torque);
        Self {
            position_w: s.position_w.into(),
            rotation_we: rows(&s.rotation_we),
            velocity_w: s.velocity_w.into(),
            angular_velocity_w: s.angular_velocity_w.into(),
            acceleration_w: s.acceleration_w.into(),
            angular_acceleration_w: s.angular_acceleration_w.into(),
            wrench_w: s.wrench_w.into(),
            force_axes: chosen.enumerate().map(|(bit, on)| u32::from(on) << bit).sum(),
        }
    }
}

impl TilthexSetpoint {
    pub(crate) fn setpoint(&self) -> Result<Setpoint, TilthexStatus> {
        let bit = |i: u32| self.force_axes & (1 << i) != 0;
        let setpoint = Setpoint {
            position_w: self.position_w.into(),
            rotation_we: rotation(&self.rotation_we)?,
            velocity_w: self.velocity_w.into(),
            angular_velocity_w: self.angular_velocity_w.into(),
            acceleration_w: self.acceleration_w.into(),
            angular_acceleration_w: self.angular_acceleration_w.into(),
            wrench_w: self.wrench_w.wrench()?,
            force_axes: ForceAxes {
                force: [bit(0), bit(1), bit(2)],
                torque: [bit(3), bit(4), bit(5)],
                surface_ws: None,
            },
        };
        require(setpoint.is_finite(), TilthexStatus::NotFinite)?;
        Ok(setpoint)
    }
}

/// Gains of the wrench observer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexObserverGains {
    /// Rate at which the force estimate follows, 1/s, world axes.
    pub force: [f64; 3],
    /// Rate at which the torque estimate follows, 1/s, robot axes.
    pub torque: [f64; 3],
}

/// Mass, damping and stiffness at the tool, translation before rotation, and limits.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexAdmittanceParams {
    /// 0: the axes of the matrices are those of the world; otherwise those of the tool at its set-point.
    pub tool_axes: u32,
    /// kg and kg m^2; positive definite.
    pub mass: [[f64; 6]; 6],
    /// N s/m and N m s/rad; positive semi-definite.
    pub damping: [[f64; 6]; 6],
    /// N/m and N m/rad; positive semi-definite.
    pub stiffness: [[f64; 6]; 6],
    /// Largest distance of the reference from the set-point, m.
    pub max_translation: f64,
    /// Largest rotation of the reference from the set-point, rad; below pi.
    pub max_rotation: f64,
}

/// Parameters of the controller. Those of the core that are not here have their defaults.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexControllerParams {
    /// Gain on the position error, 1/s^2, world axes.
    pub position_gain: [f64; 3],
    /// Gain on the velocity error, 1/s, world axes.
    pub velocity_gain: [f64; 3],
    /// Gain on the rotation error, 1/s^2, robot axes.
    pub rotation_gain: [f64; 3],
    /// Gain on the angular velocity error, 1/s, robot axes.
    pub angular_velocity_gain: [f64; 3],
    /// The wrench observer.
    pub observer: TilthexObserverGains,
    /// The admittance filter.
    pub admittance: TilthexAdmittanceParams,
    /// Tool forces up to this norm, N, do not move the reference.
    pub force_dead_zone: f64,
    /// Tool torques up to this norm, N m, do not turn the reference.
    pub torque_dead_zone: f64,
    /// Cut-off of the low-pass before the dead zones, Hz; 0 for none.
    pub low_pass_hz: f64,
    /// Speeds are limited to those that the rotors can reach within this time, s; 0 for no such limit.
    pub horizon: f64,
}

impl From<&ControllerParams> for TilthexControllerParams {
    fn from(p: &ControllerParams) -> Self {
        let rows = |m: &Matrix6| m.transpose().into();
        let admittance = &p.admittance;
        Self {
            position_gain: p.pose.position.into(),
            velocity_gain: p.pose.velocity.into(),
            rotation_gain: p.pose.rotation.into(),
            angular_velocity_gain: p.pose.angular_velocity.into(),
            observer: TilthexObserverGains {
                force: p.observer.force.into(),
                torque: p.observer.torque.into(),
            },
            admittance: TilthexAdmittanceParams {
                tool_axes: u32::from(admittance.axes == tilthex_core::admittance::Axes::Tool),
                mass: rows(&admittance.mass),
                damping: rows(&admittance.damping),
                stiffness: rows(&admittance.stiffness),
                max_translation: admittance.max_translation,
                max_rotation: admittance.max_rotation,
            },
            force_dead_zone: p.force_dead_zone,
            torque_dead_zone: p.torque_dead_zone,
            low_pass_hz: p.low_pass_hz,
            horizon: p.allocation.horizon,
        }
    }
}
