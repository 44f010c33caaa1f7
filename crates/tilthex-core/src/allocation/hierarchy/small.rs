//! Equations of one level's size.
#![allow(clippy::needless_range_loop)] // an index runs along several vectors

use super::LEVEL_ROWS;
use libm::sqrt;

/// A level's triangular factor.
pub(super) type Small = [[f64; LEVEL_ROWS]; LEVEL_ROWS];

/// `L y = r` where row `pick[j]` of `L` ends at column `j`.
#[inline]
pub(super) fn forward_substitution(
    l: &Small,
    pick: &[usize; LEVEL_ROWS],
    r: &[f64; LEVEL_ROWS],
    rank: usize,
) -> [f64; LEVEL_ROWS] {
    let mut y = [0.0; LEVEL_ROWS];
    for j in 0..rank.min(LEVEL_ROWS) {
        let taken = pick[j].min(LEVEL_ROWS - 1);
        let row = &l[taken];
        let mut sum = r[taken];
        for i in 0..j {
            sum -= row[i] * y[i];
        }
        y[j] = sum / row[j];
    }
    y
}

/// The `y` of least `|L y - r|`, for `L` of full column rank.
#[inline]
pub(super) fn least_squares(l: &Small, r: &[f64; LEVEL_ROWS], rows: usize, rank: usize) -> [f64; LEVEL_ROWS] {
    let (rows, rank) = (rows.min(LEVEL_ROWS), rank.min(LEVEL_ROWS));
    let mut q = *l;
    let mut upper: Small = [[0.0; LEVEL_ROWS]; LEVEL_ROWS];
    let mut rhs = *r;
    let mut y = [0.0; LEVEL_ROWS];
    for j in 0..rank {
        let norm = sqrt((0..rows).map(|s| q[s][j] * q[s][j]).sum());
        upper[j][j] = norm;
        for row in q.iter_mut().take(rows) {
            row[j] /= norm;
        }
        for k in j + 1..rank {
            upper[j][k] = (0..rows).map(|s| q[s][j] * q[s][k]).sum();
            for row in q.iter_mut().take(rows) {
                row[k] -= row[j] * upper[j][k];
            }
        }
        y[j] = (0..rows).map(|s| q[s][j] * rhs[s]).sum();
        for s in 0..rows {
            rhs[s] -= q[s][j] * y[j];
        }
    }
    for j in (0..rank).rev() {
        for k in j + 1..rank {
            y[j] -= upper[j][k] * y[k];
        }
        y[j] /= upper[j][j];
    }
    y
}
