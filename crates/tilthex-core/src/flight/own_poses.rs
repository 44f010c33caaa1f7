//! Finds that refused poses are those of this vehicle: they accelerate as the IMU or the rotors say.
//!
//! A wrong pose that was believed, or a sensor that went wrong, leads the state astray. It then refuses true poses, and the vehicle
//! would fly on the wrong state until it strikes something. A frozen pose and the pose of another body do not accelerate as the
//! vehicle does. Therefore the readings of the accelerometer, and separately the thrust of the rotors, are turned by the rotations
//! of the poses themselves and integrated. If one of these two ways equals the captured way, apart from a constant velocity, the poses are
//! those of this vehicle, whatever the state says: their velocity and rotation are right, and only their position may be displaced.

use super::Flight;
use crate::{
    GRAVITY,
    ring::Ring,
    so3,
    types::{Matrix3, PoseSample, RotorVector, Vector3},
    ukf::Navigation,
};

/// Interval at which the felt velocity is kept, s, and how often: older poses are not used.
const FELT_EVERY: f64 = 4e-3;
const FELT: usize = 48;
/// Interval at which ways are kept, s; how many are compared at least, and at most.
const EVERY: f64 = 0.02;
const LEAST: usize = 8;
const SEEN: usize = 26;
/// Poses farther apart than this, s, are not one way.
const GAP: f64 = 0.06;
/// A body that moves faster than this, m/s and rad/s, or leaps by more than this, m and rad, does not go one way.
const FASTEST: (f64, f64) = (6.0, 12.0);
const LEAP: (f64, f64) = (0.03, 0.1);
/// A way that deviates by less than this from a constant velocity, m, proves nothing.
const MOVES: f64 = 5e-3;
/// The felt way leaves at most this part of the captured deviation, and of its horizontal part.
const UNEXPLAINED: f64 = 0.3;

/// Poses are compared with the state if none was used for this time, s; older poses than this, s, say nothing.
const REFUSED: f64 = 0.05;
const OLDEST: f64 = 0.06;
/// A state that is off by less than this, m/s and rad, is kept. It is never turned by more than the last value, rad.
const WRONG: (f64, f64) = (0.3, 0.1);
const TURNED: f64 = 1.0;
/// Poses that were farther than this from the state when it first refused them, m, are displaced.
const DISPLACED: f64 = 0.2;

/// What is felt in two ways: by the accelerometer, in IMU axes, and by the thrust of the rotors, in robot axes.
type Both<T> = [T; 2];

/// Integrals of the specific force up to a time, s, m/s.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Felt {
    time: f64,
    gained: Both<Vector3>,
}

impl Felt {
    const NOTHING: Self = Self { time: f64::NEG_INFINITY, gained: [Vector3::new(0.0, 0.0, 0.0); 2] };
}

/// Captured position of IMU or centre of mass, and the way that was felt, from rest at the origin, m and m/s, world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Track {
    captured_w: Vector3,
    position_w: Vector3,
    velocity_w: Vector3,
}

impl Track {
    /// Goes on with a change of the velocity, without gravity, over `dt` s.
    fn go(&mut self, gained_w: &Vector3, dt: f64) {
        let gained_w = gained_w - Vector3::new(0.0, 0.0, GRAVITY * dt);
        self.position_w += (self.velocity_w + gained_w * 0.5) * dt;
        self.velocity_w += gained_w;
    }
}

/// The tracks at the time of a pose, s, and its position minus that of the state, m, world.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Seen {
    time: f64,
    tracks: Both<Track>,
    off_w: Vector3,
}

/// The newest pose.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Last {
    rotation_wi: Matrix3,
    felt: Felt,
    seen: Seen,
}

/// A straight line through points over time, and the root mean square of what it leaves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Line {
    slope: Vector3,
    left: f64,
}

