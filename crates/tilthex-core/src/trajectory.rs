//! Way-points in six dimensions, joined by quintic polynomials that begin and end at rest, within limits on velocity
//! and acceleration.

use crate::{
    Error,
    error::check_range,
    force_axes::ForceAxes,
    so3,
    types::{Matrix3, Setpoint, Vector3, Wrench},
};

/// Largest number of way-points of a trajectory.
pub const MAX_WAYPOINTS: usize = 64;

/// Peak rate and peak second rate of `10 s^3 - 15 s^4 + 6 s^5` over one unit of time.
const PEAK_VELOCITY: f64 = 1.875;
const PEAK_ACCELERATION: f64 = 5.773_502_691_896_258;

/// A pose of the tool that is reached and left at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    /// Position of the tool tip, m, world.
    pub position_w: Vector3,
    /// Orientation of the tool: maps E to W.
    pub rotation_we: Matrix3,
    /// Wrench that the tool must exert here (world, at the tip); blended between way-points.
    pub wrench_w: Wrench,
    /// Along which axes that wrench is controlled instead of the pose, from here to where the next way-point is reached.
    pub force_axes: ForceAxes,
    /// Shortest time of the motion to this way-point, s; the limits may make it longer.
    pub duration: f64,
    /// Time to stay here, s.
    pub hold: f64,
}

/// Largest rates between way-points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Velocity, m/s.
    pub velocity: f64,
    /// Acceleration, m/s^2.
    pub acceleration: f64,
    /// Angular velocity, rad/s.
    pub angular_velocity: f64,
    /// Angular acceleration, rad/s^2.
    pub angular_acceleration: f64,
}

