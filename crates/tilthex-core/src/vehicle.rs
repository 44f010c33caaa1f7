//! The vehicle: mass, rotors, tool and IMU, and the allocation matrix; (3)-(10).

mod corrected;
mod products;
mod rotor;

use crate::{
    Error,
    error::check_range,
    so3,
    types::{MAX_ROTORS, Matrix3, RotorVector, Vector3},
};
pub use corrected::Correction;
use nalgebra::SMatrix;
pub use products::{inputs, speeds};
pub(crate) use products::{inputs_for, speeds_of, wrench_of};
pub use rotor::{Rotor, TiltedHexarotor};
use rotor::{check_rotor, column};

/// Maps rotor inputs to the body wrench `[force_r; torque_r]`; zero columns past the rotor count.
pub type Allocation = SMatrix<f64, 6, MAX_ROTORS>;
/// Maps a body wrench to rotor inputs; zero rows past the rotor count.
pub type AllocationInverse = SMatrix<f64, MAX_ROTORS, 6>;

/// A pose that is fixed on the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mounting {
    /// Its origin from the centre of mass, m, robot coordinates.
    pub position_r: Vector3,
    /// Its orientation: maps its own coordinates to robot coordinates.
    pub rotation_r: Matrix3,
}

impl Default for Mounting {
    fn default() -> Self {
        Self { position_r: Vector3::zeros(), rotation_r: Matrix3::identity() }
    }
}

/// What a vehicle can track independently. Every vehicle has three torques, so that the rank of the allocation matrix
/// says in how many directions it has force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Actuation {
    /// Rank 6: position and orientation.
    Pose,
    /// Rank 5: position, heading, and the tilt about one axis.
    PositionAndPartOfAttitude,
    /// Rank 4: position and heading; the tilt follows from the force that is needed.
    PositionAndHeading,
}

impl Actuation {
    /// The name of what can be tracked.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pose => "position and attitude",
            Self::PositionAndPartOfAttitude => "position, heading and the tilt about one axis",
            Self::PositionAndHeading => "position and heading",
        }
    }
}

/// A validated vehicle. Fields are read, never written: build a new one instead.
///
/// ```
/// use tilthex_core::{Matrix3, examples, vehicle::Actuation};
///
/// let vehicle = examples::tilt_hex()?;
/// assert_eq!((vehicle.rotor_count(), vehicle.rank()), (6, 6));
/// assert_eq!(vehicle.actuation(), Actuation::Pose);
/// // The six rotors carry the weight, each with the same speed.
/// let hover = vehicle.hover_speeds(&Matrix3::identity());
/// let lift = vehicle.body_wrench(&hover).force.z;
/// assert!((lift - vehicle.weight()).abs() < 1e-9);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vehicle {
    mass: f64,
    inertia: Matrix3,
    inertia_inverse: Matrix3,
    rotors: [Rotor; MAX_ROTORS],
    rotor_count: usize,
    rotor_time_constant: f64,
    tool: Mounting,
    imu: Mounting,
    allocation: Allocation,
    allocation_inverse: AllocationInverse,
    rank: usize,
    condition: f64,
}

/// Singular values below this part of the largest count as zero.
const RANK_TOLERANCE: f64 = 1e-9;

impl Vehicle {
    /// Checks and combines the parts of a vehicle.
    ///
    /// `inertia` is about the centre of mass, kg m^2, robot coordinates;
    /// `rotor_time_constant` is that of the speed's first-order lag, s.
    ///
    /// # Errors
    /// Names the parameter or the rotor with an impossible value. A vehicle needs all
    /// three torques and a force besides; what it tracks is its [`Actuation`].
    pub fn new(
        mass: f64,
        inertia: Matrix3,
        rotors: &[Rotor],
        rotor_time_constant: f64,
        tool: Mounting,
        imu: Mounting,
    ) -> Result<Self, Error> {
        check_range("mass", mass, 1e-3, 1e3)?;
        check_range("rotor_time_constant", rotor_time_constant, 0.0, 1.0)?;
        let inertia_inverse = check_inertia(&inertia)?;
        check_mounting("tool_position", "tool_rotation", &tool)?;
        check_mounting("imu_position", "imu_rotation", &imu)?;
        if !(1..=MAX_ROTORS).contains(&rotors.len()) {
            return Err(Error::Count { name: "rotors", found: rotors.len(), min: 1, max: MAX_ROTORS });
        }
        let mut allocation = Allocation::zeros();
        let mut padded = [rotors[0]; MAX_ROTORS];
        for (i, rotor) in rotors.iter().enumerate() {
            check_rotor(i + 1, rotor)?;
            padded[i] = *rotor;
            allocation.set_column(i, &column(rotor));
        }
        let (rank, condition, allocation_inverse) = pseudo_inverse(&allocation);
        let mut torques = allocation;
        torques.rows_mut(0, 3).fill(0.0);
        let (torque_rank, ..) = pseudo_inverse(&torques);
        if rank < 4 || torque_rank < 3 {
            let rotor = redundant_rotor(&allocation, rotors.len(), rank);
            return Err(Error::NotControllable { rank, torque_rank, condition, rotor });
        }
        Ok(Self {
            mass,
            inertia,
            inertia_inverse,
            rotors: padded,
            rotor_count: rotors.len(),
            rotor_time_constant,
            tool,
            imu,
            allocation,
            allocation_inverse,
            rank,
            condition,
        })
    }