/// The motion of the IMU that poses of this vehicle show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Own {
    /// Velocity of the IMU at the newest sample, m/s, world.
    pub(super) velocity_w: Vector3,
    /// Position of the IMU at the newest sample, m, world.
    pub(super) position_w: Vector3,
    /// Rotation at the time of the pose.
    pub(super) rotation_wi: Matrix3,
    /// Time since the pose, s.
    pub(super) age: f64,
    /// Displacement of the poses, m, world; zero if it is small.
    pub(super) displaced_w: Vector3,
    /// Whether the rotors show the captured way better than the accelerometer does: then the velocity is that of the centre of mass.
    pub(super) of_centre: bool,
    /// Whether a sideways motion shows them, too.
    pub(super) aside: bool,
}

/// The comparison of the last poses with what was felt.
#[derive(Clone, Copy, Debug)]
pub(super) struct OwnPoses {
    sum: Felt,
    felt: Ring<Felt, FELT>,
    last: Option<Last>,
    seen: Ring<Option<Seen>, SEEN>,
    /// Time of the first pose after the last one that was used, s, and its position minus that of the state, m, world.
    begin: Option<(f64, Vector3)>,
    /// The displacement of poses that was found, m, world.
    displaced_w: Vector3,
}

impl Default for OwnPoses {
    fn default() -> Self {
        Self {
            sum: Felt::NOTHING,
            felt: Ring::new(Felt::NOTHING),
            last: None,
            seen: Ring::new(None),
            begin: None,
            displaced_w: Vector3::zeros(),
        }
    }
}

impl OwnPoses {
    /// Takes the specific force of the IMU, without bias, IMU axes, and that of the rotors, robot axes, m/s^2, for the `dt` s
    /// up to a time, s.
    pub(super) fn feel(&mut self, force_i: &Vector3, rotors_r: &Vector3, time: f64, dt: f64) {
        for (gained, force) in self.sum.gained.iter_mut().zip([force_i, rotors_r]) {
            *gained += force * dt;
        }
        self.sum.time = time;
        if self.felt.iter().next().is_some_and(|newest| time - newest.time >= FELT_EVERY) {
            self.felt.push(self.sum);
        }
    }

    /// What was felt up to a time, s.
    fn felt_at(&self, time: f64) -> Option<Felt> {
        let mut later = self.sum;
        if time > later.time {
            return None;
        }
        for earlier in self.felt.iter() {
            if earlier.time <= time {
                let between = later.time - earlier.time;
                let part = if between > 0.0 { (time - earlier.time) / between } else { 0.0 };
                let [a, b] = earlier.gained;
                let [c, d] = later.gained;
                return earlier
                    .time
                    .is_finite()
                    .then(|| Felt { time, gained: [a + (c - a) * part, b + (d - b) * part] });
            }
            later = *earlier;
        }
        None
    }

    /// The pose of the IMU without the displacement that was found.
    pub(super) fn placed(&self, pose: &PoseSample) -> PoseSample {
        PoseSample { position_w: pose.position_w - self.displaced_w, ..*pose }
    }

