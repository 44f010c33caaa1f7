//! The check between a decoded sample and the estimator. A protocol without a checksum needs it, because a flipped
//! bit leaves a sample well-formed.

use crate::bump;
use tilthex_core::error::{Error, check_range};

/// Largest change of a rotor's speed from one sample to the next, Hz.
const ROTOR_JUMP: f64 = 40.0;
/// A jump of a rotor's speed is accepted once this many samples agree with it.
const ROTOR_PATIENCE: u8 = 4;

/// Limits of a stream of `N` numbers, in the units of the stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GateParams<const N: usize> {
    /// Smallest value of each number.
    pub min: [f64; N],
    /// Largest value of each number.
    pub max: [f64; N],
    /// Largest change of each number from one sample to the next; infinity allows any change.
    pub jump: [f64; N],
    /// A jump is accepted once this many samples in a row agree with it.
    pub patience: u8,
    /// Largest number of samples in a row, without a lost sample between them, that are refused for their jumps. In an
    /// impact no sample agrees with the one before, but the samples are right.
    pub longest: u8,
}

/// The result of the check of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It may pass.
    Pass,
    /// A number is not finite or out of range.
    OutOfRange,
    /// A number is too far from the last sample that passed.
    Jump,
}

/// Counts of one gate; they saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GateCounters {
    /// Samples that passed.
    pub passed: u32,
    /// Samples refused for their range.
    pub out_of_range: u32,
    /// Samples refused for their jump.
    pub jumps: u32,
}

/// A gate for one stream of `N` numbers.
///
/// ```
/// use tilthex_link::{Gate, GateParams, Verdict};
///
/// // A rotor's speed, Hz.
/// let mut gate = Gate::new(GateParams { min: [-200.0], max: [200.0], jump: [40.0], patience: 4, longest: 4 })?;
/// assert_eq!(gate.step(&[60.0], 0), Verdict::Pass);
/// assert_eq!(gate.step(&[150.0], 0), Verdict::Jump);
/// assert_eq!(gate.step(&[f64::NAN], 0), Verdict::OutOfRange);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate<const N: usize> {
    params: GateParams<N>,
    last: Option<[f64; N]>,
    /// The newest sample after a jump, and how many samples in a row agree with it.
    candidate: Option<([f64; N], u8)>,
    refused_in_a_row: u8,
    counters: GateCounters,
}

impl Gate<1> {
    /// A gate for the measured speed of a rotor, Hz.
    ///
    /// # Errors
    /// Never: its limits are constant.
    pub fn rotor_speed() -> Result<Self, Error> {
        let (min, max, jump) = ([-1e3], [1e3], [ROTOR_JUMP]);
        Self::new(GateParams { min, max, jump, patience: ROTOR_PATIENCE, longest: ROTOR_PATIENCE })
    }
}

impl<const N: usize> Gate<N> {
    /// A gate that no sample has passed yet.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if a range is empty or not finite, or a jump is negative or NaN.
    pub fn new(params: GateParams<N>) -> Result<Self, Error> {
        for ((&min, &max), &jump) in params.min.iter().zip(&params.max).zip(&params.jump) {
            check_range("gate minimum", min, f64::MIN, max)?;
            check_range("gate maximum", max, min, f64::MAX)?;
            if jump.is_nan() || jump < 0.0 {
                return Err(Error::OutOfRange {
                    name: "gate jump",
                    found: jump,
                    min: 0.0,
                    max: f64::INFINITY,
                });
            }
        }
        Ok(Self {
            params,
            last: None,
            candidate: None,
            refused_in_a_row: 0,
            counters: GateCounters::default(),
        })
    }

    /// Checks a sample; `lost` samples between it and the last one increase the allowed jump.
    pub fn step(&mut self, sample: &[f64; N], lost: u32) -> Verdict {
        let mut bounds = sample.iter().zip(self.params.min.iter().zip(&self.params.max));
        // NaN is outside of every range.
        if !bounds.all(|(x, (min, max))| min <= x && x <= max) {
            bump(&mut self.counters.out_of_range);
            return Verdict::OutOfRange;
        }
        let steps = 1.0 + f64::from(lost);
        if self.last.is_none_or(|last| self.near(&last, sample, steps)) {
            self.pass(sample);
            return Verdict::Pass;
        }
        let agreeing = match self.candidate {
            Some((before, agreeing)) if self.near(&before, sample, steps) => agreeing.saturating_add(1),
            _ => 1,
        };
        if agreeing > self.params.patience || self.refused_in_a_row >= self.params.longest {
            self.pass(sample);
            return Verdict::Pass;
        }
        self.candidate = Some((*sample, agreeing));
        // A bad line loses samples; an impact does not.
        self.refused_in_a_row = if lost == 0 { self.refused_in_a_row.saturating_add(1) } else { 1 };
        bump(&mut self.counters.jumps);
        Verdict::Jump
    }

    /// Forgets the last sample. It is called after a silence.
    pub fn forget(&mut self) {
        self.last = None;
        self.interrupt();
    }

    /// Reports a sample that is not a measurement: the samples before and after it do not count as samples in a row.
    pub fn interrupt(&mut self) {
        self.candidate = None;
        self.refused_in_a_row = 0;
    }

    /// Counts so far.
    #[must_use]
    pub fn counters(&self) -> GateCounters {
        self.counters
    }

    fn near(&self, a: &[f64; N], b: &[f64; N], steps: f64) -> bool {
        a.iter().zip(b).zip(&self.params.jump).all(|((a, b), jump)| (a - b).abs() <= jump * steps)
    }

    fn pass(&mut self, sample: &[f64; N]) {
        self.last = Some(*sample);
        self.candidate = None;
        self.refused_in_a_row = 0;
        bump(&mut self.counters.passed);
    }
}
