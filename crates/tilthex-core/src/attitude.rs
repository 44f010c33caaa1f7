//! The attitude to fly where the rotors can not give the lateral force that
//! the wanted one needs: the least turn of the reference that brings the wanted
//! force into what the vehicle can produce.
//!
//! After Franchi, Carli, Bicego, Ryll, "Full-pose tracking control for aerial
//! robotic systems with laterally bounded input force", T-RO 34(2), 2018, which
//! takes the lateral forces from a given planar set; here they are the vehicle's
//! own section (no torque, the force's own magnitude), whatever its shape, so
//! that a vehicle with collinear rotors is the extreme case of one with few
//! lateral forces. The turn passes a critically damped filter: the attitude, its
//! rate and its acceleration are consistent and the first two continuous.

use crate::{
    Error, GRAVITY, Vehicle,
    allocation::{AllocatorState, ForceSection, RotorStatus},
    error::check_range,
    so3,
    types::{Matrix3, Reference, Vector3},
    vehicle::Actuation,
};
use libm::{atan2, exp, fabs, sqrt};

/// Which attitude is wanted, and whether it yields.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AttitudeMode {
    /// That of the reference; turned where the force needs it.
    #[default]
    Full,
    /// Level with the reference's heading; turned where the force needs it.
    MinimalTilt,
    /// Level with the reference's heading, always: lateral force beyond reach is given up.
    ZeroTilt,
    /// That of the reference, always: lateral force beyond reach is given up.
    FixedTilt,
}

impl AttitudeMode {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Full, Self::MinimalTilt, Self::ZeroTilt, Self::FixedTilt];

    /// Its name in a configuration.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::MinimalTilt => "minimal-tilt",
            Self::ZeroTilt => "zero-tilt",
            Self::FixedTilt => "fixed-tilt",
        }
    }

    /// The mode of a [`Self::name`].
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    fn turns(self) -> bool {
        matches!(self, Self::Full | Self::MinimalTilt)
    }

    fn levels(self) -> bool {
        matches!(self, Self::MinimalTilt | Self::ZeroTilt)
    }
}

/// How the attitude is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeParams {
    /// Which attitude is wanted.
    pub mode: AttitudeMode,
    /// Part of each rotor's input range, at either end, that hovering leaves
    /// for torques and disturbances; below 0.5.
    pub reserve: f64,
    /// Largest turn away from the wanted attitude, rad; horizontal force that needs more is given up.
    pub max_turn: f64,
    /// Both poles of the turn's filter, rad/s.
    pub bandwidth: f64,
}

impl Default for AttitudeParams {
    fn default() -> Self {
        let max_turn = core::f64::consts::FRAC_PI_4;
        Self { mode: AttitudeMode::default(), reserve: 0.05, max_turn, bandwidth: 10.0 }
    }
}

/// Chooses the attitude of one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeSelector {
    params: AttitudeParams,
    section: ForceSection,
    weight: f64,
}

/// The turn now, and where the last searches ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AttitudeState {
    /// Rotation vector from the wanted to the chosen attitude, rad, wanted body coordinates.
    pub turn: Vector3,
    /// Its rate, rad/s.
    pub turn_rate: Vector3,
    search: AllocatorState,
}

/// The attitude to fly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// The reference with the chosen attitude.
    pub reference: Reference,
    /// The wanted force, N, world, less what no allowed turn makes possible.
    pub force_w: Vector3,
}

/// Cutting planes that are kept, and rounds of cutting.
const PLANES: usize = 8;
const ROUNDS: usize = 20;
/// A force this part of its size away from the section is in it.
const INSIDE: f64 = 1e-8;
/// Halvings of the horizontal force in search of the largest possible.
const HALVINGS: usize = 10;

impl AttitudeSelector {
    /// Checks the parameters against the vehicle.
    ///
    /// # Errors
    /// A parameter out of range, or a mode that never turns for a vehicle that must.
    pub fn new(vehicle: &Vehicle, params: AttitudeParams) -> Result<Self, Error> {
        check_range("attitude reserve", params.reserve, 0.0, 0.45)?;
        check_range("attitude max_turn", params.max_turn, 0.0, 1.5)?;
        check_range("attitude bandwidth", params.bandwidth, 0.1, 500.0)?;
        if vehicle.actuation() != Actuation::Pose && !params.mode.turns() {
            return Err(Error::Unsupported {
                name: "attitude",
                found: params.mode.name(),
                expected: "\"full\" or \"minimal-tilt\": this vehicle moves sideways only by tilting",
            });
        }
        let section = ForceSection::new(vehicle, params.reserve);
        Ok(Self { params, section, weight: vehicle.mass() * GRAVITY })
    }

