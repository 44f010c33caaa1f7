//! The covariance of one prediction, from that before it and from the bent sigma points.
//!
//! With `d`, the change of the rotation error, and `f`, the acceleration from gyro bias and rotation, the error state
//! moves linearly:
//!
//! ```text
//! r' = r + d     a = f - M b     v' = v + a dt     p' = p + v dt + a dt^2 / 2
//! ```
//!
//! (`b` the error of the accelerometer's bias, `M` the mean rotation.) The biases stay. So it suffices to know the
//! covariance of `d` and `f` with the state: the columns of the factor times the odd halves.
#![allow(clippy::needless_range_loop)] // Indices are the mathematics here.

use super::{
    matrix::{Column, LANES, Triangle},
    sigma::{ACCELEROMETER_BIAS, CURVED, GYRO_BIAS, POSITION, Pairs, ROTATION, Row, Squares, VELOCITY},
};
use crate::types::Matrix3;

/// Three columns: the covariance of all entries of the state with a vector.
type Columns = [Column; 3];

/// Sums of the first `COUNT` columns of the factor, times their odd halves.
#[inline]
fn with_state<const COUNT: usize>(factor: &[Column; CURVED], odd: &[Row; 3]) -> Columns {
    let mut sums = [[0.0; LANES]; 3];
    for j in 0..3 {
        let mut sum = factor[0].map(|x| odd[j][0] * x);
        for k in 1..COUNT {
            let weight = odd[j][k];
            for i in 0..LANES {
                sum[i] += weight * factor[k][i];
            }
        }
        sums[j] = sum;
    }
    sums
}

/// Adds the change of the rotation error, whose covariance with the state is `bent`.
#[inline]
fn add_rotation(p: &mut Triangle, bent: &Columns, squares: &Squares) {
    for j in 0..3 {
        for i in 0..3 {
            p.0[GYRO_BIAS + j][ROTATION + i] += bent[i][GYRO_BIAS + j];
        }
        let column = &mut p.0[ROTATION + j];
        for i in ACCELEROMETER_BIAS..LANES {
            column[i] += bent[j][i];
        }
        for i in j..3 {
            column[ROTATION + i] += bent[j][ROTATION + i] + bent[i][ROTATION + j] + squares[j][i];
        }
    }
}

/// Turns the covariance of `f` with the state into that of the acceleration with the state after the rotation error has
/// changed.
#[inline]
fn accelerate(p: &Triangle, columns: &mut Columns, squares: &Squares, mid: &Matrix3) {
    for j in 0..3 {
        for i in 0..3 {
            columns[j][ROTATION + i] += squares[i][3 + j];
        }
    }
    for l in 0..3 {
        let bias = p.whole_column(ACCELEROMETER_BIAS + l);
        for j in 0..3 {
            let weight = mid[(j, l)];
            for i in 0..LANES {
                columns[j][i] -= weight * bias[i];
            }
        }
    }
}

/// Covariance of row `i` of `M b` with column `j`.
#[inline]
fn of_bias(mid: &Matrix3, columns: &Columns, i: usize, j: usize) -> f64 {
    (0..3).map(|l| mid[(i, l)] * columns[j][ACCELEROMETER_BIAS + l]).sum()
}

/// Moves a covariance by `dt`; `factor` has the first columns of its factor, and `mid` is `M`.
#[inline]
pub(super) fn propagate(p: &mut Triangle, factor: &[Column; CURVED], pairs: &Pairs, mid: &Matrix3, dt: f64) {
    let half = 0.5 * dt * dt;
    let squares = pairs.squares();
    add_rotation(p, &with_state::<3>(factor, &pairs.odd.rotation), &squares);
    // Covariance of the acceleration with the state, and with itself (lower triangle by columns).
    let (mut a, mut own) = (with_state::<CURVED>(factor, &pairs.odd.force), [[0.0; 3]; 3]);
    for j in 0..3 {
        for i in j..3 {
            own[j][i] = squares[3 + j][3 + i] - of_bias(mid, &a, j, i);
        }
    }
    accelerate(p, &mut a, &squares, mid);
    for j in 0..3 {
        for i in j..3 {
            own[j][i] -= of_bias(mid, &a, i, j);
        }
    }
    for j in 0..VELOCITY {
        let column = &mut p.0[j];
        for i in 0..3 {
            let velocity = column[VELOCITY + i];
            column[POSITION + i] += dt * velocity + half * a[i][j];
            column[VELOCITY + i] = velocity + dt * a[i][j];
        }
    }
    for j in 0..3 {
        for i in j..3 {
            let (ij, ji) = (p.0[VELOCITY + j][POSITION + i], p.0[VELOCITY + i][POSITION + j]);
            let positions = a[j][POSITION + i] + a[i][POSITION + j];
            let velocities = a[j][VELOCITY + i] + a[i][VELOCITY + j];
            let still = dt * (ij + ji) + dt * dt * p.0[VELOCITY + j][VELOCITY + i];
            p.0[POSITION + j][POSITION + i] +=
                still + half * (positions + dt * velocities + half * own[j][i]);
        }
    }
    for j in 0..3 {
        for i in 0..3 {
            let (low, high) = (i.min(j), i.max(j));
            let moved = a[j][POSITION + i] + dt * a[j][VELOCITY + i] + half * own[low][high];
            let velocity = p.0[VELOCITY + low][VELOCITY + high];
            p.0[VELOCITY + j][POSITION + i] += dt * (velocity + moved) + half * a[i][VELOCITY + j];
        }
    }
    for j in 0..3 {
        for i in j..3 {
            let velocities = a[j][VELOCITY + i] + a[i][VELOCITY + j];
            p.0[VELOCITY + j][VELOCITY + i] += dt * (velocities + dt * own[j][i]);
        }
    }
}
