//! The motion of the centre of mass while the attitude yields, so that the turn is about the tool.
//!
//! A turn about the centre of mass would move the tool by the turn times the tool's lever. Therefore the centre of
//! mass is led to the position at which the turned attitude has the tool at its reference. This position is `r - T r`
//! away from the one without the turn T (r: the tool in robot coordinates). A critically damped filter of second
//! order leads it there, with the rate `sqrt(g / |r|) / 2`. To move the centre of mass takes horizontal force, and a
//! vehicle with no force to spare must turn for it: an angle a demands `m |r| s^2 a`, and gives `m g a`. With the
//! filter this loop has a gain of `|r| w^2 / g |s / (s + w)|^2 <= 1/4` at every frequency, whatever the vehicle can
//! push.

use crate::{
    GRAVITY, so3,
    types::{Reference, Vector3},
};
use libm::{exp, sqrt};

/// The filter's rate divided by `sqrt(g / |r|)`. Its square bounds the gain of the loop.
const RATE: f64 = 0.5;
/// A lever shorter than this, m, counts as this long.
const SHORTEST: f64 = 0.02;

/// Leads the centre of mass of one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AboutTool {
    /// Position of the tool from the centre of mass, m, robot.
    pub lever_r: Vector3,
    /// Rate of the filter, 1/s.
    pub rate: f64,
}

/// The state of the filter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Led {
    /// Offset and speed, m and m/s, along the wanted attitude's axes.
    offset_r: Vector3,
    rate_r: Vector3,
}

impl AboutTool {
    pub(super) fn new(lever_r: &Vector3) -> Self {
        Self { lever_r: *lever_r, rate: RATE * sqrt(GRAVITY / lever_r.norm().max(SHORTEST)) }
    }

    /// Moves by `dt` seconds with a turn (rotation vector) from the wanted to the chosen attitude, and returns the wanted reference
    /// with the led position.
    #[inline]
    pub(super) fn lead(&self, state: &mut Led, wanted: Reference, turn: &Vector3, dt: f64) -> Reference {
        if state.offset_r.norm_squared() + state.rate_r.norm_squared() + turn.norm_squared() == 0.0 {
            return wanted;
        }
        let target = self.lever_r - so3::exp(turn) * self.lever_r;
        let left = state.offset_r - target;
        // Exact over a period in which the turn is constant.
        let slope = state.rate_r + left * self.rate;
        let decay = exp(-self.rate * dt);
        let left = (left + slope * dt) * decay;
        let rate_r = state.rate_r * decay - slope * (self.rate * dt * decay);
        let acceleration_r = -left * (self.rate * self.rate) - rate_r * (2.0 * self.rate);
        *state = Led { offset_r: target + left, rate_r };
        let (r, omega) = (&wanted.rotation_wr, &wanted.angular_velocity_r);
        let offset_r = &state.offset_r;
        let carried = omega.cross(offset_r);
        let turned = wanted.angular_acceleration_r.cross(offset_r) + omega.cross(&carried);
        Reference {
            position_w: wanted.position_w + r * offset_r,
            velocity_w: wanted.velocity_w + r * (rate_r + carried),
            acceleration_w: wanted.acceleration_w
                + r * (acceleration_r + 2.0 * omega.cross(&rate_r) + turned),
            ..wanted
        }
    }
}
