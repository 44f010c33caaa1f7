//! The recent inertial samples, poses and checkpoints, in rings of fixed size.

use super::{Head, Quality, coarse::Coarse, kept_bias::KeptBias, leaps::is_blow, trust::Trust};
use crate::{
    types::{Matrix3, Vector3},
    ukf::PackedState,
};

/// An interval between samples above this is a gap, s.
pub(super) const GAP: f64 = 0.02;

/// Number of inertial samples: 0.3 s at 640 Hz.
const SAMPLES: u64 = 192;
/// Number of poses: 0.3 s at 130 Hz.
const POSES: usize = 40;
/// Number of checkpoints.
const CHECKPOINTS: usize = 9;

/// One inertial sample, IMU coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct ImuEntry {
    pub(super) time: f64,
    pub(super) gyro: Vector3,
    pub(super) force: Vector3,
    pub(super) quality: Quality,
    /// Squares of its leap from the two samples before, beyond the usual (see [`Leaps`](super::leaps::Leaps)).
    pub(super) leap: [Coarse; 2],
}

/// Largest acceleration that a sample misses, m/s^2: of a blow, and of flight.
const BLOW: f64 = 200.0;
const FLIES: f64 = 30.0;
/// A pose shows the velocity as it was this time before it, s: what samples have missed later, it has not shown.
const SHOWN: f64 = 0.02;

/// What doubtful samples may have missed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Doubt {
    /// Largest change of the velocity, m/s.
    pub(super) velocity: f64,
    /// Largest change of the position since then, m.
    pub(super) position: f64,
    /// Whether one of them is shaken. A blow may change more than these bounds say.
    pub(super) shaken: bool,
}

/// The newest samples, each with a number that counts from zero.
#[derive(Clone, Copy, Debug)]
pub(super) struct ImuHistory {
    entries: [ImuEntry; SAMPLES as usize],
    count: u64,
}

impl ImuHistory {
    pub(super) const EMPTY: Self = {
        let zero = Vector3::new(0.0, 0.0, 0.0);
        Self {
            entries: [ImuEntry {
                time: 0.0,
                gyro: zero,
                force: zero,
                quality: Quality::Measured,
                leap: [Coarse::ZERO; 2],
            }; SAMPLES as usize],
            count: 0,
        }
    };

    pub(super) fn push(&mut self, entry: ImuEntry) {
        self.entries[(self.count % SAMPLES) as usize] = entry;
        self.count += 1;
    }

    /// What the samples of the last `time` seconds before `now` may have missed; number `next` is the first sample after `now`.
    /// None if all of them were simply measured, and none shows a blow. Older samples than those of half the ring count like the
    /// oldest of these. A pose that agreed `since` seconds ago has shown what missing samples before it have done.
    pub(super) fn doubt(&self, next: u64, now: f64, time: f64, since: f64) -> Option<Doubt> {
        let shown = now - since - SHOWN;
        let mut doubt: Option<Doubt> = None;
        let (mut before, mut last) = (now - time, None);
        let end = next.saturating_add(1).min(self.end());
        for s in (next.saturating_sub(SAMPLES / 2)..end).map(|n| self.get(n)) {
            let shaken = is_blow(s.leap) || matches!(s.quality, Quality::Shaken | Quality::ModelledShaken);
            let gap = last.replace(s.time).is_some_and(|last| s.time - last > GAP);
            let missing = s.quality == Quality::Modelled || gap;
            let until = if s.time < now { s.time } else { now };
            if (shaken || missing) && now - until <= time {
                let (begin, acceleration) = if shaken { (before, BLOW) } else { (before.max(shown), FLIES) };
                let gained = (until - begin).max(0.0) * acceleration;
                let doubt = doubt.get_or_insert(Doubt { velocity: 0.0, position: 0.0, shaken });
                doubt.shaken |= shaken;
                doubt.velocity += gained;
                doubt.position += gained * (now - 0.5 * (begin + until));
            }
            before = s.time;
        }
        doubt
    }

    /// Number of the next sample.
    pub(super) fn end(&self) -> u64 {
        self.count
    }

    /// Number of the oldest sample in the ring.
    fn begin(&self) -> u64 {
        self.count.saturating_sub(SAMPLES)
    }

    /// Number of the oldest sample from which the filter can start again. The interval before it stays complete when
    /// the next sample arrives.
    pub(super) fn first_usable(&self) -> u64 {
        if self.count < SAMPLES { 0 } else { self.begin() + 2 }
    }

    pub(super) fn get(&self, number: u64) -> &ImuEntry {
        &self.entries[(number % SAMPLES) as usize]
    }

    pub(super) fn newest(&self) -> Option<&ImuEntry> {
        (self.count > 0).then(|| self.get(self.count - 1))
    }

    /// Readings over the interval that ends with sample `number`, and its length (s). The readings are the mean of
    /// both ends if both ends have the same source.
    pub(super) fn interval(&self, number: u64) -> (Vector3, Vector3, f64) {
        let end = self.get(number);
        if number == 0 || number <= self.begin() {
            return (end.gyro, end.force, 0.0);
        }
        let start = self.get(number - 1);
        if start.quality.is_modelled() != end.quality.is_modelled() {
            return (end.gyro, end.force, end.time - start.time);
        }
        (0.5 * (start.gyro + end.gyro), 0.5 * (start.force + end.force), end.time - start.time)
    }

    /// The newest sample and the one before it.
    pub(super) fn newest_two(&self) -> Option<(&ImuEntry, &ImuEntry)> {
        (self.count > 1).then(|| (self.get(self.count - 1), self.get(self.count - 2)))
    }

