//! One rotor, and the six of a tilted hexarotor; (4)-(5).

use crate::{Error, so3, types::Vector3};

/// One rotor, fixed to the airframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotor {
    /// Centre of rotation from the centre of mass, m, robot coordinates.
    pub position_r: Vector3,
    /// Direction of the thrust, unit vector, robot coordinates.
    pub axis_r: Vector3,
    /// +1 or -1: the sign of the drag moment about the thrust axis at positive speed.
    pub spin: f64,
    /// Thrust coefficient c_f, N/Hz^2.
    pub thrust_coefficient: f64,
    /// Drag-moment coefficient c_tau, N m/Hz^2.
    pub drag_coefficient: f64,
    /// Lowest speed, Hz.
    pub min_speed: f64,
    /// Highest speed, Hz.
    pub max_speed: f64,
}

/// A hexarotor with tilted propellers, (4)-(5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiltedHexarotor {
    /// Distance from the centre to each tilting centre, m.
    pub arm: f64,
    /// From the tilting centre to the rotor, m, in the rotor's own tilted frame.
    pub rotor_offset: Vector3,
    /// Tilt about the arm, rad; its sign alternates from rotor to rotor.
    pub alpha: f64,
    /// Tilt towards the centre, rad.
    pub beta: f64,
    /// Thrust coefficient, N/Hz^2.
    pub thrust_coefficient: f64,
    /// Drag-moment coefficient, N m/Hz^2.
    pub drag_coefficient: f64,
    /// Lowest speed, Hz.
    pub min_speed: f64,
    /// Highest speed, Hz.
    pub max_speed: f64,
}

impl TiltedHexarotor {
    /// The six rotors, counter-clockwise from the x axis.
    #[must_use]
    pub fn rotors(&self) -> [Rotor; 6] {
        core::array::from_fn(|i| {
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            let yaw = so3::rot_z(i as f64 * core::f64::consts::FRAC_PI_3);
            let rotation = yaw * so3::rot_x(sign * self.alpha) * so3::rot_y(self.beta);
            Rotor {
                // (5) prints the arm as I and does not rotate the offset; see docs/laws.md.
                position_r: yaw * Vector3::new(self.arm, 0.0, 0.0) + rotation * self.rotor_offset,
                axis_r: rotation * Vector3::z(),
                spin: sign,
                thrust_coefficient: self.thrust_coefficient,
                drag_coefficient: self.drag_coefficient,
                min_speed: self.min_speed,
                max_speed: self.max_speed,
            }
        })
    }
}

/// The rotor's column of the allocation matrix, (8)-(9).
pub(super) fn column(rotor: &Rotor) -> nalgebra::Vector6<f64> {
    let force = rotor.thrust_coefficient * rotor.axis_r;
    let torque = rotor.position_r.cross(&force) + rotor.spin * rotor.drag_coefficient * rotor.axis_r;
    crate::Wrench { force, torque }.to_vector()
}

/// Refuses a rotor with impossible values; `rotor` counts from 1.
pub(super) fn check_rotor(rotor: usize, r: &Rotor) -> Result<(), Error> {
    let refuse = |name, found, expected| Err(Error::Rotor { rotor, name, found, expected });
    if let Some(x) = r.position_r.iter().find(|x| !x.is_finite()) {
        return refuse("position", *x, "finite numbers");
    }
    let length = r.axis_r.norm();
    if !length.is_finite() || libm::fabs(length - 1.0) > 1e-6 {
        return refuse("length of axis", length, "a unit vector");
    }
    if libm::fabs(r.spin) != 1.0 {
        return refuse("spin", r.spin, "1 or -1");
    }
    if !r.thrust_coefficient.is_finite() || r.thrust_coefficient <= 0.0 {
        return refuse("thrust_coefficient", r.thrust_coefficient, "a positive number (N/Hz^2)");
    }
    if !r.drag_coefficient.is_finite() || r.drag_coefficient < 0.0 {
        return refuse("drag_coefficient", r.drag_coefficient, "zero or a positive number (N m/Hz^2)");
    }
    if !r.min_speed.is_finite() || r.min_speed.abs() > 1e4 {
        return refuse("min_speed", r.min_speed, "a finite number (Hz)");
    }
    if !(r.max_speed.is_finite() && r.max_speed > r.min_speed && r.max_speed <= 1e4) {
        return refuse("max_speed", r.max_speed, "a number above min_speed, up to 10000 (Hz)");
    }
    Ok(())
}
