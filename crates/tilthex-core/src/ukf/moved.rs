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
    sigma::{ACCELEROMETER_BIAS, CURVED, GYRO_BIAS, POSITION, Prediction, ROTATION, Row, VELOCITY},
};
use crate::types::Matrix3;

/// Outer products of the halves, see [`Prediction::squares`].
type Squares = [[f64; 6]; 6];

/// Three columns: the covariance of all entries of the state with a vector.
type Columns = [Column; 3];

/// Sums of the first `COUNT` columns of the factor, times their odd halves.
#[inline]
fn with_state<const COUNT: usize>(factor: &[Column; CURVED], odd: &[Row; 3]) -> Columns {
    let mut sums = [[0.0; LANES]; 3];
    for j in 0..3 {
        let mut sum = [0.0; LANES];
        for k in 0..COUNT {
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

/// Covariance of the acceleration with the state, whose rotation error has changed. `forced` is that of `f` before.
#[inline]
fn accelerate(p: &Triangle, forced: &Columns, squares: &Squares, mid: &Matrix3) -> Columns {
    let mut columns = *forced;
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
    columns
}

/// Covariance of the acceleration with itself, lower triangle by columns.
#[inline]
fn acceleration(forced: &Columns, accelerated: &Columns, squares: &Squares, mid: &Matrix3) -> [[f64; 3]; 3] {
    let mut own = [[0.0; 3]; 3];
    for j in 0..3 {
        for i in j..3 {
            let mut sum = squares[3 + j][3 + i];
            for l in 0..3 {
                let bias = ACCELEROMETER_BIAS + l;
                sum -= mid[(j, l)] * forced[i][bias] + mid[(i, l)] * accelerated[j][bias];
            }
            own[j][i] = sum;
        }
    }
    own
}

/// Moves a covariance by `dt`; `factor` has the first columns of its factor.
#[inline]
pub(super) fn propagate(p: &mut Triangle, factor: &[Column; CURVED], points: &Prediction, dt: f64) {
    let half = 0.5 * dt * dt;
    let squares = points.squares();
    add_rotation(p, &with_state::<3>(factor, &points.odd.rotation), &squares);
    let forced = with_state::<CURVED>(factor, &points.odd.force);
    let a = accelerate(p, &forced, &squares, &points.mid);
    let own = acceleration(&forced, &a, &squares, &points.mid);
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