    /// Takes a pose of the IMU, at the time at which it was taken. `accepted` is the time of the last pose that
    /// was used, s. `position_w` and `velocity_w` are the present ones of the IMU, m and m/s, world; `imu_r` and `rotation_ri` are its
    /// place and rotation on the robot.
    fn see(
        &mut self,
        pose: &PoseSample,
        accepted: f64,
        (position_w, velocity_w): (&Vector3, &Vector3),
        (imu_r, rotation_ri): (&Vector3, &Matrix3),
    ) {
        let Some(felt) = self.felt_at(pose.time) else {
            self.last = None;
            return;
        };
        let (rotation_wi, imu_w) = (pose.rotation_wr, pose.position_w);
        let rotation_wr = rotation_wi * rotation_ri.transpose();
        let captured = [imu_w, imu_w - rotation_wr * imu_r];
        let off_w = imu_w - (position_w - velocity_w * (self.sum.time - pose.time));
        let fresh = captured.map(|captured_w| Track { captured_w, ..Track::default() });
        let mut seen = Seen { time: pose.time, tracks: fresh, off_w };
        let before = self.last.filter(|last| last.leads_to(pose));
        if let Some(last) = &before {
            let dt = pose.time - last.seen.time;
            let rotations = [
                (rotation_wi + last.rotation_wi) * 0.5,
                (rotation_wi + last.rotation_wi) * 0.5 * rotation_ri.transpose(),
            ];
            seen.tracks = last.seen.tracks;
            for (((track, captured_w), rotation), (to, from)) in seen
                .tracks
                .iter_mut()
                .zip(captured)
                .zip(rotations)
                .zip(felt.gained.iter().zip(&last.felt.gained))
            {
                track.captured_w = captured_w;
                track.go(&(rotation * (to - from)), dt);
            }
        } else {
            (self.seen, self.begin) = (Ring::new(None), None);
            // Poses have leapt back to where the state is.
            if off_w.norm() < DISPLACED {
                self.displaced_w = Vector3::zeros();
            }
        }
        if self.begin.is_none_or(|(begin, _)| begin <= accepted) {
            self.begin = Some((pose.time, off_w));
        }
        self.last = Some(Last { rotation_wi, felt, seen });
        if self
            .seen
            .iter()
            .next()
            .copied()
            .flatten()
            .is_none_or(|newest| pose.time - newest.time >= EVERY - 1e-4)
        {
            self.seen.push(Some(seen));
        }
    }

    /// The lines through the positions that a function of the tracks gives.
    fn line(&self, of: impl Fn(&Seen) -> Vector3) -> Line {
        let points = || self.seen.iter().flatten();
        let count = points().count().max(1) as f64;
        let newest = points().next().map_or(0.0, |seen| seen.time);
        let time = |seen: &Seen| seen.time - newest;
        let middle = points().map(time).sum::<f64>() / count;
        let mean = points().map(&of).sum::<Vector3>() / count;
        let (mut spread, mut moment) = (1e-9, Vector3::zeros());
        for seen in points() {
            let off = time(seen) - middle;
            spread += off * off;
            moment += (of(seen) - mean) * off;
        }
        let slope = moment / spread;
        let left = points()
            .map(|seen| (of(seen) - mean - slope * (time(seen) - middle)).norm_squared())
            .sum::<f64>();
        Line { slope, left: libm::sqrt(left / count) }
    }

    /// The motion that poses show, if they are those of this vehicle.
    pub(super) fn own(&self) -> Option<Own> {
        let last = self.last?;
        if self.seen.iter().flatten().count() < LEAST {
            return None;
        }
        let tells = |k: usize| {
            let track = |seen: &Seen| seen.tracks.get(k).copied().unwrap_or_default();
            let captured_w = |seen: &Seen| track(seen).captured_w;
            let off_w = |seen: &Seen| track(seen).captured_w - track(seen).position_w;
            let (captured, off) = (self.line(captured_w), self.line(off_w));
            let part = if captured.left > MOVES { off.left / captured.left } else { f64::INFINITY };
            // A vertical motion does not show a wrong yaw.
            let (aside, off_aside) =
                (self.line(|seen| level(captured_w(seen))).left, self.line(|seen| level(off_w(seen))).left);
            let part = if aside > MOVES { part.max(off_aside / aside) } else { part };
            (part, off.slope + track(&last.seen).velocity_w, aside > MOVES)
        };
        let [by_imu, by_rotors] = [tells(0), tells(1)];
        let of_centre = by_rotors.0 < by_imu.0;
        let (part, velocity_w, aside) = if of_centre { by_rotors } else { by_imu };
        if part.is_nan() || part > UNEXPLAINED {
            return None;
        }
        let age = self.sum.time - last.seen.time;
        let [gained_i, _] = self.sum.gained;
        let [before_i, _] = last.felt.gained;
        let gained_w = last.rotation_wi * (gained_i - before_i) - Vector3::new(0.0, 0.0, GRAVITY * age);
        let [imu, _] = last.seen.tracks;
        let position_w = imu.captured_w + (velocity_w + gained_w * 0.5) * age;
        let displaced_w = self.begin.map_or_else(Vector3::zeros, |(_, off_w)| off_w);
        Some(Own {
            velocity_w: velocity_w + gained_w,
            position_w,
            rotation_wi: last.rotation_wi,
            displaced_w: if displaced_w.norm() > DISPLACED { displaced_w } else { Vector3::zeros() },
            age,
            of_centre,
            aside,
        })
    }

