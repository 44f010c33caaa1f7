//! Orders to a vehicle that flies itself.

use super::body::{FAR, Reader, Writer};
use crate::tk3::Refusal;
use tilthex_core::{Matrix3, Vector3, Vector6, trajectory::Limits};

/// Largest mass, damping or stiffness in a message.
const STIFFEST: f64 = 1e6;
/// Longest duration of a motion, s.
const LONGEST: f64 = 3600.0;

/// A place of the tool to fly to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GoTo {
    /// Position of the tool tip, m, world.
    pub position_w: Vector3,
    /// Rotation of the tool: maps its coordinates to world coordinates.
    pub rotation_we: Matrix3,
    /// Shortest duration of the motion, s.
    pub duration: f64,
    /// Its largest rates.
    pub limits: Limits,
}

/// A part of the admittance filter that can be changed in flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The diagonal of its mass, kg and kg m^2.
    Mass,
    /// Of its damping, N s/m and N m s/rad.
    Damping,
    /// Of its stiffness, N/m and N m/rad.
    Stiffness,
}

/// An order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// Start the motors and take off.
    TakeOff,
    /// Land.
    Land,
    /// Stop the motors at once.
    Kill,
    /// Stop the present motion and hold the present set-point.
    Hold,
    /// Fly to a place and hold there.
    GoTo(GoTo),
    /// Learn the observer's bias from a contact-free hover.
    ZeroBias,
    /// Use another diagonal, translation first, in the axes of the filter.
    Admittance(Part, Vector6),
}

impl Order {
    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::TakeOff => "take off",
            Self::Land => "land",
            Self::Kill => "kill",
            Self::Hold => "hold",
            Self::GoTo(_) => "go to a place",
            Self::ZeroBias => "learn the bias",
            Self::Admittance(Part::Mass, _) => "change the mass of the admittance",
            Self::Admittance(Part::Damping, _) => "change the damping of the admittance",
            Self::Admittance(Part::Stiffness, _) => "change the stiffness of the admittance",
        }
    }

    /// Whether it is carried out whenever it arrives: it is not numbered, and not answered.
    #[must_use]
    pub fn is_urgent(&self) -> bool {
        matches!(self, Self::Land | Self::Kill)
    }

    /// Whether the one who gives it must keep sending heartbeats.
    #[must_use]
    pub fn moves(&self) -> bool {
        matches!(self, Self::TakeOff | Self::Hold | Self::GoTo(_))
    }

    pub(super) fn write(&self, to: Writer) -> Writer {
        match self {
            Self::TakeOff => to.bytes(&[1]),
            Self::Land => to.bytes(&[2]),
            Self::Kill => to.bytes(&[3]),
            Self::Hold => to.bytes(&[4]),
            Self::GoTo(go) => {
                let l = &go.limits;
                to.bytes(&[5]).floats(&go.position_w).rotation(&go.rotation_we).floats(&[
                    go.duration,
                    l.velocity,
                    l.acceleration,
                    l.angular_velocity,
                    l.angular_acceleration,
                ])
            }
            Self::ZeroBias => to.bytes(&[6]),
            Self::Admittance(Part::Mass, diagonal) => to.bytes(&[7]).floats(diagonal),
            Self::Admittance(Part::Damping, diagonal) => to.bytes(&[8]).floats(diagonal),
            Self::Admittance(Part::Stiffness, diagonal) => to.bytes(&[9]).floats(diagonal),
        }
    }

    pub(super) fn read(from: &mut Reader<'_>) -> Result<Self, Refusal> {
        let kind = from.u8()?;
        Ok(match kind {
            1 => Self::TakeOff,
            2 => Self::Land,
            3 => Self::Kill,
            4 => Self::Hold,
            5 => Self::GoTo(GoTo {
                position_w: from.vector(FAR)?,
                rotation_we: from.rotation()?,
                duration: from.float(0.0, LONGEST)?,
                limits: Limits {
                    velocity: from.float(1e-3, 100.0)?,
                    acceleration: from.float(1e-3, 1e3)?,
                    angular_velocity: from.float(1e-3, 100.0)?,
                    angular_acceleration: from.float(1e-3, 1e4)?,
                },
            }),
            6 => Self::ZeroBias,
            7 => Self::Admittance(Part::Mass, from.six(0.0, STIFFEST)?),
            8 => Self::Admittance(Part::Damping, from.six(0.0, STIFFEST)?),
            9 => Self::Admittance(Part::Stiffness, from.six(0.0, STIFFEST)?),
            _ => return Err(from.out_of_range()),
        })
    }
}

/// The answer to the newest numbered order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Answer {
    /// There was no order.
    #[default]
    Nothing,
    /// The order with this number is carried out.
    Accepted(u8),
    /// The order with this number was refused; a text says why.
    Refused(u8),
}

impl Answer {
    /// The number of the order; 0 if there was none.
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::Nothing => 0,
            Self::Accepted(number) | Self::Refused(number) => number,
        }
    }

    pub(super) fn to_bytes(self) -> [u8; 2] {
        let kind = match self {
            Self::Nothing => 0,
            Self::Accepted(_) => 1,
            Self::Refused(_) => 2,
        };
        [self.number(), kind]
    }

    pub(super) fn from_bytes([number, kind]: [u8; 2]) -> Option<Self> {
        match kind {
            0 if number == 0 => Some(Self::Nothing),
            1 => Some(Self::Accepted(number)),
            2 => Some(Self::Refused(number)),
            _ => None,
        }
    }
}
