//! The axes of a capture system.

use proptest::prelude::*;
use tilthex_core::{Vector3, so3};
use tilthex_mocap::UpAxis;

#[test]
fn up_is_up() {
    let level = [0.0, 0.0, 0.0, 1.0];
    for (axis, up) in [(UpAxis::Y, [0.0, 1.0, 0.0]), (UpAxis::Z, [0.0, 0.0, 1.0])] {
        let (position, rotation) = axis.to_world(up, level).expect("a unit quaternion");
        assert_eq!(position, Vector3::z());
        assert_eq!(rotation, nalgebra::Matrix3::identity());
        // A turn about the vertical is a turn about the world's z.
        let [x, y, z] = up.map(|x| x * 0.5_f64.sin());
        let (_, turned) = axis.to_world(up, [x, y, z, 0.5_f64.cos()]).expect("a unit quaternion");
        assert!((turned - so3::exp(&Vector3::z())).norm() < 1e-12);
    }
}

#[test]
fn what_is_no_pose_is_refused() {
    for axis in [UpAxis::Y, UpAxis::Z] {
        assert!(axis.to_world([0.0; 3], [0.0; 4]).is_none());
        assert!(axis.to_world([0.0; 3], [0.0, 0.0, 0.0, 1.1]).is_none());
        assert!(axis.to_world([f64::NAN, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]).is_none());
        assert!(axis.to_world([0.0; 3], [0.0, f64::INFINITY, 0.0, 1.0]).is_none());
    }
}

proptest! {
    #[test]
    fn there_and_back(p in [-10.0..10.0_f64, -10.0..10.0, -10.0..10.0], v in [-2.0..2.0_f64, -2.0..2.0, -2.0..2.0]) {
        let (position, rotation) = (Vector3::from(p), so3::exp(&Vector3::from(v)));
        for axis in [UpAxis::Y, UpAxis::Z] {
            let (told, quaternion) = axis.from_world(&position, &rotation);
            let (back, turned) = axis.to_world(told, quaternion).expect("a unit quaternion");
            prop_assert!((back - position).norm() < 1e-12 && (turned - rotation).norm() < 1e-12);
        }
    }
}
