//! The text form of orders.

use super::force_axes;
use serde::Deserialize;
use tilthex_core::{
    Matrix3, Wrench,
    flight::Route,
    force_axes::ForceAxes,
    so3,
    trajectory::{Limits, Waypoint},
};

/// Force (N) and torque (N m), world.
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct WrenchText {
    /// N, world.
    #[serde(default)]
    force: [f64; 3],
    /// N m, world.
    #[serde(default)]
    torque: [f64; 3],
    /// Axes along which the wrench is controlled instead of the pose: of x, y, z (force) and rx, ry, rz (torque), those of
    /// the tool.
    #[serde(default)]
    force_axes: Vec<String>,
    /// Row by row; maps coordinates of a surface to world coordinates: then the axes are those of the surface.
    surface: Option<[[f64; 3]; 3]>,
}

impl WrenchText {
    pub(super) fn force_axes(&self) -> Result<ForceAxes, String> {
        force_axes(&self.force_axes, self.surface.as_ref().map(matrix3))
    }

    pub(super) fn wrench(&self) -> Wrench {
        Wrench { force: self.force.into(), torque: self.torque.into() }
    }
}

/// A way-point: a pose of the tool and the wrench that it exerts there. At most one form of orientation may be given;
/// without any, the tool is level.
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct WaypointText {
    /// m, world.
    position: [f64; 3],
    /// Row by row; maps tool coordinates to world coordinates.
    rotation: Option<[[f64; 3]; 3]>,
    /// The rotation as a quaternion, scalar last.
    quaternion_xyzw: Option<[f64; 4]>,
    /// The rotation as angles in degrees: about z, then about the new y, then about the new x.
    yaw_pitch_roll_deg: Option<[f64; 3]>,
    /// N, world.
    #[serde(default)]
    force: [f64; 3],
    /// N m, world.
    #[serde(default)]
    torque: [f64; 3],
    /// Axes along which the wrench is controlled instead of the pose: of x, y, z (force) and rx, ry, rz (torque), those of
    /// the tool.
    #[serde(default)]
    force_axes: Vec<String>,
    /// Row by row; maps coordinates of a surface to world coordinates: then the axes are those of the surface.
    surface: Option<[[f64; 3]; 3]>,
    /// Shortest duration of the motion to this way-point, s.
    #[serde(default)]
    duration: f64,
    /// Time for which the tool stays at this way-point, s.
    #[serde(default)]
    hold: f64,
}

impl WaypointText {
    pub(super) fn rotation(&self) -> Result<Matrix3, String> {
        match (self.rotation, self.quaternion_xyzw, self.yaw_pitch_roll_deg) {
            (None, None, None) => Ok(Matrix3::identity()),
            (Some(rows), None, None) => Ok(matrix3(&rows)),
            (None, Some(q), None) => so3::from_quaternion_xyzw(q).ok_or_else(|| {
                format!("quaternion_xyzw {q:?} has no direction; expected four finite numbers")
            }),
            (None, None, Some(angles)) => {
                let [yaw, pitch, roll] = angles.map(f64::to_radians);
                Ok(so3::rot_z(yaw) * so3::rot_y(pitch) * so3::rot_x(roll))
            }
            _ => Err("a way-point has several orientations; expected one of rotation, quaternion_xyzw, \
                      yaw_pitch_roll_deg"
                .into()),
        }
    }

    pub(super) fn waypoint(&self) -> Result<Waypoint, String> {
        Ok(Waypoint {
            position_w: self.position.into(),
            rotation_we: self.rotation()?,
            wrench_w: Wrench { force: self.force.into(), torque: self.torque.into() },
            force_axes: force_axes(&self.force_axes, self.surface.as_ref().map(matrix3))?,
            duration: self.duration,
            hold: self.hold,
        })
    }
}

/// Largest rates of a motion. A rate that is not given has its configured limit.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct LimitsText {
    /// m/s.
    velocity: Option<f64>,
    /// m/s^2.
    acceleration: Option<f64>,
    /// rad/s.
    angular_velocity: Option<f64>,
    /// rad/s^2.
    angular_acceleration: Option<f64>,
}

impl LimitsText {
    pub(super) fn over(&self, base: &Limits) -> Limits {
        Limits {
            velocity: self.velocity.unwrap_or(base.velocity),
            acceleration: self.acceleration.unwrap_or(base.acceleration),
            angular_velocity: self.angular_velocity.unwrap_or(base.angular_velocity),
            angular_acceleration: self.angular_acceleration.unwrap_or(base.angular_acceleration),
        }
    }
}

/// A route of the tool.
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct RouteText {
    #[serde(default)]
    limits: LimitsText,
    /// The way-points in their order. The route begins at the tool's present set-point.
    #[serde(default)]
    waypoint: Vec<WaypointText>,
}

impl RouteText {
    pub(super) fn route(&self, base: &Limits) -> Result<Route, String> {
        let points: Result<Vec<_>, _> = self.waypoint.iter().map(WaypointText::waypoint).collect();
        Route::new(&points?, &self.limits.over(base)).map_err(|e| e.to_string())
    }
}

/// One set-point of a stream. The next one must arrive within 0.2 s.
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct FollowText {
    /// m, world.
    pub(super) position: [f64; 3],
    /// Row by row; maps tool coordinates to world coordinates.
    pub(super) rotation: [[f64; 3]; 3],
    /// m/s, world.
    #[serde(default)]
    pub(super) velocity: [f64; 3],
    /// rad/s, world.
    #[serde(default)]
    pub(super) angular_velocity: [f64; 3],
    /// m/s^2, world.
    #[serde(default)]
    pub(super) acceleration: [f64; 3],
    /// rad/s^2, world.
    #[serde(default)]
    pub(super) angular_acceleration: [f64; 3],
    /// The wrench that the tool must exert.
    #[serde(default)]
    pub(super) wrench: WrenchText,
}

/// A command without arguments.
#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct Nothing {}

pub(super) fn matrix3(rows: &[[f64; 3]; 3]) -> Matrix3 {
    Matrix3::from_fn(|i, j| rows[i][j])
}
