//! The time from lift-off to the begin of the mission, which shows errors of wiring, axes and latency; and a landing to which a
//! small error of axes or latency leads later.
//!
//! These errors do not show on the ground, because the legs take every force of the rotors. In the first decimetres a
//! correct vehicle stays level above its start; an incorrect one is stopped while a stop does no harm.

use super::{
    Flight,
    capture::Contradiction,
    witness::{Told, Witness},
};
use crate::{
    GRAVITY, so3,
    supervisor::{
        Fault, FaultSet, LIFT_OFF_FAULTS, Phase,
        limits::{LIFT_OFF, LIFT_OFF_ASIDE, LIFT_OFF_TILT, LIFT_OFF_TIME, POSE_LOST, SUSPECTED},
    },
    types::{Matrix3, PoseSample, Vector3},
    ukf::Navigation,
};

/// A correct vehicle has no external torque above this part of the weight at the farthest rotor.
const TORQUE: f64 = 0.08;
/// A captured body that has moved this far along the felt motion, m, follows it late.
const FOLLOWS: f64 = 0.01;
/// If this part of the difference from the felt motion is sideways, the captured body moves in another direction.
const ASTRAY: f64 = 0.7;
/// A captured body that has come this far the wrong way up, m, and as a part of what is felt, shows a mirror image.
const REVERSED: (f64, f64) = (0.02, 0.5);

/// A vehicle that is faster than this, m/s and rad/s, is not stopped, unless it is lower than this, m.
const FAST: (f64, f64) = (2.0, 4.0);
const LOW: f64 = 0.1;

/// The watch of the first moments.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LiftOff {
    /// Time since the take-off began, s; `None` after it.
    since: Option<f64>,
    /// Until the mission begins, and while poses surprise: the motion by the poses and by the accelerometer, and by the rotors.
    witness: Option<Witness>,
    by_rotors: Witness,
    /// The fault that was found.
    pub(super) fault: Option<Fault>,
    /// How much later than their times poses were when it was found, s.
    late: f64,
    /// Turns the captured body to where it should be, if it was found to be turned.
    turn_c: Option<Matrix3>,
}

impl LiftOff {
    /// A take-off begins.
    pub(super) fn begin(&mut self) {
        *self = Self { since: Some(0.0), witness: Some(Witness::default()), ..Self::default() };
    }

    /// Takes the specific force by the accelerometer and by the rotors, m/s^2, IMU axes, for the `dt` s up to a time, s.
    pub(super) fn feel(
        &mut self,
        state: &Navigation,
        (specific_force_i, rotors_i): (&Vector3, &Vector3),
        time: f64,
        dt: f64,
    ) {
        if let Some(witness) = &mut self.witness {
            if witness.missed(time) {
                witness.begin_again(time);
                self.by_rotors.begin_again(time);
                return;
            }
            let felt_w = |force_i: Vector3| state.rotation_wi * force_i - Vector3::new(0.0, 0.0, GRAVITY);
            witness.feel(&felt_w(specific_force_i - state.accelerometer_bias_i), time, dt);
            self.by_rotors.feel(&felt_w(*rotors_i), time, dt);
        }
    }

    /// What poses and accelerometer tell together. A step of the accelerometer's bias looks like a delay, because before it poses
    /// and accelerometer agreed: a delay must not be denied by the rotors.
    fn told(&self) -> Told {
        let told = self.witness.as_ref().map_or_else(Told::default, Witness::tells);
        Told { late: told.late.filter(|late| !self.by_rotors.denies(*late)), ..told }
    }

    /// The pose with the time at which it was captured, if poses were found to be late, and with the yaw of the vehicle, if
    /// the captured body was found to be turned.
    pub(super) fn corrected(&self, pose: &PoseSample) -> PoseSample {
        match self.fault {
            Some(Fault::CaptureLate) => PoseSample { time: pose.time - self.late, ..*pose },
            Some(Fault::CaptureAxes) => {
                let turn_c = self.turn_c.unwrap_or_else(Matrix3::identity);
                PoseSample { rotation_wr: pose.rotation_wr * turn_c, ..*pose }
            }
            _ => *pose,
        }
    }

