//! Corrects a vehicle's model from contact-free hovers: mass, thrust, rotor axes, drag moment and centre of mass,
//! split into these causes by their prior standard deviations, so that the correction holds at other attitudes, too.
//!
//! A level hover separates few of these causes: a wrong mass and a wrong thrust look the same, and so do a displaced
//! centre of mass and unequal rotors. Hovers at several attitudes determine what causes the false contact at any
//! attitude. What no hover determines (the ratio of mass and thrust, the tool's tip) keeps its value and its prior
//! deviation.

mod estimate;
mod flight;
mod hover;
mod slow;

pub use flight::{Calibration, calibration_flight};
pub use hover::{HoverSample, SETTLE, SHORTEST};

use crate::{
    Vehicle,
    types::{RotorVector, Vector3, Wrench},
};
use core::fmt;
use estimate::Estimate;
use hover::{Hover, HoverMeter};
use slow::SlowLearner;

/// Largest number of hovers; the newest are kept.
pub const MAX_HOVERS: usize = 8;
/// Tilt for which the false contact is predicted, rad.
pub const TILT: f64 = 15.0 * core::f64::consts::PI / 180.0;
/// Largest difference of a block of a hover from the whole hover: force, N, and torque, N m.
const STEADY: (f64, f64) = (0.15, 0.05);
/// How many standard deviations a misfit may be above its mean, and an unknown from its prior.
const CREDIBLE: (f64, f64) = (6.0, 5.0);

/// Standard deviations of a model's errors before any flight.
///
/// A flight without contact shows the ratio of thrust and mass. Their deviations divide an error of this ratio between
/// them. What remains wrong in both scales every observed force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelPrior {
    /// Of the mass, as a fraction.
    pub mass: f64,
    /// Of the thrust of all rotors, as a fraction.
    pub thrust: f64,
    /// Of the thrust of each rotor in addition.
    pub thrust_each: f64,
    /// Of the drag moment of all rotors, as a fraction.
    pub drag_moment: f64,
    /// Of a rotor's axis, rad about each axis across it.
    pub rotor_axis: f64,
    /// Of the centre of mass, m per axis.
    pub centre_of_mass: f64,
    /// Of the accelerometer's bias that the estimator does not remove, m/s^2 per axis.
    pub accelerometer_bias: f64,
}

impl ModelPrior {
    /// The prior of a vehicle from its drawings.
    pub const CAD: Self = Self {
        mass: 0.03,
        thrust: 0.05,
        thrust_each: 0.03,
        drag_moment: 0.15,
        rotor_axis: 1.5 * core::f64::consts::PI / 180.0,
        centre_of_mass: 0.006,
        accelerometer_bias: 0.02,
    };
}

/// Standard deviations of a model's errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ModelDeviation {
    /// Of the mass, as a fraction.
    pub mass: f64,
    /// Of each rotor's thrust, as a fraction.
    pub thrust: RotorVector,
    /// Of each rotor's axis, rad.
    pub rotor_axis: RotorVector,
    /// Of the drag moment, as a fraction.
    pub drag_moment: f64,
    /// Of the centre of mass, m, robot.
    pub centre_of_mass_r: Vector3,
    /// Of the accelerometer's bias that the estimator does not remove, m/s^2, robot.
    pub accelerometer_bias_r: Vector3,
    /// Of the force that is taken for contact in hovers tilted by [`TILT`], N.
    pub false_force: f64,
    /// Of the torque about the centre of mass that is taken for contact in these hovers, N m.
    pub false_torque: f64,
}

/// The excitation is sufficient if the hovers reduced a deviation by at least this part.
pub const EXCITED: f64 = 0.5;

impl ModelDeviation {
    /// The deviations of a vehicle before any flight.
    #[must_use]
    pub fn prior(vehicle: &Vehicle, prior: &ModelPrior) -> Self {
        Estimate::prior().deviations(vehicle, prior)
    }

    /// Whether the hovers determined the false contact at other attitudes, too, compared with the one `before`.
    #[must_use]
    pub fn is_excited(&self, before: &Self) -> bool {
        let told = 1.0 - EXCITED;
        self.false_force <= told * before.false_force && self.false_torque <= told * before.false_torque
    }
}

/// The reason why nothing is learnt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// No hover lasted long enough.
    NoHover,
    /// The wrench of a hover (number, from 1) changed by this much while it lasted.
    NotStill {
        /// The hover, from 1.
        hover: usize,
        /// Force, N.
        force: f64,
        /// Torque, N m.
        torque: f64,
    },
    /// Errors of the model alone cannot explain the hovers.
    NotTheModel {
        /// Largest external force of a hover as the model has it, N.
        force: f64,
        /// Largest external torque of a hover as the model has it, N m.
        torque: f64,
    },
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoHover => write!(
                f,
                "no hover was still for {SHORTEST} s; expected one or more to learn the model from: the set-point must \
                 rest, and nothing may touch the vehicle"
            ),
            Self::NotStill { hover, force, torque } => write!(
                f,
                "the wrench changed by {force:.2} N and {torque:.3} N m during hover {hover}; expected at most {} N \
                 and {} N m: nothing may touch the vehicle, and the air must be still",
                STEADY.0, STEADY.1
            ),
            Self::NotTheModel { force, torque } => write!(
                f,
                "an external wrench of up to {force:.2} N and {torque:.3} N m is not what errors of the model make; \
                 expected a vehicle that nothing touches and that is the configured one within its drawings"
            ),
        }
    }
}

