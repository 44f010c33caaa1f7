//! Converts poses from the axes of a capture system to the world's.

use nalgebra::{Quaternion, UnitQuaternion};
use tilthex_core::types::{Matrix3, Vector3, is_finite3};

/// The axis of the capture system that points up. (x, y, z) of a system in which y points up is (x, -z, y) in the world.
/// This holds for positions and for the axes of the bodies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// y, the default of Motive.
    #[default]
    Y,
    /// z, as in the world of this library.
    Z,
}

impl UpAxis {
    /// Position, m, and rotation of a body in the world, from those of the capture system. `None` if a number is not
    /// finite, or the length of the quaternion (x, y, z, w) differs from 1 by more than 1 %.
    #[must_use]
    pub fn to_world(self, position: [f64; 3], quaternion_xyzw: [f64; 4]) -> Option<(Vector3, Matrix3)> {
        let ([px, py, pz], [x, y, z, w]) = (position, quaternion_xyzw);
        let quaternion = match self {
            Self::Y => Quaternion::new(w, x, -z, y),
            Self::Z => Quaternion::new(w, x, y, z),
        };
        let position_w = match self {
            Self::Y => Vector3::new(px, -pz, py),
            Self::Z => Vector3::new(px, py, pz),
        };
        let unit = (0.99..=1.01).contains(&quaternion.norm());
        (unit && is_finite3(&position_w)).then(|| {
            (position_w, UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix().into_inner())
        })
    }

    /// Inverse of [`UpAxis::to_world`].
    #[must_use]
    pub fn from_world(self, position_w: &Vector3, rotation_wr: &Matrix3) -> ([f64; 3], [f64; 4]) {
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(*rotation_wr);
        let q = UnitQuaternion::from_rotation_matrix(&rotation);
        let (p, q) = (position_w, q.coords);
        match self {
            Self::Y => ([p.x, p.z, -p.y], [q.x, q.z, -q.y, q.w]),
            Self::Z => ([p.x, p.y, p.z], [q.x, q.y, q.z, q.w]),
        }
    }
}
