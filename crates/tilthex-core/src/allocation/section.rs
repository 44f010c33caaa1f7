//! The body forces that a vehicle can produce without a torque.

use super::{AllocatorState, RotorStatus, has_own_inputs, levels::Levels, within};
use crate::{
    Vehicle,
    types::{MAX_ROTORS, Matrix3, RotorVector, Vector3, Vector6, Wrench},
    vehicle::{Allocation as Matrix, AllocationInverse, inputs},
};

/// The convex set of the body forces that the vehicle can produce without a torque: the section of the attainable
/// wrenches for hovering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceSection {
    matrix: Matrix,
    inverse: AllocationInverse,
    lower: RotorVector,
    upper: RotorVector,
    full: bool,
    levels: Levels,
    /// The limits of each of six rotors as planes, if every wrench has exactly one set of inputs.
    faces: Option<[Face; 6]>,
}

/// `lower <= normal . force <= upper`, N.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Face {
    normal: Vector3,
    lower: f64,
    upper: f64,
}

/// A corner counts as inside the set if it is beyond a face by this part of its size.
const INSIDE: f64 = 1e-9;

/// The points where limits of three faces meet.
fn corners(faces: [&Face; 3]) -> impl Iterator<Item = Vector3> {
    let normals = Matrix3::from_rows(&faces.map(|face| face.normal.transpose()));
    let inverse = normals.try_inverse();
    (0..8u8).filter_map(move |choice| {
        let [a, b, c] = [0, 1, 2].map(|i| if choice >> i & 1 == 0 { faces[i].lower } else { faces[i].upper });
        inverse.map(|inverse| inverse * Vector3::new(a, b, c))
    })
}

impl ForceSection {
    /// The section of a vehicle whose rotors each keep the part `reserve` of their input range free at either end,
    /// for torques and disturbances.
    #[must_use]
    pub fn new(vehicle: &Vehicle, reserve: f64) -> Self {
        let (min, max) = vehicle.speed_limits();
        let (lower, upper) = (inputs(&min), inputs(&max));
        let kept = (upper - lower) * reserve;
        let (lower, upper) = (lower + kept, upper - kept);
        let inverse = *vehicle.allocation_inverse();
        let face = |i: usize| {
            let row = inverse.fixed_view::<1, 3>(i, 0).transpose();
            let size = row.norm().max(f64::MIN_POSITIVE);
            Face { normal: row / size, lower: lower[i] / size, upper: upper[i] / size }
        };
        let own_inputs = has_own_inputs(vehicle.rank(), vehicle.rotor_count());
        Self {
            matrix: *vehicle.allocation(),
            inverse,
            lower,
            upper,
            full: vehicle.rank() == 6,
            levels: Levels::torque_first(vehicle),
            faces: own_inputs.then(|| core::array::from_fn(face)),
        }
    }

    /// A plane, `normal . f <= offset`, with the set on one side and `force_r` on the other, more than `tolerance`
    /// (N) away from it; `None` if the force is in the set.
    #[inline(always)]
    pub(crate) fn cut(
        &self,
        state: &mut AllocatorState,
        force_r: &Vector3,
        rotors: &RotorStatus,
        tolerance: f64,
    ) -> Option<(Vector3, f64)> {
        let Some(faces) = self.faces.as_ref().filter(|_| rotors.lost == 0) else {
            let nearest = self.nearest(state, force_r, rotors).force;
            let outwards = force_r - nearest;
            let distance = outwards.norm();
            let normal = outwards / distance;
            return (distance > tolerance).then(|| (normal, normal.dot(&nearest)));
        };
        let inside = faces.iter().fold(true, |inside, face| {
            let along = face.normal.dot(force_r);
            inside & (along - face.upper <= tolerance) & (face.lower - along <= tolerance)
        });
        if inside {
            return None;
        }
        let mut farthest = tolerance;
        let mut cut = None;
        for face in faces {
            let along = face.normal.dot(force_r);
            if along - face.upper > farthest {
                farthest = along - face.upper;
                cut = Some((face.normal, face.upper));
            }
            if face.lower - along > farthest {
                farthest = face.lower - along;
                cut = Some((-face.normal, -face.lower));
            }
        }
        cut
    }

    /// The largest force of the set, N, if the set is known by its faces: at a corner.
    pub(crate) fn largest(&self) -> Option<f64> {
        let faces = self.faces.as_ref()?;
        let mut largest: f64 = 0.0;
        for (k, a) in faces.iter().enumerate() {
            for (j, b) in faces.iter().enumerate().take(k) {
                for c in faces.iter().take(j) {
                    for corner in corners([a, b, c]) {
                        let slack = INSIDE * corner.norm();
                        let inside = faces.iter().all(|face| {
                            let along = face.normal.dot(&corner);
                            (face.lower - slack..=face.upper + slack).contains(&along)
                        });
                        largest = if inside { largest.max(corner.norm()) } else { largest };
                    }
                }
            }
        }
        Some(largest)
    }

    /// The force of the set that is nearest to `force_r`, N, and the torque that is left if lost rotors allow no
    /// force without a torque.
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
        if self.full && within(MAX_ROTORS, &(self.inverse * wrench), &lower, &upper) {
            return Wrench { force: *force_r, torque: Vector3::zeros() };
        }
        self.levels.solve(state, &wrench, (&lower, &upper), None);
        Wrench::from_vector(&(self.matrix * state.inputs))
    }
}
