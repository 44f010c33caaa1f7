//! Motions of a set-point without an order: the descent of a landing, and the return from a detour.

use crate::types::Vector3;

/// A landing reaches its speed of descent within this time, s.
const SINK_IN: f64 = 1.0;

/// Time constants of the return from a detour: of the position, and of the speed, s.
const WAY_BACK: (f64, f64) = (1.0, 0.5);

/// The descent of a landing. It continues until the ground is felt, and does not depend on the height of the ground
/// in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sink {
    /// Distance below the start of the descent, m.
    pub(super) depth: f64,
    /// Speed, m/s.
    pub(super) speed: f64,
    /// Acceleration, m/s^2.
    pub(super) rate: f64,
}

impl Sink {
    pub(super) fn step(&mut self, landing_speed: f64, dt: f64) {
        let change = landing_speed / SINK_IN;
        let off = landing_speed - self.speed;
        self.rate = if off.abs() > change * dt { libm::copysign(change, off) } else { 0.0 };
        self.speed += off.max(-change * dt).min(change * dt);
        self.depth += self.speed * dt;
    }
}

/// Distance of set-points from their commanded positions. A capture system that jumps moves the world; then the
/// vehicle flies back at the usual speed and does not jump.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Detour {
    /// Distance, speed and acceleration: m, m/s and m/s^2.
    pub(super) offset_w: Vector3,
    pub(super) velocity_w: Vector3,
    pub(super) acceleration_w: Vector3,
}

impl Detour {
    pub(super) fn step(&mut self, fastest: f64, back: bool, dt: f64) {
        // Second order, damping ratio 0.7, limited to the largest rate.
        let back_w = if back { -self.offset_w / WAY_BACK.0 } else { Vector3::zeros() };
        let wanted_w = back_w * (fastest / back_w.norm().max(fastest));
        self.acceleration_w = (wanted_w - self.velocity_w) / WAY_BACK.1;
        self.velocity_w += self.acceleration_w * dt;
        self.offset_w += self.velocity_w * dt;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_descent_changes_its_speed_smoothly_and_sinks_by_its_integral() {
        let (mut sink, mut last, mut depth) = (Sink::default(), 0.0, 0.0);
        for k in 0..4000 {
            let wanted = if (1000..2500).contains(&k) { 1.2 } else { 0.3 };
            sink.step(wanted, 2e-3);
            assert!((sink.speed - last).abs() <= wanted / SINK_IN * 2e-3 + 1e-12, "{k}");
            assert!((sink.speed - last - sink.rate * 2e-3).abs() < 1e-3, "{k}");
            depth += sink.speed * 2e-3;
            last = sink.speed;
        }
        assert!((sink.speed - 0.3).abs() < 1e-9 && (sink.depth - depth).abs() < 1e-9);
    }
}
