//! A hint when the configured vertical axis can not be right.

use tilthex_core::{Matrix3, Vector3, mocap::UpAxis};

/// Measured and captured verticals that differ by more, rad, do not agree.
const LIMIT: f64 = 0.2;

/// Compares the vertical that an accelerometer at rest measures with the
/// captured one. One sentence when they disagree, with the axis to configure
/// where the other one would agree. A body that was never turned about the
/// vertical agrees with both.
///
/// `rotation_wr` is a pose of a still vehicle, captured with `axis` up;
/// `specific_force_r` (m/s^2) was measured meanwhile, in robot coordinates.
#[must_use]
pub fn axis_hint(axis: UpAxis, rotation_wr: &Matrix3, specific_force_r: &Vector3) -> Option<String> {
    let tilt = |rotation: &Matrix3| (rotation * specific_force_r).angle(&Vector3::z());
    let found = tilt(rotation_wr);
    if found <= LIMIT {
        return None;
    }
    let other = match axis {
        UpAxis::Y => UpAxis::Z,
        UpAxis::Z => UpAxis::Y,
    };
    let (position, quaternion) = axis.from_world(&Vector3::zeros(), rotation_wr);
    let (_, turned) = other.to_world(position, quaternion)?;
    let name = |axis| match axis {
        UpAxis::Y => "y",
        UpAxis::Z => "z",
    };
    let advice = if tilt(&turned) < LIMIT {
        format!("with {} up it would agree: set the capture's up axis to \"{}\"", name(other), name(other))
    } else {
        "check the capture's up axis and how the body was defined in it".into()
    };
    Some(format!(
        "the captured vertical is {:.0} deg away from the measured one with {} up; {advice}",
        found.to_degrees(),
        name(axis)
    ))
}
