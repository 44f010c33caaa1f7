//! Whether a vehicle lies still, by its IMU alone. Without poses neither place nor speed shows the ground.

use super::landing::Seen;
use crate::{GRAVITY, types::Vector3};

/// A vehicle that lies still feels its weight to within this part of it, which is more than the bias of an accelerometer, and
/// turns by less than this, rad/s, in the mean over this time, s. A push that carries it in the air mostly turns it, or is not
/// its weight.
const AT_REST: (f64, f64, f64) = (0.11, 0.5, 0.3);

/// What the IMU has felt in the mean: specific force, m/s^2, robot, and angular rate, rad/s; and for how long it has felt
/// nothing, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rest {
    force_r: Vector3,
    turning: f64,
    unfelt: f64,
}

impl Default for Rest {
    fn default() -> Self {
        Self { force_r: Vector3::zeros(), turning: 0.0, unfelt: 0.0 }
    }
}

impl Rest {
    /// One tick: whether the vehicle lies still; `None` if nothing has been felt for some time.
    pub(super) fn step(&mut self, seen: &Seen, dt: f64) -> Option<bool> {
        let (off, most, mean) = AT_REST;
        if let Some((force_r, turning)) = seen.felt {
            let share = (dt / mean).min(1.0);
            self.force_r += (force_r - self.force_r) * share;
            self.turning += (turning - self.turning) * share;
            self.unfelt = 0.0;
        } else {
            // A few samples that are missing change no mean.
            self.unfelt += dt;
            if self.unfelt > mean {
                *self = Self { unfelt: self.unfelt, ..Self::default() };
                return None;
            }
        }
        let still = (self.force_r.norm() - GRAVITY).abs() < off * GRAVITY && self.turning < most;
        Some(still)
    }
}