    /// The same vehicle with another tool.
    ///
    /// # Errors
    /// If the position of the mounting is not finite, or its orientation is not a rotation.
    pub fn with_tool(mut self, tool: Mounting) -> Result<Self, Error> {
        check_mounting("tool_position", "tool_rotation", &tool)?;
        self.tool = tool;
        Ok(self)
    }

    /// Mass of vehicle and tool, kg.
    #[must_use]
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// Its weight, N.
    #[must_use]
    pub fn weight(&self) -> f64 {
        self.mass * crate::GRAVITY
    }

    /// Inertia about the centre of mass, kg m^2, robot coordinates.
    #[must_use]
    pub fn inertia(&self) -> &Matrix3 {
        &self.inertia
    }

    /// Inverse of [`Self::inertia`].
    #[must_use]
    pub fn inertia_inverse(&self) -> &Matrix3 {
        &self.inertia_inverse
    }

    /// The rotors.
    #[must_use]
    pub fn rotors(&self) -> &[Rotor] {
        self.rotors.get(..self.rotor_count).unwrap_or(&self.rotors)
    }

    /// Smallest and largest speeds of the rotors, Hz.
    #[must_use]
    pub fn speed_limits(&self) -> (RotorVector, RotorVector) {
        let (mut min, mut max) = (RotorVector::zeros(), RotorVector::zeros());
        for ((min, max), rotor) in min.iter_mut().zip(&mut max).zip(self.rotors()) {
            (*min, *max) = (rotor.min_speed, rotor.max_speed);
        }
        (min, max)
    }

    /// Number of rotors.
    #[must_use]
    pub fn rotor_count(&self) -> usize {
        self.rotor_count
    }

    /// Time constant of the rotor speed's first-order lag, s.
    #[must_use]
    pub fn rotor_time_constant(&self) -> f64 {
        self.rotor_time_constant
    }

    /// Mounting of the tool (p_E^R, R_E^R).
    #[must_use]
    pub fn tool(&self) -> &Mounting {
        &self.tool
    }

    /// Mounting of the IMU (p_I^R, R_I^R).
    #[must_use]
    pub fn imu(&self) -> &Mounting {
        &self.imu
    }

    /// `A = [F1; F2]`, N/Hz^2 and N m/Hz^2: body wrench `= A u`; (8)-(9).
    #[must_use]
    pub fn allocation(&self) -> &Allocation {
        &self.allocation
    }

    /// Pseudo-inverse of `A`: its inverse for six rotors, minimum norm above.
    #[must_use]
    pub fn allocation_inverse(&self) -> &AllocationInverse {
        &self.allocation_inverse
    }

    /// Rank of `A`.
    #[must_use]
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// What the vehicle can track.
    #[must_use]
    pub fn actuation(&self) -> Actuation {
        match self.rank {
            0..=4 => Actuation::PositionAndHeading,
            5 => Actuation::PositionAndPartOfAttitude,
            _ => Actuation::Pose,
        }
    }

    /// Condition number of `A`: largest divided by smallest non-zero singular value.
    #[must_use]
    pub fn condition(&self) -> f64 {
        self.condition
    }

    /// Body wrench `[F1 u; F2 u]` of rotor speeds in Hz.
    #[must_use]
    pub fn body_wrench(&self, rotor_speeds: &RotorVector) -> crate::Wrench {
        crate::Wrench::from_vector(&wrench_of(&self.allocation, &inputs(rotor_speeds), self.rotor_count))
    }

    /// Rotor speeds, Hz, that hold the vehicle still at an orientation without
    /// contact, before any limit.
    #[must_use]
    pub fn hover_speeds(&self, rotation_wr: &Matrix3) -> RotorVector {
        let weight_r = rotation_wr.transpose() * Vector3::new(0.0, 0.0, self.weight());
        let wrench = crate::Wrench { force: weight_r, torque: Vector3::zeros() };
        let inputs = inputs_for(&self.allocation_inverse, &wrench.to_vector(), self.rotor_count);
        speeds_of(&inputs, self.rotor_count)
    }
}

