//! The quantities that pass between blocks, each with its frame and unit.

use crate::force_axes::ForceAxes;

/// Largest number of rotors. The entries of rotor vectors after the vehicle's own count are zero.
pub const MAX_ROTORS: usize = 12;

/// A time of the host's monotonic clock, ns.
pub type Nanos = u64;
/// A 3-vector of `f64`.
pub type Vector3 = nalgebra::Vector3<f64>;
/// A 3x3 matrix of `f64`.
pub type Matrix3 = nalgebra::Matrix3<f64>;
/// Six numbers: a wrench (force, torque), a twist (linear, angular) or a diagonal.
pub type Vector6 = nalgebra::Vector6<f64>;
/// A 6x6 matrix of `f64`.
pub type Matrix6 = nalgebra::Matrix6<f64>;
/// One number for each rotor: speeds in Hz, or inputs `u = w |w|` in Hz^2.
pub type RotorVector = nalgebra::SVector<f64, MAX_ROTORS>;

/// A force, N, and a torque, N m. The frame and the point of the torque are
/// those of the field that holds it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Force, N.
    pub force: Vector3,
    /// Torque, N m.
    pub torque: Vector3,
}

impl Wrench {
    /// No force and no torque.
    pub const ZERO: Self = Self { force: Vector3::new(0.0, 0.0, 0.0), torque: Vector3::new(0.0, 0.0, 0.0) };

    /// The wrench `[force; torque]`.
    #[must_use]
    pub fn from_vector(w: &Vector6) -> Self {
        Self { force: w.fixed_rows::<3>(0).into_owned(), torque: w.fixed_rows::<3>(3).into_owned() }
    }

    /// `[force; torque]`.
    #[must_use]
    pub fn to_vector(self) -> Vector6 {
        let (f, t) = (self.force, self.torque);
        Vector6::new(f.x, f.y, f.z, t.x, t.y, t.z)
    }

    /// Whether every component is a finite number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        is_finite3(&self.force) && is_finite3(&self.torque)
    }
}

impl core::ops::Add for Wrench {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { force: self.force + other.force, torque: self.torque + other.torque }
    }
}

impl core::ops::Sub for Wrench {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { force: self.force - other.force, torque: self.torque - other.torque }
    }
}

/// Pose and twist of the robot (its centre of mass).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobotState {
    /// Position of the centre of mass, m, world.
    pub position_w: Vector3,
    /// Its velocity, m/s, world.
    pub velocity_w: Vector3,
    /// Orientation: maps robot coordinates to world coordinates.
    pub rotation_wr: Matrix3,
    /// Angular velocity, rad/s, robot coordinates.
    pub angular_velocity_r: Vector3,
}

impl RobotState {
    /// At rest at a position, level.
    #[must_use]
    pub fn at_rest(position_w: Vector3) -> Self {
        Self {
            position_w,
            velocity_w: Vector3::zeros(),
            rotation_wr: Matrix3::identity(),
            angular_velocity_r: Vector3::zeros(),
        }
    }

    /// Whether every component is a finite number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        is_finite3(&self.position_w)
            && is_finite3(&self.velocity_w)
            && is_finite33(&self.rotation_wr)
            && is_finite3(&self.angular_velocity_r)
    }
}

/// The commanded set-point of the tool: the desired pose, twist and acceleration of the tool frame (all linear and
/// angular rates in world coordinates), and the wrench that the tool must exert on the environment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint {
    /// Position of the tool tip, m, world.
    pub position_w: Vector3,
    /// Orientation of the tool: maps tool coordinates to world coordinates.
    pub rotation_we: Matrix3,
    /// Velocity of the tool tip, m/s, world.
    pub velocity_w: Vector3,
    /// Angular velocity, rad/s, world.
    pub angular_velocity_w: Vector3,
    /// Acceleration of the tool tip, m/s^2, world.
    pub acceleration_w: Vector3,
    /// Angular acceleration, rad/s^2, world.
    pub angular_acceleration_w: Vector3,
    /// Wrench that the tool must exert on the environment, world, about the tool tip.
    pub wrench_w: Wrench,
    /// Along which axes that wrench is controlled instead of the pose.
    pub force_axes: ForceAxes,
}

impl Setpoint {
    /// Hold a tool pose at rest.
    #[must_use]
    pub fn hold(position_w: Vector3, rotation_we: Matrix3) -> Self {
        Self {
            position_w,
            rotation_we,
            velocity_w: Vector3::zeros(),
            angular_velocity_w: Vector3::zeros(),
            acceleration_w: Vector3::zeros(),
            angular_acceleration_w: Vector3::zeros(),
            wrench_w: Wrench::ZERO,
            force_axes: ForceAxes::NONE,
        }
    }

    /// Whether every component is a finite number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        is_finite3(&self.position_w)
            && is_finite33(&self.rotation_we)
            && is_finite3(&self.velocity_w)
            && is_finite3(&self.angular_velocity_w)
            && is_finite3(&self.acceleration_w)
            && is_finite3(&self.angular_acceleration_w)
            && self.wrench_w.is_finite()
    }
}

/// The reference of the centre of mass: the input of the pose
/// controller. Angular quantities are in the *reference's* body frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// Position of the centre of mass, m, world.
    pub position_w: Vector3,
    /// Orientation: maps (reference) robot coordinates to world coordinates.
    pub rotation_wr: Matrix3,
    /// Velocity, m/s, world.
    pub velocity_w: Vector3,
    /// Angular velocity, rad/s, reference body coordinates.
    pub angular_velocity_r: Vector3,
    /// Acceleration, m/s^2, world.
    pub acceleration_w: Vector3,
    /// Angular acceleration, rad/s^2, reference body coordinates.
    pub angular_acceleration_r: Vector3,
}

impl Reference {
    /// Hold a pose of the centre of mass at rest.
    #[must_use]
    pub fn hold(position_w: Vector3, rotation_wr: Matrix3) -> Self {
        Self {
            position_w,
            rotation_wr,
            velocity_w: Vector3::zeros(),
            angular_velocity_r: Vector3::zeros(),
            acceleration_w: Vector3::zeros(),
            angular_acceleration_r: Vector3::zeros(),
        }
    }
}

/// Whether the nine entries are finite numbers.
pub(crate) fn is_finite33(m: &Matrix3) -> bool {
    m.as_slice().iter().all(|x| x.is_finite())
}

/// Whether the three components are finite numbers.
#[must_use]
pub fn is_finite3(v: &Vector3) -> bool {
    v.x.is_finite() && v.y.is_finite() && v.z.is_finite()
}

/// One captured pose, on the host's monotonic clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSample {
    /// When it was taken, s.
    pub time: f64,
    /// When it arrived, s.
    pub arrival: f64,
    /// Position of the captured body, m, world.
    pub position_w: Vector3,
    /// Orientation of the captured body: maps its coordinates to world coordinates.
    pub rotation_wr: Matrix3,
    /// Whether the capture system marks it as valid.
    pub tracking_valid: bool,
}

impl PoseSample {
    /// Whether every component is a finite number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.time.is_finite()
            && self.arrival.is_finite()
            && is_finite3(&self.position_w)
            && is_finite33(&self.rotation_wr)
    }
}
