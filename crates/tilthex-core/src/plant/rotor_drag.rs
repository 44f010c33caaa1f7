//! Rotor drag and flapping torque: the effects of air that moves in the plane of a rotor's disc.

use crate::{Rotor, types::Vector3};

/// Coefficients of one rotor. Both effects grow with the speed of the rotor and with the component of the airspeed in
/// the rotor's disc.
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
    /// For rotors with the same upward axis the forces add up to `-d sum(|w_i|) v` in body x and y (Kai, Allibert,
    /// Hua, Hamel, IFAC 2017, eq. 3; Faessler, Franchi, Scaramuzza, RA-L 2018, eq. 3). The torque is that of Mahony,
    /// Kumar, Corke, RAM 2012, eq. 6 to 8.
    #[must_use]
    pub fn hub(&self, rotor: &Rotor, speed: f64, airspeed_r: &Vector3) -> (Vector3, Vector3) {
        let in_disc = airspeed_r - rotor.axis_r * rotor.axis_r.dot(airspeed_r);
        let speed = libm::fabs(speed);
        (-self.drag * speed * in_disc, -self.flapping * speed * rotor.axis_r.cross(&in_disc))
    }
}
