//! How a set-point moves of itself: the descent of a landing, and the way back from a detour.

use crate::types::Vector3;

/// A landing reaches its speed of descent within this time, s.
const SINK_IN: f64 = 1.0;

/// Times of the way back from a detour: to the place, and to the speed, s.
const WAY_BACK: (f64, f64) = (1.0, 0.5);

/// The descent of a landing, which goes on until the ground is felt: where the
/// ground is in the world is not relied on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sink {
    /// Distance below the start of the descent, m.
    pub(super) depth: f64,
    /// m/s.
    pub(super) speed: f64,
    /// m/s^2.
    pub(super) rate: f64,
}

impl Sink {
    pub(super) fn step(&mut self, landing_speed: f64, dt: f64) {
        let faster = self.speed + landing_speed / SINK_IN * dt;
        self.rate = if faster < landing_speed { landing_speed / SINK_IN } else { 0.0 };
        self.speed = faster.min(landing_speed);
        self.depth += self.speed * dt;
    }
}

/// How far set-points are moved from where they were commanded: a capture system that jumps
/// moves the world, and what follows is a flight back at the usual speed, not a leap.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Detour {
    /// m, m/s and m/s^2.
    pub(super) offset_w: Vector3,
    pub(super) velocity_w: Vector3,
    pub(super) acceleration_w: Vector3,
}

impl Detour {
    pub(super) fn step(&mut self, fastest: f64, back: bool, dt: f64) {
        // Second order, damping ratio 0.7, cut to the fastest.
        let back_w = if back { -self.offset_w / WAY_BACK.0 } else { Vector3::zeros() };
        let wanted_w = back_w * (fastest / back_w.norm().max(fastest));
        self.acceleration_w = (wanted_w - self.velocity_w) / WAY_BACK.1;
        self.velocity_w += self.acceleration_w * dt;
        self.offset_w += self.velocity_w * dt;
    }
}
