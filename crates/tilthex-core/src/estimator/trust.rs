//! How far poses are trusted. Poses that contradict the state may be right (then they agree with each other), or
//! noisier than configured (then they do not).

use super::coarse::Coarse;
use crate::{types::Vector3, ukf::InitialDeviation};
use libm::sqrt;

/// This many refused poses in a row are judged together, never fewer: one outlier after a loss must not restart the
/// state.
pub(super) const REFUSALS: usize = 5;
/// Poses that are this many times as noisy as configured contain no information.
const MOST_NOISE: f64 = 100.0;
/// The number of applied poses from which the usual innovation follows.
const RECENT: usize = 15;
/// Median of a chi-square variable with 6 degrees of freedom.
const EXPECTED_MEDIAN: f64 = 5.348;
/// Largest value of [`Trust::level`]: the configured noises are too small by at most the square root of this.
const MOST_LEVEL: f64 = 100.0;
/// Two surprising poses agree if the square of their difference is below this share of the square of one of them.
const SAME: f64 = 0.25;
/// Two differences have about the same direction if the cosine between them is above this.
const ALIKE: f64 = 0.9;
/// Weight of an accepted pose in the estimate of the noise.
const NOISE_SHARE: f64 = 0.05;
/// Smallest deviations after the state was replaced by that of poses.
pub(super) const REACQUIRED: InitialDeviation = InitialDeviation {
    position: 0.02,
    velocity: 0.3,
    rotation: 0.05,
    gyro_bias: 0.03,
    accelerometer_bias: 0.2,
};

/// Smallest deviation of a modelled rate after the state was replaced by that of poses, rad/s.
pub(super) const MODELLED_RATE: f64 = 0.3;

/// A surprising pose: its time, and its difference from the state (position m, rotation rad; W). Single precision,
/// because every checkpoint has copies.
#[derive(Clone, Copy, Debug)]
pub(super) struct Said {
    /// Time since the last accepted pose, s.
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

    pub(super) fn position(&self) -> Vector3 {
        Vector3::from(self.position.map(f64::from))
    }

    fn rotation(&self) -> Vector3 {
        Vector3::from(self.rotation.map(f64::from))
    }

    /// Whether the difference of another pose has about the same direction, measured by the noises of position and rotation.
    fn points_as(&self, other: &Self, (position, rotation): (f64, f64)) -> bool {
        let along = |a: &Self, b: &Self| {
            a.position().dot(&b.position()) / (position * position)
                + a.rotation().dot(&b.rotation()) / (rotation * rotation)
        };
        along(self, other) > ALIKE * sqrt(along(self, self) * along(other, other))
    }

    /// Whether another pose said the same, measured by the noises of position and rotation.
    fn agrees(&self, other: &Self, (position, rotation): (f64, f64)) -> bool {
        let size = |p: Vector3, r: Vector3| {
            p.norm_squared() / (position * position) + r.norm_squared() / (rotation * rotation)
        };
        let apart = size(self.position() - other.position(), self.rotation() - other.rotation());
        apart < SAME * size(self.position(), self.rotation())
    }
}

/// What the estimator has learnt about the poses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trust {
    /// Time of the last accepted pose, s.
    pub(super) accepted: f64,
    /// Noise of the poses divided by the configured noise, from 1 on.
    pub(super) noise: f64,
    /// What the last poses said, and how many surprising ones there have been in a row.
    said: [Said; REFUSALS],
    in_a_row: u8,
    /// How many of the last ones said the same, one after the other.
    alike: u16,
    /// This number when they contradicted the state beyond what its doubt explains, 0 if they did not; and whether samples have
    /// become doubtful since then. This is no reason to believe poses that still say the same.
    contradicted: u16,
    doubted: bool,
    /// Normalised innovations squared of the last poses that were applied, newest last.
    recent: [Coarse; RECENT],
}

/// What refused poses in a row say together: a line through their differences from the state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Agreement {
    /// The difference at the newest of them: position m, velocity m/s, rotation rad; W.
    pub(super) position: Vector3,
    pub(super) velocity: Vector3,
    pub(super) rotation: Vector3,
    /// Rate of change of that rotation, rad/s; W. Zero if a gyro measures the rate.
    pub(super) rate: Vector3,
    /// Their noise divided by the configured noise, from 1 on.
    pub(super) noise: f64,
    /// Deviations of the state after it has been moved by that difference.
    pub(super) deviation: InitialDeviation,
}

impl Trust {
    /// The initial trust, with an accepted pose at this time.
    pub(super) const fn since(accepted: f64) -> Self {
        Self {
            accepted,
            noise: 1.0,
            said: [Said::NOTHING; REFUSALS],
            in_a_row: 0,
            alike: 0,
            contradicted: 0,
            doubted: false,
            recent: [Coarse::ZERO; RECENT],
        }
    }

    /// How large innovations have been recently, from 1 on: the median of their normalised squares, divided by the
    /// expected median. If the configured noises are too small, large innovations are usual and no reason to doubt a
    /// pose.
    pub(super) fn level(&self) -> f64 {
        let recent = || self.recent.iter().map(|x| x.get());
        let median = recent().find(|x| {
            let below = recent().filter(|y| y <= x).count();
            let above = recent().filter(|y| y >= x).count();
            below > RECENT / 2 && above > RECENT / 2
        });
        (median.unwrap_or(0.0) / EXPECTED_MEDIAN).clamp(1.0, MOST_LEVEL)
    }

    /// Remembers the normalised innovation squared of an applied pose.
    pub(super) fn remember(&mut self, nis: f64) {
        self.recent.rotate_left(1);
        if let Some(slot) = self.recent.last_mut() {
            *slot = Coarse::new(nis);
        }
    }

