//! Wind or contact: which part of an observed wrench may move the tool.
//!
//! Two causes explain the observed wrench. Wind causes the drag of the airspeed `v - W`, whose torque about the tool
//! is that of a force at the rotors and the airframe; W changes slowly. A touch causes a force at the tool, with
//! little torque about it, and begins suddenly. A Kalman filter estimates the wind W, a random walk that is observed
//! through the drag of the model, while nothing touches the tool. During a touch W returns to its mean; if touches have
//! no torque about the tool (`point_contact`), the torque corrects W, too. At the same time the log-odds of contact
//! are computed: the logarithm of the ratio of the likelihoods of the innovation
//!
//! ```text
//! n = h_hat - drag(v - W),   without contact: N(0, J P J' + R),   with contact: N(0, J P J' + R + C),
//! ```
//!
//! where h_hat is the observed wrench, J the derivative of the drag with respect to W, P the covariance of W, R the
//! covariance of the observed wrench without wind and contact, and C that of touches. The ratio is summed over
//! independent samples, one in `2 / L` for an observer of rate L, and bounded, so that it forgets. The method follows
//! Tomic, Lutz, Schmid, Mathers, Haddadin, arXiv 1810.12908, who also distinguish wind and contact by a model of drag.
//!
//! Only the contact moves the admittance filter; the whole observed wrench, with the wind, is compensated.

use crate::{
    Error, Vehicle,
    error::check_range,
    filters::lag_fraction,
    plant::{BodyDrag, Effects, RotorDrag, Rotors},
    types::{Matrix3, RobotState, RotorVector, Vector3, Wrench, is_finite3},
    wrench_observer::tool_wrench,
};
use libm::{exp, log};

/// Bounds of the log-odds of contact. They determine how soon the log-odds can change their sign.
const BOUND: f64 = 4.0;
/// The part of the contact that moves the filter grows between these log-odds.
const RAMP: (f64, f64) = (0.0, 2.0);
/// The wind is learnt while the log-odds of contact are below this.
const LEARNS: f64 = -1.0;
/// The mean of the wind is taken over the last time of this length in which the wind was learnt, s.
const MEAN: f64 = 10.0;
/// Time constant with which the wind returns to its mean during a touch, s: a gust of 20 m passes in about this time in a
/// wind of 3 m/s.
const GUST: f64 = 6.0;
/// A wind that differs from its mean by more than this many deviations of its gusts, for a time of `LASTS`, is another wind:
/// its mean begins anew. A touch that begins slowly is recognised sooner.
const JUMP: f64 = 2.0;
/// This time, s.
const LASTS: f64 = 1.0;
/// A torque about the tool that is larger than this many deviations of gusts and noise is one of the touch.
const WITHIN: f64 = 2.0;
/// Errors of the model in the torque stay about this long, s.
const STEADY: f64 = 2.0;
/// Change of the wind, m/s, for the derivative of its drag.
const STEP: f64 = 0.1;

/// How wind and contact are distinguished.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactParams {
    /// Whether they are distinguished. If not, the whole observed wrench counts as contact.
    pub discrimination: bool,
    /// Drag of the rotors.
    pub rotor_drag: RotorDrag,
    /// Drag of the airframe.
    pub body_drag: BodyDrag,
    /// Density of the air, kg/m^3.
    pub air_density: f64,
    /// The random walk of the wind.
    pub wind: WindWalk,
    /// Standard deviations of the wrench that is observed without wind and contact, N and N m, about the tool.
    pub noise: (f64, f64),
    /// Sizes of touches, N and N m, about the tool.
    pub touch: (f64, f64),
    /// Whether touches are at the tip of the tool only, where they have no torque about it. Then the torque shows the gusts
    /// during a touch.
    pub point_contact: bool,
    /// Rate of the wrench observer, 1/s: two samples are independent after twice its inverse.
    pub rate: f64,
}

/// How far a wind strays: it changes by its deviations in a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindWalk {
    /// Standard deviation of each horizontal component, m/s.
    pub horizontal: f64,
    /// Standard deviation of the vertical component, m/s, and of the gusts in every direction. Near the ground there are only
    /// gusts along the vertical.
    pub vertical: f64,
    /// The time in which each component changes by its deviation, s.
    pub time: f64,
}

impl WindWalk {
    /// A wind of 3 m/s. Its gusts, also the vertical ones, deviate by 0.2 of it (Stull, Boundary Layer Meteorology, ch. 1).
    pub const DEFAULT: Self = Self { horizontal: 3.0, vertical: 0.6, time: 60.0 };

    /// Variances of the components before any observation, (m/s)^2, world.
    fn variances_w(&self) -> Vector3 {
        Vector3::new(self.horizontal, self.horizontal, self.vertical).map(|x| x * x)
    }

    /// The covariance of the wind `dt` seconds later. No variance grows beyond its first value.
    fn grown(&self, covariance: Option<Matrix3>, dt: f64) -> Matrix3 {
        let first = self.variances_w();
        let Some(covariance) = covariance else { return Matrix3::from_diagonal(&first) };
        let room = (first - covariance.diagonal()).map(|x| x.max(0.0));
        covariance + Matrix3::from_diagonal(&(first * (dt / self.time)).inf(&room))
    }
}

