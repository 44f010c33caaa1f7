//! The attitude of the vehicle if the rotors cannot produce the lateral force in the wanted attitude: the smallest
//! rotation of the reference that brings the wanted force into the set of forces that the vehicle can produce.
//!
//! After Franchi, Carli, Bicego, Ryll, "Full-pose tracking control for aerial robotic systems with laterally bounded
//! input force", T-RO 34(2), 2018. That paper takes the lateral forces from a given planar set. Here they are the
//! vehicle's own section (no torque, a given magnitude of the force), whatever its shape. A vehicle with collinear
//! rotors is thus the extreme case of one with small lateral forces. The turn is only as fast as the rotors can turn
//! the vehicle (see `turn`): the attitude, its rate and its acceleration are consistent and continuous. The turn is
//! about the tool, which stays at its reference (see `about_tool`).

mod about_tool;
mod cuts;
mod search;
mod turn;

use crate::{
    Error, Vehicle, admittance,
    allocation::{AllocatorState, ForceSection, RotorStatus},
    error::check_range,
    so3,
    types::{Matrix3, Reference, Setpoint, Vector3},
    vehicle::{Actuation, Mounting},
};
use about_tool::{AboutTool, Led};
use cuts::{Plane, Sphere};
use libm::{acos, atan2, sqrt};
use search::{STEPS, Trial, search};
use turn::TurnFilter;
pub use turn::{TurnLimits, TurnState};

/// The wanted attitude, and whether the vehicle may turn from it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AttitudeMode {
    /// That of the reference; turned if the force needs it.
    #[default]
    Full,
    /// Level with the reference's heading; turned if the force needs it.
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
    /// Part of each rotor's input range, at either end, that a hover keeps free for torques and disturbances; below
    /// 0.5.
    pub reserve: f64,
    /// Largest turn for horizontal force, rad, from the hover attitude that is nearest to the wanted attitude. Force
    /// that needs a larger turn is given up.
    pub max_turn: f64,
    /// Bandwidth of the turn's filter, rad/s: small turns take about `2 / bandwidth`.
    pub bandwidth: f64,
}

impl Default for AttitudeParams {
    fn default() -> Self {
        let max_turn = 35.0 * core::f64::consts::PI / 180.0;
        Self { mode: AttitudeMode::default(), reserve: 0.05, max_turn, bandwidth: 10.0 }
    }
}

/// Chooses the attitude of one vehicle.
///
/// ```
/// use tilthex_core::{
///     Matrix3, Setpoint, Vector3,
///     allocation::RotorStatus,
///     attitude::{AttitudeParams, AttitudeSelector, AttitudeState},
///     examples,
/// };
///
/// let vehicle = examples::tilt_hex()?;
/// let selector = AttitudeSelector::new(&vehicle, AttitudeParams::default())?;
/// let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
/// // More force to the side than the rotors can give: the vehicle turns for it.
/// let force_w = Vector3::new(0.6 * vehicle.weight(), 0.0, vehicle.weight());
/// let mut state = AttitudeState::default();
/// let mut tilt = 0.0;
/// for _ in 0..1000 {
///     let wanted = selector.reference(&mut state, &setpoint, 0.002);
///     let attitude = selector.step(&mut state, &wanted, &force_w, &RotorStatus::default(), 0.002);
///     tilt = attitude.reference.rotation_wr[(0, 2)].asin();
/// }
/// assert!(tilt > 0.05 && tilt < selector.params().max_turn);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeSelector {
    params: AttitudeParams,
    section: ForceSection,
    /// The largest force that all rotors can produce, N, if it is known.
    largest: Option<f64>,
    weight: f64,
    /// Smallest and largest upward force, N, for which a turn is chosen.
    vertical: (f64, f64),
    filter: TurnFilter,
    tool: Mounting,
    about_tool: AboutTool,
}

/// The present turn, and the results of the last searches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AttitudeState {
    /// The turn from the wanted to the chosen attitude.
    pub turn: TurnState,
    led: Led,
    search: AllocatorState,
    /// The horizontal force that was possible in the last call, N, if it was not the whole one.
    possible: Option<f64>,
}

/// The attitude to fly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// The reference with the chosen attitude.
    pub reference: Reference,
    /// Angular acceleration, rad/s^2, to demand in addition to the reference's, because the rotors follow with a lag.
    pub lead_r: Vector3,
    /// The wanted force, N, world, without the part that no allowed turn makes possible.
    pub force_w: Vector3,
}

