//! Learning that goes on after a calibration: slowly, from hovers without contact in the mission.
//!
//! The estimate of the calibration is the prior. From hover to hover mass, thrust and centre of mass stray (a payload that is
//! used up, a battery whose voltage changes what a throttle does), and so does the accelerometer's bias. A hover that differs
//! from the expected one by more than both uncertainties is not of the model: something touches the vehicle. It changes
//! nothing, not even the uncertainty, so that a touch that lasts stays a touch.

use super::{
    Learnt, ModelPrior,
    estimate::{ACCELEROMETER_BIAS, CENTRE_OF_MASS, Estimate, MASS, THRUST},
    hover::{HoverMeter, HoverSample},
};
use crate::{Vehicle, types::Vector3};
use core::ops::Range;

/// The unknowns that stray, and the time in which each changes by its prior deviation, s.
const STRAYS: [(Range<usize>, f64); 3] =
    [(MASS..THRUST + 1, 10_800.0), (CENTRE_OF_MASS, 10_800.0), (ACCELEROMETER_BIAS, 60.0)];
/// They stray for at most this time between two hovers, s.
const LONGEST: f64 = 10.0;
/// Largest innovation of each component of a hover's wrench, in standard deviations.
const CREDIBLE: f64 = 3.5;

/// What the calibration showed, and each hover since.
#[derive(Clone, Copy, Debug)]
pub(super) struct SlowLearner {
    /// The vehicle before the calibration: the estimate refers to it.
    before: Vehicle,
    estimate: Estimate,
    /// The centre of mass, from the one of the vehicle before, m, robot.
    centre_r: Vector3,
    hovers: usize,
    meter: HoverMeter,
    /// Time since the last hover, s.
    elapsed: f64,
}

impl SlowLearner {
    pub(super) fn new(before: Vehicle, estimate: Estimate, learnt: &Learnt) -> Self {
        let meter = HoverMeter::default();
        Self { before, estimate, centre_r: learnt.centre_r, hovers: learnt.hovers, meter, elapsed: 0.0 }
    }

    /// Time passes without a hover.
    pub(super) fn wait(&mut self, dt: f64) {
        self.meter.give_up();
        self.elapsed += dt;
    }

    /// One tick of a set-point at rest. At the end of a hover that errors of the model explain, the corrected model.
    pub(super) fn hover(
        &mut self,
        vehicle: &Vehicle,
        prior: &ModelPrior,
        sample: &HoverSample,
        dt: f64,
    ) -> Option<Learnt> {
        self.elapsed += dt;
        self.meter.add(vehicle, sample, dt);
        if !self.meter.is_full() {
            return None;
        }
        let (hover, away) = self.meter.finish(vehicle)?;
        if !(hover.is_finite() && super::is_steady(&away)) {
            return None;
        }
        let mut estimate = self.estimate;
        for (unknowns, time) in STRAYS {
            estimate.stray(unknowns, self.elapsed.min(LONGEST) / time);
        }
        let largest = estimate.absorb(&self.before, prior, &estimate.about(), &hover, false);
        if !(largest <= CREDIBLE && estimate.is_within(super::CREDIBLE.1)) {
            return None;
        }
        let correction = estimate.correction(&self.before, prior);
        let corrected = self.before.corrected(&correction)?;
        let deviation = estimate.deviations(&corrected, prior);
        let centre_r = correction.centre_r - self.centre_r;
        let hovers = self.hovers.saturating_add(1);
        (self.estimate, self.centre_r, self.hovers) = (estimate, correction.centre_r, hovers);
        self.elapsed = 0.0;
        let misfit = estimate.misfit / (6.0 * hovers as f64);
        Some(Learnt { vehicle: corrected, centre_r, deviation, misfit, hovers })
    }
}
