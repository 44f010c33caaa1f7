//! Compares captured positions with what is felt just after lift-off: finds the delay of the poses, whether they are
//! a mirror image, and a wrong yaw of the captured body.
//!
//! Second differences of both are correlated over a range of delays, so that no drift of the felt motion has an
//! effect. The largest correlation gives the delay, and its matrix the axes: a rotation keeps its determinant
//! positive, a mirror image does not. The matrix without a delay gives the yaw.

use crate::{
    supervisor::limits::CAPTURE_LATE,
    types::{Matrix3, PoseSample, Vector3},
};

/// Second differences are taken over twice this time, s.
const SPAN: f64 = 0.06;
/// Step between the delays that are tried, s, and their number.
const STEP: f64 = 0.02;
const DELAYS: usize = 16;
/// Interval at which the felt position is kept, s; how many of these, and how many captured positions, are kept.
const EVERY: f64 = 0.01;
const KEPT: usize = 48;
const SEEN: usize = 16;
/// Time constant with which older products lose their weight, s.
const FORGETS: f64 = 2.0;
/// Smallest integral of the squared felt acceleration that allows a conclusion, (m/s^2)^2 s.
const SHAKES: f64 = 0.1;
/// Least correlation that is used; and how much larger that of a delay must be than that without a delay.
const TELLS: f64 = 0.6;
const BETTER: f64 = 0.15;
/// A smaller determinant than this, divided by the squared sideways products, is a mirror image: a rotation has 1, a
/// mirror image -1.
const MIRRORS: f64 = -0.4;
/// A horizontal correlation above this part shows a yaw; a smaller yaw than this, rad, does not make a flight unstable.
const TURNS: (f64, f64) = (0.8, 0.5);
/// It is told if the motion has two directions (the product of their sizes is at least this part of the sum of their squares),
/// and after this time, s: a delay turns a motion, too, but not for long.
const TWO_DIRECTIONS: f64 = 0.15;
const HOLDS: f64 = 0.6;
/// A pose that comes earlier than this after the last one, s, is not used.
const SPARSE: f64 = 0.008;

/// After a longer interval without a sample, s, nobody has felt how the vehicle moved: the comparison begins again.
const MISSED: f64 = 0.02;
/// A comparison that begins in motion tells nothing before this time, s.
const AGAIN: f64 = 1.0;

/// What the comparison shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Told {
    /// How much later than their times poses are, s.
    pub(super) late: Option<f64>,
    /// Whether poses are a mirror image.
    pub(super) mirrored: bool,
    /// The yaw by which the captured body must be turned, rad.
    pub(super) yaw: Option<f64>,
}

/// The observations since the take-off began.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Witness {
    /// The motion by the accelerometer alone, m/s and m, world, from rest; what was kept of it, and when last, s.
    velocity_w: Vector3,
    position_w: Vector3,
    felt: [Vector3; KEPT],
    newest: usize,
    time: f64,
    now: f64,
    /// Before this time, s, nothing was felt; before a take-off the vehicle rests.
    begin: f64,
    /// Where the first pose was, m, world, and the last ones, newest first.
    from_w: Option<Vector3>,
    seen: [(f64, Vector3); SEEN],
    /// Products of captured and felt accelerations for each delay, and their squares.
    products: [Matrix3; DELAYS],
    captured_square: f64,
    felt_squares: [f64; DELAYS],
    /// Squares of the horizontal accelerations.
    captured_level: f64,
    felt_level: f64,
    /// For how long they have shown a yaw, s.
    turned: f64,
}

impl Default for Witness {
    fn default() -> Self {
        let zero = Vector3::zeros();
        Self {
            velocity_w: zero,
            position_w: zero,
            felt: [zero; KEPT],
            newest: 0,
            time: 0.0,
            now: 0.0,
            begin: f64::NEG_INFINITY,
            from_w: None,
            seen: [(f64::NEG_INFINITY, zero); SEEN],
            products: [Matrix3::zeros(); DELAYS],
            captured_square: 0.0,
            felt_squares: [0.0; DELAYS],
            captured_level: 0.0,
            felt_level: 0.0,
            turned: 0.0,
        }
    }
}

impl Witness {
    /// A comparison that begins in motion, at a time, s.
    pub(super) fn in_motion(now: f64) -> Self {
        Self { begin: now, now, ..Self::default() }
    }