/// Number of rounds of cutting.
const ROUNDS: usize = 20;
/// A force counts as inside the section if its distance from it is this part of its size.
const INSIDE: f64 = 1e-8;
/// The vertical force for which a turn is chosen is at least this part of the weight, because the upward direction
/// must be known in a fall too. It is also at least this many times the smallest possible one, so that less
/// horizontal force is never harder to produce.
const LEAST_VERTICAL: f64 = 0.2;
const ABOVE_LEAST: f64 = 1.5;
/// The vertical force is at most this part of the largest; the rest is left for horizontal force.
const MOST_VERTICAL: f64 = 0.9;

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
        let filter = TurnFilter {
            limits: TurnLimits::of(vehicle),
            bandwidth: params.bandwidth,
            lag: vehicle.rotor_time_constant(),
        };
        Ok(Self::with_filter(vehicle, params, filter))
    }

    /// A selector with the same parameters for a vehicle whose model has been corrected; turns keep their limits.
    #[must_use]
    pub fn for_vehicle(&self, vehicle: &Vehicle) -> Self {
        Self::with_filter(vehicle, self.params, self.filter)
    }

    fn with_filter(vehicle: &Vehicle, params: AttitudeParams, filter: TurnFilter) -> Self {
        let section = ForceSection::new(vehicle, params.reserve);
        let weight = vehicle.weight();
        let far = 1e3 * weight;
        let farthest = |z: f64| {
            let force = Vector3::new(0.0, 0.0, z);
            section.nearest(&mut AllocatorState::default(), &force, &RotorStatus::default()).force.z
        };
        let vertical =
            ((LEAST_VERTICAL * weight).max(ABOVE_LEAST * farthest(-far)), MOST_VERTICAL * farthest(far));
        let tool = *vehicle.tool();
        let about_tool = AboutTool::new(&tool.position_r);
        Self { params, largest: section.largest(), section, weight, vertical, filter, tool, about_tool }
    }

    /// The parameters.
    #[must_use]
    pub fn params(&self) -> &AttitudeParams {
        &self.params
    }

    /// The reference of the centre of mass for a reference of the tool: in the wanted attitude, at the position to
    /// which the present turn leads it, `dt` seconds after the last call.
    #[must_use]
    #[inline]
    pub fn reference(&self, state: &mut AttitudeState, tool_reference: &Setpoint, dt: f64) -> Reference {
        let full = admittance::centre_of_mass_reference(tool_reference, &self.tool);
        let wanted = if self.params.mode.levels() {
            admittance::about_tool(tool_reference, &levelled(&full), &self.tool.position_r)
        } else {
            full
        };
        if !self.params.mode.turns() {
            return wanted;
        }
        self.about_tool.lead(&mut state.led, wanted, &state.turn.turn, dt)
    }

    /// The attitude for a wanted force of the rotors (N, world)
    /// and a [reference](Self::reference); `dt` is the time since the last call, s.
    #[must_use]
    #[inline]
    pub fn step(
        &self,
        state: &mut AttitudeState,
        wanted: &Reference,
        force_w: &Vector3,
        rotors: &RotorStatus,
        dt: f64,
    ) -> Attitude {
        if !self.params.mode.turns() {
            return Attitude { reference: *wanted, lead_r: Vector3::zeros(), force_w: *force_w };
        }
        let (target, force_w) = self.target(state, &wanted.rotation_wr, force_w, rotors);
        let mut reference = *wanted;
        let lead_r = self.filter.step(&mut state.turn, &mut reference, &target, dt);
        Attitude { reference, lead_r, force_w }
    }

    /// The limits of a turn's angular acceleration.
    #[must_use]
    pub fn turn_limits(&self) -> &TurnLimits {
        &self.filter.limits
    }

    /// The turn to make, wanted body coordinates, and the force that it makes possible: the whole wanted force, or as
    /// much of the horizontal part as the largest turn allows.
    #[inline]
    fn target(
        &self,
        state: &mut AttitudeState,
        rotation_wr: &Matrix3,
        force_w: &Vector3,
        rotors: &RotorStatus,
    ) -> (Vector3, Vector3) {
        let last = state.possible.take();
        if let Some((_, None)) = self.first_cut(state, rotation_wr, force_w, rotors) {
            return (Vector3::zeros(), *force_w);
        }
        let mut turn = |force_w: &Vector3| self.turn(state, rotation_wr, force_w, rotors);
        let vertical = force_w.z.min(self.vertical.1).max(self.vertical.0);
        let upright = turn(&Vector3::new(0.0, 0.0, self.weight)).unwrap_or_else(Vector3::zeros);
        let hover = so3::exp(&upright);
        let cut = |part: u16| f64::from(part) / f64::from(STEPS);
        let none = Trial { turn: upright, room: self.params.max_turn };
        let horizontal = force_w.xy().norm();
        let steps = |possible: f64| (f64::from(STEPS) * (possible / horizontal).min(1.0)) as u16;
        // No turn makes a larger force possible than the largest.
        let largest = self.largest.filter(|_| rotors.lost == 0).unwrap_or(f64::INFINITY);
        let most = steps(sqrt((largest * largest - vertical * vertical).max(0.0)));
        let (best, part) = search(last.map_or(most, steps).min(most), most, none, |part| {
            let force_w = Vector3::new(cut(part) * force_w.x, cut(part) * force_w.y, vertical);
            let turn = turn(&force_w)?;
            // The cosine of the rotation from the hover attitude.
            let cosine = 0.5 * (hover.dot(&so3::exp(&turn)) - 1.0);
            Some(Trial { turn, room: self.params.max_turn - acos(cosine.clamp(-1.0, 1.0)) })
        });
        if part == STEPS {
            return (best, *force_w);
        }
        state.possible = Some(cut(part) * horizontal);
        (best, Vector3::new(cut(part) * force_w.x, cut(part) * force_w.y, force_w.z))
    }

    /// A force in wanted body coordinates, and a plane that parts it from the section; no plane if no turn is necessary. `None`
    /// for a force that is not finite.
    #[inline]
    fn first_cut(
        &self,
        state: &mut AttitudeState,
        rotation_wr: &Matrix3,
        force_w: &Vector3,
        rotors: &RotorStatus,
    ) -> Option<(Vector3, Option<(Vector3, f64)>)> {
        let force_r = rotation_wr.transpose() * force_w;
        let size = force_r.norm();
        if !size.is_finite() {
            return None;
        }
        if size < 1e-6 * self.weight {
            return Some((force_r, None));
        }
        Some((force_r, self.section.cut(&mut state.search, &force_r, rotors, INSIDE * size)))
    }

    /// The smallest rotation vector, wanted body coordinates, whose turn makes the force possible; `None` if no turn
    /// does.
    fn turn(
        &self,
        state: &mut AttitudeState,
        rotation_wr: &Matrix3,
        force_w: &Vector3,
        rotors: &RotorStatus,
    ) -> Option<Vector3> {
        let (force_r, first) = self.first_cut(state, rotation_wr, force_w, rotors)?;
        let Some(first) = first else { return Some(Vector3::zeros()) };
        let size = force_r.norm();
        let possible = self.nearest_of_size(state, &force_r, first, rotors)?;
        // Rotates the possible direction onto the wanted one.
        let axis = possible.cross(&force_r);
        let (sine, cosine) = (axis.norm(), possible.dot(&force_r));
        if sine > INSIDE * size * size {
            return Some(axis * (atan2(sine, cosine) / sine));
        }
        // Equal, or opposite: then about any axis across.
        let half_turn = Vector3::new(core::f64::consts::PI, 0.0, 0.0);
        Some(if cosine > 0.0 { Vector3::zeros() } else { half_turn })
    }

    /// The possible force with the same magnitude that is nearest to `force_r`, if there is one. Found by cutting
    /// planes of the section, the first given, each other one from the last guess.
    fn nearest_of_size(
        &self,
        state: &mut AttitudeState,
        force_r: &Vector3,
        first: (Vector3, f64),
        rotors: &RotorStatus,
    ) -> Option<Vector3> {
        let tolerance = INSIDE * force_r.norm();
        let mut sphere = Sphere::new(*force_r);
        let (mut guess, mut cut) = (*force_r, Some(first));
        for _ in 0..ROUNDS {
            let Some((normal, offset)) = cut else { break };
            sphere.cut(Plane { normal, offset });
            guess = sphere.nearest()?;
            cut = self.section.cut(&mut state.search, &guess, rotors, tolerance);
        }
        Some(guess)
    }
}

/// The reference, level, with its heading.
fn levelled(reference: &Reference) -> Reference {
    let r = &reference.rotation_wr;
    let omega_w = r * reference.angular_velocity_r;
    let x: Vector3 = r.column(0).into_owned();
    let x_rate = omega_w.cross(&x);
    let horizontal = x.x * x.x + x.y * x.y;
    // If x points up or down there is no heading.
    let rate = if horizontal > 1e-6 { (x.x * x_rate.y - x.y * x_rate.x) / horizontal } else { 0.0 };
    let acceleration = r * reference.angular_acceleration_r;
    Reference {
        rotation_wr: so3::rot_z(atan2(x.y, x.x)),
        angular_velocity_r: Vector3::new(0.0, 0.0, rate),
        angular_acceleration_r: Vector3::new(0.0, 0.0, if horizontal > 1e-6 { acceleration.z } else { 0.0 }),
        ..*reference
    }
}

#[cfg(test)]
mod tests;
