//! Forces of one magnitude: a sphere from which planes cut the impossible forces.

use crate::types::Vector3;
use libm::{fabs, sqrt};

/// Largest number of cutting planes.
const PLANES: usize = 8;

/// The half space `normal . f <= offset`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Plane {
    pub normal: Vector3,
    pub offset: f64,
}

/// Forces of one magnitude, some of which planes have cut off.
pub(super) struct Sphere {
    wanted: Vector3,
    size: f64,
    planes: [Plane; PLANES],
    count: usize,
}

impl Sphere {
    /// All forces with the magnitude of the wanted one.
    pub(super) fn new(wanted: Vector3) -> Self {
        Self { wanted, size: wanted.norm(), planes: [Plane::default(); PLANES], count: 0 }
    }

    /// Adds a plane; if there are too many, it replaces the one that is farthest from the wanted force.
    pub(super) fn cut(&mut self, plane: Plane) {
        if self.count < PLANES {
            self.planes[self.count] = plane;
            self.count += 1;
            return;
        }
        let mut slackest = 0;
        let mut most = f64::NEG_INFINITY;
        for (i, p) in self.planes.iter().enumerate() {
            let slack = p.offset - p.normal.dot(&self.wanted);
            if slack > most {
                most = slack;
                slackest = i;
            }
        }
        self.planes[slackest] = plane;
    }

    /// The force of this magnitude inside all planes that is nearest to the wanted one: on the circle of one plane,
    /// or at the intersection of two circles.
    pub(super) fn nearest(&self) -> Option<Vector3> {
        let planes = self.planes.get(..self.count).unwrap_or(&[]);
        let mut best: Option<Vector3> = None;
        let mut consider = |f: Vector3| {
            // Large enough that rounding does not remove the corners.
            let slack = 1e-9 * self.size;
            let allowed = planes.iter().all(|p| p.normal.dot(&f) <= p.offset + slack);
            if allowed && best.is_none_or(|b| f.dot(&self.wanted) > b.dot(&self.wanted)) {
                best = Some(f);
            }
        };
        for (i, a) in planes.iter().enumerate() {
            if let Some(f) = self.on_circle(a) {
                consider(f);
            }
            for b in planes.iter().take(i) {
                if let Some((f, g)) = self.meeting(a, b) {
                    consider(f);
                    consider(g);
                }
            }
        }
        best
    }

    fn on_circle(&self, p: &Plane) -> Option<Vector3> {
        let radius2 = self.size * self.size - p.offset * p.offset;
        let along = self.wanted - p.normal * p.normal.dot(&self.wanted);
        let length = along.norm();
        // At the pole every direction is equally near: take the most upright one.
        let along = if length > 1e-9 * self.size {
            along / length
        } else {
            let up = Vector3::z() - p.normal * p.normal.z;
            if up.norm() > 1e-9 { up.normalize() } else { Vector3::x() }
        };
        (radius2 >= 0.0).then(|| p.normal * p.offset + along * sqrt(radius2))
    }

    fn meeting(&self, a: &Plane, b: &Plane) -> Option<(Vector3, Vector3)> {
        let line = a.normal.cross(&b.normal);
        let sine2 = line.norm_squared();
        if sine2 < 1e-12 {
            return None;
        }
        let cosine = a.normal.dot(&b.normal);
        let foot =
            (a.normal * (a.offset - b.offset * cosine) + b.normal * (b.offset - a.offset * cosine)) / sine2;
        let rest = self.size * self.size - foot.norm_squared();
        if fabs(rest) < 1e-12 * self.size * self.size {
            return Some((foot, foot));
        }
        (rest > 0.0).then(|| {
            let half = line * sqrt(rest / sine2);
            (foot + half, foot - half)
        })
    }
}
