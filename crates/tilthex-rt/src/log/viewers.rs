//! Lines and frames for log viewers.

use tilthex_core::{Matrix3, RobotState, Vector3, so3};
use tilthex_link::Severity;

use super::messages::foxglove;

fn timestamp(ns: u64) -> Option<prost_types::Timestamp> {
    Some(prost_types::Timestamp { seconds: (ns / 1_000_000_000) as i64, nanos: (ns % 1_000_000_000) as i32 })
}

/// A line for log viewers.
pub(super) fn line(ns: u64, level: foxglove::log::Level, name: &str, message: String) -> foxglove::Log {
    foxglove::Log {
        timestamp: timestamp(ns),
        level: level.into(),
        message,
        name: name.into(),
        ..foxglove::Log::default()
    }
}

/// The level of a text from the vehicle.
pub(super) fn level(severity: Severity) -> foxglove::log::Level {
    match severity {
        Severity::Note => foxglove::log::Level::Info,
        Severity::Warning => foxglove::log::Level::Warning,
        Severity::Error => foxglove::log::Level::Error,
    }
}

/// The pose of a frame in the world, for 3D viewers.
pub(super) fn transform(
    ns: u64,
    child: &str,
    position_w: &Vector3,
    rotation: &Matrix3,
) -> foxglove::FrameTransform {
    let [x, y, z, w] = so3::to_quaternion_xyzw(rotation);
    foxglove::FrameTransform {
        timestamp: timestamp(ns),
        parent_frame_id: "world".into(),
        child_frame_id: child.into(),
        translation: Some(foxglove::Vector3 { x: position_w.x, y: position_w.y, z: position_w.z }),
        rotation: Some(foxglove::Quaternion { x, y, z, w }),
    }
}

/// The robot's pose.
pub(super) fn robot_transform(ns: u64, state: &RobotState) -> foxglove::FrameTransform {
    transform(ns, "robot", &state.position_w, &state.rotation_wr)
}
