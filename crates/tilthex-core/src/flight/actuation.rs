//! From the state to the motor command.

use super::{
    Flight,
    guidance::Descent,
    io::{Measured, MotorCommand},
    late,
};
use crate::{
    bias::BiasEstimator,
    controller::{ControllerInput, ControllerState},
    supervisor::{
        Fault, Phase,
        limits::{LINE_LATE, POSE_LOST, POSE_LOST_LONG, UNSEEN_DESCENT, VELOCITY_DEVIATION},
    },
    types::{RobotState, RotorVector},
};

/// Duration of the ramp from the lowest speeds to just below hover, s.
pub(super) const RAMP: f64 = 3.0;
/// Speeds at the end of the ramp, divided by those in hover. The vehicle still stands.
const RAMP_END: f64 = 0.95;

impl Flight {
    /// The motor command of this phase.
    pub(super) fn control(&mut self, rotor_speeds: &RotorVector, line_delay: f64, dt: f64) {
        let phase = self.supervisor.phase();
        self.not_finite = false;
        match phase {
            Phase::Disarmed => self.command = RotorVector::zeros(),
            Phase::Starting => self.command = self.min_speeds,
            Phase::Grounded => {
                self.ramp += dt;
                let part = (self.ramp / RAMP).min(1.0);
                let hover = self.params.vehicle.hover_speeds(&self.robot_state().rotation_wr);
                let ramped = self.min_speeds + (hover * RAMP_END - self.min_speeds) * part;
                self.accept(&ramped);
            }
            Phase::Flying | Phase::Holding | Phase::Landing | Phase::Emergency => {
                // Without a wait; the supervisor waits whether the delay lasts.
                let is_late = line_delay > LINE_LATE;
                let robot = self.state_at_arrival(if is_late { line_delay } else { 0.0 }, dt);
                let guided = self.guidance.step(phase, self.descent(), &robot, &self.params.vehicle, dt);
                let learns_model = guided.learn_model || self.learns_model;
                self.learn_model(learns_model, &guided, rotor_speeds, dt);
                let compliant =
                    guided.compliant && !self.learns && !learns_model && !self.model.is_calibrated_next();
                let input = ControllerInput {
                    state: robot,
                    specific_force_r: self.specific_force_r(),
                    rotor_speeds: *rotor_speeds,
                    setpoint: guided.setpoint,
                    compliant,
                    unyielding: (!compliant).then_some(self.lift),
                    learn_bias: guided.learn_bias || self.learns,
                    lost_rotors: self.lost | self.thrust.tried(),
                    fixed_attitude: phase == Phase::Emergency,
                };
                let output = if is_late {
                    late::step(&self.controller, line_delay, &mut self.control, &input, dt)
                } else {
                    self.controller.step(&mut self.control, &input, dt)
                };
                if self.accept(&self.rotor_model.made_up(&output.rotor_speeds)) {
                    let (vehicle, external) =
                        (&self.params.vehicle, output.contact(&robot, &self.control.bias_r));
                    self.without_thrust = self.thrust.step(vehicle, rotor_speeds, &external, dt);
                    self.thrust_seen = (self.rotor_model.expected(), external);
                    self.output = Some(output);
                    if guided.learn_bias {
                        self.watch_learning();
                    }
                    // If the attitude is not known, thrust would only drive the vehicle away.
                    if self.attitude_lost() {
                        self.command = self.min_speeds;
                    }
                } else {
                    // A value that is not finite must not stay in the state of the laws.
                    self.not_finite = true;
                    let bias_r = self.control.bias_r;
                    self.control = ControllerState::default();
                    if bias_r.is_finite() {
                        self.control.bias_r = bias_r;
                    }
                }
            }
        }
    }

    /// Pose and twist at the time at which a command of this tick takes effect: over a late line, samples and
    /// commands are both late.
    fn state_at_arrival(&mut self, line_delay: f64, dt: f64) -> RobotState {
        let vehicle = &self.params.vehicle;
        let torque_r = vehicle.body_wrench(&self.rotor_model.expected()).torque;
        self.pending.push(vehicle.inertia_inverse() * (torque_r + self.control.observer.wrench.torque), dt);
        let robot = self.robot_state();
        if line_delay > 0.0 { self.pending.ahead(&robot, 2.0 * line_delay) } else { robot }
    }

    /// Handles an order to learn the bias. It is refused if the tool is in contact or the set-point moves.
    pub(super) fn zero_bias(&mut self) {
        let free = self.output.is_some_and(|o| self.controller.is_small(&o.wrench_tool_w));
        self.bias_refused = !(free && self.guidance.zero_bias());
    }

