//! The story of one flight: its changes of phase and its faults.

use std::fmt::Write as _;

use tilthex_core::{
    so3,
    supervisor::{FaultSet, Phase},
};

use super::World;

/// Time between two lines if nothing changes, s.
const EVERY: f64 = 0.25;

/// A line for every change of the phase or the faults, and one every [`EVERY`].
#[derive(Debug, Default)]
pub(super) struct Story {
    text: String,
    phase: Phase,
    faults: FaultSet,
    next: f64,
}

impl Story {
    pub(super) fn see(&mut self, world: &World) {
        let record = world.record();
        let changed = record.phase != self.phase || record.faults != self.faults;
        if !changed && world.now() < self.next {
            return;
        }
        (self.phase, self.faults, self.next) = (record.phase, record.faults, world.now() + EVERY);
        let truth = world.simulation.truth().robot;
        let off = (record.state.position_w - truth.position_w).norm();
        let turned = so3::angle(&(record.state.rotation_wr.transpose() * truth.rotation_wr)).to_degrees();
        let [x, y, z] = truth.position_w.into();
        let faults: Vec<_> = record.faults.rows().map(|row| row.name).collect();
        let _ = writeln!(
            self.text,
            "{:7.3} s  {:9}  at ({x:5.2} {y:5.2} {z:5.2}) m, {:5.2} m/s, tilted {:5.1} deg, turning {:5.1} rad/s; \
             estimate off by {off:.3} m, {turned:.1} deg  {}",
            world.now(),
            record.phase.name(),
            truth.velocity_w.norm(),
            so3::tilt(&truth.rotation_wr).to_degrees(),
            truth.angular_velocity_r.norm(),
            faults.join(", ")
        );
    }

    pub(super) fn text(self) -> String {
        self.text
    }
}
