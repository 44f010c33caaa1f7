//! A gyro whose scale or range is wrong.

use super::{params, recording, run};
use tilthex_core::{Vector3, estimator::Estimator, so3};

/// Largest errors of position, m, and rotation, rad, with a gyro that reads `gyro` of the true rate, and every n-th pose.
fn worst(seed: u64, every: usize, gyro: impl Fn(&Vector3) -> Vector3) -> (f64, f64) {
    let mut recording = recording(seed, 8.0);
    for sample in &mut recording.imu {
        sample.1 = gyro(&sample.1);
    }
    let poses: Vec<_> = recording.poses.iter().step_by(every).copied().collect();
    let mut estimator = Estimator::new(params()).unwrap();
    let mut worst = (0.0f64, 0.0f64);
    run(&mut estimator, &recording, &poses, |e, k| {
        let (state, truth) = (e.robot_state(), &recording.truth[k]);
        if recording.imu[k].0 > 1.0 {
            worst.0 = worst.0.max((state.position_w - truth.position_w).norm());
            worst.1 = worst.1.max(so3::angle(&(state.rotation_wr.transpose() * truth.rotation_wr)));
        }
    });
    worst
}

/// The poses show its error: the state stays near them, as far as the gyro can be wrong between some poses.
#[test]
fn the_rotation_follows_poses_that_a_wrong_gyro_contradicts() {
    for seed in 31..35 {
        for every in [1, 2, 5] {
            let scaled = worst(seed, every, |w| 1.8 * w);
            let limit = 0.6;
            let clipped = worst(seed, every, |w| w.map(|x| x.clamp(-limit, limit)));
            println!("{seed} {every}: scaled {scaled:.4?}, clipped {clipped:.4?}");
            assert!(scaled.0 < 0.01 && scaled.1 < 0.3, "{seed} {every}: {scaled:?}");
            assert!(clipped.0 < 0.01 && clipped.1 < 0.3, "{seed} {every}: {clipped:?}");
        }
    }
}
