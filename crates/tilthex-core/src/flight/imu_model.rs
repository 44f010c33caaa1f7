//! The inertial samples that the vehicle's model expects. They replace missing ones.

use crate::{
    Vehicle,
    plant::ImuSample,
    types::{RobotState, RotorVector, Vector3, Wrench},
};

/// Time constant of the external torque that lasts, s. A blow is shorter, and an IMU that freezes in a turn shows a torque that
/// is none for 50 ms.
const LASTS: f64 = 0.7;
/// A vehicle is pushed by a torque above this, N m.
const PUSHED: f64 = 0.1;
/// How fast the torque follows the corrections of the angular velocity by poses, 1/s.
const FOLLOWS: f64 = 20.0;
/// It follows late poses more slowly: by at most this part of a correction in the age of the pose.
const SHARE: f64 = 0.5;

/// The model of the IMU's readings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ImuModel {
    /// Mean of the external torque about the centre of mass, N m, robot axes.
    torque_r: Vector3,
    /// The torque that the IMU has shown last.
    last_r: Vector3,
}

impl ImuModel {
    /// Takes the external torque that the IMU has shown, N m, robot axes, over `dt` s.
    pub(super) fn feel(&mut self, torque_r: &Vector3, dt: f64) {
        self.torque_r += (torque_r - self.torque_r) * (dt / LASTS).min(1.0);
        self.last_r = *torque_r;
    }

    /// The model begins to replace the IMU: a torque that has already ended does not go on. Returns whether one goes on.
    pub(super) fn begin(&mut self) -> bool {
        self.torque_r = self.torque_r.zip_map(&self.last_r, |mean, last| {
            if mean * last <= 0.0 {
                0.0
            } else if last.abs() < mean.abs() {
                last
            } else {
                mean
            }
        });
        self.torque_r.norm() > PUSHED
    }

    /// Takes the change of the angular momentum, N m s, robot axes, by which poses have corrected the model: the torque has been
    /// another one. The newest pose was taken `pose_age` s ago.
    pub(super) fn correct(&mut self, momentum_r: &Vector3, pose_age: f64) {
        self.torque_r += FOLLOWS.min(SHARE / pose_age.max(f64::MIN_POSITIVE)) * momentum_r;
    }

    /// The sample that the model predicts after `dt` s from the last estimate, the rotor speeds and the observed force, without
    /// biases. The torque is the one that lasted while the IMU was there, and that poses have shown since then.
    #[must_use]
    pub(super) fn sample(
        &self,
        vehicle: &Vehicle,
        state: &RobotState,
        rotor_speeds: &RotorVector,
        external: &Wrench,
        dt: f64,
    ) -> ImuSample {
        let actuation = vehicle.body_wrench(rotor_speeds);
        let omega = state.angular_velocity_r;
        let torque = actuation.torque + self.torque_r - omega.cross(&(vehicle.inertia() * omega));
        let alpha = vehicle.inertia_inverse() * torque;
        let omega = omega + alpha * dt;
        let force = actuation.force + state.rotation_wr.transpose() * external.force;
        let imu = vehicle.imu();
        let lever: Vector3 = alpha.cross(&imu.position_r) + omega.cross(&omega.cross(&imu.position_r));
        let to_imu = imu.rotation_r.transpose();
        ImuSample { gyro_i: to_imu * omega, specific_force_i: to_imu * (force / vehicle.mass() + lever) }
    }
}