    /// Begins the comparison again in motion, at a time, s. The captured positions stay.
    pub(super) fn begin_again(&mut self, now: f64) {
        *self = Self { from_w: self.from_w, seen: self.seen, ..Self::in_motion(now) };
    }

    /// Whether nothing was felt for too long before a time, s.
    pub(super) fn missed(&self, time: f64) -> bool {
        self.now > 0.0 && time - self.now > MISSED
    }

    /// Takes an acceleration, m/s^2, world, for the `dt` s up to `now`, s.
    pub(super) fn feel(&mut self, acceleration_w: &Vector3, now: f64, dt: f64) {
        self.velocity_w += acceleration_w * dt;
        self.position_w += self.velocity_w * dt;
        self.now = now;
        if now - self.time > EVERY * KEPT as f64 {
            self.time = now - EVERY;
        }
        while now - self.time >= EVERY - 1e-4 {
            self.time += EVERY;
            self.newest = self.newest.wrapping_add(1) % KEPT;
            if let Some(slot) = self.felt.get_mut(self.newest) {
                *slot = self.position_w - self.velocity_w * (now - self.time);
            }
        }
    }

    /// Position of the vehicle by the accelerometer at a time, s, if it is still kept.
    fn felt_at(&self, time: f64) -> Option<Vector3> {
        if time < self.begin {
            return None;
        }
        if time >= self.time {
            return (time <= self.now).then(|| self.position_w - self.velocity_w * (self.now - time));
        }
        let back = (self.time - time) / EVERY;
        let whole = libm::floor(back);
        if !(0.0..(KEPT - 1) as f64).contains(&whole) {
            return None;
        }
        let at = |back: usize| self.felt.get(self.newest.wrapping_add(KEPT).wrapping_sub(back) % KEPT);
        let (later, earlier) = (at(whole as usize)?, at((whole as usize).wrapping_add(1))?);
        Some(later + (earlier - later) * (back - whole))
    }

    /// Takes a pose of the IMU, as the capture system shows it.
    pub(super) fn see(&mut self, pose: &PoseSample) {
        if self.seen.first().is_some_and(|(time, _)| pose.time - time < SPARSE) {
            return;
        }
        self.from_w.get_or_insert(pose.position_w);
        let mut last = (pose.time, pose.position_w);
        for slot in &mut self.seen {
            last = core::mem::replace(slot, last);
        }
        let before = |ago: f64| self.seen.iter().find(|(time, _)| pose.time - time >= ago - 0.5 * EVERY);
        let (Some(middle), Some(first), Some(second)) = (before(SPAN), before(2.0 * SPAN), self.seen.get(1))
        else {
            return;
        };
        let (span, dt) = (pose.time - middle.0, pose.time - second.0);
        if (middle.0 - first.0 - span).abs() > 0.2 * SPAN || span > 2.0 * SPAN {
            return;
        }
        let difference =
            |last: &Vector3, middle: &Vector3, first: &Vector3| (last - middle * 2.0 + first) / (span * span);
        let seen = difference(&pose.position_w, &middle.1, &first.1);
        let felt = |delay: f64| {
            let at = |time: f64| self.felt_at(time - delay);
            Some(difference(&at(pose.time)?, &at(middle.0)?, &at(first.0)?))
        };
        let rates: [Option<Vector3>; DELAYS] = core::array::from_fn(|k| felt(k as f64 * STEP));
        // Only if every delay can be compared.
        if rates.iter().any(Option::is_none) {
            return;
        }
        let kept = 1.0 - (dt / FORGETS).min(1.0);
        let add = |square: &mut f64, new: f64| *square = *square * kept + new * dt;
        for ((product, square), rate) in self.products.iter_mut().zip(&mut self.felt_squares).zip(&rates) {
            let rate = rate.unwrap_or_default();
            *product = *product * kept + seen * rate.transpose() * dt;
            add(square, rate.norm_squared());
        }
        let now = rates.first().copied().flatten().unwrap_or_default();
        add(&mut self.captured_square, seen.norm_squared());
        add(&mut self.captured_level, seen.xy().norm_squared());
        add(&mut self.felt_level, now.xy().norm_squared());
        self.turned = if self.yaw().is_some() { self.turned + dt } else { 0.0 };
    }

    /// The correlation of each delay, and its products. What was felt before the first pose is in the delayed products only:
    /// each has its own square.
    fn correlations(&self) -> impl Iterator<Item = (f64, &Matrix3)> {
        let [at_once, ..] = self.felt_squares;
        let size = move |product: &Matrix3, square: f64| {
            product.norm() / libm::sqrt((self.captured_square * square.max(at_once)).max(f64::MIN_POSITIVE))
        };
        let delays = self.products.iter().zip(&self.felt_squares);
        delays.map(move |(product, square)| (size(product, *square), product))
    }