    /// Ends the learning of the bias if there is contact.
    fn watch_learning(&mut self) {
        if !self.controller.can_be_bias(&self.control.bias_estimator) {
            self.control.bias_estimator = BiasEstimator::default();
            self.guidance.end_learning();
            self.bias_refused = true;
        }
    }

    /// The kind of descent now.
    pub(super) fn descent(&self) -> Descent {
        let health = self.estimator.health();
        // A NaN counts as unknown.
        let known = self.known.is_some() || health.velocity_deviation <= VELOCITY_DEVIATION;
        let forced = self.supervisor.active().contains(Fault::LandingFails);
        match (known && !self.hopeless(), forced, self.adrift) {
            (true, true, _) => Descent::Forced,
            (false, ..) => Descent::Blind,
            (true, false, true) => Descent::Adrift,
            (true, false, false) => {
                let unseen = if self.known.is_some() { 0.0 } else { health.position_age - POSE_LOST_LONG };
                let (rate, most) = UNSEEN_DESCENT;
                Descent::Steady((rate * unseen).max(0.0).min(most))
            }
        }
    }

    /// Whether the attitude cannot be recovered: the vehicle is turned over, or spins beyond the gyro's range,
    /// and nothing measures or holds its attitude.
    fn attitude_lost(&self) -> bool {
        let active = self.supervisor.active();
        let seen = self.estimator.health().pose_age < POSE_LOST;
        let unfelt = active.contains(Fault::ImuSilent) && !seen;
        let powerless = self.adrift || active.contains(Fault::SetpointInfeasible);
        // A tenth of a second decides how far aside the vehicle comes down.
        let turned_over = || self.watch.is_tilted(&self.robot_state().rotation_wr);
        powerless && turned_over()
            || active.contains(Fault::Tilt) && unfelt
            || active.contains(Fault::ImuSaturated) && self.adrift && unfelt
    }

    /// Rotors that the allocator must do without, as soon as the supervisor counts a fault of theirs. The state bits
    /// alone are not sufficient: the line has no checksum, and a motor that turns as it should carries.
    pub(super) fn lose_rotors(&mut self, stopped: u16) {
        let active = self.supervisor.active();
        let counted = [Fault::MotorEmergency, Fault::MotorNotSpinning, Fault::ThrustLost]
            .iter()
            .any(|f| active.contains(*f));
        let in_flight = self.supervisor.phase().in_flight();
        let lost = if counted && in_flight { stopped | self.without_thrust } else { 0 };
        if lost != self.lost {
            self.lost = lost;
            self.adrift = lost != 0 && !self.controller.hovers_without(lost);
        }
    }

    /// Takes a command that is finite, limited to the rotors' limits; otherwise keeps the last one.
    fn accept(&mut self, command: &RotorVector) -> bool {
        // No early end: without one, the processor checks several rotors with one instruction.
        let finite = command.as_slice().iter().fold(true, |all, w| all & w.is_finite());
        if finite {
            let limits = self.min_speeds.as_slice().iter().zip(self.max_speeds.as_slice());
            let wanted = self.command.as_mut_slice().iter_mut().zip(command.as_slice());
            for ((speed, wanted), (least, most)) in wanted.zip(limits) {
                let raised = if wanted < least { *least } else { *wanted };
                *speed = if raised > *most { *most } else { raised };
            }
        }
        finite
    }

    /// Whether each motor has turned alone in this start, if the configuration requires it.
    pub(super) fn check_motors(&mut self, phase: Phase, input: &Measured<'_>, dt: f64) -> bool {
        let (watch, motors) = (&self.params.watch, input.telemetry.motors());
        if phase == Phase::Starting && watch.motor_check {
            self.motor_check.step(motors, input.time, &self.min_speeds, watch.start_timeout, dt);
        }
        !watch.motor_check || self.motor_check.passed(motors.len())
    }

    /// The order to the motors in this phase.
    pub(super) fn motor_command(&self) -> MotorCommand {
        match self.supervisor.phase() {
            Phase::Disarmed if self.supervisor.killed() => MotorCommand::Kill,
            Phase::Disarmed => MotorCommand::Stop,
            Phase::Starting => {
                let motors = self.params.vehicle.rotor_count();
                if self.params.watch.motor_check && !self.motor_check.passed(motors) {
                    self.motor_check.command(&self.min_speeds)
                } else {
                    MotorCommand::Start(self.command)
                }
            }
            Phase::Grounded | Phase::Flying | Phase::Holding | Phase::Landing | Phase::Emergency => {
                if self.supervisor.active().contains(Fault::Reboot) {
                    MotorCommand::Start(self.command)
                } else {
                    MotorCommand::Turn(self.command)
                }
            }
        }
    }
}
