//! The vehicle model that the laws use, and its replacement by the one that a calibration has learnt.

use super::{Flight, KnownState};
use crate::{
    Vehicle,
    model_learning::{HoverSample, Learnt, ModelDeviation, ModelLearner, ModelPrior, Refusal},
    so3,
    supervisor::Phase,
    types::{RobotState, RotorVector, Setpoint, Vector3},
    wrench_observer::ObserverInput,
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
    /// The learnt model, and the sample at which it replaces the present one, at the begin of the next tick.
    pending: Option<(Learnt, ObserverInput)>,
    refused: Option<Refusal>,
    deviation: ModelDeviation,
    /// Centre of mass relative to the one of the configuration, m, robot.
    centre_r: Vector3,
    hovers: usize,
    misfit: f64,
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
    /// Number of hovers from which it was learnt; 0 for the configured model.
    pub hovers: u8,
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
        let robot = &known.robot;
        let velocity_r = robot.angular_velocity_r.cross(&self.centre_r);
        KnownState {
            robot: RobotState {
                position_w: robot.position_w + robot.rotation_wr * self.centre_r,
                velocity_w: robot.velocity_w + robot.rotation_wr * velocity_r,
                ..*robot
            },
            ..*known
        }
    }

    /// Whether another model will replace the present one in the next tick.
    pub(super) fn is_pending(&self) -> bool {
        self.pending.is_some()
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
    pub(super) fn learn_model(&mut self, learns: bool, setpoint: &Setpoint, speeds: &RotorVector, dt: f64) {
        if !matches!(self.supervisor.phase(), Phase::Flying | Phase::Holding) {
            (self.model.learner, self.model.learning) = (ModelLearner::default(), false);
            return;
        }
        let ended = core::mem::replace(&mut self.model.learning, learns) && !learns;
        if !learns && !ended {
            return;
        }
        let vehicle = self.params.vehicle;
        let robot = self.robot_state();
        let specific_force_r = self.specific_force_r();
        if learns {
            let still = self.model.setpoint_rests(setpoint);
            let sample = HoverSample { robot, specific_force_r, rotor_speeds: *speeds };
            self.model.learner.observe(&vehicle, still, &sample, dt);
            return;
        }
        self.model.setpoint = None;
        match self.model.learner.finish(&vehicle, &self.params.model_prior) {
            Ok(learnt) => {
                let now = ObserverInput {
                    rotation_wr: robot.rotation_wr,
                    angular_velocity_r: robot.angular_velocity_r,
                    specific_force_r,
                    rotor_speeds: *speeds,
                };
                self.model.pending = Some((learnt, now));
                self.model.refused = None;
            }
            Err(refusal) => {
                self.model.refused = Some(refusal);
                // The bias of this attitude is better than no bias.
                self.guidance.zero_bias();
            }
        }
    }

    /// Replaces the model by the learnt one, between two ticks. The model changes nowhere else.
    pub(super) fn change_model(&mut self) {
        let Some((learnt, now)) = self.model.pending.take() else { return };
        let before = core::mem::replace(&mut self.params.vehicle, learnt.vehicle);
        self.controller = self.controller.for_vehicle(&learnt.vehicle);
        self.control.change_model(&before, &learnt.vehicle, &now);
        self.estimator.move_centre_of_mass(&learnt.centre_r);
        let moved = ModelState { centre_r: learnt.centre_r, ..self.model };
        self.known = self.known.map(|known| moved.at_centre(&known));
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
            hovers: self.model.hovers.min(255) as u8,
            misfit: self.model.misfit,
        }
    }
}
