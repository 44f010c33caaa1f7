//! The output of the estimator, at the centre of mass.

use super::{
    Estimator, Health, Quality, Status,
    history::ImuEntry,
    leaps::{is_blow, missed_velocity},
};
use crate::{
    so3,
    supervisor::limits::{POSE_LOST, POSITION_DEVIATION, VELOCITY_DEVIATION},
    types::{RobotState, Vector3},
    ukf::{Covariance, Navigation},
};

impl Estimator {
    /// Whether a pose has started the estimator.
    #[must_use]
    pub fn is_initialized(&self) -> bool {
        self.initialized
    }

    /// The constant latency that is subtracted from the time of every pose, s.
    #[must_use]
    pub fn latency(&self) -> f64 {
        self.params.latency
    }

    /// Time of the newest sample, s.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.now()
    }

    /// Pose and twist of the centre of mass at the newest sample.
    #[must_use]
    pub fn robot_state(&self) -> RobotState {
        let p = &self.params;
        let rotation_wr = self.current.rotation_wi * p.imu_rotation_ri.transpose();
        let angular_velocity_r = p.imu_rotation_ri * self.rate_i();
        RobotState {
            position_w: self.current.position_w - rotation_wr * p.imu_position_r,
            velocity_w: self.current.velocity_w - rotation_wr * angular_velocity_r.cross(&p.imu_position_r),
            rotation_wr,
            angular_velocity_r,
        }
    }

    /// From now on, gives the state of a corrected centre of mass, which is `by_r`, m, robot, away from the old one.
    /// The filter itself works at the IMU and does not change.
    pub fn move_centre_of_mass(&mut self, by_r: &Vector3) {
        self.params.imu_position_r -= by_r;
        self.params.body_position_r -= by_r;
    }

    /// Whether the newest sample comes from a model.
    #[must_use]
    pub fn is_modelled(&self) -> bool {
        self.samples.newest().is_some_and(|s| s.quality.is_modelled())
    }

    /// Rate at the newest sample without the bias.
    fn rate_i(&self) -> Vector3 {
        self.samples.newest().map_or(Vector3::zeros(), |s| s.gyro - self.current.gyro_bias_i)
    }

    /// Specific force at the centre of mass at the newest sample, m/s^2, robot coordinates, without the bias and
    /// corrected for the lever arm.
    #[must_use]
    pub fn specific_force_r(&self) -> Vector3 {
        let p = &self.params;
        let force =
            self.samples.newest().map_or(Vector3::zeros(), |s| s.force - self.current.accelerometer_bias_i);
        let omega = p.imu_rotation_ri * self.rate_i();
        let alpha = p.imu_rotation_ri * self.angular_acceleration_i;
        let arm = p.imu_position_r;
        p.imu_rotation_ri * force - alpha.cross(&arm) - omega.cross(&omega.cross(&arm))
    }

    /// The IMU's state and biases at the newest sample.
    pub(crate) fn navigation(&self) -> Navigation {
        self.current
    }

    /// Bias of the gyro, rad/s, IMU coordinates.
    #[must_use]
    pub fn gyro_bias(&self) -> Vector3 {
        self.current.gyro_bias_i
    }

    /// Bias of the gyro itself, rad/s, IMU coordinates: while a model replaces the gyro, the bias that it had before.
    pub(crate) fn own_gyro_bias(&self) -> Vector3 {
        self.current_kept_bias.mean_i().unwrap_or(self.current.gyro_bias_i)
    }

    /// Bias of the accelerometer, m/s^2, IMU coordinates.
    #[must_use]
    pub fn accelerometer_bias(&self) -> Vector3 {
        self.current.accelerometer_bias_i
    }

    /// Covariance at the newest sample of (position (W) and velocity (W) of the
    /// centre of mass, rotation (W), gyro bias, accelerometer bias).
    ///
    /// If poses are late, this predicts from the head to the newest sample: up to 192 predictions. Do not call it in
    /// every tick; [`health`](Self::health) is cheap.
    #[must_use]
    pub fn covariance(&self) -> Covariance {
        let mut copy = self.head;
        for number in copy.next_sample..self.samples.end() {
            let (gyro, force, length) = self.samples.interval(number);
            let ImuEntry { time: end, quality, .. } = *self.samples.get(number);
            let filter = self.filter_over(number, length);
            copy.pass_bias(quality);
            if end > copy.time {
                filter.predict(&mut copy.state, &gyro, &force, (end - copy.time).min(1.0));
                copy.time = end;
            }
        }
        self.at_centre_of_mass(&copy.state.covariance())
    }

    /// Moves a covariance from the IMU to the centre of mass.
    fn at_centre_of_mass(&self, covariance: &Covariance) -> Covariance {
        let p = &self.params;
        if p.imu_position_r == Vector3::zeros() {
            return *covariance;
        }
        let rotation_wr = self.current.rotation_wi * p.imu_rotation_ri.transpose();
        let omega = p.imu_rotation_ri * self.rate_i();
        let mut map = Covariance::identity();
        map.fixed_view_mut::<3, 3>(0, 6).copy_from(&so3::hat(&(rotation_wr * p.imu_position_r)));
        map.fixed_view_mut::<3, 3>(3, 6)
            .copy_from(&so3::hat(&(rotation_wr * omega.cross(&p.imu_position_r))));
        map.fixed_view_mut::<3, 3>(3, 9)
            .copy_from(&(-rotation_wr * so3::hat(&p.imu_position_r) * p.imu_rotation_ri));
        map * covariance * map.transpose()
    }

    /// Variance of the velocity that the newest inertial sample, `dt` s after the one before, may miss beyond its
    /// noise, (m/s)^2. None if the sample was not simply measured, or shows a blow.
    #[must_use]
    pub fn missed_velocity(&self, dt: f64) -> Option<f64> {
        let simple = |s: &&ImuEntry| s.quality == Quality::Measured && !is_blow(s.leap);
        self.samples.newest().filter(simple).map(|s| missed_velocity(s, dt))
    }

    /// The health of the estimate.
    #[must_use]
    pub fn health(&self) -> Health {
        let now = self.now();
        let [position_deviation, velocity_deviation, rotation_deviation] = self.head.state.deviations();
        let position_age = now - self.newest_position;
        // A NaN counts as lost.
        let certain = position_deviation <= POSITION_DEVIATION && velocity_deviation <= VELOCITY_DEVIATION;
        let status = match (self.initialized, certain) {
            (false, _) => Status::Uninitialized,
            (true, false) => Status::Lost,
            (true, true) if position_age > POSE_LOST => Status::Coasting,
            (true, true) => Status::Tracking,
        };
        Health {
            status,
            pose_age: now - self.newest_pose,
            position_age,
            latency: self.latency,
            latency_deviation: self.latency_deviation,
            nis: self.nis,
            nis_mean: self.nis_mean,
            position_deviation,
            velocity_deviation,
            rotation_deviation,
            lag: now - self.head.time,
            at_rest: self.rest.at_rest(),
            recoveries: self.head.state.recoveries(),
            counts: self.counts,
        }
    }
}
