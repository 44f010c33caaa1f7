//! A vehicle after a correction of its model, made within a tick: bounded work, no failure, no panic.

use super::{Allocation, AllocationInverse, Rotor, Vehicle, rotor::column};
use crate::types::{MAX_ROTORS, RotorVector, Vector3};

/// Steps of Newton's iteration for the pseudo-inverse; a matrix with a condition number of 1000 needs 27.
const STEPS: usize = 40;
/// A step that changes the inverse by less than this part of it is the last.
const CONVERGED: f64 = 1e-14;

/// A correction of a vehicle. Rotors, tool and IMU keep their places on the airframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    /// True mass divided by the model's.
    pub mass: f64,
    /// Centre of mass relative to the model's, m, robot.
    pub centre_r: Vector3,
    /// True thrust of each rotor divided by the model's.
    pub thrust: RotorVector,
    /// True drag moment divided by the model's.
    pub drag: f64,
    /// Vector that is added to each rotor's axis before it is normalised again, robot.
    pub axis_r: [Vector3; MAX_ROTORS],
}

impl Correction {
    /// No correction.
    pub const NONE: Self = Self {
        mass: 1.0,
        centre_r: Vector3::new(0.0, 0.0, 0.0),
        thrust: RotorVector::from_array_storage(nalgebra::ArrayStorage([[1.0; MAX_ROTORS]])),
        drag: 1.0,
        axis_r: [Vector3::new(0.0, 0.0, 0.0); MAX_ROTORS],
    };

    /// The rotors of a vehicle, corrected.
    pub(crate) fn rotors<'a>(&'a self, vehicle: &'a Vehicle) -> impl Iterator<Item = Rotor> + 'a {
        let all = vehicle.rotors().iter().zip(self.thrust.iter()).zip(&self.axis_r);
        all.map(|((rotor, thrust), axis_r)| {
            let axis = rotor.axis_r + axis_r;
            Rotor {
                position_r: rotor.position_r - self.centre_r,
                axis_r: axis / axis.norm().max(1e-9),
                thrust_coefficient: rotor.thrust_coefficient * thrust,
                drag_coefficient: rotor.drag_coefficient * self.drag,
                ..*rotor
            }
        })
    }

    fn is_possible(&self) -> bool {
        let factor = |x: f64| (0.3..3.0).contains(&x);
        factor(self.mass)
            && self.thrust.iter().all(|x| factor(*x))
            && self.drag.is_finite()
            && self.drag >= 0.0
            && self.centre_r.norm() < 0.1
            && self.axis_r.iter().all(|a| a.norm() < 0.3)
    }
}

impl Vehicle {
    /// The vehicle after a correction; `None` if the correction is too large to be possible.
    ///
    /// Inertia, rank and condition number stay those of the model.
    #[must_use]
    pub fn corrected(&self, correction: &Correction) -> Option<Self> {
        if !correction.is_possible() {
            return None;
        }
        let mut vehicle = *self;
        vehicle.mass *= correction.mass;
        vehicle.tool.position_r -= correction.centre_r;
        vehicle.imu.position_r -= correction.centre_r;
        for (slot, rotor) in vehicle.rotors.iter_mut().zip(correction.rotors(self)) {
            *slot = rotor;
        }
        let mut allocation = Allocation::zeros();
        for (mut slot, rotor) in
            allocation.column_iter_mut().zip(vehicle.rotors.iter()).take(self.rotor_count)
        {
            slot.copy_from(&column(rotor));
        }
        vehicle.allocation = allocation;
        vehicle.allocation_inverse = pseudo_inverse(&allocation)?;
        Some(vehicle)
    }

    /// Rotor inputs, Hz^2, of a hover whose upward direction is `up_r`, robot, before any limit.
    pub(crate) fn hover_inputs(&self, up_r: &Vector3) -> RotorVector {
        self.allocation_inverse.fixed_columns::<3>(0) * (up_r * self.weight())
    }
}

/// Pseudo-inverse by Newton's iteration, its rows scaled to equal size.
fn pseudo_inverse(a: &Allocation) -> Option<AllocationInverse> {
    let (force, torque) = (a.fixed_rows::<3>(0).norm(), a.fixed_rows::<3>(3).norm());
    if !(force > 0.0 && torque > 0.0) {
        return None;
    }
    let mut scaled = *a;
    scaled.fixed_rows_mut::<3>(0).scale_mut(1.0 / force);
    scaled.fixed_rows_mut::<3>(3).scale_mut(1.0 / torque);
    let mut inverse = scaled.transpose() / scaled.norm_squared();
    for _ in 0..STEPS {
        let next = inverse * 2.0 - inverse * (scaled * inverse);
        let change = (next - inverse).norm_squared();
        inverse = next;
        if change <= CONVERGED * CONVERGED * inverse.norm_squared() {
            break;
        }
    }
    inverse.fixed_columns_mut::<3>(0).scale_mut(1.0 / force);
    inverse.fixed_columns_mut::<3>(3).scale_mut(1.0 / torque);
    inverse.iter().all(|x| x.is_finite()).then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{so3, vehicle::tests::tilt_hex};

    #[test]
    fn no_correction_changes_nothing() {
        let vehicle = tilt_hex();
        let same = vehicle.corrected(&Correction::NONE).unwrap();
        assert_eq!(same.mass(), vehicle.mass());
        assert!((same.allocation() - vehicle.allocation()).amax() < 1e-17);
        let product = same.allocation() * same.allocation_inverse();
        assert!((product - nalgebra::Matrix6::identity()).amax() < 1e-9, "{product}");
    }

    #[test]
    fn a_corrected_vehicle_is_the_one_built_from_its_parts() {
        let vehicle = tilt_hex();
        let mut correction = Correction { mass: 1.04, drag: 0.8, ..Correction::NONE };
        correction.centre_r = Vector3::new(0.004, -0.006, 0.008);
        correction.thrust = RotorVector::from_fn(|i, _| 1.0 + 0.02 * (i as f64 - 2.0));
        correction.axis_r[2] = Vector3::new(0.01, 0.02, -0.01);
        let made = vehicle.corrected(&correction).unwrap();
        let built = Vehicle::new(
            made.mass(),
            *vehicle.inertia(),
            made.rotors(),
            vehicle.rotor_time_constant(),
            *made.tool(),
            *made.imu(),
        )
        .unwrap();
        assert!((made.allocation() - built.allocation()).amax() < 1e-15);
        let (a, b) = (made.allocation_inverse(), built.allocation_inverse());
        assert!((a - b).amax() < 1e-8 * b.amax());
        let wrench = made.body_wrench(&made.hover_speeds(&so3::rot_x(0.2)));
        assert!((wrench.force.norm() - made.weight()).abs() < 1e-8 && wrench.torque.amax() < 1e-9);
        let tip = |v: &Vehicle, c: &Vector3| v.tool().position_r + c;
        assert_eq!(tip(&made, &correction.centre_r), tip(&vehicle, &Vector3::zeros()));
        let up = so3::rot_x(0.2).transpose() * Vector3::z();
        let inputs = super::super::inputs(&made.hover_speeds(&so3::rot_x(0.2)));
        assert!((made.hover_inputs(&up) - inputs).amax() < 1e-9 * inputs.amax());
    }

    #[test]
    fn what_can_not_be_is_refused() {
        let vehicle = tilt_hex();
        for mass in [0.0, f64::NAN, 10.0] {
            assert!(vehicle.corrected(&Correction { mass, ..Correction::NONE }).is_none());
        }
    }
}