    /// The delay with the largest correlation, in steps, that correlation, that of no delay, and its products.
    fn best(&self) -> Option<(usize, f64, f64, Matrix3)> {
        let [felt_square, ..] = self.felt_squares;
        if felt_square < SHAKES || self.captured_square <= 0.0 {
            return None;
        }
        let (at_once, _) = self.correlations().next()?;
        let of = |(k, (size, product)): (usize, (f64, &Matrix3))| (k, size, at_once, *product);
        self.correlations().enumerate().map(of).reduce(|a, b| if b.1 > a.1 { b } else { a })
    }

    /// Whether poses without a delay fit better than those with a delay, s.
    pub(super) fn denies(&self, late: f64) -> bool {
        let steps = libm::round(late / STEP) as usize;
        let size = |steps: usize| self.correlations().nth(steps).map_or(0.0, |(size, _)| size);
        size(0) > size(steps)
    }

    /// What the observations show.
    pub(super) fn tells(&self) -> Told {
        if self.now < self.begin + AGAIN {
            return Told::default();
        }
        let Some((steps, size, at_once, p)) = self.best().filter(|best| best.1 > TELLS) else {
            return Told::default();
        };
        let delay = steps as f64 * STEP;
        let late = delay >= CAPTURE_LATE - 1e-9 && size > at_once + BETTER;
        let (determinant, square) = level(&p);
        let mirrored = 2.0 * determinant < MIRRORS * square;
        let turned = !(late || mirrored) && steps <= 1 && self.turned > HOLDS;
        Told { late: late.then_some(delay), mirrored, yaw: self.yaw().filter(|_| turned) }
    }

    /// The yaw that turns the felt motion onto the captured one, rad, if it is large.
    fn yaw(&self) -> Option<f64> {
        let p = self.products.first()?;
        let (sine, cosine) = (p.m21 - p.m12, p.m11 + p.m22);
        let scale = libm::sqrt(self.captured_level * self.felt_level);
        let (part, least) = TURNS;
        let yaw = libm::atan2(sine, cosine);
        let (determinant, square) = level(p);
        let shows = determinant > TWO_DIRECTIONS * square
            && self.felt_level > SHAKES
            && libm::hypot(sine, cosine) > part * scale;
        Some(yaw).filter(|yaw| shows && yaw.abs() > least)
    }

    /// Distance that the captured body has moved, m, world.
    pub(super) fn way(&self) -> Vector3 {
        let newest_w = self.seen.first().map(|(_, position_w)| position_w);
        newest_w.zip(self.from_w).map_or_else(Vector3::zeros, |(newest_w, from_w)| newest_w - from_w)
    }
}

