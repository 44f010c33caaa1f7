//! Where orders would lead: the geofence.

use tilthex_core::{
    Matrix3, Vector3, Wrench,
    flight::{Command, Fence, robot_position},
    vehicle::Mounting,
};

use super::bounds::numbers;
use crate::Config;

/// Where a flight began, or would begin, and where its tool is; m, world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The robot's origin at the start.
    pub start_w: Vector3,
    /// The tool's reference, position and rotation, in flight.
    pub tool_w: Option<(Vector3, Matrix3)>,
}

/// The condition that the geofence sets for orders.
#[derive(Clone, Debug)]
pub(super) struct Geofence {
    fence: Fence,
    tool: Mounting,
    /// How far a commanded force moves the tool without resistance, m.
    way: f64,
}

impl Geofence {
    /// Of a configuration.
    pub(super) fn of(config: &Config) -> Self {
        let supervisor = config.supervisor();
        Self {
            fence: Fence { sideways: supervisor.geofence, up: supervisor.geofence_height },
            tool: *config.vehicle().vehicle().tool(),
            way: config.controller().free_wrench.way,
        }
    }

    /// Refuses an order that would lead the vehicle out of the geofence.
    pub(super) fn check(&self, command: &Command, place: &Place) -> Result<(), String> {
        match command {
            Command::Play(route) => match self.fence.leaves(&place.start_w, &self.tool, route) {
                Some(first) => {
                    let point = &route.waypoints()[first];
                    let what = format!("play: way-point {}", first + 1);
                    self.check_pose(&what, &point.position_w, &point.rotation_we, place)
                }
                None => Ok(()),
            },
            Command::Follow(s) => {
                self.check_pose("follow: the set-point", &s.position_w, &s.rotation_we, place)
            }
            Command::SetWrench(wrench_w, _) => self.check_wrench(wrench_w, place),
            _ => Ok(()),
        }
    }

    /// Without resistance, a commanded force moves the tool.
    fn check_wrench(&self, wrench_w: &Wrench, place: &Place) -> Result<(), String> {
        let Some(along_w) = wrench_w.force.try_normalize(1e-9) else { return Ok(()) };
        let Some((tool_w, rotation_we)) = &place.tool_w else { return Ok(()) };
        let what = format!("set_wrench: where nothing resists it, the force, after {} m,", self.way);
        self.check_pose(&what, &(tool_w + along_w * self.way), rotation_we, place)
    }

    fn check_pose(
        &self,
        what: &str,
        position_w: &Vector3,
        rotation_we: &Matrix3,
        place: &Place,
    ) -> Result<(), String> {
        if self.fence.holds(&place.start_w, &self.tool, position_w, rotation_we) {
            return Ok(());
        }
        let robot_w = robot_position(&self.tool, position_w, rotation_we);
        let Fence { sideways, up } = self.fence.of_orders();
        Err(format!(
            "{what} puts the vehicle at {} m, outside the geofence; expected within {sideways:.2} m of the start, {} m, along \
             x and y, and {up:.2} m above it at most, by [supervisor] geofence and geofence_height",
            numbers(&robot_w),
            numbers(&place.start_w)
        ))
    }
}
