//! The rod of the tool, which bends.

use crate::{
    so3,
    types::{Matrix3, Vector3},
    vehicle::Mounting,
};

/// A rod along the tool's z axis, clamped at its upper end.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rod {
    /// Lateral force at the tip divided by its lateral displacement, N/m; 0 for a rigid rod.
    ///
    /// `3 E I / L^3` for a cantilever (Timoshenko, Strength of Materials, part I, ch. 5): a 6 mm rod of
    /// 0.4 m in carbon fibre (E = 130 GPa) has 390 N/m, in steel 600 N/m.
    pub stiffness: f64,
    /// Length from the clamp to the tip, m.
    pub length: f64,
}

impl Rod {
    /// Whether no force bends it.
    #[must_use]
    pub fn is_rigid(&self) -> bool {
        self.stiffness <= 0.0
    }

    /// The mounting of the tool when a force at its tip, N, tool coordinates, bends the rod.
    ///
    /// The rod has no mass and no damping: it follows the force at once. The tip rotates by `3/2` of the displacement
    /// divided by the length.
    #[must_use]
    pub fn bent(&self, tool: &Mounting, force_e: &Vector3) -> Mounting {
        if self.is_rigid() {
            return *tool;
        }
        let moved = Vector3::new(force_e.x, force_e.y, 0.0) / self.stiffness;
        let slope = 1.5 * moved / self.length;
        let turn: Matrix3 = so3::exp(&Vector3::new(slope.y, -slope.x, 0.0));
        Mounting { position_r: tool.position_r + tool.rotation_r * moved, rotation_r: tool.rotation_r * turn }
    }
}