impl Default for ContactParams {
    fn default() -> Self {
        Self {
            discrimination: false,
            rotor_drag: RotorDrag::default(),
            body_drag: BodyDrag::default(),
            air_density: Effects::OFF.air_density,
            wind: WindWalk::DEFAULT,
            noise: (0.08, 0.03),
            touch: (0.7, 0.1),
            point_contact: false,
            rate: 30.0,
        }
    }
}

impl ContactParams {
    /// Checks the parameters.
    ///
    /// # Errors
    /// The error names the parameter that is out of range.
    pub fn checked(self) -> Result<Self, Error> {
        check_range("rotor_drag", self.rotor_drag.drag, 0.0, 1.0)?;
        for area in self.body_drag.area_r.iter() {
            check_range("drag_area", *area, 0.0, 10.0)?;
        }
        for place in self.body_drag.centre_r.iter() {
            check_range("centre_of_pressure", *place, -10.0, 10.0)?;
        }
        check_range("air_density", self.air_density, 0.0, 10.0)?;
        check_range("wind_deviation", self.wind.horizontal, 1e-3, 50.0)?;
        check_range("vertical_wind_deviation", self.wind.vertical, 1e-3, 50.0)?;
        check_range("wind_time", self.wind.time, 0.1, 1e4)?;
        check_range("force_noise", self.noise.0, 1e-3, 10.0)?;
        check_range("torque_noise", self.noise.1, 1e-4, 10.0)?;
        check_range("touch_force", self.touch.0, 1e-3, 100.0)?;
        check_range("touch_torque", self.touch.1, 1e-3, 100.0)?;
        check_range("rate of the observer (1/s)", self.rate, 1e-6, 1e5)?;
        Ok(self)
    }

    /// Separates the contact from an observed wrench, `dt` seconds after the last one.
    #[inline]
    pub fn step(&self, state: &mut ContactState, seen: &Seen<'_>, dt: f64) -> Contact {
        if !self.discrimination {
            return Contact {
                wind_w: Vector3::zeros(),
                log_odds: BOUND,
                drag_tool_w: Wrench::ZERO,
                part: 1.0,
            };
        }
        let drag = self.drag(seen, &state.wind_w);
        let innovation = *seen.wrench_tool_w - drag;
        let slope = self.slope(seen, &state.wind_w, &drag);
        let (force, torque) = self.noise;
        let noise = [force * force, torque * torque];
        let touched = [noise[0] + self.touch.0 * self.touch.0, noise[1] + self.touch.1 * self.touch.1];
        let covariance = self.wind.grown(state.covariance, dt);
        let free = Fit::of(&innovation, &slope, &covariance, noise);
        let contact = Fit::of(&innovation, &slope, &covariance, touched);
        let independent = (0.5 * self.rate * dt).min(1.0);
        if let (Some(free), Some(contact)) = (&free, &contact) {
            let odds = state.log_odds + independent * (contact.log_likelihood - free.log_likelihood);
            if odds.is_finite() {
                state.log_odds = odds.clamp(-BOUND, BOUND);
            }
        }
        state.covariance = Some(covariance);
        if state.log_odds >= LEARNS {
            self.gust_passes(state, &innovation, &slope, dt);
        } else if independent > 0.0 {
            let sampled = noise.map(|variance| variance / independent);
            if let Some(fit) = Fit::of(&innovation, &slope, &covariance, sampled) {
                state.learn(&fit);
                let away = (state.wind_w - state.mean_w).amax() > JUMP * self.wind.vertical;
                state.away = if away { state.away + dt } else { 0.0 };
                if state.away > LASTS {
                    (state.learnt, state.away) = (0.0, 0.0);
                }
                state.learnt = (state.learnt + dt).min(MEAN);
                state.mean_w += (state.wind_w - state.mean_w) * (dt / state.learnt).min(1.0);
            }
        }
        let (from, to) = RAMP;
        Contact {
            wind_w: state.wind_w,
            log_odds: state.log_odds,
            drag_tool_w: drag,
            part: ((state.log_odds - from) / (to - from)).clamp(0.0, 1.0),
        }
    }

    /// The wind during a touch, `dt` seconds later. It returns to its mean: the last gust does not last, and the first moments
    /// of a contact were learnt as one. A torque that gusts explain shows them, if touches have none.
    fn gust_passes(&self, state: &mut ContactState, innovation: &Wrench, slope: &[Matrix3; 2], dt: f64) {
        let gust = self.wind.vertical;
        let back = lag_fraction(1.0 / GUST, dt);
        state.away = 0.0;
        let keep = (1.0 - back) * (1.0 - back);
        state.wind_w += (state.mean_w - state.wind_w) * back;
        let before = state.covariance.unwrap_or_else(Matrix3::zeros);
        let covariance = before * keep + Matrix3::identity() * (gust * gust * (1.0 - keep));
        state.covariance = Some(covariance);
        let noise = self.noise.1;
        let explained = innovation.torque.norm() <= WITHIN * (noise + slope[1].norm() * gust);
        if !(self.point_contact && explained && dt > 0.0) {
            return;
        }
        // Any force can be that of the touch.
        let sampled = [f64::INFINITY, noise * noise * 2.0 * STEADY / dt];
        if let Some(fit) = Fit::of(innovation, slope, &covariance, sampled) {
            state.learn(&fit);
        }
    }

