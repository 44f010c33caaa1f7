//! The vehicle model that the laws use, and its replacement by the one that a calibration has learnt.

use super::{Flight, KnownState, guidance::Guided};
use crate::{
    Vehicle,
    model_learning::{HoverSample, Learnt, ModelDeviation, ModelLearner, ModelPrior, Refusal},
    so3,
    supervisor::Phase,
    types::{RobotState, RotorVector, Setpoint, Vector3, Wrench},
    wrench_observer::{ObserverInput, robot_wrench},
};

/// A set-point that moves less than this in a tick, m and rad, is at rest.
const RESTS: f64 = 1e-7;

/// Learning, and its result.
#[derive(Clone, Copy, Debug)]
pub(super) struct ModelState {
    learner: ModelLearner,
    /// Whether the last tick was one to learn from, and its set-point.
    learning: bool,
    setpoint: Option<Setpoint>,
    pending: Option<Pending>,
    refused: Option<Refusal>,
    deviation: ModelDeviation,
    /// Centre of mass relative to the one of the configuration, m, robot.
    centre_r: Vector3,
    hovers: usize,
    misfit: f64,
}

/// A model that replaces the present one at the begin of the next tick.
#[derive(Clone, Copy, Debug)]
struct Pending {
    learnt: Learnt,
    /// The sample at which it replaces it.
    now: ObserverInput,
    /// Whether a calibration made it.
    calibrated: bool,
}

/// The working model, for the log.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ModelRecord {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass relative to the one of the configuration, m, robot.
    pub centre_of_mass_r: Vector3,
    /// Force of the false contact that is expected in tilted hovers, N, one standard deviation.
    pub false_force: f64,
    /// Torque of that false contact, N m, one standard deviation.
    pub false_torque: f64,
    /// Number of hovers from which it was learnt, those of the mission too; 0 for the configured model.
    pub hovers: u32,
    /// Mean squared normalised innovation of these hovers.
    pub misfit: f64,
}

impl ModelState {
    /// The configured model.
    pub(super) fn new(vehicle: &Vehicle, prior: &ModelPrior) -> Self {
        Self {
            learner: ModelLearner::default(),
            learning: false,
            setpoint: None,
            pending: None,
            refused: None,
            deviation: ModelDeviation::prior(vehicle, prior),
            centre_r: Vector3::zeros(),
            hovers: 0,
            misfit: 0.0,
        }
    }

    /// A known state of the configured centre of mass, moved to the corrected one.
    pub(super) fn at_centre(&self, known: &KnownState) -> KnownState {
        moved(known, &self.centre_r)
    }

    /// Whether the model of a calibration will replace the present one in the next tick.
    pub(super) fn is_calibrated_next(&self) -> bool {
        self.pending.is_some_and(|pending| pending.calibrated)
    }

    /// Whether a calibration was refused.
    pub(super) fn is_refused(&self) -> bool {
        self.refused.is_some()
    }

    fn setpoint_rests(&mut self, setpoint: &Setpoint) -> bool {
        self.setpoint.replace(*setpoint).is_some_and(|last| {
            let turn = last.rotation_we.transpose() * setpoint.rotation_we;
            (last.position_w - setpoint.position_w).norm() < RESTS && so3::log(&turn).norm() < RESTS
        })
    }
}

/// A known state, moved to another centre of mass.
fn moved(known: &KnownState, centre_r: &Vector3) -> KnownState {
    let robot = &known.robot;
    let velocity_r = robot.angular_velocity_r.cross(centre_r);
    KnownState {
        robot: RobotState {
            position_w: robot.position_w + robot.rotation_wr * centre_r,
            velocity_w: robot.velocity_w + robot.rotation_wr * velocity_r,
            ..*robot
        },
        ..*known
    }
}

impl Flight {
    /// The vehicle that the laws use now: the configured one, or the learnt one.
    #[must_use]
    pub fn model(&self) -> &Vehicle {
        &self.params.vehicle
    }

    /// Standard deviations of the remaining errors of the model.
    #[must_use]
    pub fn model_deviation(&self) -> &ModelDeviation {
        &self.model.deviation
    }

    /// Standard deviations of the model's errors before any calibration.
    #[must_use]
    pub fn model_prior(&self) -> &ModelPrior {
        &self.params.model_prior
    }

    /// Why the last calibration was refused.
    #[must_use]
    pub fn model_refused(&self) -> Option<Refusal> {
        self.model.refused
    }

    /// Number of hovers from which the model was learnt; 0 for the configured model.
    #[must_use]
    pub fn model_hovers(&self) -> usize {
        self.model.hovers
    }

    /// Says from now on whether this is a contact-free calibration flight. It overrides the guidance, for a caller
    /// who knows it. At its end the learnt model replaces the present one.
    pub fn set_model_learning(&mut self, learns: bool) {
        self.learns_model = learns;
    }

