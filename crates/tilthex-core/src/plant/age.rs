//! Past rotor speeds, for a measurement that has an age.

use crate::{ring::Ring, types::RotorVector};

/// Number of samples: 64 ms at 1 kHz.
const KEPT: usize = 64;
/// The largest age, s, if samples are 1 ms apart.
pub const LARGEST: f64 = 0.05;

/// The last speeds, each with the time from the next older speeds to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Past {
    samples: Ring<(f64, RotorVector), KEPT>,
    count: usize,
}

impl Default for Past {
    fn default() -> Self {
        Self { samples: Ring::new((0.0, RotorVector::zeros())), count: 0 }
    }
}

impl Past {
    /// Adds the speeds, Hz, at a time `dt` seconds after the last ones.
    pub fn push(&mut self, speeds: &RotorVector, dt: f64) {
        self.samples.push((dt, *speeds));
        self.count = (self.count + 1).min(KEPT);
    }

    /// The speeds `age` seconds before the newest ones, by linear interpolation. The oldest speeds if none are so
    /// old; `None` if there are no speeds.
    #[must_use]
    pub fn at(&self, age: f64) -> Option<RotorVector> {
        let mut known = self.samples.iter().take(self.count);
        let &(mut gap, ref first) = known.next()?;
        let mut newer = first;
        let mut left = age;
        for (next_gap, older) in known {
            if left < gap {
                return Some(newer + (older - newer) * (left / gap));
            }
            left -= gap;
            (gap, newer) = (*next_gap, older);
        }
        Some(*newer)
    }
}
