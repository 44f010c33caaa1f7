//! The link to the vehicle: the codec of its serial protocol, and what stands
//! between a decoded frame and the estimator: the clock of each numbered
//! stream and the gate on its samples.

mod gate;
mod sequence;
pub mod tk3;

pub use gate::{Gate, GateCounters, GateParams, Verdict};
pub use sequence::{Arrival, SequenceClock, SequenceCounters};

/// Counts one more; saturates.
fn bump(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}
