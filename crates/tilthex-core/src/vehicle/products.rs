//! From rotor speeds to inputs and the body wrench, and back.

use super::{Allocation, AllocationInverse};
use crate::types::{MAX_ROTORS, RotorVector, Vector6};

/// Body wrench of the inputs of `count` rotors. The zero columns of the others cost nothing.
#[must_use]
#[inline(always)]
pub(crate) fn wrench_of(matrix: &Allocation, inputs: &RotorVector, count: usize) -> Vector6 {
    let mut wrench = [0.0; 6];
    let (columns, _) = matrix.as_slice().as_chunks::<6>();
    for (column, input) in columns.iter().zip(inputs.as_slice()).take(count) {
        wrench.iter_mut().zip(column).for_each(|(sum, entry)| *sum += entry * input);
    }
    wrench.into()
}

/// Inputs of `count` rotors for a body wrench, by an inverse of the allocation matrix. The other inputs are zero.
#[must_use]
#[inline(always)]
pub(crate) fn inputs_for(inverse: &AllocationInverse, wrench: &Vector6, count: usize) -> RotorVector {
    if count > 6 {
        return inverse * wrench;
    }
    let mut inputs = RotorVector::zeros();
    inputs.fixed_rows_mut::<6>(0).copy_from(&(inverse.fixed_rows::<6>(0) * wrench));
    inputs
}

/// Rotor inputs `u = w |w|`, Hz^2, of speeds, Hz.
#[must_use]
pub fn inputs(speeds: &RotorVector) -> RotorVector {
    speeds.map(|w| w * libm::fabs(w))
}

/// Rotor speeds, Hz, of inputs, Hz^2: inverse of [`inputs`].
#[must_use]
pub fn speeds(inputs: &RotorVector) -> RotorVector {
    speeds_of(inputs, MAX_ROTORS)
}

/// The same for `count` rotors. The other speeds are zero.
#[must_use]
#[inline(always)]
pub(crate) fn speeds_of(inputs: &RotorVector, count: usize) -> RotorVector {
    let mut speeds = RotorVector::zeros();
    for (speed, input) in speeds.as_mut_slice().iter_mut().zip(inputs.as_slice()).take(count) {
        *speed = libm::copysign(libm::sqrt(libm::fabs(*input)), *input);
    }
    speeds
}
