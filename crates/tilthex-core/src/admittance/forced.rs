//! The spring for a set-point that controls force along some axes.

use super::{AdmittanceFilter, AdmittanceState, Axes, Law, propagator::Block, spring::join, turned};
use crate::{
    force_axes::Forced,
    types::{Matrix6, Setpoint, Vector6, Wrench},
};

impl AdmittanceFilter {
    /// The force axes of a set-point, if it has any: those of the reference's tool, or of the surface.
    pub(super) fn forced(&self, state: &AdmittanceState, setpoint: &Setpoint) -> Option<Forced> {
        setpoint.force_axes.any().then(|| setpoint.force_axes.at(&(state.rotation * setpoint.rotation_we)))
    }

    /// The wrench of the spring against a deviation of the reference, N and N m, world, if the spring acts along all
    /// axes.
    pub(super) fn spring_w(&self, state: &AdmittanceState, setpoint: &Setpoint) -> Wrench {
        let strained = |s: &AdmittanceState| self.spring.at(&s.translation_w, &s.rotation, true).wrench;
        Wrench::from_vector(&match self.params.axes {
            Axes::World => strained(state),
            Axes::Tool => {
                let own = state.turned(&setpoint.rotation_we.transpose());
                turned(&strained(&own), &setpoint.rotation_we)
            }
        })
    }

    /// The wrench of the spring if it does not act along the force axes.
    pub(super) fn relieved_w(&self, state: &AdmittanceState, setpoint: &Setpoint, forced: &Forced) -> Wrench {
        let [along, _] = &forced.projections;
        let across =
            AdmittanceState { translation_w: state.translation_w - along * state.translation_w, ..*state };
        let spring_w = self.spring_w(&across, setpoint);
        spring_w - forced.along(&spring_w)
    }

    /// The wrench by which the motion of the set-point moves the reference, N and N m, world.
    pub(super) fn carried_w(&self, setpoint: &Setpoint) -> Wrench {
        let (v, w) = (&setpoint.velocity_w, &setpoint.angular_velocity_w);
        let (a, alpha) = (&setpoint.acceleration_w, &setpoint.angular_acceleration_w);
        let [mass, damping] = [&self.params.mass, &self.params.damping].map(|m| self.in_world(m, setpoint));
        Wrench::from_vector(&(mass * join(a, alpha) + damping * join(v, w)))
    }

    /// The wrench of the spring along the axes along which it acts, N and N m, world.
    pub(crate) fn acting_spring_w(&self, state: &AdmittanceState, setpoint: &Setpoint) -> Wrench {
        self.forced(state, setpoint).map_or_else(
            || self.spring_w(state, setpoint),
            |forced| self.relieved_w(state, setpoint, &forced),
        )
    }

    /// The change of the reference's twist by an impulse `wrench_w`, N s and N m s, on the filter's mass, world.
    pub(crate) fn impulse_w(&self, wrench_w: &Wrench, setpoint: &Setpoint) -> Vector6 {
        let struck = |impulse: &Vector6| match &self.law {
            Law::Diagonal(law) => law.mass_inverse.apply(impulse),
            Law::Full(law) => law.mass_inverse.apply(impulse),
        };
        let impulse_w = wrench_w.to_vector();
        match self.params.axes {
            Axes::World => struck(&impulse_w),
            Axes::Tool => {
                let own = struck(&turned(&impulse_w, &setpoint.rotation_we.transpose()));
                turned(&own, &setpoint.rotation_we)
            }
        }
    }

    /// A matrix of the parameters in world axes.
    pub(crate) fn in_world(&self, matrix: &Matrix6, setpoint: &Setpoint) -> Matrix6 {
        if self.params.axes == Axes::World {
            return *matrix;
        }
        let r = &setpoint.rotation_we;
        let both = Matrix6::from_fn(|i, k| {
            if i / 3 == k / 3 { r.get((i % 3, k % 3)).copied().unwrap_or_default() } else { 0.0 }
        });
        both * matrix * both.transpose()
    }
}
