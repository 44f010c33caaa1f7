//! A gyro whose scale or range is wrong.

use super::{params, recording, run};
use tilthex_core::{
    GRAVITY, PoseSample, Vector3,
    estimator::{Estimator, EstimatorParams},
    so3,
};

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
            assert!(scaled.0 < 0.01 && scaled.1 < 0.2, "{seed} {every}: {scaled:?}");
            assert!(clipped.0 < 0.01 && clipped.1 < 0.1, "{seed} {every}: {clipped:?}");
        }
    }
}

/// Poses of a body that is turned for a moment, or for good, by swapped markers, while the vehicle turns slowly: the gyro did not
/// measure this turn, so it is no error of the gyro.
#[test]
fn a_turned_body_is_not_taken_for_an_error_of_the_gyro() {
    const SPIN: f64 = 0.2;
    let truth = |time: f64| so3::rot_z(SPIN * time);
    for (angle, wrong, every) in
        [(0.1, 3, 5), (0.1, 10, 5), (0.3, 3, 5), (0.3, 5, 5), (0.3, 10, 5), (0.3, 1000, 50), (0.2, 1000, 50)]
    {
        let turn = so3::exp(&(Vector3::new(0.6, -0.7, 0.4).normalize() * angle));
        let mut estimator = Estimator::new(EstimatorParams::default()).unwrap();
        estimator.initialize(0.0, &Vector3::zeros(), &truth(0.0)).unwrap();
        let (mut given, mut worst) = (0, (0.0f64, 0.0f64));
        for k in 1..2000 {
            let time = 0.002 * f64::from(k);
            estimator.predict(time, &Vector3::new(0.0, 0.0, SPIN), &(GRAVITY * Vector3::z()));
            if k % every == 0 {
                let swapped = time > 2.0 && given < wrong;
                given += i32::from(swapped);
                let rotation_wr = if swapped { truth(time) * turn } else { truth(time) };
                let position_w = Vector3::zeros();
                let pose = PoseSample { time, arrival: time, position_w, rotation_wr, tracking_valid: true };
                estimator.update_pose(&pose);
            }
            let state = estimator.robot_state();
            worst.0 = worst.0.max(state.position_w.norm());
            worst.1 = worst.1.max(so3::angle(&(state.rotation_wr.transpose() * truth(time))));
        }
        println!("{angle} rad, {wrong} poses: {worst:.4?}");
        // A turn that lasts is followed after some time, by another rule.
        let lasts = wrong > 100;
        assert!(worst.0 < if lasts { 0.05 } else { 0.002 }, "{angle} rad, {wrong} poses: {worst:?}");
        assert!(lasts || worst.1 < 0.015, "{angle} rad, {wrong} poses: {worst:?}");
    }
}