/// The result of learning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learnt {
    /// The vehicle after the correction.
    pub vehicle: Vehicle,
    /// Its centre of mass relative to the one of the model before, m, robot.
    pub centre_r: Vector3,
    /// Standard deviations of the remaining errors of the model.
    pub deviation: ModelDeviation,
    /// Mean squared normalised innovation: about 1 if the deviations are right.
    pub misfit: f64,
    /// Number of hovers from which it was learnt.
    pub hovers: usize,
}

/// Collects hovers, and learns from them.
#[derive(Clone, Copy, Debug, Default)]
pub struct ModelLearner {
    meter: HoverMeter,
    hovers: [Hover; MAX_HOVERS],
    count: usize,
    total: usize,
    refusal: Option<Refusal>,
    /// Learns slowly after the last calibration that was not refused.
    slow: Option<SlowLearner>,
}

impl ModelLearner {
    /// One tick without contact; `still` says whether the set-point is at rest.
    pub fn observe(&mut self, vehicle: &Vehicle, still: bool, sample: &HoverSample, dt: f64) {
        if still {
            self.meter.add(vehicle, sample, dt);
        } else {
            self.close(vehicle);
        }
    }

    fn close(&mut self, vehicle: &Vehicle) {
        let Some((hover, away)) = self.meter.finish(vehicle).filter(|(hover, _)| hover.is_finite()) else {
            return;
        };
        self.total = self.total.saturating_add(1);
        if !is_steady(&away) {
            let (force, torque) = (away.force.norm(), away.torque.norm());
            self.refusal.get_or_insert(Refusal::NotStill { hover: self.total, force, torque });
        }
        self.hovers.rotate_right(1);
        if let Some(first) = self.hovers.first_mut() {
            *first = hover;
        }
        self.count = (self.count + 1).min(MAX_HOVERS);
    }

    /// Learns the vehicle's model from the hovers since the last call.
    ///
    /// # Errors
    /// Why the hovers do not determine the model. The learner starts again in this case too.
    pub fn finish(&mut self, vehicle: &Vehicle, prior: &ModelPrior) -> Result<Learnt, Refusal> {
        self.close(vehicle);
        let done = core::mem::take(self);
        self.slow = done.slow;
        if let Some(refusal) = done.refusal {
            return Err(refusal);
        }
        let hovers = done.hovers.get(..done.count).unwrap_or(&[]);
        if hovers.is_empty() {
            return Err(Refusal::NoHover);
        }
        let estimate = Estimate::of(vehicle, prior, hovers);
        let correction = estimate.correction(vehicle, prior);
        let freedom = 6.0 * hovers.len() as f64;
        let credible = freedom + CREDIBLE.0 * libm::sqrt(2.0 * freedom);
        let possible = estimate.misfit <= credible && estimate.is_within(CREDIBLE.1);
        let corrected = vehicle.corrected(&correction).filter(|_| possible);
        let Some(corrected) = corrected else {
            let largest = |of: fn(&Wrench) -> f64| {
                hovers.iter().map(|hover| of(&hover.wrench(vehicle))).fold(0.0, f64::max)
            };
            let (force, torque) = (largest(|w| w.force.norm()), largest(|w| w.torque.norm()));
            return Err(Refusal::NotTheModel { force, torque });
        };
        let learnt = Learnt {
            deviation: estimate.deviations(&corrected, prior),
            vehicle: corrected,
            centre_r: correction.centre_r,
            misfit: estimate.misfit / freedom,
            hovers: hovers.len(),
        };
        self.slow = Some(SlowLearner::new(*vehicle, estimate, &learnt));
        Ok(learnt)
    }

    /// One tick of the flight after a calibration, without a known contact; `still` says whether the set-point is at rest. At the
    /// end of a hover that errors of the model explain, the model that is corrected by it. A hover of a vehicle that is touched
    /// changes nothing.
    pub fn observe_slowly(
        &mut self,
        vehicle: &Vehicle,
        prior: &ModelPrior,
        still: bool,
        sample: &HoverSample,
        dt: f64,
    ) -> Option<Learnt> {
        let slow = self.slow.as_mut()?;
        if still {
            return slow.hover(vehicle, prior, sample, dt);
        }
        slow.wait(dt);
        None
    }

    /// The hovers of a calibration that is not over are forgotten.
    pub fn give_up(&mut self) {
        self.meter.give_up();
        (self.count, self.total, self.refusal) = (0, 0, None);
    }
}

/// Whether no block of a hover differs from the whole hover by more than [`STEADY`].
fn is_steady(away: &Wrench) -> bool {
    away.force.norm() <= STEADY.0 && away.torque.norm() <= STEADY.1
}