    /// Whether the vehicle has just taken off, and errors of wiring, axes and latency may still show.
    pub(super) fn begins(&self) -> bool {
        self.since.is_some()
    }

    /// Takes a pose of the IMU, as the capture system shows it.
    pub(super) fn see(&mut self, pose: &PoseSample) {
        if let Some(witness) = &mut self.witness {
            witness.see(pose);
            self.by_rotors.see(pose);
        }
    }
}

impl Flight {
    /// Watches a take-off; returns the reaction that is needed at once.
    pub(super) fn watch_lift_off(
        &mut self,
        phase: Phase,
        contradiction: Option<&Contradiction>,
        conditions: &mut FaultSet,
        dt: f64,
    ) -> Option<Fault> {
        let abort = if self.lift_off.fault.is_none() {
            self.find_lift_off_fault(phase, contradiction, dt)
        } else {
            None
        };
        for known in LIFT_OFF_FAULTS {
            conditions.insert_if(known, self.lift_off.fault == Some(known));
        }
        abort
    }

    /// Looks for a fault; returns the reaction that is needed at once.
    fn find_lift_off_fault(
        &mut self,
        phase: Phase,
        contradiction: Option<&Contradiction>,
        dt: f64,
    ) -> Option<Fault> {
        let watch = &mut self.lift_off;
        // A delay or a yaw shows in the first hover, or in the landing to which it leads: the smaller it is, the later it does.
        let inconsistent = self.supervisor.active().contains(Fault::EstimateInconsistent);
        let hovers = !self.guidance.ready() && matches!(phase, Phase::Flying | Phase::Holding);
        let (begins, ends) = SUSPECTED;
        let surprise = if watch.witness.is_some() { ends } else { begins };
        let suspected = inconsistent || self.estimator.health().nis_mean > surprise;
        if suspected && matches!(phase, Phase::Flying | Phase::Holding | Phase::Landing) {
            let now = self.estimator.time();
            if watch.witness.is_none() {
                (watch.witness, watch.by_rotors) = (Some(Witness::in_motion(now)), Witness::in_motion(now));
            }
        } else if !hovers {
            watch.witness = None;
        }
        let asked = hovers || phase == Phase::Landing;
        let told = if asked { watch.told() } else { Told::default() };
        watch.late = told.late.unwrap_or(0.0);
        if watch.since.is_none() {
            if told.late.is_some() {
                watch.fault = Some(Fault::CaptureLate);
            } else if let Some(yaw) = told.yaw.filter(|_| self.estimator.health().pose_age < POSE_LOST) {
                // Rotations are still accepted: the estimate has the yaw of the poses.
                watch.fault = Some(Fault::CaptureAxes);
                self.turn(yaw);
            }
            return None;
        }
        let since = watch.since? + dt;
        watch.since = Some(since).filter(|since| *since < LIFT_OFF_TIME && phase.in_flight());
        let robot = self.robot_state();
        let output = self.output.as_ref()?;
        let felt_height = contradiction.map_or(0.0, |c| (c.reckoned.position_w - c.from_w).z);
        // Late poses show a rising vehicle lower than it is.
        let risen = told.late.unwrap_or(0.0) * robot.velocity_w.z.max(0.0);
        let height = (self.bounds.height(&robot.position_w).unwrap_or(0.0) + risen).max(felt_height);
        if height > LIFT_OFF {
            self.lift_off.since = None;
            return None;
        }
        let turned = so3::log(&(output.robot_reference.rotation_wr.transpose() * robot.rotation_wr));
        let placed = self.known.is_some() || self.estimator.health().position_age < POSE_LOST;
        let aside = placed && output.pose.position_error_w.xy().norm() > LIFT_OFF_ASIDE;
        let tilted = turned.norm() > LIFT_OFF_TILT.to_radians();
        let fault = if let Some(contradiction) = contradiction {
            Some(self.cause_of(contradiction))
        } else if tilted || aside {
            let torque = output.contact(&robot, &self.control.bias_r).torque.norm();
            let wrong = torque > TORQUE * self.controller.weight_at_arm();
            Some(if tilted && wrong { Fault::MotorOrder } else { Fault::LiftOff })
        } else if inconsistent {
            // The IMU contradicts poses of a body whose yaw is wrong before any of the signs above shows.
            Some(Fault::CaptureAxes)
        } else {
            told.late.map(|_| Fault::CaptureLate).or(told.yaw.map(|_| Fault::CaptureAxes))
        };
        let fault = fault.map(|fault| match (told.late, told.mirrored) {
            (Some(_), _) => Fault::CaptureLate,
            (None, true) => Fault::CaptureMirrored,
            (None, false) => fault,
        });
        self.lift_off.fault = fault;
        if let Some(yaw) = told.yaw.filter(|_| fault == Some(Fault::CaptureAxes) && contradiction.is_none()) {
            self.turn(yaw);
        }
        // If the vehicle is already fast or tumbles, a landing does less harm than a stop. It cannot land if its motors are
        // exchanged.
        let slow = robot.velocity_w.norm() < FAST.0 && robot.angular_velocity_r.norm() < FAST.1;
        fault.filter(|fault| slow || height < LOW || *fault == Fault::MotorOrder)
    }