/// A checked trajectory of fixed size.
///
/// ```
/// use tilthex_core::{Matrix3, Vector3, Wrench, force_axes::ForceAxes, trajectory::{Limits, Trajectory, Waypoint}};
///
/// let at = |x: f64| Waypoint {
///     position_w: Vector3::new(x, 0.0, 1.0),
///     rotation_we: Matrix3::identity(),
///     wrench_w: Wrench::ZERO,
///     force_axes: ForceAxes::NONE,
///     duration: 0.0,
///     hold: 1.0,
/// };
/// let limits = Limits { velocity: 0.5, acceleration: 1.0, angular_velocity: 0.5, angular_acceleration: 1.0 };
/// let way = Trajectory::new(at(0.0), &[at(1.0)], &limits)?;
/// // It is at rest at both ends, and never faster than the limit.
/// assert_eq!(way.sample(0.5).velocity_w.norm(), 0.0);
/// assert_eq!(way.sample(way.duration()).position_w.x, 1.0);
/// assert!((0..1000).all(|k| way.sample(0.01 * f64::from(k)).velocity_w.norm() <= 0.5 + 1e-9));
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trajectory {
    start: Waypoint,
    legs: [Leg; MAX_WAYPOINTS],
    count: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Leg {
    to: Waypoint,
    /// Rotation vector from the leg's start to its end, in coordinates of the start.
    turn_e: Vector3,
    begins: f64,
    duration: f64,
}

impl Trajectory {
    /// A trajectory from `start` (whose own duration is ignored, its hold kept) through the way-points.
    ///
    /// # Errors
    /// Too many way-points; a number that is not finite or a limit that is not positive; a matrix that is not a
    /// rotation.
    pub fn new(start: Waypoint, waypoints: &[Waypoint], limits: &Limits) -> Result<Self, Error> {
        if waypoints.len() > MAX_WAYPOINTS {
            let (name, found) = ("way-points", waypoints.len());
            return Err(Error::Count { name, found, min: 0, max: MAX_WAYPOINTS });
        }
        check_range("velocity limit", limits.velocity, 1e-6, 100.0)?;
        check_range("acceleration limit", limits.acceleration, 1e-6, 1e3)?;
        check_range("angular velocity limit", limits.angular_velocity, 1e-6, 100.0)?;
        check_range("angular acceleration limit", limits.angular_acceleration, 1e-6, 1e4)?;
        check_waypoint(&start)?;
        let blank = Leg { to: start, turn_e: Vector3::zeros(), begins: 0.0, duration: 0.0 };
        let mut legs = [blank; MAX_WAYPOINTS];
        let (mut from, mut begins) = (start, start.hold);
        for (leg, to) in legs.iter_mut().zip(waypoints) {
            check_waypoint(to)?;
            let turn_e = so3::log(&(from.rotation_we.transpose() * to.rotation_we));
            let way = (to.position_w - from.position_w).norm();
            let duration = to
                .duration
                .max(shortest(way, limits.velocity, limits.acceleration))
                .max(shortest(turn_e.norm(), limits.angular_velocity, limits.angular_acceleration));
            *leg = Leg { to: *to, turn_e, begins, duration };
            begins += duration + to.hold;
            from = *to;
        }
        Ok(Self { start, legs, count: waypoints.len() })
    }

    /// A trajectory that stays at one tool pose.
    #[must_use]
    pub fn hold(position_w: Vector3, rotation_we: Matrix3) -> Self {
        let (wrench_w, turn_e) = (Wrench::ZERO, Vector3::zeros());
        let force_axes = ForceAxes::NONE;
        let start = Waypoint { position_w, rotation_we, wrench_w, force_axes, duration: 0.0, hold: 0.0 };
        let blank = Leg { to: start, turn_e, begins: 0.0, duration: 0.0 };
        Self { start, legs: [blank; MAX_WAYPOINTS], count: 0 }
    }

    /// The first way-point.
    #[must_use]
    pub fn start(&self) -> &Waypoint {
        &self.start
    }

    /// The way-points after the start, each with the duration of the motion to it.
    pub fn waypoints(&self) -> impl Iterator<Item = Waypoint> + '_ {
        self.legs().iter().map(|leg| Waypoint { duration: leg.duration, ..leg.to })
    }

    fn legs(&self) -> &[Leg] {
        self.legs.get(..self.count).unwrap_or(&[])
    }

    /// Time of the end, with the last hold, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        match self.legs().last() {
            Some(leg) => leg.begins + leg.duration + leg.to.hold,
            None => self.start.hold,
        }
    }

    /// Times at which the motions between way-points begin, s.
    pub fn begins(&self) -> impl Iterator<Item = f64> + '_ {
        self.legs[..self.count].iter().map(|leg| leg.begins)
    }

    /// The set-point at `time` seconds from the start. Before the start it is the first one, after the end the last
    /// one.
    #[must_use]
    pub fn sample(&self, time: f64) -> Setpoint {
        let starts = core::iter::once(&self.start).chain(self.legs().iter().map(|leg| &leg.to));
        let Some((from, leg)) = starts.zip(self.legs()).take_while(|(_, leg)| time >= leg.begins).last()
        else {
            return at_rest(&self.start);
        };
        let elapsed = time - leg.begins;
        if elapsed >= leg.duration {
            return at_rest(&leg.to);
        }
        let (t, s) = (leg.duration, elapsed / leg.duration);
        let part = s * s * s * (10.0 + s * (-15.0 + 6.0 * s));
        let rate = 30.0 * s * s * (1.0 - s) * (1.0 - s) / t;
        let second_rate = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (t * t);
        let way = leg.to.position_w - from.position_w;
        // The axis of the rotation is the same in the frames of start, motion and end.
        let turn_w = from.rotation_we * leg.turn_e;
        let blend = |a: &Vector3, b: &Vector3| a + (b - a) * part;
        Setpoint {
            position_w: from.position_w + way * part,
            rotation_we: from.rotation_we * so3::exp(&(leg.turn_e * part)),
            velocity_w: way * rate,
            angular_velocity_w: turn_w * rate,
            acceleration_w: way * second_rate,
            angular_acceleration_w: turn_w * second_rate,
            wrench_w: Wrench {
                force: blend(&from.wrench_w.force, &leg.to.wrench_w.force),
                torque: blend(&from.wrench_w.torque, &leg.to.wrench_w.torque),
            },
            force_axes: from.force_axes,
        }
    }
}

fn at_rest(waypoint: &Waypoint) -> Setpoint {
    let Waypoint { position_w, rotation_we, wrench_w, force_axes, .. } = *waypoint;
    Setpoint { wrench_w, force_axes, ..Setpoint::hold(position_w, rotation_we) }
}

/// Shortest rest-to-rest time of a quintic polynomial over a distance within both limits.
fn shortest(way: f64, velocity: f64, acceleration: f64) -> f64 {
    (PEAK_VELOCITY * way / velocity).max(libm::sqrt(PEAK_ACCELERATION * way / acceleration))
}

fn check_waypoint(w: &Waypoint) -> Result<(), Error> {
    for x in w.position_w.iter() {
        check_range("position of a way-point", *x, -1e4, 1e4)?;
    }
    so3::check_rotation("rotation of a way-point", &w.rotation_we)?;
    w.force_axes.check()?;
    check_range("duration of a way-point", w.duration, 0.0, 1e6)?;
    check_range("hold of a way-point", w.hold, 0.0, 1e6)?;
    for x in w.wrench_w.to_vector().iter() {
        check_range("wrench of a way-point", *x, -1e3, 1e3)?;
    }
    Ok(())
}