    /// The state was replaced by what poses show: their displacement, m, world, is subtracted from now on.
    fn believed(&mut self, displaced_w: &Vector3) {
        self.displaced_w = *displaced_w;
        self.begin = None;
    }
}

/// The horizontal part of a vector, world.
fn level(v_w: Vector3) -> Vector3 {
    Vector3::new(v_w.x, v_w.y, 0.0)
}

impl Last {
    /// Whether a pose can be the next one of the same body.
    fn leads_to(&self, pose: &PoseSample) -> bool {
        let dt = pose.time - self.seen.time;
        let [imu, _] = self.seen.tracks;
        let moved = (pose.position_w - imu.captured_w).norm();
        let turned = so3::angle(&(self.rotation_wi.transpose() * pose.rotation_wr));
        dt > 0.0 && dt < GAP && moved < LEAP.0 + FASTEST.0 * dt && turned < LEAP.1 + FASTEST.1 * dt
    }
}

impl Flight {
    /// Takes what was felt up to a time, s, over `dt` s: the specific force, m/s^2, IMU axes.
    pub(super) fn feel_own(&mut self, specific_force_i: &Vector3, rotors_r: &Vector3, time: f64, dt: f64) {
        let force_i = specific_force_i - self.estimator.accelerometer_bias();
        self.own_poses.feel(&force_i, rotors_r, time, dt);
    }

    /// The specific force of the rotors with the bias, m/s^2, robot axes.
    pub(super) fn specific_thrust_r(&self, rotor_speeds: &RotorVector) -> Vector3 {
        let vehicle = &self.params.vehicle;
        (vehicle.body_wrench(rotor_speeds).force + self.control.bias_r.force) / vehicle.mass()
    }

    /// Takes a captured pose.
    pub(super) fn see_own(&mut self, pose: &PoseSample) {
        let state = self.estimator.navigation();
        let accepted = self.estimator.time() - self.estimator.health().position_age;
        let imu = self.params.vehicle.imu();
        let pose = self.estimator.pose_of_imu(pose);
        self.own_poses.see(
            &pose,
            accepted,
            (&state.position_w, &state.velocity_w),
            (&imu.position_r, &imu.rotation_r),
        );
    }

    /// If poses that are not used are those of this vehicle, the state is replaced by what they show.
    pub(super) fn believe_own(&mut self) {
        let refused = self.capture.lies() || self.estimator.health().position_age > REFUSED;
        if !refused || !self.supervisor.phase().in_flight() || self.lift_off.begins() {
            return;
        }
        let proven = |own: &Own| own.age < OLDEST && (own.aside || !self.capture.lies_aside());
        let Some(own) = self.own_poses.own().filter(proven) else { return };
        let state = self.estimator.navigation();
        let robot = self.estimator.robot_state();
        let imu = self.params.vehicle.imu();
        let rate_r = robot.angular_velocity_r;
        let rotation_wi = own.rotation_wi * so3::exp(&(imu.rotation_r.transpose() * rate_r * own.age));
        let lever_w = rotation_wi * (imu.rotation_r.transpose() * rate_r.cross(&imu.position_r));
        let velocity_w = if own.of_centre { own.velocity_w + lever_w } else { own.velocity_w };
        let turn = so3::angle(&(state.rotation_wi.transpose() * rotation_wi));
        let fast = (velocity_w - state.velocity_w).norm();
        if turn > TURNED || fast < WRONG.0 && turn < WRONG.1 {
            return;
        }
        let position_w = own.position_w - own.displaced_w;
        self.estimator.go_on_with(Navigation { position_w, velocity_w, rotation_wi, ..state }, own.of_centre);
        self.take_state();
        self.own_poses.believed(&own.displaced_w);
        self.capture.recognized();
    }
}

#[cfg(test)]
mod tests;