/// Determinant of the horizontal products, and the sum of their squares.
fn level(p: &Matrix3) -> (f64, f64) {
    let determinant = p.m11 * p.m22 - p.m12 * p.m21;
    (determinant, p.m11 * p.m11 + p.m12 * p.m12 + p.m21 * p.m21 + p.m22 * p.m22)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{random::Random, so3};

    /// Sways before a capture system that is late by `late`, s, and shows positions changed by a matrix, every `every`
    /// samples. `look` gets what is told after each pose.
    fn watch((late, every): (f64, usize), change: Matrix3, seed: u64, mut look: impl FnMut(Told)) -> Witness {
        let (mut witness, mut random) = (Witness::default(), Random::new(seed));
        let at = |t: f64| {
            Vector3::new(0.01 * libm::sin(9.0 * t), 0.02 * libm::cos(6.3 * t), 0.02 * libm::sin(4.0 * t))
        };
        for k in 0..1000 {
            let t = f64::from(k) * 0.002;
            let acceleration = (at(t + 1e-3) - at(t) * 2.0 + at(t - 1e-3)) / 1e-6;
            witness.feel(&(acceleration + random.normal3(0.05)), t, 0.002);
            if (k as usize).is_multiple_of(every) {
                let position_w = change * at(t - late) + random.normal3(2e-4);
                let rotation_wr = Matrix3::identity();
                witness.see(&PoseSample {
                    time: t,
                    arrival: t,
                    position_w,
                    rotation_wr,
                    tracking_valid: true,
                });
                look(witness.tells());
            }
        }
        witness
    }

    /// What is told of good poses, of a vehicle that sways and is struck by `strike`, m/s^2, for 80 ms, `at` s after a comparison
    /// began in motion.
    fn struck(strike: f64, at: f64, seed: u64) -> bool {
        let (mut witness, mut random) = (Witness::in_motion(100.0), Random::new(seed));
        let waves: [_; 9] = core::array::from_fn(|_| {
            (0.4 * random.normal(), 2.0 + 8.0 * random.uniform(), 6.0 * random.uniform())
        });
        let strike_w = random.normal3(1.0).normalize() * strike;
        let (mut velocity_w, mut position_w) = (Vector3::zeros(), Vector3::zeros());
        let mut told = false;
        for k in 1..2000 {
            let since = f64::from(k) * 0.002;
            let struck = if since >= at && since < at + 0.08 { strike_w } else { Vector3::zeros() };
            let acceleration = waves.iter().enumerate().fold(struck, |mut sum, (j, (size, rate, phase))| {
                sum[j % 3] += size * libm::sin(rate * since + phase);
                sum
            });
            velocity_w += acceleration * 0.002;
            position_w += velocity_w * 0.002;
            let time = 100.0 + since;
            witness.feel(&(acceleration + random.normal3(0.05)), time, 0.002);
            if k % 5 == 0 {
                let (position_w, rotation_wr) = (position_w + random.normal3(2e-4), Matrix3::identity());
                let tracking_valid = true;
                witness.see(&PoseSample { time, arrival: time, position_w, rotation_wr, tracking_valid });
                told |= witness.tells() != Told::default();
            }
        }
        told
    }

    #[test]
    fn poses_of_a_vehicle_that_is_struck_are_good() {
        for strike in [0.0, 4.0, 8.0, 16.0] {
            for at in [0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 1.0, 2.0] {
                let told = (0..12).filter(|seed| struck(strike, at, 7919 * seed + 13)).count();
                assert_eq!(told, 0, "{strike} m/s^2 after {at} s");
            }
        }
    }

    /// Size of the difference of two angles, rad.
    fn apart(a: f64, b: f64) -> f64 {
        libm::atan2(libm::sin(a - b), libm::cos(a - b)).abs()
    }

    #[test]
    fn delay_mirror_and_yaw_are_told_apart() {
        for (seed, every) in [(0, 5), (1, 2), (2, 1), (3, 4), (4, 5)] {
            for yaw in [0.0, 0.3, 0.7, 1.6, 3.1, -1.0] {
                // Neither a delay nor a mirror image is ever told; a small yaw is no fault.
                let watched = |told: Told| {
                    assert_eq!((told.late, told.mirrored), (None, false), "{yaw} {every}");
                    let near = told.yaw.is_none_or(|found| apart(found, yaw) < 0.3);
                    assert!(near && (told.yaw.is_none() || yaw != 0.0), "{:?} {yaw} {every}", told.yaw);
                };
                let told = watch((0.0, every), so3::rot_z(yaw), seed, watched).tells();
                let near = told.yaw.map_or(yaw.abs() <= TURNS.1, |found| apart(found, yaw) < 0.1);
                assert!(near, "{:?} {yaw} {every}", told.yaw);
                for late in [0.12, 0.18, 0.25] {
                    // A motion that comes late is not taken for one that is turned.
                    let watched = |told: Told| assert!(yaw != 0.0 || told.yaw.is_none(), "{told:?} {late}");
                    let told = watch((late, every), so3::rot_z(yaw), seed, watched).tells();
                    assert!(!told.mirrored && told.yaw.is_none(), "{told:?} {late} {every}");
                    // At other rates than 100 Hz not every delay is found.
                    let off = if every == 5 { 0.5 * STEP + 1e-3 } else { STEP + 1e-3 };
                    let found = told.late.map_or(every != 5, |found| (found - late).abs() <= off);
                    assert!(found, "{told:?} {late} {every}");
                }
                for axis in [0, 1] {
                    let mut mirror = so3::rot_z(yaw);
                    mirror.column_mut(axis).neg_mut();
                    let expected = Told { mirrored: true, ..Told::default() };
                    assert_eq!(watch((0.0, every), mirror, seed, |_| ()).tells(), expected);
                    let late = watch((0.1, every), mirror, seed, |_| ()).tells();
                    assert!(late.mirrored || every != 5);
                }
            }
        }
    }
}
