//! Rotor speeds that are measured with an age.

use crate::types::RotorVector;

/// How many samples are kept: 64 ms at 1 kHz.
const KEPT: usize = 64;
/// The largest age, s, that samples 1 ms apart can give.
pub const LARGEST: f64 = 0.05;

/// The last speeds, newest first, each with the time from the next older ones to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Past {
    samples: [(f64, RotorVector); KEPT],
    count: usize,
}

impl Default for Past {
    fn default() -> Self {
        Self { samples: [(0.0, RotorVector::zeros()); KEPT], count: 0 }
    }
}

impl Past {
    /// Adds the speeds, Hz, at a time `dt` seconds after the last ones.
    pub fn push(&mut self, speeds: &RotorVector, dt: f64) {
        self.samples.rotate_right(1);
        let [newest, ..] = &mut self.samples;
        *newest = (dt, *speeds);
        self.count = (self.count + 1).min(KEPT);
    }

    /// The speeds that were true `age` seconds before the newest, between samples by a straight line;
    /// the oldest where none is that old, `None` where there is none at all.
    #[must_use]
    pub fn at(&self, age: f64) -> Option<RotorVector> {
        let mut known = self.samples.iter().take(self.count);
        let (mut gap, mut newer) = *known.next()?;
        let mut left = age;
        for (next_gap, older) in known {
            if left < gap {
                return Some(newer + (older - newer) * (left / gap));
            }
            left -= gap;
            (gap, newer) = (*next_gap, *older);
        }
        Some(newer)
    }
}
