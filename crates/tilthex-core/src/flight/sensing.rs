//! From samples and poses to the state that the laws use.

use super::{
    Flight,
    capture::{Contradiction, Verdict},
    gyro_doubt::BIAS,
    io::{KnownState, MAX_POSES, Measured},
};
use crate::{
    admittance::AdmittanceState,
    estimator::{Estimator, Quality},
    so3,
    supervisor::{Fault, FaultSet, Phase, limits::IMU_LATE},
    types::{RobotState, RotorVector, Setpoint, Vector3},
};

/// A larger correction of the estimate than this in a tick, m and rad, is a jump.
const JUMP: (f64, f64) = (0.03, 0.03);

/// What the estimator knows of the vehicle.
pub(super) fn state_of(estimator: &Estimator) -> KnownState {
    KnownState { robot: estimator.robot_state(), specific_force_r: estimator.specific_force_r() }
}

impl Flight {
    /// Pose and twist of the robot: the estimator's, or the known ones.
    #[must_use]
    pub fn robot_state(&self) -> RobotState {
        debug_assert!(self.state == self.newest_state() || !self.state.robot.is_finite());
        self.state.robot
    }

    /// Specific force at the centre of mass, m/s^2, robot: the estimator's, or the known one.
    pub(super) fn specific_force_r(&self) -> Vector3 {
        self.state.specific_force_r
    }

    /// Pose and twist of the tool.
    pub(super) fn actual_tool(&self) -> Setpoint {
        let (tool, robot) = (self.params.vehicle.tool(), self.robot_state());
        let lever_w = robot.rotation_wr * tool.position_r;
        let angular_velocity_w = robot.rotation_wr * robot.angular_velocity_r;
        Setpoint {
            velocity_w: robot.velocity_w + angular_velocity_w.cross(&lever_w),
            angular_velocity_w,
            ..Setpoint::hold(robot.position_w + lever_w, robot.rotation_wr * tool.rotation_r)
        }
    }

    fn newest_state(&self) -> KnownState {
        self.known.unwrap_or_else(|| state_of(&self.estimator))
    }

    /// Takes over what the estimator has changed.
    pub(super) fn take_state(&mut self) {
        self.state = self.newest_state();
    }

    /// Updates the estimator. In flight, the model replaces missing inertial samples.
    pub(super) fn estimate(&mut self, input: &Measured<'_>, rotor_speeds: &RotorVector, dt: f64) {
        self.known = input.known.map(|known| self.model.at_centre(&known));
        if self.known.is_none() {
            self.run_estimator(input, rotor_speeds, dt);
        }
        self.take_state();
    }

    fn run_estimator(&mut self, input: &Measured<'_>, rotor_speeds: &RotorVector, dt: f64) {
        let inertial = &input.telemetry.inertial;
        let samples = inertial.samples();
        let modelled = self.estimator.is_modelled();
        let mut last = self.estimator.time();
        let mut believed = false;
        let rotors_r = self.specific_thrust_r(rotor_speeds);
        let rotors_i = self.params.vehicle.imu().rotation_r.transpose() * rotors_r;
        for s in samples {
            if !self.believes(s, input.time) {
                continue;
            }
            believed = true;
            let quality = if s.shaken { Quality::Shaken } else { Quality::Measured };
            self.estimator.predict_as(quality, s.time, &s.gyro_i, &s.specific_force_i);
            let dt = (s.time - last).max(0.0);
            let (gyro_i, force_i) = self.estimator.corrected(quality, &s.gyro_i, &s.specific_force_i);
            self.lift_off.feel(&self.estimator.navigation(), (&force_i, &rotors_i), s.time, dt);
            self.capture.feel(&gyro_i, &force_i, self.estimator.missed_velocity(dt), (s.time, dt));
            self.feel_own(&force_i, &rotors_r, s.time, dt);
            last = s.time;
        }
        if inertial.refused_now || inertial.saturated {
            self.capture.struck();
        }
        let mut expected_i = None;
        let late = self.returning.age(inertial, input.time) > IMU_LATE;
        let external = self.control.observer.wrench;
        if !modelled {
            self.imu_model.feel(&external.torque, dt);
        }
        if !believed && late && self.supervisor.phase().in_flight() {
            if !modelled && self.imu_model.begin() {
                self.estimator.expect_torques();
            }
            let state = self.estimator.robot_state();
            let model = self.imu_model.sample(&self.params.vehicle, &state, rotor_speeds, &external, dt);
            expected_i = Some(model.gyro_i);
            let gyro_i = model.gyro_i + self.estimator.gyro_bias();
            let specific_force_i = model.specific_force_i + self.estimator.accelerometer_bias();
            // Readings that have just left their range are an impact, until this lasts.
            let broken = self.supervisor.active().contains(Fault::ImuSaturated);
            let shaken = inertial.saturated && !broken;
            let quality = if shaken { Quality::ModelledShaken } else { Quality::Modelled };
            let dt = (input.time - last).max(0.0);
            self.estimator.predict_as(quality, input.time, &gyro_i, &specific_force_i);
            self.feel_own(&specific_force_i, &rotors_r, input.time, dt);
            self.capture.flies_unfelt();
        }
        // When the source changes, rates jump without a motion.
        if self.estimator.is_modelled() != modelled {
            self.control.observer.forget_sample();
        }
        let in_flight = self.supervisor.phase().in_flight();
        for pose in input.poses.iter().take(MAX_POSES) {
            let pose = &self.capture_clock.timed(pose, in_flight);
            let frozen = self.capture.frozen();
            let admitted = self.capture.admits(pose);
            if self.capture.frozen() && !frozen && self.estimator.is_modelled() {
                // Until now the estimate has followed these poses, and no sample has shown otherwise.
                self.estimator.doubt_motion();
            }
            if !admitted {
                continue;
            }
            if self.estimator.is_initialized() {
                if !self.capture.lies() {
                    self.lift_off.see(&self.estimator.pose_of_imu(pose));
                }
                let pose = self.lift_off.corrected(pose);
                self.see_own(&pose);
                let placed = self.own_poses.placed(&pose);
                let now = self.estimator.time();
                if !self.capture.lies() && self.capture.continues(&self.estimator.pose_of_imu(&placed), now) {
                    self.estimator.update_pose(&placed);
                }
            } else if pose.tracking_valid && pose.is_finite() {
                // Until the start succeeds, the operator gets this reason.
                self.start_refused =
                    self.estimator.initialize_at_rest(pose.time, &pose.position_w, &pose.rotation_wr).err();
            }
        }
        if !input.poses.is_empty() {
            self.believe_own();
        }
        if let Some(expected_i) = expected_i {
            // Late poses correct the model in later ticks, too.
            let vehicle = &self.params.vehicle;
            let expected_r = vehicle.imu().rotation_r * expected_i;
            let correction_r = self.estimator.robot_state().angular_velocity_r - expected_r;
            let pose_age = self.estimator.health().position_age;
            self.imu_model.correct(&(vehicle.inertia() * correction_r), pose_age);
        }
    }

