//! Stability margins from a configuration alone: a linear model of the loop in hover and in contact.
//!
//! docs/stability.md derives it.

mod contact;
mod hover;
mod model;

pub use contact::{Contact, Hold, StiffnessRange};
pub use hover::{AXES, AxisMargins, HoverMargins, Loops};
pub use model::{LoopDelays, LoopModel};

#[cfg(test)]
mod tests;
