//! The flight that shows the errors of a model: a level hover, and three tilted hovers at another heading. A wind keeps its
//! direction in the world when the vehicle turns, and the errors of its model do not.

use super::{SHORTEST, TILT};
use crate::{
    Error, Vehicle,
    force_axes::ForceAxes,
    so3,
    trajectory::{Limits, Trajectory, Waypoint},
    types::{Matrix3, Vector3, Wrench},
    vehicle::inputs,
};

/// The flight after take-off from which the model is learnt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Calibration {
    /// Nothing: the mean wrench of the first hover is the bias.
    #[default]
    None,
    /// A level hover.
    Hover,
    /// A level hover and three that are tilted, at another heading.
    Tilts,
}

impl Calibration {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::None, Self::Hover, Self::Tilts];

    /// Its name in a configuration.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Hover => "hover",
            Self::Tilts => "tilts",
        }
    }

    /// The calibration of a [`Self::name`].
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|c| c.name() == name)
    }
}

/// Tilted hovers, and their heading relative to that of the level hover, rad.
const TILTS: u8 = 3;
const HEADING: f64 = core::f64::consts::FRAC_PI_2;
/// Part of each rotor's input range that a tilted hover keeps free at either end.
const ROOM: f64 = 0.08;
/// If rotors have no room, the tilt is reduced in these steps, rad, down to the smallest.
const STEP: f64 = core::f64::consts::PI / 180.0;
const LEAST: f64 = 5.0 * core::f64::consts::PI / 180.0;
/// Durations, s: of the first hover, in which the estimator settles, of each tilted hover, and of the end.
const FIRST: f64 = SHORTEST + 3.0;
const TILTED: f64 = SHORTEST + 1.0;
const LAST: f64 = 1.0;

/// A trajectory that begins and ends with a level hover with the tool at a position and heading, with tilted hovers
/// about the same centre of mass between, turned by 90 degrees.
///
/// A vehicle that hovers in one attitude only stays level.
///
/// # Errors
/// What [`Trajectory::new`] refuses.
pub fn calibration_flight(
    vehicle: &Vehicle,
    kind: Calibration,
    tool_w: Vector3,
    heading: f64,
    limits: &Limits,
) -> Result<Trajectory, Error> {
    let tool = vehicle.tool();
    let level = so3::rot_z(heading);
    let centre_w = tool_w - level * tool.position_r;
    let at = |turn: Matrix3, hold: f64| {
        let rotation_wr = level * turn;
        Waypoint {
            position_w: centre_w + rotation_wr * tool.position_r,
            rotation_we: rotation_wr * tool.rotation_r,
            wrench_w: Wrench::ZERO,
            force_axes: ForceAxes::NONE,
            duration: 0.0,
            hold,
        }
    };
    let start = Waypoint { position_w: tool_w, ..at(Matrix3::identity(), FIRST) };
    let mut ways = [Waypoint { position_w: tool_w, ..at(Matrix3::identity(), LAST) }; TILTS as usize + 1];
    let tilts = kind == Calibration::Tilts && vehicle.rank() == 6;
    let mut count = 0;
    for k in (0..TILTS).filter(|_| tilts) {
        let angle = f64::from(k) * core::f64::consts::TAU / f64::from(TILTS);
        let axis_r = Vector3::new(libm::cos(angle), libm::sin(angle), 0.0);
        if let (Some(slot), Some(turn)) = (ways.get_mut(count), largest_tilt(vehicle, &axis_r)) {
            *slot = at(so3::rot_z(HEADING) * turn, TILTED);
            count += 1;
        }
    }
    Trajectory::new(start, ways.get(..count + 1).unwrap_or(&ways), limits)
}

/// The largest turn about an axis, up to [`TILT`], in which the rotors keep some room in a hover.
fn largest_tilt(vehicle: &Vehicle, axis_r: &Vector3) -> Option<Matrix3> {
    let mut tilt = TILT;
    while tilt > LEAST {
        let turn = so3::exp(&(axis_r * tilt));
        let speeds = vehicle.hover_speeds(&turn);
        let free = vehicle.rotors().iter().zip(inputs(&speeds).iter()).all(|(rotor, input)| {
            let at = |speed: f64| speed * speed.abs();
            let (lower, upper) = (at(rotor.min_speed), at(rotor.max_speed));
            let kept = ROOM * (upper - lower);
            (lower + kept..=upper - kept).contains(input)
        });
        if free {
            return Some(turn);
        }
        tilt -= STEP;
    }
    None
}
