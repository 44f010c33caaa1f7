//! The inner loop: geometric pose control on SO(3); (13)-(17).

use crate::{
    Error,
    error::check_range,
    so3,
    types::{Reference, RobotState, Vector3},
};

/// Diagonal gains. The units make each row of the closed loop a second-order
/// system `s^2 + velocity s + position`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseGains {
    /// K_p2, 1/s^2, world axes.
    pub position: Vector3,
    /// K_p1, 1/s, world axes.
    pub velocity: Vector3,
    /// K_R2, 1/s^2, robot axes.
    pub rotation: Vector3,
    /// K_R1, 1/s, robot axes.
    pub angular_velocity: Vector3,
}

/// The pose controller.
///
/// ```
/// use tilthex_core::{Reference, RobotState, Vector3, pose_control::{PoseController, PoseGains}};
///
/// let gains = PoseGains {
///     position: Vector3::repeat(100.0),
///     velocity: Vector3::repeat(20.0),
///     rotation: Vector3::repeat(225.0),
///     angular_velocity: Vector3::repeat(30.0),
/// };
/// let controller = PoseController::new(gains)?;
/// let here = RobotState::at_rest(Vector3::zeros());
/// let there = Reference::hold(Vector3::new(0.1, 0.0, 0.0), here.rotation_wr);
/// // 0.1 m of error, a gain of 100 1/s^2: 10 m/s^2.
/// assert_eq!(controller.step(&here, &there).acceleration_w.x, 10.0);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseController {
    gains: PoseGains,
}

/// The wanted accelerations, and the errors from which they follow.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseCommand {
    /// v_p, m/s^2, world; (14).
    pub acceleration_w: Vector3,
    /// v_w, rad/s^2, robot; (17) with the exact feed-forward.
    pub angular_acceleration_r: Vector3,
    /// e_p = p_r - p, m, world.
    pub position_error_w: Vector3,
    /// v_r - v, m/s, world.
    pub velocity_error_w: Vector3,
    /// e_R, robot; (15).
    pub rotation_error_r: Vector3,
    /// e_w, rad/s, robot; (16).
    pub angular_velocity_error_r: Vector3,
}

impl PoseController {
    /// Checks the gains.
    ///
    /// # Errors
    /// Names the gain that is negative, not finite or above 1e5.
    pub fn new(gains: PoseGains) -> Result<Self, Error> {
        for (name, gain) in [
            ("position_gain", gains.position),
            ("velocity_gain", gains.velocity),
            ("rotation_gain", gains.rotation),
            ("angular_velocity_gain", gains.angular_velocity),
        ] {
            for x in gain.iter() {
                check_range(name, *x, 0.0, 1e5)?;
            }
        }
        Ok(Self { gains })
    }

    /// The gains.
    #[must_use]
    pub fn gains(&self) -> &PoseGains {
        &self.gains
    }

    /// The accelerations that make the pose converge to the reference.
    ///
    /// (17) prints only the reference's angular acceleration; the two terms
    /// here are the exact ones of Lee, Leok and McClamroch (2010).
    #[must_use]
    pub fn step(&self, state: &RobotState, reference: &Reference) -> PoseCommand {
        let mut command = self.translation(state, reference);
        self.rotation(&mut command, state, reference, &Vector3::zeros());
        command
    }

    /// The half of [`Self::step`] that does not depend on attitudes; the other half is zero.
    #[must_use]
    #[inline]
    pub fn translation(&self, state: &RobotState, reference: &Reference) -> PoseCommand {
        let g = &self.gains;
        let position_error_w = reference.position_w - state.position_w;
        let velocity_error_w = reference.velocity_w - state.velocity_w;
        PoseCommand {
            acceleration_w: reference.acceleration_w
                + g.velocity.component_mul(&velocity_error_w)
                + g.position.component_mul(&position_error_w),
            position_error_w,
            velocity_error_w,
            ..PoseCommand::default()
        }
    }

    /// Adds the half that depends on attitudes; `lead_r` is demanded beside the reference's angular acceleration, rad/s^2.
    #[inline(always)]
    pub fn rotation(
        &self,
        command: &mut PoseCommand,
        state: &RobotState,
        reference: &Reference,
        lead_r: &Vector3,
    ) {
        let g = &self.gains;
        // Maps reference body coordinates to body coordinates: R^T R_r.
        let rotation_rd = so3::between(&state.rotation_wr, &reference.rotation_wr);
        let rotation_error_r = so3::vee(&rotation_rd.transpose());
        let reference_velocity_r = rotation_rd * reference.angular_velocity_r;
        let angular_velocity_error_r = state.angular_velocity_r - reference_velocity_r;
        command.angular_acceleration_r = rotation_rd * (reference.angular_acceleration_r + lead_r)
            - state.angular_velocity_r.cross(&reference_velocity_r)
            - g.angular_velocity.component_mul(&angular_velocity_error_r)
            - g.rotation.component_mul(&rotation_error_r);
        command.rotation_error_r = rotation_error_r;
        command.angular_velocity_error_r = angular_velocity_error_r;
    }
}
