//! The bias of the wrench observer: its mean over a contact-free hover
//! ("Practical Implementation" in the paper; docs/laws.md).

use crate::types::{Matrix3, Wrench};

/// Running mean of the observed wrench, in robot coordinates: what errors of
/// mass, thrust and inertia leave turns with the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BiasEstimator {
    mean_r: Wrench,
    time: f64,
}

impl BiasEstimator {
    /// Takes in an estimate (force W, torque R) that held for `dt` seconds.
    pub fn add(&mut self, wrench: &Wrench, rotation_wr: &Matrix3, dt: f64) {
        if !(wrench.is_finite() && dt > 0.0) {
            return;
        }
        self.time += dt;
        let weight = dt / self.time;
        self.mean_r.force += (rotation_wr.transpose() * wrench.force - self.mean_r.force) * weight;
        self.mean_r.torque += (wrench.torque - self.mean_r.torque) * weight;
    }

    /// The mean so far (force and torque in R), and the seconds it was taken over.
    #[must_use]
    pub fn mean(&self) -> (Wrench, f64) {
        (self.mean_r, self.time)
    }
}
