//! The filter's motion over one period: an exponential integrator of third order.

use super::{
    AdmittanceState, halves,
    propagator::{Block, Propagator},
    spring::{Spring, Strained, join},
};
use crate::{
    so3,
    types::{Vector3, Vector6},
};

/// The period for which a filter is prepared if no other is given, s.
const USUAL_PERIOD: f64 = 0.002;
/// A period that differs from the prepared one by at most this part is completed by a Taylor step from the end of the
/// prepared one; its error is at most 3e-6 of the fastest mode. Other periods need their own propagator.
const JITTER: f64 = 0.025;

/// A filter that swings by more than this in a period, rad, is prevented from gaining energy.
const SWINGS: f64 = 0.1;

/// The linear part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Linear<B> {
    pub mass: B,
    pub mass_inverse: B,
    /// M^-1 D and M^-1 K.
    damping_rate: B,
    stiffness_rate: B,
    /// A bound of the fastest mode, 1/s.
    fastest: f64,
    /// A bound of the fastest swing without damping, 1/s.
    swing: f64,
    propagator: Propagator<B>,
}

impl<B: Block> Linear<B> {
    /// Prepared for periods near 2 ms.
    pub(super) fn new(mass: B, mass_inverse: B, damping_rate: B, stiffness_rate: B, fastest: f64) -> Self {
        let propagator = Propagator::new(&stiffness_rate, &damping_rate, fastest, USUAL_PERIOD);
        let swing = libm::sqrt(stiffness_rate.largest_row_sum());
        Self { mass, mass_inverse, damping_rate, stiffness_rate, fastest, swing, propagator }
    }

    /// Prepares for periods near this, s.
    pub(super) fn prepare(&mut self, period: f64) {
        if libm::fabs(period - self.propagator.period) > JITTER * self.propagator.period && period > 0.0 {
            self.propagator = self.over(period);
        }
    }

    fn over(&self, period: f64) -> Propagator<B> {
        Propagator::new(&self.stiffness_rate, &self.damping_rate, self.fastest, period)
    }
}

/// The filter in one period, with its inputs.
pub(super) struct Motion<'a, B> {
    pub law: &'a Linear<B>,
    pub spring: &'a Spring,
    /// M^-1 (h_hat + h_user).
    pub push: Vector6,
    /// Angular velocity of the set-point, rad/s, in the axes of the matrices.
    pub setpoint_velocity: Vector3,
}