    /// The parameters.
    #[must_use]
    pub fn params(&self) -> &AttitudeParams {
        &self.params
    }

    /// The attitude for a wanted force (N, world: what the rotors shall exert)
    /// and a reference; `dt` is the time since the last call, s.
    #[must_use]
    pub fn step(
        &self,
        state: &mut AttitudeState,
        reference: &Reference,
        force_w: &Vector3,
        rotors: &RotorStatus,
        dt: f64,
    ) -> Attitude {
        let wanted = if self.params.mode.levels() { levelled(reference) } else { *reference };
        if !self.params.mode.turns() {
            return Attitude { reference: wanted, force_w: *force_w };
        }
        let mut force_w = *force_w;
        let mut turn = self.turn(state, &wanted.rotation_wr, &force_w, rotors);
        if turn.norm() > self.params.max_turn {
            force_w = self.within_reach(state, &wanted.rotation_wr, &force_w, rotors);
            turn = self.turn(state, &wanted.rotation_wr, &force_w, rotors);
            let angle = turn.norm();
            if angle > self.params.max_turn {
                turn *= self.params.max_turn / angle;
            }
        }
        let acceleration = self.filter(state, &turn, dt);
        Attitude { reference: turned(&wanted, state, &acceleration), force_w }
    }

    /// The least rotation vector, wanted body coordinates, whose turn makes the force possible.
    fn turn(
        &self,
        state: &mut AttitudeState,
        rotation_wr: &Matrix3,
        force_w: &Vector3,
        rotors: &RotorStatus,
    ) -> Vector3 {
        let force_r = rotation_wr.transpose() * force_w;
        let size = force_r.norm();
        if !size.is_finite() || size < 1e-6 * self.weight {
            return Vector3::zeros();
        }
        let possible = self.nearest_of_size(state, &force_r, rotors);
        // Turns the possible direction onto the wanted one.
        let axis = possible.cross(&force_r);
        let sine = axis.norm();
        if sine <= INSIDE * size * possible.norm() {
            return Vector3::zeros();
        }
        axis * (atan2(sine, possible.dot(&force_r)) / sine)
    }

    /// The possible force nearest to `force_r` of those as large; by cutting
    /// planes, each the supporting plane of the section's point nearest to the last guess.
    fn nearest_of_size(&self, state: &mut AttitudeState, force_r: &Vector3, rotors: &RotorStatus) -> Vector3 {
        let mut sphere =
            Sphere { wanted: *force_r, size: force_r.norm(), planes: [Plane::default(); PLANES], count: 0 };
        let mut guess = *force_r;
        for _ in 0..ROUNDS {
            let nearest = self.section.nearest(&mut state.search, &guess, rotors).force;
            let outwards = guess - nearest;
            let distance = outwards.norm();
            if distance <= INSIDE * sphere.size {
                return guess;
            }
            let normal = outwards / distance;
            sphere.cut(Plane { normal, offset: normal.dot(&nearest) });
            match sphere.nearest() {
                Some(next) => guess = next,
                // No possible force is that large, or that small: one in the right direction.
                None => return nearest,
            }
        }
        guess
    }

    /// The wanted force with as much of its horizontal part as the largest turn makes possible.
    fn within_reach(
        &self,
        state: &mut AttitudeState,
        rotation_wr: &Matrix3,
        force_w: &Vector3,
        rotors: &RotorStatus,
    ) -> Vector3 {
        let part = |s: f64| Vector3::new(s * force_w.x, s * force_w.y, force_w.z);
        let (mut possible, mut impossible) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (possible + impossible);
            if self.turn(state, rotation_wr, &part(middle), rotors).norm() > self.params.max_turn {
                impossible = middle;
            } else {
                possible = middle;
            }
        }
        part(possible)
    }

    /// Moves the turn on by the exact step of two equal poles; returns its acceleration, rad/s^2.
    fn filter(&self, state: &mut AttitudeState, target: &Vector3, dt: f64) -> Vector3 {
        let w = self.params.bandwidth;
        let decay = exp(-w * dt);
        let away = state.turn - target;
        let slope = state.turn_rate + away * w;
        state.turn = target + (away + slope * dt) * decay;
        state.turn_rate = (state.turn_rate - slope * (w * dt)) * decay;
        (target - state.turn) * (w * w) - state.turn_rate * (2.0 * w)
    }
}

