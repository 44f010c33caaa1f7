//! Drag of the airframe.

use crate::types::{Vector3, Wrench};

/// Drag of the airframe, quadratic in the airspeed along each robot axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyDrag {
    /// Drag coefficient times projected area along robot x, y and z, m^2.
    pub area_r: Vector3,
    /// Point at which the force acts, from the centre of mass, m, robot coordinates.
    pub centre_r: Vector3,
}

impl BodyDrag {
    /// Wrench at the centre of mass, robot coordinates, at an airspeed (m/s, robot coordinates):
    /// `force_k = -1/2 rho (C A)_k |v| v_k` (Anderson, Fundamentals of Aerodynamics, ch. 1.5).
    #[must_use]
    pub fn wrench(&self, density: f64, airspeed_r: &Vector3) -> Wrench {
        let force = -0.5 * density * airspeed_r.norm() * self.area_r.component_mul(airspeed_r);
        Wrench { force, torque: self.centre_r.cross(&force) }
    }
}
