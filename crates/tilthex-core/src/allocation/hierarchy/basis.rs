//! The row space of the levels already settled.
#![allow(clippy::needless_range_loop)] // an index runs along several vectors

use super::ROWS;
use libm::fabs;

/// Rows orthonormal over the free variables, carried over all.
pub(super) struct Basis<const N: usize> {
    /// One where a variable is free, zero where it is held.
    pub free: [f64; N],
    rows: [[f64; N]; ROWS],
    /// The rows with zeros at the held variables.
    pub masked: [[f64; N]; ROWS],
    pub count: usize,
}

impl<const N: usize> Basis<N> {
    pub(super) fn new(free: [f64; N]) -> Self {
        Self { free, rows: [[0.0; N]; ROWS], masked: [[0.0; N]; ROWS], count: 0 }
    }

    pub(super) fn norm_squared(&self, v: &[f64; N]) -> f64 {
        in_pairs(|i| v[i] * v[i] * self.free[i], N)
    }

    pub(super) fn coefficient(&self, j: usize, v: &[f64; N]) -> f64 {
        dot(&self.masked[j.min(ROWS - 1)], v)
    }

    pub(super) fn subtract(&self, j: usize, coefficient: f64, v: &mut [f64; N]) {
        for i in 0..N {
            v[i] -= coefficient * self.rows[j.min(ROWS - 1)][i];
        }
    }

    /// Takes the basis' part out of `v`; a second time where little is left, for its rounding.
    pub(super) fn reduce(&self, v: &mut [f64; N]) {
        if self.count == 0 {
            return;
        }
        let before = self.norm_squared(v);
        for j in 0..self.count {
            self.subtract(j, self.coefficient(j, v), v);
        }
        if self.norm_squared(v) < 0.01 * before {
            for j in 0..self.count {
                self.subtract(j, self.coefficient(j, v), v);
            }
        }
    }

    pub(super) fn push(&mut self, v: &[f64; N], norm: f64) {
        let (Some(row), Some(masked)) = (self.rows.get_mut(self.count), self.masked.get_mut(self.count))
        else {
            return;
        };
        let inverse = 1.0 / norm;
        for i in 0..N {
            row[i] = v[i] * inverse;
            masked[i] = row[i] * self.free[i];
        }
        self.count += 1;
    }
}

pub(super) fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    in_pairs(|i| a[i] * b[i], N)
}

/// The sum of an even number of terms. Two sums side by side are one instruction.
#[inline]
fn in_pairs(term: impl Fn(usize) -> f64, count: usize) -> f64 {
    let mut sums = [0.0; 2];
    for i in 0..count / 2 {
        sums[0] += term(2 * i);
        sums[1] += term(2 * i + 1);
    }
    sums[0] + sums[1]
}

pub(super) fn largest<const N: usize>(v: &[f64; N]) -> f64 {
    v.iter().fold(0.0, |m, x| m.max(fabs(*x)))
}