/// The reference, level, with its heading.
fn levelled(reference: &Reference) -> Reference {
    let r = &reference.rotation_wr;
    let omega_w = r * reference.angular_velocity_r;
    let x: Vector3 = r.column(0).into_owned();
    let x_rate = omega_w.cross(&x);
    let horizontal = x.x * x.x + x.y * x.y;
    // Where x points up or down there is no heading to turn.
    let rate = if horizontal > 1e-6 { (x.x * x_rate.y - x.y * x_rate.x) / horizontal } else { 0.0 };
    let acceleration = r * reference.angular_acceleration_r;
    Reference {
        rotation_wr: so3::rot_z(atan2(x.y, x.x)),
        angular_velocity_r: Vector3::new(0.0, 0.0, rate),
        angular_acceleration_r: Vector3::new(0.0, 0.0, if horizontal > 1e-6 { acceleration.z } else { 0.0 }),
        ..*reference
    }
}

/// The wanted attitude turned by the filter's state. The change of the turn's
/// Jacobian, of second order in the turn, is left out of the acceleration.
fn turned(wanted: &Reference, state: &AttitudeState, acceleration: &Vector3) -> Reference {
    if state.turn == Vector3::zeros() && state.turn_rate == Vector3::zeros() {
        return *wanted;
    }
    let turn = so3::exp(&state.turn);
    let jacobian = so3::left_jacobian(&-state.turn);
    let carried = turn.transpose() * wanted.angular_velocity_r;
    let turning = jacobian * state.turn_rate;
    Reference {
        rotation_wr: wanted.rotation_wr * turn,
        angular_velocity_r: carried + turning,
        angular_acceleration_r: turn.transpose() * wanted.angular_acceleration_r - turning.cross(&carried)
            + jacobian * acceleration,
        ..*wanted
    }
}

/// The half space `normal . f <= offset`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Plane {
    normal: Vector3,
    offset: f64,
}

/// Forces of one size, some cut off by planes.
struct Sphere {
    wanted: Vector3,
    size: f64,
    planes: [Plane; PLANES],
    count: usize,
}

impl Sphere {
    /// Adds a plane; in place of the one farthest from the wanted force where there are too many.
    fn cut(&mut self, plane: Plane) {
        if self.count < PLANES {
            self.planes[self.count] = plane;
            self.count += 1;
            return;
        }
        let mut slackest = 0;
        let mut most = f64::NEG_INFINITY;
        for (i, p) in self.planes.iter().enumerate() {
            let slack = p.offset - p.normal.dot(&self.wanted);
            if slack > most {
                most = slack;
                slackest = i;
            }
        }
        self.planes[slackest] = plane;
    }

    /// The force of this size inside all planes that is nearest to the wanted one:
    /// on one plane's circle, or where two circles meet.
    fn nearest(&self) -> Option<Vector3> {
        let planes = self.planes.get(..self.count).unwrap_or(&[]);
        let mut best: Option<Vector3> = None;
        let mut consider = |f: Vector3| {
            let slack = 1e-11 * self.size;
            let allowed = planes.iter().all(|p| p.normal.dot(&f) <= p.offset + slack);
            if allowed && best.is_none_or(|b| f.dot(&self.wanted) > b.dot(&self.wanted)) {
                best = Some(f);
            }
        };
        for (i, a) in planes.iter().enumerate() {
            if let Some(f) = self.on_circle(a) {
                consider(f);
            }
            for b in planes.iter().take(i) {
                if let Some((f, g)) = self.meeting(a, b) {
                    consider(f);
                    consider(g);
                }
            }
        }
        best
    }

    fn on_circle(&self, p: &Plane) -> Option<Vector3> {
        let radius2 = self.size * self.size - p.offset * p.offset;
        let along = self.wanted - p.normal * p.normal.dot(&self.wanted);
        let length = along.norm();
        // From the pole every direction is as near: take the most upright.
        let along = if length > 1e-9 * self.size {
            along / length
        } else {
            let up = Vector3::z() - p.normal * p.normal.z;
            if up.norm() > 1e-9 { up.normalize() } else { Vector3::x() }
        };
        (radius2 >= 0.0).then(|| p.normal * p.offset + along * sqrt(radius2))
    }

    fn meeting(&self, a: &Plane, b: &Plane) -> Option<(Vector3, Vector3)> {
        let line = a.normal.cross(&b.normal);
        let sine2 = line.norm_squared();
        if sine2 < 1e-12 {
            return None;
        }
        let cosine = a.normal.dot(&b.normal);
        let foot =
            (a.normal * (a.offset - b.offset * cosine) + b.normal * (b.offset - a.offset * cosine)) / sine2;
        let rest = self.size * self.size - foot.norm_squared();
        if fabs(rest) < 1e-12 * self.size * self.size {
            return Some((foot, foot));
        }
        (rest > 0.0).then(|| {
            let half = line * sqrt(rest / sine2);
            (foot + half, foot - half)
        })
    }
}

#[cfg(test)]
mod tests;