    /// The captured body is turned: from now on the estimate has the yaw of the vehicle.
    fn turn(&mut self, yaw: f64) {
        let before = self.robot_state();
        let captured = self.estimator.captured_rotation();
        self.lift_off.turn_c = Some(captured.transpose() * so3::rot_z(yaw) * captured);
        self.estimator.turn(yaw);
        self.take_state();
        self.capture.struck();
        self.absorb_jump(&before, 0.0);
    }

    /// The cause of a contradiction between captured body and IMU, from the motion of both.
    fn cause_of(&self, contradiction: &Contradiction) -> Fault {
        let felt_w: Vector3 = contradiction.reckoned.position_w - contradiction.from_w;
        let captured_w = contradiction.estimate.position_w - contradiction.from_w;
        let seen_w = self.lift_off.witness.as_ref().map_or_else(Vector3::zeros, Witness::way);
        let sizes = felt_w.norm() * captured_w.norm();
        let along = felt_w.dot(&captured_w);
        if seen_w.z < -REVERSED.0.max(REVERSED.1 * felt_w.z) {
            Fault::CaptureMirrored
        } else if sizes > 1e-4 && along < 0.8 * sizes {
            Fault::CaptureAxes
        } else if (felt_w - seen_w).xy().norm() > ASTRAY * (felt_w - seen_w).norm() {
            if seen_w.norm() > FOLLOWS { Fault::CaptureAxes } else { Fault::PoseContradicts }
        } else if seen_w.dot(&felt_w) > FOLLOWS * felt_w.norm() {
            Fault::CaptureLate
        } else {
            Fault::PoseContradicts
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A program that stands still misses samples; then all poses of that time come at once. This is no delay of the poses.
        #[test]
        fn missed_samples_are_no_delay(begin in 0.5f64..1.0, length in 0.1f64..0.3, rate in 6.0f64..11.0) {
            let sway = |t: f64, rate: f64| 0.02 * t.min(1.0) * (1.0 - libm::cos(rate * t));
            let way = |t: f64| Vector3::new(sway(t, rate), sway(t, 6.3), sway(t, 4.0));
            let (mut watch, state, mut last, mut waiting) = (LiftOff::default(), Navigation::ORIGIN, 0.0, std::vec::Vec::new());
            watch.begin();
            for k in 1..1000 {
                let time = 0.002 * f64::from(k);
                if k % 5 == 0 {
                    let (position_w, rotation_wr) = (way(time), Matrix3::identity());
                    waiting.push(PoseSample { time, arrival: time, position_w, rotation_wr, tracking_valid: true });
                }
                if (begin..begin + length).contains(&time) {
                    continue;
                }
                let felt_w = (way(time + 1e-3) - way(time) * 2.0 + way(time - 1e-3)) / 1e-6;
                let force_i = felt_w + Vector3::new(0.0, 0.0, GRAVITY);
                watch.feel(&state, (&force_i, &force_i), time, time - last);
                last = time;
                waiting.drain(..).for_each(|pose| watch.see(&pose));
                let told = watch.witness.as_ref().map_or_else(Told::default, Witness::tells);
                prop_assert!(told.late.is_none() && !told.mirrored, "{time} {told:?}");
                // Where the captured body has come is known all the time.
                let moved = watch.witness.as_ref().map_or_else(Vector3::zeros, Witness::way);
                prop_assert!((moved - (way(time) - way(0.01))).norm() < 3e-3 || time < 0.01, "{time} {moved}");
            }
        }

        /// A step of the accelerometer's bias while the vehicle rises is no delay of the poses.
        #[test]
        fn a_step_of_the_accelerometers_bias_is_no_delay(
            at in 0.2f64..1.5, step in -1.0f64..1.0, axis in 0..3_usize, lasts in 0.1f64..2.0, rate in 6.0f64..11.0
        ) {
            let way = |t: f64| {
                let rises = if t < 1.2 { 0.2 * t * t } else { 0.48 * t - 0.288 };
                Vector3::new(2e-3 * libm::sin(rate * t), 2e-3 * libm::cos(6.3 * t), rises)
            };
            let (mut watch, state) = (LiftOff::default(), Navigation::ORIGIN);
            watch.begin();
            for k in 1..1250 {
                let time = 0.002 * f64::from(k);
                let moves = (way(time + 1e-3) - way(time) * 2.0 + way(time - 1e-3)) / 1e-6;
                let rotors = moves + Vector3::new(0.0, 0.0, GRAVITY);
                let stepped = (at..at + lasts).contains(&time);
                let felt = rotors + if stepped { Vector3::ith(axis, step) } else { Vector3::zeros() };
                watch.feel(&state, (&felt, &rotors), time, 0.002);
                if k % 5 == 0 {
                    let (position_w, rotation_wr) = (way(time), Matrix3::identity());
                    watch.see(&PoseSample { time, arrival: time, position_w, rotation_wr, tracking_valid: true });
                    prop_assert_eq!(watch.told().late, None, "{}", time);
                }
            }
        }

        #[test]
        fn poses_are_corrected_by_what_was_found_and_only_then(
            late in 0.04f64..0.3, yaw in 0.5f64..3.0, time in 0.0f64..9.0
        ) {
            let (position_w, rotation_wr) = (Vector3::zeros(), so3::exp(&Vector3::new(0.1, 0.2, 0.3)));
            let pose = PoseSample { time, arrival: time, position_w, rotation_wr, tracking_valid: true };
            let turn_c = Some(so3::rot_z(yaw));
            for fault in [None, Some(Fault::CaptureLate), Some(Fault::CaptureAxes)] {
                let watch = LiftOff { fault, late, turn_c, ..LiftOff::default() };
                let expected = match fault {
                    Some(Fault::CaptureLate) => PoseSample { time: time - late, ..pose },
                    Some(Fault::CaptureAxes) => PoseSample { rotation_wr: rotation_wr * so3::rot_z(yaw), ..pose },
                    _ => pose,
                };
                prop_assert_eq!(watch.corrected(&pose), expected);
            }
            let mut again = LiftOff { fault: Some(Fault::CaptureLate), late, turn_c, ..LiftOff::default() };
            again.begin();
            prop_assert_eq!(again.corrected(&pose), pose);
        }
    }
}
