//! The orders that a flight gets from its operator or a client.

use super::{Command, Flight, motor_check::MotorCheck};
use crate::supervisor::Phase;

impl Flight {
    /// Drops an order to take off that is not carried out yet: the motors start only after a new one.
    pub fn call_off(&mut self) {
        self.take_off = false;
    }

    /// Whether the flight refused the set-point or the route of the last tick.
    #[must_use]
    pub fn refused_order(&self) -> bool {
        self.setpoint_refused
    }

    /// Carries out an order. A set-point or a route that the flight refuses sets `setpoint_refused`.
    pub(super) fn obey(&mut self, command: Option<&Command>) {
        self.setpoint_refused = false;
        match command {
            None => {}
            Some(Command::TakeOff) => {
                self.take_off = true;
                if self.motor_check.fault().is_some() {
                    self.motor_check = MotorCheck::default();
                }
            }
            Some(Command::ZeroBias) => self.zero_bias(),
            Some(Command::SetWrench(wrench_w, axes)) => self.guidance.set_wrench(Some((*wrench_w, *axes))),
            Some(Command::ReleaseWrench) => self.guidance.set_wrench(None),
            Some(Command::SetAdmittance(filter)) => self.controller.set_admittance(*filter),
            Some(Command::Play(route)) => {
                // Also while it holds: a route ends a hold that began because set-points stopped arriving.
                if matches!(self.supervisor.phase(), Phase::Flying | Phase::Holding) && self.guidance.ready()
                {
                    self.setpoint_refused = !(self.keeps(route) && self.guidance.play(route));
                } else {
                    self.route = Some(*route);
                }
            }
            Some(Command::Follow(setpoint)) => {
                let kept = self.guidance.ready() && self.keeps_setpoint(setpoint);
                self.setpoint_refused = !(kept && self.guidance.follow(setpoint));
            }
        }
    }
}