    /// Compares poses with the IMU. After a contradiction the vehicle is flown with the IMU.
    pub(super) fn watch_capture(
        &mut self,
        phase: Phase,
        conditions: &mut FaultSet,
        dt: f64,
    ) -> Option<Contradiction> {
        conditions.insert_if(Fault::PoseFrozen, self.capture.frozen());
        conditions.insert_if(Fault::CaptureClock, self.capture_clock.jumped());
        conditions.insert_if(Fault::PoseContradicts, self.capture.lies());
        if self.known.is_some() || !self.estimator.is_initialized() {
            return None;
        }
        if matches!(phase, Phase::Disarmed | Phase::Starting | Phase::Grounded) {
            self.capture.rests(&self.estimator.navigation());
        }
        self.capture.settle(self.estimator.health().position_age, dt);
        let output = self.output.as_ref().filter(|_| phase.in_flight())?;
        let robot = self.robot_state();
        let external_r = output.contact(&robot, &self.control.bias_r);
        match self.capture.contradicts(&self.estimator, &external_r, &self.params.vehicle, dt)? {
            Verdict::PosesLie(found, state) => {
                self.estimator.go_on_from(state);
                self.take_state();
                conditions.insert_if(Fault::PoseContradicts, true);
                Some(found)
            }
            Verdict::GyroIsOff => {
                self.estimator.doubt_gyro(BIAS.1);
                self.take_state();
                None
            }
        }
    }

    /// A correction of the estimate is not a motion. Reference and set-point move together with it, and return from
    /// there at the usual speed. The admittance filter's spring corrects a rotation.
    pub(super) fn absorb_jump(&mut self, before: &RobotState, dt: f64) {
        let now = self.robot_state();
        let Some(output) = self.output.as_mut().filter(|_| self.supervisor.phase().in_flight()) else {
            return;
        };
        let expected_w = before.position_w + before.velocity_w * dt;
        let turn_r = before.angular_velocity_r * dt;
        let (far, wide) = JUMP;
        if (now.position_w - expected_w).norm() < far
            && so3::follows(&before.rotation_wr, &turn_r, &now.rotation_wr, wide)
        {
            return;
        }
        let turn = now.rotation_wr * (before.rotation_wr * so3::exp(&turn_r)).transpose();
        let r = &mut output.reference;
        let moved_w = now.position_w + turn * (r.position_w - expected_w) - r.position_w;
        r.position_w += moved_w;
        r.rotation_we = turn * r.rotation_we;
        r.velocity_w = turn * r.velocity_w;
        r.angular_velocity_w = turn * r.angular_velocity_w;
        output.setpoint.position_w += moved_w;
        self.guidance.shift(moved_w);
        self.control.admittance = AdmittanceState::at(r, &output.setpoint);
        self.control.observer.forget_sample();
    }
}