    /// The drag in a wind, m/s, world, as a wrench about the tool, world.
    fn drag(&self, seen: &Seen<'_>, wind_w: &Vector3) -> Wrench {
        let effects = Effects {
            air_density: self.air_density,
            rotor_drag: self.rotor_drag,
            body_drag: self.body_drag,
            ..Effects::OFF
        };
        let rotors = Rotors { speeds: *seen.rotor_speeds, accelerations: RotorVector::zeros() };
        let r = &seen.robot.rotation_wr;
        let drag_r = effects.wrench(seen.vehicle, seen.robot, &rotors, wind_w);
        let drag = Wrench { force: r * drag_r.force, ..drag_r };
        tool_wrench(&drag, r, &seen.vehicle.tool().position_r)
    }

    /// Its derivatives by the components of the wind, force and torque.
    fn slope(&self, seen: &Seen<'_>, wind_w: &Vector3, drag: &Wrench) -> [Matrix3; 2] {
        let by = |axis: Vector3| self.drag(seen, &(wind_w + axis * STEP)) - *drag;
        let [x, y, z] = [by(Vector3::x()), by(Vector3::y()), by(Vector3::z())];
        [
            Matrix3::from_columns(&[x.force, y.force, z.force]) / STEP,
            Matrix3::from_columns(&[x.torque, y.torque, z.torque]) / STEP,
        ]
    }
}

/// The inputs of the discrimination.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// The vehicle.
    pub vehicle: &'a Vehicle,
    /// Its pose and twist.
    pub robot: &'a RobotState,
    /// Measured rotor speeds, Hz.
    pub rotor_speeds: &'a RotorVector,
    /// The observed wrench about the tool, world.
    pub wrench_tool_w: &'a Wrench,
}

/// The state of wind and contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactState {
    wind_w: Vector3,
    /// Its mean over the last time without contact, m/s, world, and the length of that time, s.
    mean_w: Vector3,
    learnt: f64,
    /// How long the wind has been far from its mean, s.
    away: f64,
    /// Covariance of the wind, (m/s)^2, once there is one.
    covariance: Option<Matrix3>,
    log_odds: f64,
}

impl ContactState {
    /// Corrects the wind.
    fn learn(&mut self, fit: &Fit) {
        let wind_w = self.wind_w + fit.correction;
        if is_finite3(&wind_w) {
            (self.wind_w, self.covariance) = (wind_w, Some(fit.covariance));
        }
    }
}

impl Default for ContactState {
    fn default() -> Self {
        Self {
            wind_w: Vector3::zeros(),
            mean_w: Vector3::zeros(),
            learnt: 0.0,
            away: 0.0,
            covariance: None,
            log_odds: -BOUND,
        }
    }
}

/// The parts of an observed wrench.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Estimated velocity of the air, m/s, world.
    pub wind_w: Vector3,
    /// Log-odds of contact, -4 to 4.
    pub log_odds: f64,
    /// Drag of the airspeed as a wrench about the tool, world; it is not contact.
    pub drag_tool_w: Wrench,
    /// The part of the rest that moves the admittance filter: 0 to 1.
    pub part: f64,
}

/// The likelihood, 0 to 1, of log-odds.
pub(crate) fn likelihood_of(log_odds: f64) -> f64 {
    1.0 / (1.0 + exp(-log_odds))
}

/// An innovation with a wind of covariance P and a noise of diagonal covariance D, by the Woodbury identity: `S^-1 =
/// D^-1 - D^-1 J Q J' D^-1`, `Q = (P^-1 + J' D^-1 J)^-1`.
struct Fit {
    /// Without the terms that do not depend on D.
    log_likelihood: f64,
    /// Correction of the wind, m/s.
    correction: Vector3,
    covariance: Matrix3,
}

impl Fit {
    fn of(n: &Wrench, slope: &[Matrix3; 2], covariance: &Matrix3, noise: [f64; 2]) -> Option<Self> {
        let (mut information, mut weighed) = (covariance.try_inverse()?, Vector3::zeros());
        let (mut square, mut volume) = (0.0, 0.0);
        for ((n, slope), variance) in [n.force, n.torque].iter().zip(slope).zip(noise) {
            information += slope.transpose() * slope / variance;
            weighed += slope.transpose() * n / variance;
            square += n.norm_squared() / variance;
            volume += 3.0 * log(variance);
        }
        let known = information.try_inverse()?;
        let correction = known * weighed;
        let square = square - weighed.dot(&correction);
        let log_likelihood = -0.5 * (square + volume + log(information.determinant()));
        Some(Self { log_likelihood, correction, covariance: 0.5 * (known + known.transpose()) })
    }
}

#[cfg(test)]
mod tests;
