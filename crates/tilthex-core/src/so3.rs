//! Rotations: the maps between so(3), as 3-vectors, and SO(3), as matrices.
//!
//! Near 0 and near pi each map uses the form that keeps its full precision there.
//!
//! ```
//! use tilthex_core::{Vector3, so3};
//!
//! let turn = Vector3::new(0.1, -0.2, 0.3);
//! assert!((so3::log(&so3::exp(&turn)) - turn).norm() < 1e-12);
//! let (a, b) = (Vector3::x(), Vector3::y());
//! assert_eq!(so3::hat(&a) * b, a.cross(&b));
//! ```

use crate::{
    Error,
    types::{Matrix3, Vector3},
};
use libm::{acos, atan2, cos, fabs, sin, sqrt};

/// Below this squared angle the trigonometric ratios are summed as series.
const SMALL_ANGLE_SQUARED: f64 = 1e-2;
/// Below this squared angle three terms of a series are exact to rounding.
const TINY_ANGLE_SQUARED: f64 = 3e-5;
/// Trace of a rotation whose angle is a little less than the root of that.
const SMALL_ANGLE_TRACE: f64 = 3.0 - 0.99 * SMALL_ANGLE_SQUARED;

/// `hat(a) b = a x b`.
#[must_use]
pub fn hat(a: &Vector3) -> Matrix3 {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Inverse of [`hat`]. For a matrix that is not skew-symmetric, the inverse for its skew-symmetric part: `1/2 vee(A -
/// A^T)` of the paper's (15) and (28) is `vee(A)` here.
#[must_use]
pub fn vee(m: &Matrix3) -> Vector3 {
    0.5 * Vector3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)])
}

/// The sum of `coefficients[k] x^k`.
#[inline]
fn polynomial<const N: usize>(x: f64, coefficients: [f64; N]) -> f64 {
    coefficients.into_iter().rev().reduce(|sum, c| sum * x + c).unwrap_or(0.0)
}

/// sin(t)/t, (1-cos(t))/t^2 and (t-sin(t))/t^3 of t^2.
#[inline]
pub(crate) fn ratios(t2: f64) -> (f64, f64, f64) {
    if t2 < TINY_ANGLE_SQUARED {
        series::<3>(t2)
    } else if t2 < SMALL_ANGLE_SQUARED {
        small_ratios(t2)
    } else {
        let t = sqrt(t2);
        let (s, h) = (sin(t), sin(0.5 * t));
        (s / t, 2.0 * h * h / t2, (t - s) / (t2 * t))
    }
}

/// The same for t^2 below [`SMALL_ANGLE_SQUARED`].
#[inline]
pub(crate) fn small_ratios(t2: f64) -> (f64, f64, f64) {
    series::<5>(t2)
}

/// The first terms, at most five, of the series of the same.
#[inline]
fn series<const TERMS: usize>(t2: f64) -> (f64, f64, f64) {
    let sum = |coefficients: [f64; 5]| {
        polynomial::<TERMS>(t2, core::array::from_fn(|k| coefficients.get(k).copied().unwrap_or(0.0)))
    };
    (
        sum([1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0]),
        sum([0.5, -1.0 / 24.0, 1.0 / 720.0, -1.0 / 40_320.0, 1.0 / 3_628_800.0]),
        sum([1.0 / 6.0, -1.0 / 120.0, 1.0 / 5040.0, -1.0 / 362_880.0, 1.0 / 39_916_800.0]),
    )
}

/// t/sin(t) of sin(t)^2, for small angles: the series of the arc sine.
#[inline]
fn arc_ratio(s2: f64) -> f64 {
    polynomial(
        s2,
        [
            1.0,
            1.0 / 6.0,
            3.0 / 40.0,
            5.0 / 112.0,
            35.0 / 1152.0,
            63.0 / 2816.0,
            231.0 / 13_312.0,
            143.0 / 10_240.0,
        ],
    )
}

/// The rotation by the angle `|v|` about `v` (Rodrigues).
#[must_use]
#[inline]
pub fn exp(v: &Vector3) -> Matrix3 {
    let (a, b, _) = ratios(v.norm_squared());
    rodrigues(v, a, b)
}

/// `I + a hat(v) + b hat(v)^2`. With a unit quaternion's vector, twice its scalar, and 2 it is the quaternion's rotation.
#[inline]
pub(crate) fn rodrigues(v: &Vector3, a: f64, b: f64) -> Matrix3 {
    let w = a * v;
    // Written out: the hot path of the estimator.
    let (xx, yy, zz) = (b * v.x * v.x, b * v.y * v.y, b * v.z * v.z);
    let (xy, xz, yz) = (b * v.x * v.y, b * v.x * v.z, b * v.y * v.z);
    Matrix3::new(
        1.0 - yy - zz,
        xy - w.z,
        xz + w.y,
        xy + w.z,
        1.0 - xx - zz,
        yz - w.x,
        xz - w.y,
        yz + w.x,
        1.0 - xx - yy,
    )
}

