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
const POSES: u32 = 40;
/// Number of checkpoints.
const CHECKPOINTS: u32 = 9;

/// One inertial sample, IMU coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct ImuEntry {
    pub(super) time: f64,
    pub(super) gyro: Vector3,
    pub(super) force: Vector3,
    pub(super) quality: Quality,
    /// Squares of its leap from the two samples before, beyond the usual (see [`Leaps`](super::leaps::Leaps)).
    pub(super) leap: [Coarse; 2],
    /// Whether it repeats the sample before: the motion since then was not measured.
    pub(super) held: bool,
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
                held: false,
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

/// Places in a ring of `SIZE` entries, oldest first. Entries stay where they are when older ones are removed.
#[derive(Clone, Copy, Debug)]
struct Places<const SIZE: u32> {
    start: u32,
    len: u32,
}

impl<const SIZE: u32> Places<SIZE> {
    const NONE: Self = Self { start: 0, len: 0 };

    /// The place of entry `i`, which is below `SIZE`.
    fn of(self, i: u32) -> usize {
        ((self.start + i) % SIZE) as usize
    }

    /// The places in use, oldest first.
    fn used(self) -> impl DoubleEndedIterator<Item = usize> {
        (0..self.len.min(SIZE)).map(move |i| self.of(i))
    }

    fn is_full(self) -> bool {
        self.len >= SIZE
    }

    /// Removes the oldest entries.
    fn remove_oldest(&mut self, count: u32) {
        let count = count.min(self.len);
        self.start = (self.start + count) % SIZE;
        self.len -= count;
    }

    /// The place of a new newest entry; removes the oldest one if there is no other place.
    fn push(&mut self) -> usize {
        self.remove_oldest(u32::from(self.is_full()));
        self.len += 1;
        self.of(self.len - 1)
    }
}

/// Poses in the order in which they were taken.
#[derive(Clone, Copy, Debug)]
pub(super) struct PoseQueue {
    entries: [PoseEntry; POSES as usize],
    places: Places<POSES>,
}

impl PoseQueue {
    pub(super) const EMPTY: Self = {
        let entry = PoseEntry {
            time: 0.0,
            position: Vector3::new(0.0, 0.0, 0.0),
            rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
            reported: false,
        };
        Self { entries: [entry; POSES as usize], places: Places::NONE }
    };

    pub(super) fn contains(&self, time: f64) -> bool {
        self.places.used().any(|place| self.entries[place].time == time)
    }

    /// Inserts a pose in its order. If this removes the oldest pose, returns the time of that pose.
    pub(super) fn insert(&mut self, entry: PoseEntry) -> Option<f64> {
        let pushed_out = self.places.is_full().then(|| self.entries[self.places.of(0)].time);
        let mut place = self.places.push();
        // Each later pose moves by one place.
        for before in self.places.used().rev().skip(1) {
            if self.entries[before].time < entry.time {
                break;
            }
            self.entries[place] = self.entries[before];
            place = before;
        }
        self.entries[place] = entry;
        pushed_out
    }

    /// The first pose that was taken after `time` and not after `until`, and its place.
    pub(super) fn next(&self, time: f64, until: f64) -> Option<(usize, PoseEntry)> {
        // From the newest on: few or none are later.
        let later = self.places.used().rev().take_while(|place| self.entries[*place].time > time);
        let place = later.last()?;
        let pose = self.entries[place];
        (pose.time <= until).then_some((place, pose))
    }

    pub(super) fn mark_reported(&mut self, place: usize) {
        if let Some(pose) = self.entries.get_mut(place) {
            pose.reported = true;
        }
    }

    pub(super) fn clear(&mut self) {
        self.places = Places::NONE;
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
    entries: [Checkpoint; CHECKPOINTS as usize],
    places: Places<CHECKPOINTS>,
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
        let spacing = history / f64::from(CHECKPOINTS - 1);
        Self { entries: [none; CHECKPOINTS as usize], places: Places::NONE, spacing }
    }

    fn kept(&self) -> impl DoubleEndedIterator<Item = &Checkpoint> {
        self.places.used().map(|place| &self.entries[place])
    }

    /// Saves the filter if the last checkpoint is old enough.
    pub(super) fn save(&mut self, head: &Head) {
        if self.kept().next_back().is_some_and(|c| head.time < c.time + self.spacing) {
            return;
        }
        self.entries[self.places.push()] = Checkpoint {
            state: PackedState::pack(&head.state),
            time: head.time,
            next_sample: head.next_sample,
            applied: head.applied,
            trust: head.trust,
            kept_bias: head.kept_bias,
        };
    }

    /// Returns to the last checkpoint before `time`, and removes those after it. Returns false if there is none that
    /// starts at sample `oldest` or later.
    pub(super) fn restore(&mut self, time: f64, oldest: u64, head: &mut Head) -> bool {
        let before = self.kept().filter(|c| c.time <= time && c.applied < time).count();
        let Some(found) = before.checked_sub(1).and_then(|last| self.kept().nth(last)) else {
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
        self.places.len = before as u32;
        true
    }

    /// Removes the checkpoints from which a pose of that `time`, which is no longer in the queue, would have to be
    /// applied again.
    pub(super) fn forget_before(&mut self, time: f64) {
        let stale = self.kept().filter(|c| c.applied < time).count();
        self.places.remove_oldest(stale as u32);
    }

    pub(super) fn clear(&mut self) {
        self.places = Places::NONE;
    }
}
