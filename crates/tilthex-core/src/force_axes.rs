//! Hybrid force and pose control: along chosen axes the tool's force is controlled, along the others its pose.
//!
//! Raibert and Craig 1981 select the axes of a task frame. Here the task frame is that of the tool, or of a surface.
//! Along a chosen axis neither position nor motion of the set-point acts on the reference, and the dead zone does not
//! act: the filter moves the reference until the observed wrench and the commanded one balance, `M a_ref + D v_ref =
//! h_hat + h_user`.

use crate::{
    Error,
    filters::dead_zone,
    so3,
    types::{Matrix3, Vector3, Wrench},
};

/// The axes along which a set-point's wrench is controlled instead of its pose.
///
/// ```
/// use tilthex_core::{Matrix3, Vector3, force_axes::ForceAxes, so3};
///
/// // Press along the tool's z axis, here tilted by 30 degrees.
/// let axes = ForceAxes { force: [false, false, true], ..ForceAxes::NONE };
/// let [along, about] = axes.at(&so3::rot_x(0.5)).projections;
/// assert!((along * so3::rot_x(0.5) * Vector3::z() - so3::rot_x(0.5) * Vector3::z()).norm() < 1e-15);
/// assert_eq!(about, Matrix3::zeros());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceAxes {
    /// The axes along which the force is controlled.
    pub force: [bool; 3],
    /// The axes about which the torque is controlled.
    pub torque: [bool; 3],
    /// Maps coordinates of the surface, whose axes these are, to world coordinates. `None` for the tool's axes.
    pub surface_ws: Option<Matrix3>,
}

impl ForceAxes {
    /// The pose is controlled along all axes.
    pub const NONE: Self = Self { force: [false; 3], torque: [false; 3], surface_ws: None };
    /// Names of the axes: forces along x, y, z, then torques about them.
    pub const NAMES: [&'static str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

    /// Whether any axis is chosen.
    #[must_use]
    #[inline]
    pub fn any(&self) -> bool {
        self.force != [false; 3] || self.torque != [false; 3]
    }

    /// Chooses the axis of a name of [`NAMES`](Self::NAMES); returns false if there is no such axis.
    pub fn choose(&mut self, name: &str) -> bool {
        let chosen =
            Self::NAMES.iter().zip(self.force.iter_mut().chain(&mut self.torque)).find(|(n, _)| **n == name);
        chosen.map(|(_, axis)| *axis = true).is_some()
    }

    /// The names of the chosen axes.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        let chosen = self.force.into_iter().chain(self.torque);
        Self::NAMES.into_iter().zip(chosen).filter_map(|(name, chosen)| chosen.then_some(name))
    }

    /// # Errors
    /// If the surface's axes are not a rotation.
    pub fn check(&self) -> Result<(), Error> {
        self.surface_ws.map_or(Ok(()), |surface_ws| so3::check_rotation("surface", &surface_ws))
    }

    /// The chosen axes in world coordinates, for a tool with the orientation `rotation_we`.
    #[must_use]
    pub fn at(&self, rotation_we: &Matrix3) -> Forced {
        if !self.any() {
            return Forced::NONE;
        }
        let axes = self.surface_ws.as_ref().unwrap_or(rotation_we);
        let on = |chosen: [bool; 3]| {
            let diagonal = Vector3::from(chosen.map(f64::from));
            axes * Matrix3::from_diagonal(&diagonal) * axes.transpose()
        };
        Forced { any: true, projections: [on(self.force), on(self.torque)] }
    }
}

/// The tool is in contact if at least this part of the commanded force or torque is felt against it.
const RESISTS: f64 = 0.3;

/// Whether something resists a commanded force or torque.
pub(crate) fn resists(felt: &Vector3, commanded: &Vector3) -> bool {
    felt.dot(commanded) < -RESISTS * commanded.norm_squared()
}

/// The projection onto no axis.
const NO_AXES: Matrix3 = Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);

/// The chosen axes in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forced {
    any: bool,
    /// Projections onto the axes of force and of torque, world.
    pub projections: [Matrix3; 2],
}

impl Forced {
    /// No axis.
    pub(crate) const NONE: Self = Self { any: false, projections: [NO_AXES; 2] };

    /// Whether any axis is chosen.
    #[must_use]
    pub fn any(&self) -> bool {
        self.any
    }

    /// A felt wrench after the dead zones, N and N m. They do not act along the chosen axes while something resists the
    /// commanded wrench there.
    #[must_use]
    #[inline(always)]
    pub fn beyond(&self, felt_w: &Wrench, commanded_w: &Wrench, dead_zones: (f64, f64)) -> Wrench {
        let part = |felt: &Vector3, commanded: &Vector3, along: &Matrix3, zone: f64| {
            let forced = along * felt;
            if self.any && resists(&forced, &(along * commanded)) {
                dead_zone(&(felt - forced), zone) + forced
            } else {
                dead_zone(felt, zone)
            }
        };
        let [force, torque] = &self.projections;
        Wrench {
            force: part(&felt_w.force, &commanded_w.force, force, dead_zones.0),
            torque: part(&felt_w.torque, &commanded_w.torque, torque, dead_zones.1),
        }
    }

    /// The part of a wrench, or of a twist in its place, along the chosen axes.
    #[must_use]
    pub fn along(&self, wrench_w: &Wrench) -> Wrench {
        let [force, torque] = &self.projections;
        Wrench { force: force * wrench_w.force, torque: torque * wrench_w.torque }
    }
}
