//! The spring between the set-point and the reference.
//!
//! The printed rotational spring, `K_R vee(Q)` with `Q = R_r R_d^T`, is not the derivative of a potential if K_R is
//! not isotropic: a rotation that ends where it began gains energy. The spring here is that of `V = tr(G (I - Q))`
//! with `G = tr(K_R)/2 I - K_R`. Its torque, `2 vee(Q G)`, equals the printed one for an isotropic K_R, for rotations
//! about a principal axis and for small angles. It pulls back from every side only if no stiffness is larger than the
//! sum of the two others; otherwise the printed form is used.

use super::halves;
use crate::{
    so3::{hat, vee},
    types::{Matrix3, Matrix6, Vector3, Vector6},
};

/// The spring's wrench on the reference is `-wrench`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spring {
    /// Translational stiffness, N/m.
    translation: Matrix3,
    /// Force by rotation, N, and its transpose: torque by translation.
    coupling: Matrix3,
    /// Rotational stiffness, N m/rad.
    rotation: Matrix3,
    /// The torque is `outer 2 vee(Q g)`.
    g: Matrix3,
    outer: Option<Matrix3>,
}

/// The spring at one deviation.
pub(super) struct Strained {
    /// Force, N, and torque, N m, world, against the deviation.
    pub wrench: Vector6,
    /// Q G.
    turned: Matrix3,
}

impl Spring {
    pub(super) fn new(stiffness: &Matrix6) -> Self {
        let rotation: Matrix3 = stiffness.fixed_view::<3, 3>(3, 3).into_owned();
        let translation = stiffness.fixed_view::<3, 3>(0, 0).into_owned();
        let coupling = stiffness.fixed_view::<3, 3>(0, 3).into_owned();
        let symmetric = 0.5 * (rotation + rotation.transpose());
        Self::judged(translation, coupling, symmetric, |g| g.symmetric_eigenvalues().min())
    }

    /// The spring of a diagonal matrix. It computes no eigenvalues.
    pub(super) fn diagonal(stiffness: &Vector6) -> Self {
        let (translation, rotation) = halves(stiffness);
        let [translation, rotation] = [translation, rotation].map(|half| Matrix3::from_diagonal(&half));
        Self::judged(translation, Matrix3::zeros(), rotation, |g| g.m11.min(g.m22).min(g.m33))
    }

    /// `smallest` gives the smallest eigenvalue of G.
    fn judged(
        translation: Matrix3,
        coupling: Matrix3,
        rotation: Matrix3,
        smallest: impl FnOnce(&Matrix3) -> f64,
    ) -> Self {
        let g = 0.5 * rotation.trace() * Matrix3::identity() - rotation;
        let pulls_back = smallest(&g) >= -1e-9 * rotation.amax();
        Self {
            translation,
            coupling,
            rotation,
            g: if pulls_back { g } else { 0.5 * Matrix3::identity() },
            outer: (!pulls_back).then_some(rotation),
        }
    }

    pub(super) fn has_potential(&self) -> bool {
        self.outer.is_none()
    }

    /// The stored energy, J. G is symmetric: `tr(G A)` is the sum of the products of their entries.
    pub(super) fn energy(&self, translation: &Vector3, turn: &Matrix3, coupled: bool) -> f64 {
        let bent = Matrix3::identity() - turn;
        if !coupled {
            let stretched = self.translation.diagonal().component_mul(translation);
            return 0.5 * translation.dot(&stretched) + self.g.diagonal().dot(&bent.diagonal());
        }
        let cross = translation.dot(&(self.coupling * vee(turn)));
        0.5 * translation.dot(&(self.translation * translation)) + cross + self.g.dot(&bent)
    }

    /// The spring at a deviation; without `coupled`, no axis acts on another: the matrices are diagonal.
    #[inline]
    pub(super) fn at(&self, translation: &Vector3, turn: &Matrix3, coupled: bool) -> Strained {
        if !coupled {
            let [gx, gy, gz] = [self.g.m11, self.g.m22, self.g.m33];
            let turned =
                Matrix3::from_columns(&[turn.column(0) * gx, turn.column(1) * gy, turn.column(2) * gz]);
            let force = self.translation.diagonal().component_mul(translation);
            let torque = self.outward(2.0 * vee(&turned));
            return Strained { wrench: join(&force, &torque), turned };
        }
        let turned = turn * self.g;
        let force = self.translation * translation + self.coupling * vee(turn);
        let torque = self.outward(2.0 * vee(&turned)) + across(turn, &self.pull(translation));
        Strained { wrench: join(&force, &torque), turned }
    }

    /// Rate of the wrench if the deviation moves at `velocity` and rotates at `turning`, minus the rate of the linear
    /// spring.
    pub(super) fn rate(
        &self,
        strained: &Strained,
        (translation, turn): (&Vector3, &Matrix3),
        (velocity, turning): (&Vector3, &Vector3),
        coupled: bool,
    ) -> Vector6 {
        let a = &strained.turned;
        // 2 vee(hat(w) A) = (tr(A) I - A) w.
        let linear =
            if coupled { self.rotation * turning } else { self.rotation.diagonal().component_mul(turning) };
        let mut torque = self.outward(turning * a.trace() - a * turning) - linear;
        let mut force = Vector3::zeros();
        if coupled {
            let turned = hat(turning) * turn;
            force += self.coupling * (vee(&turned) - turning);
            let pull = self.pull(velocity);
            torque += across(turn, &pull) - pull + across(&turned, &self.pull(translation));
        }
        join(&force, &torque)
    }

    /// The linear spring's wrench at a small deviation (translation, rotation vector).
    pub(super) fn linear(&self, deviation: &Vector6, coupled: bool) -> Vector6 {
        let (p, turn) = halves(deviation);
        if !coupled {
            let [force, torque] = [&self.translation, &self.rotation].map(Matrix3::diagonal);
            return join(&force.component_mul(&p), &torque.component_mul(&turn));
        }
        join(&(self.translation * p + self.coupling * turn), &(self.rotation * turn + self.pull(&p)))
    }

    fn outward(&self, torque: Vector3) -> Vector3 {
        self.outer.map_or(torque, |outer| outer * torque)
    }

    /// The torque of a translation, N m, at no rotation.
    fn pull(&self, translation: &Vector3) -> Vector3 {
        self.coupling.tr_mul(translation)
    }
}

/// The derivative of `vee(Q) . k` by a turn of Q: `1/2 (tr(Q) I - Q^T) k`.
fn across(q: &Matrix3, k: &Vector3) -> Vector3 {
    0.5 * (k * q.trace() - q.tr_mul(k))
}

pub(super) fn join(a: &Vector3, b: &Vector3) -> Vector6 {
    Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
}