fn check_inertia(inertia: &Matrix3) -> Result<Matrix3, Error> {
    let name = "inertia";
    if inertia.iter().any(|x| !x.is_finite()) {
        return Err(Error::NotFinite { name });
    }
    let defect = (inertia - inertia.transpose()).amax();
    if defect > 1e-9 * inertia.amax() {
        return Err(Error::NotSymmetric { name, defect });
    }
    let smallest_eigenvalue = inertia.symmetric_eigenvalues().min();
    let refused = Error::NotPositiveDefinite { name, smallest_eigenvalue };
    if smallest_eigenvalue <= 0.0 {
        return Err(refused);
    }
    inertia.try_inverse().ok_or(refused)
}

fn check_mounting(position: &'static str, rotation: &'static str, m: &Mounting) -> Result<(), Error> {
    for x in m.position_r.iter() {
        check_range(position, *x, -100.0, 100.0)?;
    }
    so3::check_rotation(rotation, &m.rotation_r)
}

/// Rank, condition number and pseudo-inverse.
fn pseudo_inverse(a: &Allocation) -> (usize, f64, AllocationInverse) {
    let svd = a.svd(true, true);
    let largest = svd.singular_values.max();
    let floor = largest * RANK_TOLERANCE;
    let rank = svd.singular_values.iter().filter(|s| **s > floor).count();
    let smallest = svd.singular_values.iter().filter(|s| **s > floor).fold(largest, |m, s| m.min(*s));
    let inverse = svd.pseudo_inverse(floor).unwrap_or_else(|_| AllocationInverse::zeros());
    // A step of Newton's iteration removes the rounding errors of the decomposition.
    let inverse = inverse * 2.0 - inverse * (a * inverse);
    (rank, largest / smallest, inverse)
}

/// A rotor, from 1, without which the rank does not change.
fn redundant_rotor(a: &Allocation, count: usize, rank: usize) -> usize {
    let without = |i: usize| {
        let mut b = *a;
        b.column_mut(i).fill(0.0);
        pseudo_inverse(&b).0
    };
    (0..count).find(|i| without(*i) == rank).unwrap_or(count.saturating_sub(1)) + 1
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::GRAVITY;
    use std::string::ToString;

    /// The paper's table 1 with the published rotor figures (docs/laws.md).
    pub(crate) fn tilt_hex() -> Vehicle {
        crate::examples::tilt_hex().unwrap()
    }

    #[test]
    fn hover_carries_the_weight_and_nothing_else() {
        let vehicle = tilt_hex();
        for rotation in [Matrix3::identity(), so3::rot_x(0.2) * so3::rot_y(-0.1) * so3::rot_z(2.0)] {
            let wrench = vehicle.body_wrench(&vehicle.hover_speeds(&rotation));
            let force_w = rotation * wrench.force;
            assert!((force_w - Vector3::new(0.0, 0.0, 2.4 * GRAVITY)).amax() < 1e-9);
            assert!(wrench.torque.amax() < 1e-9);
        }
    }

    fn with_axes(axis: impl Fn(usize) -> Vector3, drag: f64) -> Result<Vehicle, Error> {
        let mut rotors = tilt_hex().rotors().to_vec();
        for (i, r) in rotors.iter_mut().enumerate() {
            r.axis_r = axis(i);
            r.drag_coefficient = drag;
        }
        Vehicle::new(2.4, Matrix3::identity(), &rotors, 0.03, Mounting::default(), Mounting::default())
    }

    #[test]
    fn a_vehicle_says_what_it_tracks() {
        assert_eq!(tilt_hex().actuation(), Actuation::Pose);
        let collinear = with_axes(|_| Vector3::z(), 2.4e-5).unwrap();
        assert_eq!((collinear.rank(), collinear.actuation()), (4, Actuation::PositionAndHeading));
        let tilt = |i: usize| so3::rot_x(if i.is_multiple_of(2) { 0.3 } else { -0.3 }) * Vector3::z();
        assert_eq!(with_axes(tilt, 2.4e-5).unwrap().actuation(), Actuation::PositionAndPartOfAttitude);
    }

    #[test]
    fn rotors_without_a_yaw_torque_are_refused_with_rank_and_rotor() {
        match with_axes(|_| Vector3::z(), 0.0) {
            Err(Error::NotControllable { rank: 3, torque_rank: 2, rotor: 1..=6, .. }) => {}
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_bad_rotor_is_named() {
        let mut rotors = tilt_hex().rotors().to_vec();
        rotors[3].spin = 0.5;
        let error =
            Vehicle::new(2.4, Matrix3::identity(), &rotors, 0.03, Mounting::default(), Mounting::default());
        let sentence = error.unwrap_err().to_string();
        assert_eq!(sentence, "rotor 4 has spin = 0.5; expected 1 or -1");
    }
}
