//! A flat surface near a rotor: ground, ceiling or wall, by the method of images.
//!
//! Cheeseman and Bennett (ARC R&M 3021, 1955) replace a rotor by a source, and the ground by the image of the source
//! at twice the distance. At the rotor the image moves the air by `(R/(4h))^2` of the induced velocity, along the
//! normal of the surface. For the ground below a level rotor this gives their `T/T0 = 1/(1 - (R/(4h))^2)`; beside a
//! wall the air moves in the plane of the disc.

use crate::{
    Rotor,
    types::{Matrix3, RobotState, Vector3},
};

/// A plane. The air is on the side to which the normal points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Unit normal, world.
    pub normal_w: Vector3,
    /// Distance of the plane from the origin along the normal, m.
    pub offset: f64,
}

/// The effect of a surface on one rotor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Influence {
    /// Fraction by which the surface reduces the induced velocity; the thrust is the free thrust times `1/(1 -
    /// part)`.
    pub part: f64,
    /// Velocity of the air in the rotor's disc, m/s, robot coordinates.
    pub wind_r: Vector3,
}

/// Smallest distance between a rotor's hub and a surface, in radii, for which the method holds; a smaller distance
/// counts as this one.
pub const NEAREST: f64 = 0.5;

impl Surface {
    /// The effect on a rotor with a radius (m) that turns at a speed (Hz) in air of a density (kg/m^3).
    #[must_use]
    pub fn influence(
        &self,
        robot: &RobotState,
        rotor: &Rotor,
        radius: f64,
        speed: f64,
        density: f64,
    ) -> Influence {
        let hub_w = robot.position_w + robot.rotation_wr * rotor.position_r;
        let height = (self.normal_w.dot(&hub_w) - self.offset).max(NEAREST * radius);
        let ratio = radius / (4.0 * height);
        let part = ratio * ratio;
        let to_r: Matrix3 = robot.rotation_wr.transpose();
        let normal_r = to_r * self.normal_w;
        let along = normal_r.dot(&rotor.axis_r);
        let in_disc = normal_r - rotor.axis_r * along;
        Influence {
            part: libm::copysign(part * along, speed * along),
            wind_r: part * induced_velocity(rotor, radius, speed, density) * in_disc,
        }
    }
}

/// Induced velocity of a hovering rotor, m/s: `sqrt(T/(2 rho A))` (Leishman, Principles of Helicopter
/// Aerodynamics, eq. 2.14).
#[must_use]
pub fn induced_velocity(rotor: &Rotor, radius: f64, speed: f64, density: f64) -> f64 {
    let thrust = rotor.thrust_coefficient * speed * speed;
    libm::sqrt(thrust / (2.0 * density * core::f64::consts::PI * radius * radius))
}
