//! How far poses are believed: those that contradict the state may be right
//! (they agree with each other), or noisier than was configured (they do not).

use super::coarse::Coarse;
use crate::{types::Vector3, ukf::InitialDeviation};
use libm::sqrt;

/// This many refused poses in a row are judged together; fewer never: an outlier after a loss is no beginning.
const REFUSALS: usize = 5;
/// Poses this many times as noisy as configured say nothing.
const MOST_NOISE: f64 = 100.0;
/// This many applied poses tell how surprising poses are.
const RECENT: usize = 15;
/// Median of a chi-square variable with 6 degrees of freedom.
const EXPECTED_MEDIAN: f64 = 5.348;
/// Noises are configured at most this many times too small, squared.
const MOST_LEVEL: f64 = 100.0;
/// Two surprises say the same where their difference, squared, is below this share of one of them.
const SAME: f64 = 0.25;
/// Share of an accepted pose in what is thought of the noise.
const NOISE_SHARE: f64 = 0.05;
/// Deviations after poses have been believed against the state, at the least.
const REACQUIRED: InitialDeviation = InitialDeviation {
    position: 0.02,
    velocity: 0.3,
    rotation: 0.05,
    gyro_bias: 0.03,
    accelerometer_bias: 0.2,
};

/// Deviation of a modelled rate after poses have been believed against it, at the least, rad/s.
const MODELLED_RATE: f64 = 0.3;

/// A pose that surprised: when, and what it says beyond the state (position m, rotation rad; W).
/// Single precision: every checkpoint keeps some.
#[derive(Clone, Copy, Debug)]
pub(super) struct Said {
    /// Since the last pose that passed, s.
    age: f32,
    position: [f32; 3],
    rotation: [f32; 3],
}

impl Said {
    const NOTHING: Self = Self { age: 0.0, position: [0.0; 3], rotation: [0.0; 3] };

    pub(super) fn new(age: f64, innovation: &[f64; 6]) -> Self {
        let [x, y, z, a, b, c] = innovation.map(|entry| entry as f32);
        Self { age: age as f32, position: [x, y, z], rotation: [a, b, c] }
    }

    fn age(&self) -> f64 {
        f64::from(self.age)
    }

    fn position(&self) -> Vector3 {
        Vector3::from(self.position.map(f64::from))
    }

    fn rotation(&self) -> Vector3 {
        Vector3::from(self.rotation.map(f64::from))
    }
}

/// What has been learnt of the poses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trust {
    /// Time of the last pose that passed, s.
    pub(super) accepted: f64,
    /// Noise of the poses by what is configured, from 1 on.
    pub(super) noise: f64,
    /// The last that surprised, and how many there have been in a row.
    refused: [Said; REFUSALS],
    in_a_row: u32,
    /// Normalised innovations squared of the last poses that were applied, newest last.
    recent: [Coarse; RECENT],
}

/// What poses that were refused in a row say together: a line through what they say beyond the state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Agreement {
    /// At the newest of them: position m, velocity m/s, rotation rad; W.
    pub(super) position: Vector3,
    pub(super) velocity: Vector3,
    pub(super) rotation: Vector3,
    /// How fast that rotation grows, rad/s; W: nothing where a gyro tells the rate.
    pub(super) rate: Vector3,
    /// Their noise by what is configured, from 1 on.
    pub(super) noise: f64,
    /// What is known of the state once it has been moved by that.
    pub(super) deviation: InitialDeviation,
}

impl Trust {
    /// After a pose of that time that is believed.
    pub(super) const fn since(accepted: f64) -> Self {
        Self {
            accepted,
            noise: 1.0,
            refused: [Said::NOTHING; REFUSALS],
            in_a_row: 0,
            recent: [Coarse::ZERO; RECENT],
        }
    }

    /// How surprising poses have lately been, from 1 on: the median of their normalised innovations squared, by what
    /// is expected. Where noises are configured too small that is the rule, and no reason to doubt a pose.
    pub(super) fn level(&self) -> f64 {
        let recent = || self.recent.iter().map(|x| x.get());
        let median = recent().find(|x| {
            let below = recent().filter(|y| y <= x).count();
            let above = recent().filter(|y| y >= x).count();
            below > RECENT / 2 && above > RECENT / 2
        });
        (median.unwrap_or(0.0) / EXPECTED_MEDIAN).clamp(1.0, MOST_LEVEL)
    }

