//! The inputs that miss a wrench only in its last part, by as little as possible.
//!
//! If every wrench has exactly one set of inputs, and the last part has two components, the inputs that miss it by `e` and
//! produce all other parts are `u - N e`: `u` those of the whole wrench, `N` two columns of the inverse. The limits of a
//! rotor are the edges of a strip in the plane of `e`. So the inputs belong to the point of all strips that is nearest to
//! the origin. It is found strip by strip: if the point of the strips before is not in the next one, the new point is on
//! that strip's edge (Seidel, "Small-dimensional linear programming and convex hulls made easy", 1991).

use super::{
    Allocator, Asked, has_own_inputs,
    hierarchy::{ROWS, Side},
    levels::turned,
};
use crate::{
    types::{MAX_ROTORS, RotorVector, Vector6},
    vehicle::inputs_for,
};

/// Squared sine of the angle below which two edges count as parallel.
const PARALLEL: f64 = 1e-12;
/// A rotor may miss its limits by this part of its range: by rounding.
const ROUNDING: f64 = 1e-9;
/// The difference `u - N e` loses digits: inputs of the whole wrench that are larger than this times the range of their rotor
/// are left to the search.
const LARGEST: f64 = 100.0;

/// `least <= normal . e <= most`.
struct Strip {
    normal: [f64; 2],
    least: f64,
    most: f64,
}

/// A point, the strips on whose edges it is with the limit of their rotors there, and the number of edges that were tried.
struct Nearest {
    point: [f64; 2],
    held: [Option<(usize, Side)>; 2],
    steps: u32,
}

/// The inputs, where they are held, and the number of edges that were tried.
pub(super) type Solved = (RotorVector, [Side; MAX_ROTORS], u32);

impl Allocator {
    /// The result of the search where only the last part of the wrench is missed.
    pub(super) fn without_last(&self, asked: &Asked<'_>) -> Option<Solved> {
        let [.., last] = self.params.order;
        let [first, second] = *last.rows() else { return None };
        if !has_own_inputs(self.rank, self.rotor_count) {
            return None;
        }
        let columns = [first, second].map(|row| {
            let mut unit = Vector6::zeros();
            unit.iter_mut().skip(row).take(1).for_each(|x| *x = 1.0);
            let unit_r = asked.rotation_wr.map_or(unit, |r| turned(&r.transpose(), &unit));
            inputs_for(&self.inverse, &unit_r, self.rotor_count)
        });
        solve(asked.inputs, &columns, asked.limits)
    }
}

/// `inputs` are those of the whole wrench, and `columns` their change with each component of the last part. `None` if another
/// part would be missed too, or if digits would be lost.
fn solve(
    inputs: &RotorVector,
    columns: &[RotorVector; 2],
    (lower, upper): (&RotorVector, &RotorVector),
) -> Option<Solved> {
    let strips: [Strip; ROWS] = core::array::from_fn(|i| Strip {
        normal: [columns[0][i], columns[1][i]],
        least: inputs[i] - upper[i],
        most: inputs[i] - lower[i],
    });
    if strips.iter().zip(inputs.as_slice()).any(|(s, u)| u.abs() >= LARGEST * (s.most - s.least)) {
        return None;
    }
    let found = nearest(&strips)?;
    let (mut solved, mut side) = (RotorVector::zeros(), [Side::Free; MAX_ROTORS]);
    for (i, strip) in strips.iter().enumerate() {
        let input = inputs[i] - dot(strip.normal, found.point);
        let noise = ROUNDING * (strip.most - strip.least);
        // Also if it is not a number.
        if !(lower[i] - noise..=upper[i] + noise).contains(&input) {
            return None;
        }
        solved[i] = input.max(lower[i]).min(upper[i]);
    }
    for (i, held) in found.held.into_iter().flatten() {
        // Without the rounding of the difference.
        if let (Some(input), Some(place)) = (solved.get_mut(i), side.get_mut(i)) {
            let limits = if held == Side::Lower { lower } else { upper };
            *input = limits.get(i).copied().unwrap_or(0.0);
            *place = held;
        }
    }
    Some((solved, side, found.steps))
}

/// The point of all strips that is nearest to the origin; `None` if there is none, or if parallel edges decide.
fn nearest(strips: &[Strip; ROWS]) -> Option<Nearest> {
    let mut nearest = Nearest { point: [0.0; 2], held: [None; 2], steps: 0 };
    for (i, strip) in strips.iter().enumerate() {
        let along = dot(strip.normal, nearest.point);
        let (edge, side) = if along < strip.least {
            (strip.least, Side::Upper)
        } else if along > strip.most {
            (strip.most, Side::Lower)
        } else {
            continue;
        };
        nearest.steps += 1;
        let [x, y] = strip.normal;
        let square = dot(strip.normal, strip.normal);
        if square == 0.0 {
            // The last part has no effect on this rotor, which misses its limits.
            return None;
        }
        let (foot, line) = ([x * edge / square, y * edge / square], [-y, x]);
        // The part of the edge that is in all strips before.
        let (mut from, mut to) = ((f64::NEG_INFINITY, None), (f64::INFINITY, None));
        for (j, other) in strips.iter().enumerate().take(i) {
            let (slope, base) = (dot(other.normal, line), dot(other.normal, foot));
            if slope * slope <= PARALLEL * square * dot(other.normal, other.normal) {
                if !(other.least < base && base < other.most) {
                    return None;
                }
                continue;
            }
            let (least, most) = ((other.least - base) / slope, (other.most - base) / slope);
            let ((begin, at_begin), (end, at_end)) = if slope > 0.0 {
                ((least, Side::Upper), (most, Side::Lower))
            } else {
                ((most, Side::Lower), (least, Side::Upper))
            };
            if begin > from.0 {
                from = (begin, Some((j, at_begin)));
            }
            if end < to.0 {
                to = (end, Some((j, at_end)));
            }
        }
        if from.0 > to.0 {
            return None;
        }
        // Zero is the foot of the perpendicular.
        let (t, held) = if from.0 > 0.0 {
            from
        } else if to.0 < 0.0 {
            to
        } else {
            (0.0, None)
        };
        nearest.point = [foot[0] + t * line[0], foot[1] + t * line[1]];
        nearest.held = [Some((i, side)), held];
    }
    Some(nearest)
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}
