//! The box around the start in which the vehicle stays, and the poses that orders may command.

use super::io::Route;
use crate::{
    types::{Matrix3, Vector3},
    vehicle::Mounting,
};

/// A box around the start, for the robot's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fence {
    /// Half its width along x and y, m.
    pub sideways: f64,
    /// Its height above the start, m.
    pub up: f64,
}

/// Orders keep this distance from the fence, m, or this part of its size if that is less.
const INSIDE: (f64, f64) = (0.1, 0.1);

impl Fence {
    /// The box for the poses that orders may command.
    #[must_use]
    pub fn of_orders(&self) -> Self {
        let (least, part) = INSIDE;
        let within = |size: f64| size - least.min(part * size);
        Self { sideways: within(self.sideways), up: within(self.up) }
    }

    /// Distance of a position from the box, m; negative inside. Both positions in the world.
    #[must_use]
    pub fn beyond(&self, start_w: &Vector3, position_w: &Vector3) -> f64 {
        let way_w = position_w - start_w;
        (way_w.x.abs().max(way_w.y.abs()) - self.sideways).max(way_w.z - self.up)
    }

    /// Whether orders may command a pose of the tool (m and rotation, world): the vehicle is then inside the box.
    #[must_use]
    pub fn holds(
        &self,
        start_w: &Vector3,
        tool: &Mounting,
        position_w: &Vector3,
        rotation_we: &Matrix3,
    ) -> bool {
        self.of_orders().beyond(start_w, &robot_position(tool, position_w, rotation_we)) <= 0.0
    }

    /// The first way-point (from 0) of a route that is outside.
    #[must_use]
    pub fn leaves(&self, start_w: &Vector3, tool: &Mounting, route: &Route) -> Option<usize> {
        let out = |(position_w, rotation_we)| !self.holds(start_w, tool, position_w, rotation_we);
        route.waypoints().iter().map(|point| (&point.position_w, &point.rotation_we)).position(out)
    }
}

/// Position of the robot, m, world, when its tool has a pose.
#[must_use]
pub fn robot_position(tool: &Mounting, position_w: &Vector3, rotation_we: &Matrix3) -> Vector3 {
    position_w - rotation_we * (tool.rotation_r.transpose() * tool.position_r)
}
