//! Stability margins from a configuration alone: a linear model of the loop in hover and in contact.
//!
//! docs/stability.md derives this model.

mod contact;
mod hover;
mod model;
mod tune;

pub use contact::{Contact, Hold, StiffnessRange};
pub(crate) use hover::warning;
pub use hover::{AXES, AxisMargins, HoverMargins, Loops};
pub use model::{LoopDelays, LoopModel};
pub use tune::{Derived, HIGH_PEAK, LARGEST_PEAK, LEAST_PHASE_MARGIN_DEG, LOW_PHASE_MARGIN_DEG};

#[cfg(test)]
mod tests;
