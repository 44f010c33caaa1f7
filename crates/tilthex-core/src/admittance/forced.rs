//! The spring for a set-point that controls force along some axes.

use super::{AdmittanceFilter, AdmittanceState, Axes, Law, propagator::Block, spring::join, turned};
use crate::{
    force_axes::Forced,
    types::{Setpoint, Vector6, Wrench},
};

impl AdmittanceFilter {
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
        let [mass, damping] =
            [&self.params.mass, &self.params.damping].map(|m| self.params.in_world(m, &setpoint.rotation_we));
        Wrench::from_vector(&(mass * join(a, alpha) + damping * join(v, w)))
    }

    /// The wrench of the spring along the axes along which it acts, N and N m, world.
    pub(crate) fn acting_spring_w(&self, state: &AdmittanceState, setpoint: &Setpoint) -> Wrench {
        state.forced(setpoint).map_or_else(
            || self.spring_w(state, setpoint),
            |forced| self.relieved_w(state, setpoint, &forced),
        )
    }

    /// The twist of the reference, m/s and rad/s, world: relative to the set-point, and along the force axes, where the
    /// set-point's motion does not act, relative to the world.
    #[inline(always)]
    pub(crate) fn own_twist_w(&self, state: &AdmittanceState, setpoint: &Setpoint) -> Vector6 {
        let Some(forced) = state.forced(setpoint) else { return state.twist_w };
        let twist_w = Wrench { force: setpoint.velocity_w, torque: setpoint.angular_velocity_w };
        state.twist_w + forced.along(&twist_w).to_vector()
    }

    /// The change of the reference's twist by an impulse `wrench_w`, N s and N m s, on the filter's mass, world.
    #[inline(always)]
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
}
