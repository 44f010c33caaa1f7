//! The geofence: refuses orders that would lead the vehicle out of it.

use tilthex_core::{
    Matrix3, Vector3, Wrench,
    flight::{Command, Fence, robot_position},
    vehicle::Mounting,
};

use crate::Config;

/// The places from which an order is judged, m, world: the start of the flight (or of the next one), and the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The robot's origin at the start.
    pub start_w: Vector3,
    /// Position and rotation of the tool's reference; `None` on the ground.
    pub tool_w: Option<(Vector3, Matrix3)>,
}

/// Tests orders against the geofence.
#[derive(Clone, Debug)]
pub(super) struct Geofence {
    fence: Fence,
    tool: Mounting,
    /// Largest distance by which a commanded force moves the tool if nothing resists it, m.
    way: f64,
}

impl Geofence {
    /// The geofence of a configuration.
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

    /// Refuses a wrench that, if nothing resists the tool, would move it out of the geofence.
    fn check_wrench(&self, wrench_w: &Wrench, place: &Place) -> Result<(), String> {
        let Some(along_w) = wrench_w.force.try_normalize(1e-9) else { return Ok(()) };
        let Some((tool_w, rotation_we)) = &place.tool_w else { return Ok(()) };
        let what = format!("set_wrench: if nothing resists it, the force, after {} m,", self.way);
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
            "{what} puts the vehicle at {} m, outside the geofence; expected at most {sideways:.2} m from the start, {} m, \
             along x and y, and at most {up:.2} m above it, the limits of [supervisor] geofence and geofence_height",
            numbers(&robot_w),
            numbers(&place.start_w)
        ))
    }
}

fn numbers(vector: &Vector3) -> String {
    format!("[{:.2}, {:.2}, {:.2}]", vector.x, vector.y, vector.z)
}
