//! Gains from the vehicle: the fastest that the rotors' lag and the delays allow.

use super::model::{LoopModel, rising};
use tilthex_core::Vector3;

/// The phase margin that derived gains give every axis of the nominal vehicle, degrees.
pub const LEAST_PHASE_MARGIN_DEG: f64 = 45.0;
/// The largest sensitivity peak of every axis of the nominal vehicle with derived gains.
pub const LARGEST_PEAK: f64 = 2.0;
/// Phase margin that derived gains have in addition, degrees.
const RESERVE_DEG: f64 = 0.5;
/// If the phase margin is below this, degrees, or the sensitivity peak above [`HIGH_PEAK`], the program warns, and default
/// gains are derived from the vehicle.
pub const LOW_PHASE_MARGIN_DEG: f64 = 25.0;
/// The sensitivity peak above which the program warns.
pub const HIGH_PEAK: f64 = 2.5;
/// The phase margin, degrees, and the largest sensitivity peak of derived gains, for each axis by itself.
const ASKED: (f64, f64) = (LEAST_PHASE_MARGIN_DEG + RESERVE_DEG, LARGEST_PEAK);
/// The fastest double poles that are derived, 1/s, of position and of rotation.
const FASTEST: (f64, f64) = (10.0, 15.0);
/// The slowest double pole that is tried, and the step between two of them, 1/s.
const STEP: f64 = 0.1;
/// Frequencies at which a loop is computed, rad/s: from, to, and their number.
const SWEEP: (f64, f64, usize) = (0.3, 300.0, 150);
/// The observer's gain is at most [`OBSERVER_BY_POLE`] times the double pole of pose control, and at most
/// [`FASTEST_OBSERVER`], 1/s. If the vehicle must tilt to move sideways, the force observer's gain is at most
/// [`FASTEST_TILTING_OBSERVER`].
const OBSERVER_BY_POLE: f64 = 1.0 / 0.3;
const FASTEST_OBSERVER: f64 = 30.0;
const FASTEST_TILTING_OBSERVER: f64 = 4.0;

/// A section's name, and its keys with the values of three axes.
type Gains = (&'static str, Vec<(&'static str, [f64; 3])>);

/// Derived gains: pose control is critically damped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Derived {
    /// The double poles of the position loop, 1/s: that of x and y, and that of z.
    pub position: [f64; 2],
    /// The double pole of the rotation loop, 1/s.
    pub rotation: f64,
    /// The force observer's gain, 1/s.
    pub force_observer: f64,
    /// The torque observer's gain, 1/s.
    pub torque_observer: f64,
}

impl Derived {
    /// The gains as a configuration names them: sections, keys, and the values of three axes.
    #[must_use]
    pub fn sections(&self) -> [Gains; 2] {
        let square = |rate: f64| (rate * rate * 100.0).round() / 100.0;
        let double = |rate: f64| (20.0 * rate).round() / 10.0;
        let [lateral, vertical] = self.position;
        let position = [lateral, lateral, vertical];
        let pose = vec![
            ("position_gain", position.map(square)),
            ("velocity_gain", position.map(double)),
            ("rotation_gain", [square(self.rotation); 3]),
            ("angular_velocity_gain", [double(self.rotation); 3]),
        ];
        let observer =
            vec![("force_gain", [self.force_observer; 3]), ("torque_gain", [self.torque_observer; 3])];
        [("pose_control", pose), ("wrench_observer", observer)]
    }

    /// The same as TOML.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let lines = self.sections().map(|(section, keys)| {
            let keys = keys.iter().map(|(key, values)| format!("{key} = {values:?}"));
            format!("{section} = {{ {} }}\n", keys.collect::<Vec<_>>().join(", "))
        });
        lines.concat()
    }
}

impl LoopModel {
    /// The fastest gains whose loops have the required margins. Uses only the vehicle, the delays and the turn's filter of
    /// this model, not its gains.
    #[must_use]
    pub fn derive(&self) -> Derived {
        let mut model = self.clone();
        let observer = |pole: f64, most: f64| (OBSERVER_BY_POLE * pole).floor().min(most);
        let rotation = fastest(FASTEST.1, |pole| {
            model.params.pose.rotation = Vector3::repeat(pole * pole);
            model.params.pose.angular_velocity = Vector3::repeat(2.0 * pole);
            model.params.observer.torque = Vector3::repeat(observer(pole, FASTEST_OBSERVER));
            (3..6).all(|axis| model.has_margins(axis, ASKED))
        });
        model.params.pose.rotation = Vector3::repeat(rotation * rotation);
        model.params.pose.angular_velocity = Vector3::repeat(2.0 * rotation);
        let tilting = (0..3).any(|i| model.tilts(i));
        let most = if tilting { FASTEST_TILTING_OBSERVER } else { FASTEST_OBSERVER };
        let mut position = |axes: std::ops::Range<usize>| {
            fastest(FASTEST.0, |pole| {
                model.params.pose.position = Vector3::repeat(pole * pole);
                model.params.pose.velocity = Vector3::repeat(2.0 * pole);
                model.params.observer.force = Vector3::repeat(observer(pole, most));
                axes.clone().all(|axis| model.has_margins(axis, ASKED))
            })
        };
        let position = [position(0..2), position(2..3)];
        Derived {
            position,
            rotation,
            force_observer: observer(position[0].min(position[1]), most),
            torque_observer: observer(rotation, FASTEST_OBSERVER),
        }
    }

    /// Whether every axis, by itself, has margins that are not low.
    pub(crate) fn is_sound(&self) -> bool {
        (0..6).all(|axis| self.has_margins(axis, (LOW_PHASE_MARGIN_DEG, HIGH_PEAK)))
    }

    /// Whether an axis by itself has at least this phase margin, degrees, and at most this sensitivity peak.
    fn has_margins(&self, axis: usize, (phase_margin_deg, peak): (f64, f64)) -> bool {
        let (from, to, count) = SWEEP;
        let found = self.axis_margins(axis, rising(from, to, count));
        found.phase_margin_deg >= phase_margin_deg && found.sensitivity_peak <= peak
    }
}

/// The fastest pole for which `holds` is true. If `holds` is true for a pole, it is true for all slower ones.
fn fastest(most: f64, mut holds: impl FnMut(f64) -> bool) -> f64 {
    let steps = (most / STEP).round() as u32;
    let (mut low, mut high) = (1, steps + 1);
    while high - low > 1 {
        let middle = low.midpoint(high);
        if holds(f64::from(middle) * STEP) { low = middle } else { high = middle }
    }
    (f64::from(low) * STEP * 10.0).round() / 10.0
}
