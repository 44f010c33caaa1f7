//! Where the centre of mass goes while the attitude yields: the turn is about the tool.
//!
//! A turn about the centre of mass would take the tool along by the turn times the
//! tool's lever. So the centre of mass is led to where the turned attitude has the tool
//! at its reference, `r - T r` from where it would be without the turn T (r: the tool in
//! robot coordinates). It is led there by a critically damped filter of second order
//! whose rate is a half of `sqrt(g / |r|)`. Moving it takes horizontal force, which a vehicle
//! with no force to spare takes from a turn: of an angle a, `m |r| s^2 a` where the angle
//! itself gives `m g a`. With the filter this loop has a gain of
//! `|r| w^2 / g |s / (s + w)|^2 <= 1/4` at every frequency, whatever the vehicle can push.

use crate::{
    GRAVITY,
    types::{Matrix3, Reference, Vector3},
};
use libm::{exp, sqrt};

/// The filter's rate in parts of `sqrt(g / |r|)`: its square bounds the gain of the loop.
const RATE: f64 = 0.5;
/// Levers below this, m, count as this long.
const SHORTEST: f64 = 0.02;

/// Leads the centre of mass of one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AboutTool {
    /// The tool from the centre of mass, m, robot.
    pub lever_r: Vector3,
    /// 1/s.
    pub rate: f64,
}

/// How far it has been led.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Led {
    /// m and m/s, along the wanted attitude's axes.
    offset_r: Vector3,
    rate_r: Vector3,
}

impl AboutTool {
    pub(super) fn new(lever_r: &Vector3) -> Self {
        Self { lever_r: *lever_r, rate: RATE * sqrt(GRAVITY / lever_r.norm().max(SHORTEST)) }
    }

    /// Moves on by `dt` seconds with a turn from the wanted to the chosen attitude, and leads the
    /// wanted reference.
    pub(super) fn lead(&self, state: &mut Led, wanted: &Reference, turn: &Matrix3, dt: f64) -> Reference {
        if *state == Led::default() && *turn == Matrix3::identity() {
            return *wanted;
        }
        let target = self.lever_r - turn * self.lever_r;
        let left = state.offset_r - target;
        // Exact over a period in which the turn holds.
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
            ..*wanted
        }
    }
}
