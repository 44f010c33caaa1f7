//! Rotates the reference about the tool's axis towards attitudes in which the rotors have more room.
//!
//! In a tilted hover some rotors are near their limits. How near depends on the axis of the tilt in the vehicle: the
//! Tilt-Hex reaches 18 deg about one axis and 33 deg about another. A tool that may rotate about its own axis can
//! choose. The room is the smallest distance of any rotor's input from its limits in a hover, as a part of the
//! rotor's range. A torque towards more room is added to the input of the admittance filter. The torque is bounded,
//! so that together with the damping it bounds the rate of the rotation.

use crate::{
    Error, Vehicle,
    error::check_range,
    types::{MAX_ROTORS, Matrix3, Vector3},
    vehicle::{Actuation, Mounting},
};
use nalgebra::SMatrix;

/// Sharpness of the smooth minimum: rooms that differ by more than its inverse are distinguished.
const SHARPNESS: f64 = 60.0;
/// Increase of the room with the rotation, 1/rad, at which the torque is 0.7 of its largest.
const KNEE: f64 = 0.01;

/// The torque towards more room, for one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotorRoom {
    /// Largest torque, N m.
    largest: f64,
    /// Rooms above the lower limits of a hover whose upward direction is e (robot): `slope * e + offset`.
    slope: SMatrix<f64, MAX_ROTORS, 3>,
    offset: [f64; MAX_ROTORS],
    count: usize,
}

impl RotorRoom {
    /// With the largest torque, N m.
    ///
    /// # Errors
    /// If the torque is out of range, or the vehicle cannot hover tilted.
    pub fn new(vehicle: &Vehicle, largest: f64) -> Result<Self, Error> {
        check_range("room_torque", largest, 0.0, 1000.0)?;
        if largest > 0.0 && vehicle.actuation() != Actuation::Pose {
            return Err(Error::Unsupported {
                name: "room_torque",
                found: "above 0",
                expected: "0: this vehicle hovers in one attitude, whatever its heading",
            });
        }
        Ok(Self::with_torque(vehicle, largest))
    }

    /// The same for a vehicle whose model has been corrected.
    #[must_use]
    pub fn for_vehicle(&self, vehicle: &Vehicle) -> Self {
        Self::with_torque(vehicle, self.largest)
    }

    fn with_torque(vehicle: &Vehicle, largest: f64) -> Self {
        let mut slope = vehicle.allocation_inverse().fixed_columns::<3>(0) * vehicle.weight();
        let mut offset = [0.0; MAX_ROTORS];
        for (i, rotor) in vehicle.rotors().iter().enumerate() {
            let input = |speed: f64| speed * libm::fabs(speed);
            let (lower, upper) = (input(rotor.min_speed), input(rotor.max_speed));
            slope.row_mut(i).scale_mut(1.0 / (upper - lower));
            offset[i] = -lower / (upper - lower);
        }
        Self { largest, slope, offset, count: vehicle.rotor_count() }
    }

    /// The room in a hover, as a part of a rotor's range, and its derivative by a rotation about `axis_w`, 1/rad.
    ///
    /// It is a smooth minimum of all rotors' distances from both limits, at most `ln(2 n) / 60` below the true
    /// minimum.
    #[must_use]
    pub fn room(&self, rotation_wr: &Matrix3, axis_w: &Vector3) -> (f64, f64) {
        let up_r = rotation_wr.transpose() * Vector3::z();
        let turning_r = rotation_wr.transpose() * Vector3::z().cross(axis_w);
        let (above, rates) = (self.slope * up_r, self.slope * turning_r);
        let rooms = || {
            above.iter().zip(rates.iter()).zip(self.offset.iter()).take(self.count).flat_map(
                |((a, rate), o)| {
                    let room = a + o;
                    [(room, *rate), (1.0 - room, -rate)]
                },
            )
        };
        let least = rooms().fold(f64::INFINITY, |least, (room, _)| least.min(room));
        let (sum, slope) = rooms().fold((0.0, 0.0), |(sum, slope), (room, rate)| {
            let weight = libm::exp(SHARPNESS * (least - room));
            (sum + weight, slope + weight * rate)
        });
        (least - libm::log(sum) / SHARPNESS, slope / sum)
    }

    /// The torque on a reference of the tool, `rotation_we`, that points along its axis: N m, world.
    #[must_use]
    pub fn torque(&self, rotation_we: &Matrix3, tool: &Mounting) -> Vector3 {
        let axis_w: Vector3 = rotation_we.column(2).into_owned();
        let (_, slope) = self.room(&(rotation_we * tool.rotation_r.transpose()), &axis_w);
        axis_w * (self.largest * slope / libm::sqrt(slope * slope + KNEE * KNEE))
    }
}
