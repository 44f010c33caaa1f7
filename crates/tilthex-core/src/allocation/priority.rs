//! The parts of a wrench, and their default order.

/// A part of the wrench. The allocator meets it or gives it up as a whole.
///
/// Torques are about robot axes. Forces are along world axes for a vehicle that can hover in every attitude, and along robot
/// axes for all other vehicles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Priority {
    /// Torque about x and y, N m: keeps the attitude.
    RollPitchTorque,
    /// Force along z, N: keeps the height.
    VerticalForce,
    /// Torque about z, N m.
    YawTorque,
    /// Force along x and y, N: keeps the horizontal position.
    LateralForce,
}

impl Priority {
    /// The default order: attitude, height, heading, horizontal position.
    pub const ORDER: [Self; 4] =
        [Self::RollPitchTorque, Self::VerticalForce, Self::YawTorque, Self::LateralForce];

    /// Its name in a configuration.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::RollPitchTorque => "roll-pitch-torque",
            Self::VerticalForce => "vertical-force",
            Self::YawTorque => "yaw-torque",
            Self::LateralForce => "lateral-force",
        }
    }

    /// The priority of a [`Self::name`].
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ORDER.into_iter().find(|p| p.name() == name)
    }

    /// Its rows in a wrench `[force; torque]`.
    #[must_use]
    pub fn rows(self) -> &'static [usize] {
        match self {
            Self::RollPitchTorque => &[3, 4],
            Self::VerticalForce => &[2],
            Self::YawTorque => &[5],
            Self::LateralForce => &[0, 1],
        }
    }
}