/// The rotation vector of `r`, rad, with an angle in `[0, pi]`.
///
/// At exactly pi both signs are right; the one whose largest component is
/// positive is returned.
#[must_use]
#[inline]
pub fn log(r: &Matrix3) -> Vector3 {
    // The unit quaternion, by the largest of its four components (Shepperd),
    // is exact to rounding at every angle, unlike the trace. At small angles their sines are.
    let (m00, m11, m22) = (r[(0, 0)], r[(1, 1)], r[(2, 2)]);
    let trace = m00 + m11 + m22;
    if trace > SMALL_ANGLE_TRACE {
        let sine = vee(r);
        return sine * arc_ratio(sine.norm_squared());
    }
    let skew = 2.0 * vee(r);
    let (mut w, mut v) = if trace >= m00 && trace >= m11 && trace >= m22 {
        (1.0 + trace, skew)
    } else if m00 >= m11 && m00 >= m22 {
        let xy = r[(0, 1)] + r[(1, 0)];
        let xz = r[(0, 2)] + r[(2, 0)];
        (skew.x, Vector3::new(1.0 + m00 - m11 - m22, xy, xz))
    } else if m11 >= m22 {
        let xy = r[(0, 1)] + r[(1, 0)];
        let yz = r[(1, 2)] + r[(2, 1)];
        (skew.y, Vector3::new(xy, 1.0 + m11 - m00 - m22, yz))
    } else {
        let xz = r[(0, 2)] + r[(2, 0)];
        let yz = r[(1, 2)] + r[(2, 1)];
        (skew.z, Vector3::new(xz, yz, 1.0 + m22 - m00 - m11))
    };
    if w < 0.0 {
        w = -w;
        v = -v;
    }
    let n = v.norm();
    // No rotation has n = 0 here.
    if n > 0.0 { v * (2.0 * atan2(n, w) / n) } else { v }
}

/// Trace of a rotation by an angle, rad: a smaller trace is a larger turn.
#[must_use]
pub(crate) fn trace(angle: f64) -> f64 {
    1.0 + 2.0 * cos(angle)
}

/// `from^T to`: maps the coordinates of the body `to` to those of the body `from`.
#[must_use]
#[inline]
pub(crate) fn between(from: &Matrix3, to: &Matrix3) -> Matrix3 {
    // The rows of one matrix as vectors: two of their entries are one instruction.
    let [x, y, z] = [0, 1, 2].map(|row| Vector3::new(from[(row, 0)], from[(row, 1)], from[(row, 2)]));
    let column = |k: usize| x * to[(0, k)] + y * to[(1, k)] + z * to[(2, k)];
    Matrix3::from_columns(&[column(0), column(1), column(2)])
}

/// Whether the rotation `after` is within an angle, rad, of `before` with the turn (rotation vector, body) after it.
#[must_use]
#[inline]
pub(crate) fn follows(before: &Matrix3, turn_r: &Vector3, after: &Matrix3, angle: f64) -> bool {
    // Two parts that are each below half of the angle need no exponential. The trace 1 + 2 cos(x) is about 3 - x^2.
    let half = 0.24 * angle * angle;
    if turn_r.norm_squared() < half && before.dot(after) > 3.0 - half {
        return true;
    }
    (before * exp(turn_r)).dot(after) >= trace(angle)
}

/// Angle of the rotation, rad, in `[0, pi]`.
#[must_use]
pub fn angle(r: &Matrix3) -> f64 {
    log(r).norm()
}

/// `J` with `exp(v + J^-1 d) ~ exp(d) exp(v)`: the left Jacobian of [`exp`].
/// It is also the mean of `exp(s v)` over `s` in `[0, 1]`.
#[must_use]
pub fn left_jacobian(v: &Vector3) -> Matrix3 {
    let (_, b, c) = ratios(v.norm_squared());
    let h = hat(v);
    Matrix3::identity() + b * h + c * h * h
}

/// `J^-1 d` for the [`left_jacobian`] J of `v`, for angles below 2 pi.
#[must_use]
#[inline]
pub fn left_jacobian_solve(v: &Vector3, d: &Vector3) -> Vector3 {
    let t2 = v.norm_squared();
    let c = if t2 < SMALL_ANGLE_SQUARED {
        polynomial(t2, [1.0 / 12.0, 1.0 / 720.0, 1.0 / 30_240.0, 1.0 / 1_209_600.0])
    } else {
        let (a, b, _) = ratios(t2);
        (1.0 - 0.5 * a / b) / t2
    };
    let across = v.cross(d);
    d - 0.5 * across + c * v.cross(&across)
}

