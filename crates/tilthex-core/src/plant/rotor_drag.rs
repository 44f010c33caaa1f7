//! Rotor drag and flapping torque: what a rotor's disc feels of the air that crosses it.

use crate::{Rotor, types::Vector3};

/// Coefficients of one rotor; both effects grow with the rotor's speed and with the
/// part of the airspeed that lies in the rotor's disc.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RotorDrag {
    /// Force against the airspeed in the disc, N s/m per Hz of rotor speed.
    pub drag: f64,
    /// Torque that lifts the leading edge of the disc, N m s/m per Hz of rotor speed.
    pub flapping: f64,
}

impl RotorDrag {
    /// Force (N) and torque (N m) on a rotor's hub, robot coordinates:
    /// `force = -drag |w| v`, `torque = -flapping |w| axis x v`, with `v` the airspeed in the disc.
    ///
    /// For rotors with one common upward axis the forces add up to `-d sum(|w_i|) v` in body x and y
    /// (Kai, Allibert, Hua, Hamel, IFAC 2017, eq. 3; Faessler, Franchi, Scaramuzza, RA-L 2018, eq. 3;
    /// the torque: Mahony, Kumar, Corke, RAM 2012, eq. 6 to 8).
    #[must_use]
    pub fn hub(&self, rotor: &Rotor, speed: f64, airspeed_r: &Vector3) -> (Vector3, Vector3) {
        let in_disc = airspeed_r - rotor.axis_r * rotor.axis_r.dot(airspeed_r);
        let speed = libm::fabs(speed);
        (-self.drag * speed * in_disc, -self.flapping * speed * rotor.axis_r.cross(&in_disc))
    }
}
