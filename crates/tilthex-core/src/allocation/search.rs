//! The inputs of a wrench beyond the limits of the rotors.

use super::{Allocation, Allocator, AllocatorState, hierarchy::Side, levels::turned};
use crate::types::{MAX_ROTORS, Matrix3, RotorVector, Vector6};

/// A wrench beyond the limits of the rotors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked<'a> {
    /// `[force_r; torque_r]`, N and N m.
    pub wrench: &'a Vector6,
    /// The inputs that would produce it without limits, Hz^2.
    pub inputs: &'a RotorVector,
    /// The attitude, if the forces of the parts are along world axes.
    pub rotation_wr: Option<&'a Matrix3>,
    /// Lowest and highest inputs, Hz^2.
    pub limits: (&'a RotorVector, &'a RotorVector),
}

impl Allocator {
    /// The inputs that serve the parts of the wrench in their order.
    pub(super) fn search(&self, state: &mut AllocatorState, asked: &Asked<'_>) -> Allocation {
        let steps = if let Some((inputs, side, steps)) = self.without_last(asked) {
            *state = AllocatorState { inputs, side, searched: true };
            steps
        } else {
            self.search_levels(state, asked)
        };
        self.report(asked.wrench, state.inputs, asked.rotation_wr, Some(asked.limits), steps)
    }

    /// Searches level by level, whichever parts are missed; returns the number of steps.
    pub(super) fn search_levels(&self, state: &mut AllocatorState, asked: &Asked<'_>) -> u32 {
        let Asked { wrench, rotation_wr, limits, .. } = *asked;
        if !state.searched {
            // A search that starts inside the limits finds the active ones in the fewest steps.
            state.inputs = self.hover;
            state.side = [Side::Free; MAX_ROTORS];
        }
        let steps = match rotation_wr {
            None => self.levels.solve(state, wrench, limits, self.preferred()),
            Some(r) => {
                let levels = self.levels.along(r, &self.matrix);
                levels.solve(state, &turned(r, wrench), limits, self.preferred())
            }
        };
        state.searched = true;
        steps
    }
}
