//! Faults of captured poses.

use tilthex_core::{Matrix3, Vector3, random::Random, so3, types::PoseSample};

use super::{Injection, acts::Memory};

/// Noise on a frozen pose, m.
const FROZEN_NOISE: f64 = 0.5e-3;

/// The pose is lost.
pub(super) fn lose(_: &Injection, _: PoseSample, _: &mut Memory, _: &mut Random) -> Option<PoseSample> {
    None
}

/// Some poses are rotated by 180 deg.
pub(super) fn flip(
    fault: &Injection,
    mut pose: PoseSample,
    _: &mut Memory,
    random: &mut Random,
) -> Option<PoseSample> {
    if random.uniform() < fault.between(0.2, 1.0) {
        pose.rotation_wr *= so3::exp(&(core::f64::consts::PI * fault.direction()));
    }
    Some(pose)
}

/// The pose is displaced.
pub(super) fn jump(
    fault: &Injection,
    mut pose: PoseSample,
    _: &mut Memory,
    _: &mut Random,
) -> Option<PoseSample> {
    pose.position_w += fault.direction() * fault.between(0.05, 2.0);
    Some(pose)
}

/// The capture time is that of another clock.
pub(super) fn shift_clock(
    fault: &Injection,
    mut pose: PoseSample,
    _: &mut Memory,
    _: &mut Random,
) -> Option<PoseSample> {
    pose.time += fault.sign() * fault.strength;
    Some(pose)
}

/// The first pose is sent again and again.
pub(super) fn freeze(
    _: &Injection,
    pose: PoseSample,
    memory: &mut Memory,
    _: &mut Random,
) -> Option<PoseSample> {
    let first = memory.pose.get_or_insert(pose);
    Some(PoseSample { time: pose.time, arrival: pose.arrival, ..*first })
}

/// The first pose is sent again and again, with a little noise.
pub(super) fn freeze_with_noise(
    fault: &Injection,
    pose: PoseSample,
    memory: &mut Memory,
    random: &mut Random,
) -> Option<PoseSample> {
    let mut pose = freeze(fault, pose, memory, random)?;
    pose.position_w += random.normal3(FROZEN_NOISE);
    Some(pose)
}

/// Some capture systems send this pose for a body that they do not see.
pub(super) fn default_pose(
    _: &Injection,
    pose: PoseSample,
    _: &mut Memory,
    _: &mut Random,
) -> Option<PoseSample> {
    Some(PoseSample { position_w: Vector3::zeros(), rotation_wr: Matrix3::identity(), ..pose })
}

/// The pose of another body, which moves at 0.3 m/s from a place beside the vehicle.
pub(super) fn other_body(
    fault: &Injection,
    pose: PoseSample,
    memory: &mut Memory,
    _: &mut Random,
) -> Option<PoseSample> {
    let first = memory.pose.get_or_insert(pose);
    let angle = pose.time - first.time;
    let way = Vector3::new(0.3 * angle.sin(), 0.3 * (1.0 - angle.cos()), 0.0);
    Some(PoseSample {
        position_w: first.position_w + fault.direction() * fault.between(0.3, 2.0) + way,
        rotation_wr: so3::rot_z(fault.strength + 0.2 * angle),
        ..pose
    })
}

/// The pose arrives late, and its time is that of its arrival.
pub(super) fn stamp_on_arrival(
    fault: &Injection,
    mut pose: PoseSample,
    _: &mut Memory,
    _: &mut Random,
) -> Option<PoseSample> {
    let late = fault.between(0.01, 0.25);
    pose.time += late;
    pose.arrival += late;
    Some(pose)
}

/// The body was defined with a rotation about its vertical.
pub(super) fn yaw(
    fault: &Injection,
    mut pose: PoseSample,
    _: &mut Memory,
    _: &mut Random,
) -> Option<PoseSample> {
    pose.rotation_wr *= so3::rot_z(fault.sign() * fault.between(20.0, 180.0).to_radians());
    Some(pose)
}

/// The body was defined with a tilt.
pub(super) fn tilt(
    fault: &Injection,
    mut pose: PoseSample,
    _: &mut Memory,
    _: &mut Random,
) -> Option<PoseSample> {
    let about = so3::rot_z(core::f64::consts::FRAC_PI_3 * fault.index as f64) * Vector3::x();
    pose.rotation_wr *= so3::exp(&(about * fault.between(1.0, 20.0).to_radians()));
    Some(pose)
}

/// The y axis of the capture system is vertical, and the body was defined at the identity.
pub(super) fn y_up(
    _: &Injection,
    mut pose: PoseSample,
    _: &mut Memory,
    _: &mut Random,
) -> Option<PoseSample> {
    let to_capture = so3::rot_x(-core::f64::consts::FRAC_PI_2);
    pose.position_w = to_capture * pose.position_w;
    pose.rotation_wr = to_capture * pose.rotation_wr * to_capture.transpose();
    Some(pose)
}