impl<B: Block> Motion<'_, B> {
    pub(super) fn strained(&self, state: &AdmittanceState) -> Strained {
        self.spring.at(&state.translation_w, &state.rotation, B::COUPLED)
    }

    #[inline]
    pub(super) fn acceleration(&self, state: &AdmittanceState, strained: &Strained) -> Vector6 {
        self.push
            - self.law.damping_rate.apply(&state.twist_w)
            - self.law.mass_inverse.apply(&strained.wrench)
    }

    /// Moves the deviation by `dt`, s.
    #[inline(always)]
    pub(super) fn advance(&self, state: &mut AdmittanceState, dt: f64) {
        let prepared = &self.law.propagator;
        let rest = dt - prepared.period;
        if libm::fabs(rest) > JITTER * prepared.period {
            self.exponential_step(state, &self.law.over(dt));
        } else {
            self.exponential_step(state, prepared);
            if libm::fabs(rest) > 1e-9 * prepared.period {
                self.taylor_step(state, rest);
            }
        }
        // A product of exponentials drifts from SO(3) by rounding only.
        state.rotation = so3::unrounded(&state.rotation);
    }

    /// One step of the linear part in closed form.
    #[inline(always)]
    fn exponential_step(&self, state: &mut AdmittanceState, p: &Propagator<B>) {
        let start = *state;
        let strained = self.strained(&start);
        let (v, w) = halves(&start.twist_w);
        // d(R_r R_d^T)/dt = hat(omega_r - Q omega_d) Q, Q the deviation itself.
        let turned_w = start.rotation * self.setpoint_velocity;
        let turning = w + self.setpoint_velocity - turned_w;
        let rates = (join(&v, &turning), self.acceleration(&start, &strained));
        let straight = p.constant.apply(&rates);
        // A spring that oscillates faster than the period can show counts as linear within the period.
        let (moved, gained) = if p.shows_bend {
            self.bent(&start, &strained, (&turning, &turned_w), &straight, p)
        } else {
            straight
        };
        let (translation, turn) = halves(&moved);
        state.translation_w += translation;
        state.rotation = so3::exp(&turn) * start.rotation;
        state.twist_w += gained;
        // Under a set-point that does not rotate, the work is known well enough for every spring.
        let swings = self.law.swing * p.period > SWINGS && self.setpoint_velocity == Vector3::zeros();
        if (swings || !p.shows_bend) && self.spring.has_potential() {
            let yielded = moved - (rates.0 - start.twist_w) * p.period;
            let work = self.law.mass.apply(&self.push).dot(&yielded)
                + strained.wrench.dot(&(rates.0 - start.twist_w)) * p.period;
            self.keep_passive(state, &start, work);
        }
    }

    /// Removes from the motion the energy beyond that of the start and the work done on it.
    fn keep_passive(&self, state: &mut AdmittanceState, start: &AdmittanceState, work: f64) {
        let moving = |s: &AdmittanceState| 0.5 * s.twist_w.dot(&self.law.mass.apply(&s.twist_w));
        let stored = |s: &AdmittanceState| self.spring.energy(&s.translation_w, &s.rotation, B::COUPLED);
        let left = moving(start) + stored(start) + work - stored(state);
        if left < 0.0 {
            *state = AdmittanceState { twist_w: Vector6::zeros(), ..*start };
        } else if moving(state) > left {
            state.twist_w *= libm::sqrt(left / moving(state));
        }
    }

    /// The parts that the spring and the rotating set-point add to the linear motion are described by their value and
    /// slope at the start and their value at the end, as a polynomial of second degree in time. The method has third
    /// order, and is exact if the spring is linear.
    #[inline(always)]
    fn bent(
        &self,
        start: &AdmittanceState,
        strained: &Strained,
        (turning, turned_w): (&Vector3, &Vector3),
        straight: &(Vector6, Vector6),
        p: &Propagator<B>,
    ) -> (Vector6, Vector6) {
        let (v, w) = halves(&start.twist_w);
        let bend =
            self.spring.rate(strained, (&start.translation_w, &start.rotation), (&v, turning), B::COUPLED);
        let slope = (
            join(&Vector3::zeros(), &turned_w.cross(turning)) * p.period,
            self.law.mass_inverse.apply(&bend) * -p.period,
        );
        let bent = p.linear.apply(&slope);
        let (moved, gained) = (straight.0 + bent.0, straight.1 + bent.1);

        let (translation, turn) = halves(&moved);
        let step = so3::exp(&turn);
        let translation_w = start.translation_w + translation;
        let end = self.spring.at(&translation_w, &(step * start.rotation), B::COUPLED).wrench;
        let rest = end - strained.wrench - self.spring.linear(&moved, B::COUPLED);
        let kept_w = step * turned_w;
        let turning_at_end = w + gained.fixed_rows::<3>(3) + self.setpoint_velocity - kept_w;
        // Inverse of the exponential's derivative; the rest is of fourth order in `turn`.
        let c = turn.cross(&turning_at_end);
        let turn_rate = turned_w - kept_w - 0.5 * c + turn.cross(&c) / 12.0;
        let left =
            (join(&Vector3::zeros(), &turn_rate) - slope.0, -self.law.mass_inverse.apply(&rest) - slope.1);
        let bent = p.squared.apply(&left);
        (moved + bent.0, gained + bent.1)
    }

    /// Moves by a small part of a period, forwards or backwards.
    fn taylor_step(&self, state: &mut AdmittanceState, dt: f64) {
        let (v, w) = halves(&state.twist_w);
        let turning = w + self.setpoint_velocity - state.rotation * self.setpoint_velocity;
        let acceleration = self.acceleration(state, &self.strained(state));
        let jerk =
            -self.law.damping_rate.apply(&acceleration) - self.law.stiffness_rate.apply(&join(&v, &turning));
        let moved = (join(&v, &turning) + (acceleration + jerk * (dt / 3.0)) * (0.5 * dt)) * dt;
        let (translation, turn) = halves(&moved);
        state.translation_w += translation;
        state.rotation = so3::exp(&turn) * state.rotation;
        state.twist_w += (acceleration + jerk * (0.5 * dt)) * dt;
    }
}