    /// Number of the first sample after `time`.
    pub(super) fn first_after(&self, time: f64) -> u64 {
        let mut number = self.count;
        while number > self.begin() && self.get(number - 1).time > time {
            number -= 1;
        }
        number
    }
}

/// A pose of the captured body that waits, or that the filter may have to apply again.
#[derive(Clone, Copy, Debug)]
pub(super) struct PoseEntry {
    pub(super) time: f64,
    pub(super) position: Vector3,
    pub(super) rotation: Matrix3,
    /// Whether its outcome has been counted. It may be applied again after a late pose.
    pub(super) reported: bool,
}

/// Poses in the order in which they were taken.
#[derive(Clone, Copy, Debug)]
pub(super) struct PoseQueue {
    entries: [PoseEntry; POSES],
    len: usize,
}

impl PoseQueue {
    pub(super) const EMPTY: Self = {
        let entry = PoseEntry {
            time: 0.0,
            position: Vector3::new(0.0, 0.0, 0.0),
            rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
            reported: false,
        };
        Self { entries: [entry; POSES], len: 0 }
    };

    fn kept(&self) -> &[PoseEntry] {
        self.entries.get(..self.len).unwrap_or(&[])
    }

    pub(super) fn contains(&self, time: f64) -> bool {
        self.kept().iter().any(|p| p.time == time)
    }

    /// Inserts a pose in its order. If this removes the oldest pose, returns the time of that pose.
    pub(super) fn insert(&mut self, entry: PoseEntry) -> Option<f64> {
        let pushed_out = (self.len >= POSES).then(|| self.entries[0].time);
        if pushed_out.is_some() {
            for i in 1..POSES {
                self.entries[i - 1] = self.entries[i];
            }
            self.len = POSES - 1;
        }
        let place = self.kept().iter().filter(|p| p.time < entry.time).count();
        // `place <= len < POSES`: exchange the new pose with each later one in turn.
        let mut moving = entry;
        for slot in self.entries.iter_mut().take(self.len + 1).skip(place) {
            core::mem::swap(slot, &mut moving);
        }
        self.len += 1;
        pushed_out
    }

    /// The first pose that was taken after `time` and not after `until`.
    pub(super) fn next(&self, time: f64, until: f64) -> Option<(usize, PoseEntry)> {
        // From the newest on: few or none are later.
        let place = self.kept().iter().rposition(|p| p.time <= time).map_or(0, |last| last + 1);
        let pose = self.kept().get(place)?;
        (pose.time <= until).then_some((place, *pose))
    }

    pub(super) fn mark_reported(&mut self, place: usize) {
        if let Some(pose) = self.entries.get_mut(place) {
            pose.reported = true;
        }
    }

    pub(super) fn clear(&mut self) {
        self.len = 0;
    }
}

/// The filter at a past time.
#[derive(Clone, Copy, Debug)]
struct Checkpoint {
    state: PackedState,
    time: f64,
    next_sample: u64,
    applied: f64,
    trust: Trust,
    kept_bias: KeptBias,
}

/// Past states of the filter, oldest first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Checkpoints {
    entries: [Checkpoint; CHECKPOINTS],
    len: usize,
    spacing: f64,
}

impl Checkpoints {
    /// An empty list, whose checkpoints will be spaced so that they cover `history` seconds.
    pub(super) fn new(history: f64) -> Self {
        let none = Checkpoint {
            state: PackedState::EMPTY,
            time: 0.0,
            next_sample: 0,
            applied: 0.0,
            trust: Trust::since(0.0),
            kept_bias: KeptBias::NONE,
        };
        Self { entries: [none; CHECKPOINTS], len: 0, spacing: history / (CHECKPOINTS - 1) as f64 }
    }

    fn kept(&self) -> &[Checkpoint] {
        self.entries.get(..self.len).unwrap_or(&[])
    }

    fn keep_from(&mut self, first: usize) {
        for i in 0..CHECKPOINTS.saturating_sub(first) {
            self.entries[i] = self.entries[(i + first).min(CHECKPOINTS - 1)];
        }
        self.len = self.len.saturating_sub(first);
    }

    /// Saves the filter if the last checkpoint is old enough.
    pub(super) fn save(&mut self, head: &Head) {
        if self.kept().last().is_some_and(|c| head.time < c.time + self.spacing) {
            return;
        }
        if self.len >= CHECKPOINTS {
            self.keep_from(1);
        }
        if let Some(slot) = self.entries.get_mut(self.len) {
            *slot = Checkpoint {
                state: PackedState::pack(&head.state),
                time: head.time,
                next_sample: head.next_sample,
                applied: head.applied,
                trust: head.trust,
                kept_bias: head.kept_bias,
            };
            self.len += 1;
        }
    }

    /// Returns to the last checkpoint before `time`, and removes those after it. Returns false if there is none that
    /// starts at sample `oldest` or later.
    pub(super) fn restore(&mut self, time: f64, oldest: u64, head: &mut Head) -> bool {
        let before = self.kept().iter().filter(|c| c.time <= time && c.applied < time).count();
        let Some(found) = before.checked_sub(1).and_then(|last| self.kept().get(last)) else {
            return false;
        };
        if found.next_sample < oldest {
            return false;
        }
        *head = Head {
            state: found.state.unpack(),
            time: found.time,
            next_sample: found.next_sample,
            applied: found.applied,
            trust: found.trust,
            kept_bias: found.kept_bias,
        };
        self.len = before;
        true
    }

    /// Removes the checkpoints from which a pose of that `time`, which is no longer in the queue, would have to be
    /// applied again.
    pub(super) fn forget_before(&mut self, time: f64) {
        let stale = self.kept().iter().filter(|c| c.applied < time).count();
        self.keep_from(stale);
    }

    pub(super) fn clear(&mut self) {
        self.len = 0;
    }
}
