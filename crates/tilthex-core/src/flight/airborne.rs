//! A flight that begins in the air, as simulations do.

use super::Flight;
use crate::{
    Error,
    supervisor::Supervisor,
    trajectory::Trajectory,
    types::{Matrix3, Vector3},
};

/// How a flight begins in the air, at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AirborneStart {
    /// A time before the first tick, s.
    pub time: f64,
    /// Position of the captured body, m, world.
    pub position_w: Vector3,
    /// Rotation of the captured body: maps its coordinates to the world's.
    pub rotation_wc: Matrix3,
    /// Set-point of the tool from the first tick on; `None` holds the tool at its pose.
    pub trajectory: Option<Trajectory>,
}

impl Flight {
    /// Begins in the air instead of on the ground: without take-off and without the hover that learns the bias.
    ///
    /// # Errors
    /// A pose that the estimator refuses.
    pub fn begin_in_air(&mut self, start: &AirborneStart) -> Result<(), Error> {
        self.estimator.initialize(start.time, &start.position_w, &start.rotation_wc)?;
        self.take_state();
        self.time = Some(start.time);
        self.command = self.params.vehicle.hover_speeds(&self.robot_state().rotation_wr);
        self.rotor_model.begin_at(&self.command);
        self.supervisor = Supervisor::in_flight();
        self.bounds.begin(&start.position_w, false);
        self.take_off = true;
        let here = self.actual_tool();
        let hold = || Trajectory::hold(here.position_w, here.rotation_we);
        self.guidance.begin_in_air(&start.trajectory.unwrap_or_else(hold));
        Ok(())
    }

    /// Says from now on whether this is a contact-free hover to learn the bias from. It overrides the guidance, for a
    /// caller who knows it.
    pub fn set_learning(&mut self, learns: bool) {
        self.learns = learns;
    }
}