    /// Whether the pose before was surprising too, and agrees with this one.
    pub(super) fn repeats(&self, said: &Said, noises: (f64, f64)) -> bool {
        let before = self.said.last().filter(|_| self.in_a_row > 0);
        before.is_some_and(|before| said.agrees(before, noises))
    }

    /// The initial trust with an accepted pose at this time, but with what has been learnt about the noise of poses.
    pub(super) fn kept_since(&self, accepted: f64) -> Self {
        Self { noise: self.noise, recent: self.recent, ..Self::since(accepted) }
    }

    /// Whether the differences of this pose and of some before it, at most [`REFUSALS`], have about the same direction, one after
    /// the other, whether they were surprising or not.
    pub(super) fn insists(&self, said: &Said, before: usize, noises: (f64, f64)) -> bool {
        let mut later = said;
        self.said.iter().rev().take(before).all(|earlier| {
            let same = later.points_as(earlier, noises);
            later = earlier;
            same
        })
    }

    /// Whether this pose says the same as those that contradicted the state, and samples have become doubtful only since then.
    /// `doubtful` says this for a time before the pose, s.
    pub(super) fn contradicts_still(
        &mut self,
        said: &Said,
        noises: (f64, f64),
        doubtful: impl Fn(f64) -> bool,
    ) -> bool {
        let still = self.contradicted > 0 && self.repeats(said, noises);
        if !still {
            (self.contradicted, self.doubted) = (0, false);
            return false;
        }
        let since = f64::from(self.alike.saturating_sub(self.contradicted)) * self.period();
        self.doubted = self.doubted || doubtful(since);
        self.doubted
    }

    /// Whether the last poses contradict the state, and all of them say the same.
    pub(super) fn contradicts(&self) -> bool {
        self.contradicted > 0
    }

    /// Refused poses in a row contradict a state whose doubt does not explain them.
    pub(super) fn contradict(&mut self) {
        if self.contradicted == 0 && usize::from(self.in_a_row) >= REFUSALS {
            self.contradicted = self.alike;
        }
    }

    /// Whether poses say what they say now for less than half of the time since the last pose that agreed, s.
    pub(super) fn is_news(&self, since: f64) -> bool {
        2.0 * f64::from(self.alike) * self.period() < since
    }

    /// Mean time between the last surprising poses, s.
    fn period(&self) -> f64 {
        let ages = self.said.first().zip(self.said.last());
        ages.map_or(0.0, |(first, last)| (last.age() - first.age()) / (REFUSALS - 1) as f64)
    }

    /// Counts an accepted pose; `nis` is its normalised innovation squared divided by its degrees of freedom, with
    /// the configured noise. Only refused poses increase the noise above the configured one; an accepted pose must
    /// not do so by chance.
    pub(super) fn accept(&mut self, time: f64, nis: f64) {
        if self.noise > 1.0 {
            let variance = self.noise * self.noise;
            let toward = variance + NOISE_SHARE * (nis - variance);
            self.noise = sqrt(toward.max(1.0)).min(MOST_NOISE);
        }
        *self = Self { accepted: time, in_a_row: 0, alike: 0, contradicted: 0, doubted: false, ..*self };
    }

    /// Counts a surprising pose; `noises` are those of position and rotation.
    pub(super) fn weigh(&mut self, said: Said, noises: (f64, f64)) {
        self.alike = if self.repeats(&said, noises) { self.alike.saturating_add(1) } else { 1 };
        self.note(said);
        self.in_a_row = self.in_a_row.saturating_add(1);
    }

    /// Remembers what a pose said.
    pub(super) fn note(&mut self, said: Said) {
        self.said.rotate_left(1);
        if let Some(slot) = self.said.last_mut() {
            *slot = said;
        }
    }

    /// Counts a pose that contradicts the state. If there are enough such poses in a row, returns what they say
    /// together. They determine the rate only if it is `modelled`.
    pub(super) fn refuse(&mut self, said: Said, noise: (f64, f64), modelled: bool) -> Option<Agreement> {
        self.weigh(said, noise);
        (usize::from(self.in_a_row) >= REFUSALS).then(|| self.agreement(said.age(), noise, modelled))
    }

    fn agreement(
        &self,
        newest: f64,
        (position_noise, rotation_noise): (f64, f64),
        modelled: bool,
    ) -> Agreement {
        let n = REFUSALS as f64;
        let mean = self.said.iter().fold(Vector3::zeros(), |sum, r| sum + r.position()) / n;
        let rotation = self.said.iter().fold(Vector3::zeros(), |sum, r| sum + r.rotation()) / n;
        let middle = self.said.iter().map(|r| r.age()).sum::<f64>() / n;
        let (mut spread, mut moment, mut turning) = (1e-9, Vector3::zeros(), Vector3::zeros());
        for r in &self.said {
            spread += (r.age() - middle) * (r.age() - middle);
            moment += (r.position() - mean) * (r.age() - middle);
            turning += (r.rotation() - rotation) * (r.age() - middle);
        }
        let velocity = moment / spread;
        let rate = if modelled { turning / spread } else { Vector3::zeros() };
        let off = |r: &Said| r.position() - mean - velocity * (r.age() - middle);
        let turned = |r: &Said| r.rotation() - rotation - rate * (r.age() - middle);
        let squares = self.said.iter().map(|r| off(r).norm_squared()).sum::<f64>();
        let turns = self.said.iter().map(|r| turned(r).norm_squared()).sum::<f64>();
        // Three axes; a line has two free parameters per axis, a mean has one.
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
    /// Whether the poses contain any information.
    pub(super) fn is_credible(&self) -> bool {
        self.noise <= MOST_NOISE
    }
}
