//! From a wanted body wrench to rotor speeds within their limits; (12), (26).

use crate::{
    Vehicle,
    types::{RotorVector, Vector6},
    vehicle::{Allocation as Matrix, AllocationInverse, inputs},
};

/// The allocator of one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Allocator {
    matrix: Matrix,
    inverse: AllocationInverse,
    min_input: RotorVector,
    max_input: RotorVector,
}

/// What the rotors are asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Allocation {
    /// Rotor inputs, Hz^2.
    pub inputs: RotorVector,
    /// The body wrench they produce, `[force_r; torque_r]`.
    pub wrench: Vector6,
    /// Whether a limit is active.
    pub saturated: bool,
}

impl Allocator {
    /// For one vehicle, with its rotors' own limits.
    #[must_use]
    pub fn new(vehicle: &Vehicle) -> Self {
        let (mut min, mut max) = (RotorVector::zeros(), RotorVector::zeros());
        for (i, rotor) in vehicle.rotors().iter().enumerate() {
            min[i] = rotor.min_speed;
            max[i] = rotor.max_speed;
        }
        Self {
            matrix: *vehicle.allocation(),
            inverse: *vehicle.allocation_inverse(),
            min_input: inputs(&min),
            max_input: inputs(&max),
        }
    }

    /// Rotor inputs for a body wrench `[force_r; torque_r]`: exact for six
    /// rotors, of minimum norm above, clipped to the limits.
    #[must_use]
    pub fn allocate(&self, wrench: &Vector6) -> Allocation {
        let wanted = self.inverse * wrench;
        let clipped = wanted.sup(&self.min_input).inf(&self.max_input);
        if clipped == wanted {
            Allocation { inputs: wanted, wrench: *wrench, saturated: false }
        } else {
            Allocation { inputs: clipped, wrench: self.matrix * clipped, saturated: true }
        }
    }
}
