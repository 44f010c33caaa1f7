//! Margins of the hovering vehicle.

use super::{
    model::{LoopModel, Matrix, unstable},
    tune::{HIGH_PEAK, LEAST_PHASE_MARGIN_DEG, LOW_PHASE_MARGIN_DEG},
};
use nalgebra::{Complex, ComplexField};

/// A loop gain below this counts as zero.
const LEAST_GAIN: f64 = 1e-3;

/// Distance of one axis' loop from its stability limit, while the loops of the other axes are closed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisMargins {
    /// Phase that can be lost at a gain of one before the loop is unstable, degrees: the least of all crossings. Negative
    /// if the loop is unstable.
    pub phase_margin_deg: f64,
    /// The least factor above one that makes the loop unstable when it multiplies the pose control's gains; infinite if
    /// there is none.
    pub gain_margin: f64,
    /// Delay that can be added before the loop is unstable, s.
    pub delay_margin: f64,
    /// Largest amplification of a disturbance by the loop, |S|.
    pub sensitivity_peak: f64,
    /// The highest frequency, rad/s, at which the gain is one.
    pub crossover: f64,
}

/// Margins of the six axes: translation along x, y, z of the world, then rotation about x, y, z of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoverMargins {
    /// The margins of each axis.
    pub axes: [AxisMargins; 6],
    /// Whether the whole loop is stable.
    pub stable: bool,
}

/// The axes' names, as in [`HoverMargins::axes`].
pub const AXES: [&str; 6] = ["x", "y", "z", "roll", "pitch", "yaw"];

impl HoverMargins {
    /// The least phase margin, degrees.
    #[must_use]
    pub fn least_phase_margin_deg(&self) -> f64 {
        self.axes.iter().map(|a| a.phase_margin_deg).fold(f64::INFINITY, f64::min)
    }

    /// The largest sensitivity peak.
    #[must_use]
    pub fn largest_sensitivity_peak(&self) -> f64 {
        self.axes.iter().map(|a| a.sensitivity_peak).fold(0.0, f64::max)
    }
}

/// One sentence if margins are low, for a vehicle that equals its model.
pub(crate) fn warning(model: &LoopModel) -> Option<String> {
    // The axes of such a vehicle do not act on each other.
    let found: [AxisMargins; 6] = std::array::from_fn(|axis| model.axis_margins(axis, model.frequencies()));
    let low = |a: &AxisMargins| a.phase_margin_deg < LOW_PHASE_MARGIN_DEG || a.sensitivity_peak > HIGH_PEAK;
    let axes: Vec<usize> = (0..6).filter(|i| low(&found[*i])).collect();
    let (last, others) = axes.split_last()?;
    let names = others.iter().map(|i| AXES[*i]).collect::<Vec<_>>().join(", ");
    let names = if others.is_empty() { AXES[*last].into() } else { format!("{names} and {}", AXES[*last]) };
    let least = axes.iter().map(|i| found[*i].phase_margin_deg).fold(f64::INFINITY, f64::min);
    let peak = axes.iter().map(|i| found[*i].sensitivity_peak).fold(0.0, f64::max);
    let what = if least > 0.0 {
        format!("{least:.1} degrees of phase margin and a sensitivity peak of {peak:.2}")
    } else {
        "the loop is unstable".into()
    };
    let delay = 1e3 * (model.delays.line + 0.5 * model.delays.period);
    Some(format!(
        "[pose_control]: {names}: {what}, with {delay:.1} ms of delay and the rotors' lag; expected at least \
         {LOW_PHASE_MARGIN_DEG} degrees and at most {HIGH_PEAK}: lower the gains, or use those of `tilthex tune`, with \
         {LEAST_PHASE_MARGIN_DEG} degrees"
    ))
}

/// The loops of the six axes over the frequency. For each of them all others are closed.
#[derive(Clone, Debug)]
pub struct Loops {
    /// Rad/s, rising.
    pub frequencies: Vec<f64>,
    /// Loop gain of each axis at each frequency.
    pub gains: [Vec<Complex<f64>>; 6],
    /// Whether the whole closed loop is stable.
    pub stable: bool,
}

impl LoopModel {
    /// The loops in a contact-free hover, in which the admittance filter rests in its dead zones. They are opened at the
    /// accelerations that the pose control asks for.
    #[must_use]
    pub fn loops(&self) -> Loops {
        let (mut characteristic, mut frequencies) = (Vec::new(), Vec::new());
        let mut gains = [const { Vec::new() }; 6];
        for frequency in self.frequencies() {
            let at = self.at(frequency, [true; 2]);
            characteristic.push((frequency, self.characteristic(&at, false)));
            let Some(closed) = self.loop_gain(&at).map(|gain| Matrix::identity() + gain) else { continue };
            let Some(sensitivity) = closed.try_inverse() else { continue };
            frequencies.push(frequency);
            for (i, of_axis) in gains.iter_mut().enumerate() {
                // With all other loops closed, S_ii is the sensitivity of axis i.
                of_axis.push(sensitivity[(i, i)].inv() - 1.0);
            }
        }
        let value = |frequency: f64| self.characteristic(&self.at(frequency, [true; 2]), false);
        Loops { frequencies, gains, stable: unstable(&characteristic, value) == 0 }
    }

    /// Margins of one axis by itself, over rising frequencies, rad/s, for a vehicle that equals its model.
    pub(super) fn axis_margins(&self, axis: usize, frequencies: impl Iterator<Item = f64>) -> AxisMargins {
        let (frequencies, gains): (Vec<_>, Vec<_>) =
            frequencies.map(|w| (w, self.axis_gain(axis, w))).unzip();
        margins(&frequencies, &gains)
    }

    /// Margins of [`Self::loops`], in a contact-free hover.
    #[must_use]
    pub fn hover(&self) -> HoverMargins {
        let loops = self.loops();
        HoverMargins {
            axes: loops.gains.map(|gains| margins(&loops.frequencies, &gains)),
            stable: loops.stable,
        }
    }
}

fn margins(frequencies: &[f64], gains: &[Complex<f64>]) -> AxisMargins {
    let mut found = AxisMargins {
        phase_margin_deg: f64::INFINITY,
        gain_margin: f64::INFINITY,
        delay_margin: f64::INFINITY,
        sensitivity_peak: gains.iter().map(|l| 1.0 / (l + 1.0).modulus()).fold(0.0, f64::max),
        crossover: 0.0,
    };
    for (w, pair) in frequencies.windows(2).zip(gains.windows(2)) {
        let (a, b) = (pair[0], pair[1]);
        let (high, low) = (a.modulus().ln(), b.modulus().ln());
        if (high > 0.0) != (low > 0.0) {
            let part = high / (high - low);
            let frequency = w[0] * (w[1] / w[0]).powf(part);
            // The distance of the phase from -180 degrees, at the crossing.
            let margin = (-a).argument() + part * (b / a).argument();
            found.phase_margin_deg = found.phase_margin_deg.min(margin.to_degrees());
            found.delay_margin = found.delay_margin.min(margin / frequency);
            found.crossover = found.crossover.max(frequency);
        }
        if (a.im > 0.0) != (b.im > 0.0) {
            let real = a.re + (b.re - a.re) * a.im / (a.im - b.im);
            if (-1.0..-LEAST_GAIN).contains(&real) {
                found.gain_margin = found.gain_margin.min(-1.0 / real);
            }
        }
    }
    found
}
