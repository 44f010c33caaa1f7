//! The body forces that a vehicle can produce without a torque.

use super::{AllocatorState, RotorStatus, levels::Levels, within};
use crate::{
    Vehicle,
    types::{MAX_ROTORS, RotorVector, Vector3, Vector6, Wrench},
    vehicle::{Allocation as Matrix, AllocationInverse, inputs},
};

/// The convex set of the body forces that go with no torque: the section of
/// the attainable wrenches where the vehicle hovers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceSection {
    matrix: Matrix,
    inverse: AllocationInverse,
    lower: RotorVector,
    upper: RotorVector,
    full: bool,
    levels: Levels,
}

impl ForceSection {
    /// That of a vehicle of which each rotor keeps the part `reserve` of its
    /// input range at either end for torques and disturbances.
    #[must_use]
    pub fn new(vehicle: &Vehicle, reserve: f64) -> Self {
        let (mut min, mut max) = (RotorVector::zeros(), RotorVector::zeros());
        for (i, rotor) in vehicle.rotors().iter().enumerate() {
            min[i] = rotor.min_speed;
            max[i] = rotor.max_speed;
        }
        let (lower, upper) = (inputs(&min), inputs(&max));
        let kept = (upper - lower) * reserve;
        Self {
            matrix: *vehicle.allocation(),
            inverse: *vehicle.allocation_inverse(),
            lower: lower + kept,
            upper: upper - kept,
            full: vehicle.rank() == 6,
            levels: Levels::torque_first(vehicle),
        }
    }

    /// The force of the set nearest to `force_r`, N, and the torque that is
    /// left where lost rotors allow none to be without.
    #[must_use]
    pub fn nearest(&self, state: &mut AllocatorState, force_r: &Vector3, rotors: &RotorStatus) -> Wrench {
        let wrench = Vector6::new(force_r.x, force_r.y, force_r.z, 0.0, 0.0, 0.0);
        let (mut lower, mut upper) = (self.lower, self.upper);
        for i in 0..MAX_ROTORS {
            if rotors.lost >> i & 1 == 1 {
                lower[i] = 0.0;
                upper[i] = 0.0;
            }
        }
        if self.full && within(&(self.inverse * wrench), &lower, &upper) {
            return Wrench { force: *force_r, torque: Vector3::zeros() };
        }
        self.levels.solve(state, &wrench, (&lower, &upper), None);
        Wrench::from_vector(&(self.matrix * state.inputs))
    }
}
