//! The allocation matrix as levels of a hierarchy, scaled to numbers near one.

use super::{
    AllocatorState, Priority,
    hierarchy::{self, Problem, ROWS},
};
use crate::{
    Vehicle,
    types::{MAX_ROTORS, Matrix3, RotorVector, Vector6, Wrench},
    vehicle::Allocation as Matrix,
};
use libm::sqrt;

/// Rows of a level that are smaller than this part of the matrix' largest entry count as zero.
const NO_EFFECT: f64 = 1e-12;

/// Rows in the order of their level: `row . (u / input_scale) = w / wrench_scale`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Levels {
    rows: [[f64; MAX_ROTORS]; ROWS],
    /// The index of each row in the wrench.
    order: [usize; ROWS],
    ends: [usize; 4],
    count: usize,
    wrench_scale: [f64; ROWS],
    input_scale: f64,
    rotor_count: usize,
}

impl Levels {
    /// One level for each priority.
    pub(super) fn by_priority(vehicle: &Vehicle, order: &[Priority; 4]) -> Self {
        Self::new(vehicle, order.iter().map(|p| p.rows()))
    }

    /// The torque, then the force.
    pub(super) fn torque_first(vehicle: &Vehicle) -> Self {
        let groups: [&[usize]; 2] = [&[3, 4, 5], &[0, 1, 2]];
        Self::new(vehicle, groups.into_iter())
    }

    fn new<'a>(vehicle: &Vehicle, groups: impl Iterator<Item = &'a [usize]>) -> Self {
        let largest_speed =
            vehicle.rotors().iter().fold(0.0, |m: f64, r| m.max(r.max_speed.abs()).max(r.min_speed.abs()));
        let (mut order, mut ends, mut count) = ([0; ROWS], [0; 4], 0);
        let mut places = order.iter_mut();
        let mut end = 0;
        for (group, slot) in groups.zip(&mut ends) {
            for (row, place) in group.iter().zip(places.by_ref()) {
                *place = *row;
            }
            end += group.len();
            *slot = end;
            count += 1;
        }
        let levels = Self {
            rows: [[0.0; MAX_ROTORS]; ROWS],
            order,
            ends,
            count,
            wrench_scale: [1.0; ROWS],
            input_scale: largest_speed * largest_speed,
            rotor_count: vehicle.rotors().len(),
        };
        levels.with_rows(vehicle.allocation())
    }

    /// The levels of a [`turned`] wrench; `matrix` is the vehicle's.
    pub(super) fn along(&self, rotation: &Matrix3, matrix: &Matrix) -> Self {
        let mut along = *matrix;
        for mut column in along.column_iter_mut() {
            let moved = turned(rotation, &column.clone_owned());
            column.copy_from(&moved);
        }
        self.with_rows(&along)
    }

    fn with_rows(mut self, matrix: &Matrix) -> Self {
        let largest = matrix.amax();
        let mut begin = 0;
        for end in self.ends.iter().take(self.count) {
            let size = |r: &usize| sqrt(row(matrix, *r).iter().map(|x| x * x).sum());
            let norm = self.order.iter().take(*end).skip(begin).map(size).fold(0.0, f64::max);
            let slots = self.order.iter().zip(&mut self.rows).zip(&mut self.wrench_scale);
            for ((place, scaled), scale) in slots.take(*end).skip(begin) {
                // The row of a level on which no rotor acts stays zero.
                if norm > NO_EFFECT * largest {
                    *scale = norm * self.input_scale;
                    *scaled = row(matrix, *place).map(|x| x / norm);
                }
            }
            begin = *end;
        }
        self
    }

    /// Searches from `state`, and writes the result to it; returns the number of steps.
    pub(super) fn solve(
        &self,
        state: &mut AllocatorState,
        wrench: &Vector6,
        limits: (&RotorVector, &RotorVector),
        preferred: Option<&RotorVector>,
    ) -> u32 {
        // The search has only as many variables as there are rotors.
        match self.rotor_count {
            0..=6 => self.solve_first::<6>(state, wrench, limits, preferred),
            7..=8 => self.solve_first::<8>(state, wrench, limits, preferred),
            _ => self.solve_first::<MAX_ROTORS>(state, wrench, limits, preferred),
        }
    }

    fn solve_first<const N: usize>(
        &self,
        state: &mut AllocatorState,
        wrench: &Vector6,
        limits: (&RotorVector, &RotorVector),
        preferred: Option<&RotorVector>,
    ) -> u32 {
        let shrink = 1.0 / self.input_scale;
        let head = |v: &RotorVector| -> [f64; N] { core::array::from_fn(|i| v[i] * shrink) };
        let preferred = preferred.map(head);
        let problem = Problem {
            rows: &self.rows.map(|row| core::array::from_fn(|i| row[i])),
            level_ends: self.ends.get(..self.count).unwrap_or(&[]),
            target: &core::array::from_fn(|i| {
                wrench.get(self.order[i]).unwrap_or(&0.0) / self.wrench_scale[i]
            }),
            lower: &head(limits.0),
            upper: &head(limits.1),
            preferred: preferred.as_ref(),
        };
        let guess = core::array::from_fn(|i| state.side[i]);
        let solution = hierarchy::solve(&problem, &head(&state.inputs), &guess);
        for i in 0..N {
            // At a limit, the input is set to the limit exactly, without the rounding of the scaling.
            state.inputs[i] = (solution.x[i] * self.input_scale).max(limits.0[i]).min(limits.1[i]);
            state.side[i] = solution.side[i];
        }
        solution.iterations
    }
}

/// A wrench `[force; torque]` with the force along the axes to which a rotation maps.
pub(super) fn turned(rotation: &Matrix3, wrench: &Vector6) -> Vector6 {
    let wrench = Wrench::from_vector(wrench);
    Wrench { force: rotation * wrench.force, ..wrench }.to_vector()
}

/// One row of the allocation matrix.
fn row(matrix: &Matrix, row: usize) -> [f64; MAX_ROTORS] {
    let mut found = [0.0; MAX_ROTORS];
    for (slot, column) in found.iter_mut().zip(matrix.as_slice().chunks_exact(ROWS)) {
        *slot = column.get(row).copied().unwrap_or(0.0);
    }
    found
}