    /// A pose was applied, with that normalised innovation squared.
    pub(super) fn remember(&mut self, nis: f64) {
        self.recent.rotate_left(1);
        if let Some(slot) = self.recent.last_mut() {
            *slot = Coarse::new(nis);
        }
    }

    /// Whether the pose before surprised too, and said the same: noises of position and rotation give the measure.
    pub(super) fn repeats(&self, said: &Said, (position, rotation): (f64, f64)) -> bool {
        let Some(before) = self.refused.last().filter(|_| self.in_a_row > 0) else { return false };
        let size = |p: Vector3, r: Vector3| {
            p.norm_squared() / (position * position) + r.norm_squared() / (rotation * rotation)
        };
        let apart = size(said.position() - before.position(), said.rotation() - before.rotation());
        apart < SAME * size(said.position(), said.rotation())
    }

    /// A pose passed; `nis` is its normalised innovation squared over its degrees of freedom, as configured.
    /// Only refusals lift the noise from what is configured: chance must not.
    pub(super) fn accept(&mut self, time: f64, nis: f64) {
        if self.noise > 1.0 {
            let variance = self.noise * self.noise;
            let toward = variance + NOISE_SHARE * (nis - variance);
            self.noise = sqrt(toward.max(1.0)).min(MOST_NOISE);
        }
        (self.accepted, self.in_a_row) = (time, 0);
    }

    /// A pose surprised.
    pub(super) fn weigh(&mut self, said: Said) {
        self.refused.rotate_left(1);
        if let Some(slot) = self.refused.last_mut() {
            *slot = said;
        }
        self.in_a_row = self.in_a_row.saturating_add(1);
    }

    /// A pose contradicts the state. What it and those before it say together, where they are enough.
    /// Of the rate they tell something where it is `modelled`.
    pub(super) fn refuse(&mut self, said: Said, noise: (f64, f64), modelled: bool) -> Option<Agreement> {
        self.weigh(said);
        (self.in_a_row as usize >= REFUSALS).then(|| self.agreement(said.age(), noise, modelled))
    }

    fn agreement(
        &self,
        newest: f64,
        (position_noise, rotation_noise): (f64, f64),
        modelled: bool,
    ) -> Agreement {
        let n = REFUSALS as f64;
        let mean = self.refused.iter().fold(Vector3::zeros(), |sum, r| sum + r.position()) / n;
        let rotation = self.refused.iter().fold(Vector3::zeros(), |sum, r| sum + r.rotation()) / n;
        let middle = self.refused.iter().map(|r| r.age()).sum::<f64>() / n;
        let (mut spread, mut moment, mut turning) = (1e-9, Vector3::zeros(), Vector3::zeros());
        for r in &self.refused {
            spread += (r.age() - middle) * (r.age() - middle);
            moment += (r.position() - mean) * (r.age() - middle);
            turning += (r.rotation() - rotation) * (r.age() - middle);
        }
        let velocity = moment / spread;
        let rate = if modelled { turning / spread } else { Vector3::zeros() };
        let off = |r: &Said| r.position() - mean - velocity * (r.age() - middle);
        let turned = |r: &Said| r.rotation() - rotation - rate * (r.age() - middle);
        let squares = self.refused.iter().map(|r| off(r).norm_squared()).sum::<f64>();
        let turns = self.refused.iter().map(|r| turned(r).norm_squared()).sum::<f64>();
        // Three axes, less the two ends of a line, or a mean.
        let position_scatter = sqrt(squares / (3.0 * (n - 2.0)));
        let rotation_scatter = sqrt(turns / (3.0 * (n - if modelled { 2.0 } else { 1.0 })));
        let noise = (position_scatter / position_noise).max(rotation_scatter / rotation_noise).max(1.0);
        let least = REACQUIRED;
        Agreement {
            position: mean + velocity * (newest - middle),
            velocity,
            rotation: rotation + rate * (newest - middle),
            rate,
            noise,
            deviation: InitialDeviation {
                position: least.position.max(2.0 * position_scatter),
                velocity: least.velocity.max(position_scatter / sqrt(spread)),
                rotation: least.rotation.max(rotation_scatter),
                gyro_bias: if modelled {
                    MODELLED_RATE.max(rotation_scatter / sqrt(spread))
                } else {
                    least.gyro_bias
                },
                ..least
            },
        }
    }
}

impl Agreement {
    /// Whether the poses say anything at all.
    pub(super) fn is_credible(&self) -> bool {
        self.noise <= MOST_NOISE
    }
}
