//! The bias of the wrench observer: its mean over a contact-free hover
//! ("Practical Implementation" in the paper; docs/laws.md).

use crate::types::{Matrix3, Wrench};

/// Running mean of the observed wrench, in robot coordinates: the wrench of errors of mass, thrust and inertia turns
/// with the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BiasEstimator {
    mean_r: Wrench,
    /// Sums of the squared distances from the mean over time, N^2 s and (N m)^2 s.
    squares: (f64, f64),
    time: f64,
}

impl BiasEstimator {
    /// Adds an estimate (force W, torque R) that was constant for `dt` seconds.
    pub fn add(&mut self, wrench: &Wrench, rotation_wr: &Matrix3, dt: f64) {
        if !(wrench.is_finite() && dt > 0.0) {
            return;
        }
        self.time += dt;
        let weight = dt / self.time;
        let force = rotation_wr.transpose() * wrench.force - self.mean_r.force;
        let torque = wrench.torque - self.mean_r.torque;
        self.mean_r.force += force * weight;
        self.mean_r.torque += torque * weight;
        let kept = dt * (1.0 - weight);
        self.squares.0 += kept * force.norm_squared();
        self.squares.1 += kept * torque.norm_squared();
    }

    /// Standard deviations of force, N, and torque, N m, from their means.
    #[must_use]
    pub fn spread(&self) -> (f64, f64) {
        let time = self.time.max(1e-9);
        (libm::sqrt(self.squares.0 / time), libm::sqrt(self.squares.1 / time))
    }

    /// The mean up to now (force and torque in R), and its duration, s.
    #[must_use]
    pub fn mean(&self) -> (Wrench, f64) {
        (self.mean_r, self.time)
    }
}
