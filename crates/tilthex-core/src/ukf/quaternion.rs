//! Unit quaternions: the rotations of the sigma points, without a division or a matrix for each point.

use crate::{
    so3,
    types::{Matrix3, Vector3},
};
use libm::{atan2, sqrt};

/// Below this square of the tangent of the half angle, the angle is summed as a series.
const SMALL: f64 = 1e-2;

/// A unit quaternion: scalar and vector.
#[derive(Clone, Copy)]
pub(super) struct Quaternion {
    pub(super) w: f64,
    pub(super) v: Vector3,
}

impl Quaternion {
    /// The rotation by a rotation vector, rad. If its angle is known to be below 0.2 rad, series suffice: without a branch,
    /// several rotations share vector instructions.
    #[inline]
    pub(super) fn exp<const SERIES: bool>(turn: &Vector3) -> Self {
        let h2 = 0.25 * turn.norm_squared();
        let (ratio, b, _) = if SERIES { so3::small_ratios(h2) } else { so3::ratios(h2) };
        Self { w: 1.0 - b * h2, v: 0.5 * ratio * turn }
    }

    pub(super) fn inverse(&self) -> Self {
        Self { w: self.w, v: -self.v }
    }

    #[inline]
    pub(super) fn times(&self, other: &Self) -> Self {
        Self {
            w: self.w * other.w - self.v.dot(&other.v),
            v: self.w * other.v + other.w * self.v + self.v.cross(&other.v),
        }
    }

    /// The rotated vector minus the vector.
    #[inline]
    pub(super) fn change(&self, u: &Vector3) -> Vector3 {
        let c = 2.0 * self.v.cross(u);
        self.w * c + self.v.cross(&c)
    }

    pub(super) fn matrix(&self) -> Matrix3 {
        so3::rodrigues(&self.v, 2.0 * self.w, 2.0)
    }

    /// Rotation vector, rad, with an angle in `[0, pi]`. `SERIES` as for [`exp`](Self::exp).
    #[inline]
    pub(super) fn log<const SERIES: bool>(&self) -> Vector3 {
        let sign = if self.w < 0.0 && !SERIES { -1.0 } else { 1.0 };
        let w = sign * self.w;
        let n2 = self.v.norm_squared();
        let inverse = 1.0 / w;
        let q2 = n2 * inverse * inverse;
        if SERIES || q2 < SMALL {
            // 2 atan(q)/q / w as a series, exact to rounding for q < 0.1.
            let s = 1.0 / 13.0 - q2 * (1.0 / 15.0 - q2 * (1.0 / 17.0));
            let s = 1.0 / 7.0 - q2 * (1.0 / 9.0 - q2 * (1.0 / 11.0 - q2 * s));
            let s = 1.0 - q2 * (1.0 / 3.0 - q2 * (1.0 / 5.0 - q2 * s));
            (2.0 * sign * inverse * s) * self.v
        } else {
            let n = sqrt(n2);
            (2.0 * sign * atan2(n, w) / n) * self.v
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn turn(most: f64) -> impl Strategy<Value = Vector3> {
        let axis = prop::array::uniform3(-1.0..1.0f64).prop_map(Vector3::from);
        (axis.prop_filter("too short", |v| v.norm() > 0.1), 0.0..most).prop_map(|(v, t)| t * v.normalize())
    }

    /// Against rotation matrices.
    fn agrees<const SERIES: bool>(turn: &Vector3, u: &Vector3) -> Result<(), TestCaseError> {
        let (q, r) = (Quaternion::exp::<SERIES>(turn), so3::exp(turn));
        prop_assert!((q.matrix() - r).amax() < 2e-15);
        prop_assert!((q.change(u) - (r * u - u)).amax() < 1e-14);
        prop_assert!((q.log::<SERIES>() - turn).amax() < 1e-14);
        let both = q.times(&q.inverse());
        prop_assert!((both.w - 1.0).abs() < 1e-15 && both.v.amax() < 1e-15);
        Ok(())
    }

    proptest! {
        #[test]
        fn small_turns_are_those_of_matrices(turn in turn(0.199), u in turn(9.0)) {
            agrees::<true>(&turn, &u)?;
            agrees::<false>(&turn, &u)?;
        }

        #[test]
        fn all_turns_are_those_of_matrices(turn in turn(3.1), u in turn(9.0)) {
            agrees::<false>(&turn, &u)?;
            // The same rotation by the other quaternion.
            let q = Quaternion::exp::<false>(&turn);
            let other = Quaternion { w: -q.w, v: -q.v };
            prop_assert!((other.log::<false>() - turn).amax() < 1e-13);
        }
    }
}
