//! The descent of a vehicle that must come down at any cost: its rotors carry less and less of the weight while it does not sink.

use super::{
    guidance::BLIND_ACCELERATION,
    landing::{LOADS, STILL, Seen},
};
use crate::GRAVITY;

/// What is carried falls by this part of the weight a second where the vehicle does not sink
/// faster than this much, m/s, and rises again where it sinks faster than this much.
const RATE: f64 = 0.1;
const SPEEDS: (f64, f64) = (0.4, 1.0);
/// The ground carries a vehicle whose rotors carry at least this much less than its weight, as a part of it, where at least
/// this part of what they lack is felt, in the mean over this time, s. The speed does not tell: without poses it may be wrong.
const GROUND_CARRIES: (f64, f64, f64) = (0.08, 0.5, 0.3);
/// A speed that was found wrong is not used for this time, s, which is enough to feel whether the ground carries.
const DOUBTED: f64 = 1.5;
/// What is carried rises this many times faster, and falls this many times faster at the height of the ground.
const FASTER: f64 = 5.0;
/// A vehicle that is unloaded by force counts as lying on something after this time, s.
const REST: f64 = 2.0;
/// Whatever is felt, a vehicle without a place whose rotors have carried nothing for this time, s, has fallen down.
const FALLS: f64 = 10.0;

/// A descent by force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Forced {
    /// Largest part of the weight that the rotors carry, and for how long they have carried nothing while the vehicle lay
    /// still, s.
    carried: f64,
    unloaded: f64,
    /// For how long they have carried nothing, whatever was felt, s.
    falling: f64,
    /// Mean upward force that is felt, N.
    felt: f64,
    /// Distance that it has sunk by its speed, m, and for how long the speed is not used, s.
    sunk: f64,
    doubted: f64,
}

impl Forced {
    /// The rotors carry the whole weight, or what carries a vehicle whose speed is not known.
    pub(super) fn begin(seen: &Seen) -> Self {
        let carried = if seen.sinks.is_some() { 1.0 } else { 1.0 - BLIND_ACCELERATION / GRAVITY };
        Self { carried, unloaded: 0.0, falling: 0.0, felt: 0.0, sunk: 0.0, doubted: 0.0 }
    }

    /// One tick; `rests` says whether the IMU alone shows rest, if it shows anything. Returns the largest part of the weight that the
    /// rotors carry, and whether the vehicle lies on something.
    pub(super) fn step(&mut self, seen: &Seen, weight: f64, rests: Option<bool>, dt: f64) -> (f64, bool) {
        let placed = seen.above.is_some();
        let (least, part, mean) = GROUND_CARRIES;
        let felt = seen.observed_w.map_or(0.0, |force| force.z);
        self.felt += (felt - self.felt) * (dt / mean).min(1.0);
        let lacks = 1.0 - self.carried;
        let stands = !placed && lacks > least && self.felt > part * lacks * weight;
        self.sunk = if placed { 0.0 } else { (self.sunk - seen.velocity * dt).max(0.0) };
        self.doubted = (self.doubted - dt).max(0.0);
        if self.sunk > seen.room {
            // This is not possible: the ground would have stopped it.
            (self.sunk, self.doubted) = (0.0, DOUBTED);
        }
        let (slow, fast) = SPEEDS;
        let down = seen.above.is_some_and(|above| above <= 0.0) && -seen.velocity < slow;
        let unknown = seen.hopeless || seen.sinks.is_none() || self.doubted > 0.0;
        let rate = if stands || down {
            FASTER * -RATE
        } else if unknown || -seen.velocity < slow {
            -RATE
        } else if -seen.velocity > fast {
            FASTER * RATE
        } else {
            0.0
        };
        self.carried = (self.carried + rate * dt).max(LOADS.1).min(1.0);
        // What moves sideways without thrust is carried by a push, not by something that it lies on.
        let carried_away = placed && seen.speed > fast;
        let lies = !carried_away && seen.velocity.abs() < STILL.0;
        // Where neither place nor speed shows the ground, only rest shows it; if nothing is felt, nothing can show it.
        let unsure = stands || seen.hopeless;
        let lowest = self.carried <= LOADS.1;
        let still = lowest && (unsure && rests.unwrap_or(true) || lies);
        self.unloaded = if still { self.unloaded + dt } else { 0.0 };
        self.falling = if lowest && unsure { self.falling + dt } else { 0.0 };
        (self.carried, self.unloaded > REST || self.falling > FALLS)
    }
}
