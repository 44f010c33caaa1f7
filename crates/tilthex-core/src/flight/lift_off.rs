//! The first moments after lift-off, in which wiring, axes and latency show.
//!
//! Nothing can be told of them on the ground: legs bear whatever the rotors do. In the first decimetres a good vehicle
//! stays level over its start; one that does not is stopped while that is gentle.

use super::{Flight, capture::Contradiction};
use crate::{
    so3,
    supervisor::{
        Fault, FaultSet, Phase,
        limits::{LIFT_OFF, LIFT_OFF_ASIDE, LIFT_OFF_TILT, LIFT_OFF_TIME},
    },
    types::Vector3,
};

/// External torques above this part of the weight at the farthest rotor are none of a good vehicle's.
const TORQUE: f64 = 0.08;

/// A vehicle that is faster than this, m/s and rad/s, is not stopped.
const FAST: (f64, f64) = (2.0, 4.0);

/// The first moments.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LiftOff {
    /// Time since the take-off began, s; none where it is over.
    since: Option<f64>,
    /// What has gone wrong.
    pub(super) fault: Option<Fault>,
}

impl LiftOff {
    /// A take-off begins.
    pub(super) fn begin(&mut self) {
        *self = Self { since: Some(0.0), fault: None };
    }
}

impl Flight {
    /// Watches a take-off; what is to be done at once.
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
        for known in [Fault::MotorOrder, Fault::CaptureAxes, Fault::LiftOff] {
            conditions.insert_if(known, self.lift_off.fault == Some(known));
        }
        abort
    }

    /// Looks for a fault; what is to be done at once.
    fn find_lift_off_fault(
        &mut self,
        phase: Phase,
        contradiction: Option<&Contradiction>,
        dt: f64,
    ) -> Option<Fault> {
        let watch = &mut self.lift_off;
        let since = watch.since? + dt;
        watch.since = Some(since).filter(|since| *since < LIFT_OFF_TIME && phase.in_flight());
        let robot = self.robot_state();
        let output = self.output.as_ref()?;
        let felt_height = contradiction.map_or(0.0, |c| (c.reckoned.position_w - c.from_w).z);
        let height = self.bounds.height(&robot.position_w).unwrap_or(0.0).max(felt_height);
        if height > LIFT_OFF {
            self.lift_off.since = None;
            return None;
        }
        let turned = so3::log(&(output.robot_reference.rotation_wr.transpose() * robot.rotation_wr));
        let aside = output.pose.position_error_w.xy().norm() > LIFT_OFF_ASIDE;
        let tilted = turned.norm() > LIFT_OFF_TILT.to_radians();
        let fault = if let Some(contradiction) = contradiction {
            Some(cause_of(contradiction))
        } else if tilted || aside {
            let torque = output.contact(&robot, &self.control.bias_r).torque.norm();
            let wrong = torque > TORQUE * self.controller.weight_at_arm();
            Some(if tilted && wrong { Fault::MotorOrder } else { Fault::LiftOff })
        } else {
            None
        };
        self.lift_off.fault = fault;
        // Where it runs or tumbles already, flying on to a landing is gentler.
        fault.filter(|_| robot.velocity_w.norm() < FAST.0 && robot.angular_velocity_r.norm() < FAST.1)
    }
}

/// Whether it is the axes: where the vehicle feels that it moves one way, and is captured on another.
fn cause_of(contradiction: &Contradiction) -> Fault {
    let felt_w: Vector3 = contradiction.reckoned.position_w - contradiction.from_w;
    let captured_w = contradiction.estimate.position_w - contradiction.from_w;
    let sizes = felt_w.norm() * captured_w.norm();
    let along = felt_w.dot(&captured_w);
    if sizes > 1e-4 && along < 0.8 * sizes { Fault::CaptureAxes } else { Fault::PoseContradicts }
}