    /// One tick of learning, or its end.
    pub(super) fn learn_model(&mut self, learns: bool, guided: &Guided, speeds: &RotorVector, dt: f64) {
        if !matches!(self.supervisor.phase(), Phase::Flying | Phase::Holding) {
            self.model.learner.give_up();
            self.model.learning = false;
            return;
        }
        let ended = core::mem::replace(&mut self.model.learning, learns) && !learns;
        if ended {
            self.end_calibration(speeds);
        }
        let slowly = !learns && self.params.slow_learning && self.model.hovers > 0;
        if !learns && !slowly {
            return;
        }
        let still = self.model.setpoint_rests(&guided.setpoint);
        let sample = HoverSample {
            robot: self.robot_state(),
            specific_force_r: self.specific_force_r(),
            rotor_speeds: *speeds,
            external_r: if slowly { self.drag_r() } else { Wrench::ZERO },
        };
        let (vehicle, prior) = (&self.params.vehicle, &self.params.model_prior);
        if learns {
            self.model.learner.observe(vehicle, still, &sample, dt);
            return;
        }
        let still = still && self.may_learn_slowly(guided);
        let learnt = self.model.learner.observe_slowly(vehicle, prior, still, &sample, dt);
        if let Some(learnt) = learnt {
            let now = self.observer_input(speeds);
            self.model.pending = Some(Pending { learnt, now, calibrated: false });
        }
    }

    /// Learns from the hovers of the calibration.
    fn end_calibration(&mut self, speeds: &RotorVector) {
        match self.model.learner.finish(&self.params.vehicle, &self.params.model_prior) {
            Ok(learnt) => {
                let now = self.observer_input(speeds);
                self.model.pending = Some(Pending { learnt, now, calibrated: true });
                self.model.refused = None;
            }
            Err(refusal) => {
                self.model.refused = Some(refusal);
                // The bias of this attitude is better than no bias.
                self.guidance.zero_bias();
            }
        }
    }

    /// Whether a hover of the mission shows errors of the model: nothing is commanded or known to touch the vehicle, what
    /// is measured is sound, and no bias that was learnt in its place explains the errors.
    fn may_learn_slowly(&self, guided: &Guided) -> bool {
        let setpoint = &guided.setpoint;
        let free = setpoint.wrench_w == Wrench::ZERO && !setpoint.force_axes.any();
        let sound = self.supervisor.active().is_empty() && !self.estimator.is_modelled();
        self.supervisor.phase() == Phase::Flying
            && guided.compliant
            && !guided.learn_bias
            && !self.learns
            && free
            && sound
            && self.control.bias_r == Wrench::ZERO
    }

    /// The drag in the estimated wind about the centre of mass, robot.
    fn drag_r(&self) -> Wrench {
        let Some(output) = &self.output else { return Wrench::ZERO };
        let (rotation_wr, tool_r) = (self.robot_state().rotation_wr, self.params.vehicle.tool().position_r);
        let drag = robot_wrench(&output.told.drag_tool_w, &rotation_wr, &tool_r);
        Wrench { force: rotation_wr.transpose() * drag.force, ..drag }
    }

    fn observer_input(&self, speeds: &RotorVector) -> ObserverInput {
        let robot = self.robot_state();
        ObserverInput {
            rotation_wr: robot.rotation_wr,
            angular_velocity_r: robot.angular_velocity_r,
            specific_force_r: self.specific_force_r(),
            rotor_speeds: *speeds,
        }
    }

    /// Replaces the model by the learnt one, between two ticks. The model changes nowhere else.
    pub(super) fn change_model(&mut self) {
        let Some(Pending { learnt, now, calibrated }) = self.model.pending.take() else { return };
        let before = core::mem::replace(&mut self.params.vehicle, learnt.vehicle);
        self.controller = self.controller.for_vehicle(&learnt.vehicle);
        self.control.change_model(&before, &learnt.vehicle, &now);
        if calibrated {
            self.control.forget_errors(&learnt.vehicle, &now);
        }
        self.estimator.move_centre_of_mass(&learnt.centre_r);
        self.known = self.known.map(|known| moved(&known, &learnt.centre_r));
        self.take_state();
        self.model.centre_r += learnt.centre_r;
        self.model.deviation = learnt.deviation;
        self.model.hovers = learnt.hovers;
        self.model.misfit = learnt.misfit;
    }

    /// The working model, for the log.
    pub(super) fn model_record(&self) -> ModelRecord {
        ModelRecord {
            mass: self.params.vehicle.mass(),
            centre_of_mass_r: self.model.centre_r,
            false_force: self.model.deviation.false_force,
            false_torque: self.model.deviation.false_torque,
            hovers: u32::try_from(self.model.hovers).unwrap_or(u32::MAX),
            misfit: self.model.misfit,
        }
    }
}