/// The rotation nearest to `m` (Frobenius norm), for `m` near a rotation: Newton's iteration for the polar factor.
/// None if it does not converge (`m` is singular, not finite, or reflects).
#[must_use]
pub fn project(m: &Matrix3) -> Option<Matrix3> {
    let mut r = *m;
    for _ in 0..40 {
        let next = 0.5 * (r + r.try_inverse()?.transpose());
        let change = (next - r).amax();
        r = next;
        if change < 1e-15 {
            break;
        }
    }
    let rotation = rotation_defect(&r) < 1e-12;
    rotation.then_some(r)
}

/// Largest entry of `R^T R - I`, or `|det R - 1|` if that is larger. NaN if `r` holds a NaN.
#[must_use]
pub fn rotation_defect(r: &Matrix3) -> f64 {
    let skewness = (r.transpose() * r - Matrix3::identity())
        .iter()
        .fold(0.0, |worst: f64, x| if x.is_nan() || fabs(*x) > worst { fabs(*x) } else { worst });
    let det = fabs(r.determinant() - 1.0);
    if skewness >= det { skewness } else { det }
}

/// Largest [`rotation_defect`] of a matrix that is meant to be a rotation: in single precision, or rounded in a
/// table.
pub const NEAR_ROTATION: f64 = 1e-3;

/// The nearest rotation of a near-rotation; other matrices are returned unchanged.
#[must_use]
pub fn straightened(r: &Matrix3) -> Matrix3 {
    let defect = rotation_defect(r);
    // A NaN is not near a rotation.
    let near = defect > 1e-9 && defect <= NEAR_ROTATION;
    // Newton's steps to the polar factor without an inverse: each squares the defect.
    let steps = if near { 3 } else { 0 };
    (0..steps).fold(*r, |r, _| 1.5 * r - 0.5 * r * (r.transpose() * r))
}

/// A product of rotations without the rounding errors of its columns' lengths and angles, up to their squares.
#[must_use]
#[inline]
pub(crate) fn unrounded(r: &Matrix3) -> Matrix3 {
    let (x, y) = (r.column(0), r.column(1));
    let half = 0.5 * x.dot(&y);
    let (along_x, along_y): (Vector3, Vector3) = (x - half * y, y - half * x);
    // Newton's step to the inverse of a root near one.
    let unit = |v: Vector3| v * (1.5 - 0.5 * v.norm_squared());
    let (x, y) = (unit(along_x), unit(along_y));
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}

/// Refuses a matrix that is not a rotation to `1e-6`.
///
/// # Errors
/// [`Error::NotFinite`] or [`Error::NotRotation`], which name the parameter.
pub fn check_rotation(name: &'static str, r: &Matrix3) -> Result<(), Error> {
    if r.iter().any(|x| !x.is_finite()) {
        return Err(Error::NotFinite { name });
    }
    let defect = rotation_defect(r);
    if defect > 1e-6 { Err(Error::NotRotation { name, defect }) } else { Ok(()) }
}

/// Rotation about x by `angle`, rad.
#[must_use]
pub fn rot_x(angle: f64) -> Matrix3 {
    let (s, c) = (sin(angle), cos(angle));
    Matrix3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c)
}

/// Rotation about y by `angle`, rad.
#[must_use]
pub fn rot_y(angle: f64) -> Matrix3 {
    let (s, c) = (sin(angle), cos(angle));
    Matrix3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c)
}

/// Rotation about z by `angle`, rad.
#[must_use]
pub fn rot_z(angle: f64) -> Matrix3 {
    let (s, c) = (sin(angle), cos(angle));
    Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
}

/// Rotation matrix of a quaternion given as `(x, y, z, w)`; None where its norm
/// is not within 1 % of one (a corrupted sample).
#[must_use]
pub fn from_quaternion_xyzw(q: [f64; 4]) -> Option<Matrix3> {
    let [x, y, z, w] = q;
    let n2 = x * x + y * y + z * z + w * w;
    if !n2.is_finite() || fabs(n2 - 1.0) > 0.02 {
        return None;
    }
    let s = 2.0 / n2;
    Some(rodrigues(&Vector3::new(x, y, z), s * w, s))
}

/// Quaternion `(x, y, z, w)`, `w >= 0`, of a rotation matrix.
#[must_use]
pub fn to_quaternion_xyzw(r: &Matrix3) -> [f64; 4] {
    let v = log(r);
    let (a, _, _) = ratios(0.25 * v.norm_squared());
    let half = 0.5 * a * v;
    [half.x, half.y, half.z, cos(0.5 * v.norm())]
}

/// Tilt: the angle between body z and world z, rad.
#[must_use]
pub fn tilt(rotation_wr: &Matrix3) -> f64 {
    acos(rotation_wr[(2, 2)].clamp(-1.0, 1.0))
}

#[cfg(test)]
mod tests;
