//! A model in the place of the IMU.

use super::{flight::Recording, params, recording};
use tilthex_core::{
    PoseSample, Vector3,
    estimator::{Estimator, Quality},
    so3,
};

/// A recording whose gyro a model replaces from `from` to `to`, at first wrong by `error` rad/s.
fn run_modelled(
    recording: &Recording,
    (from, to): (f64, f64),
    error: Vector3,
    poses: &[PoseSample],
) -> Estimator {
    let mut estimator = Estimator::new(params()).unwrap();
    let first = &recording.poses[0];
    estimator.initialize(first.time, &first.position_w, &first.rotation_wr).unwrap();
    let mut waiting = poses.iter().peekable();
    for (k, (t, gyro, force)) in recording.imu.iter().enumerate() {
        if (from..to).contains(t) {
            // As a flight does: the rate goes on from the estimate, on top of what is thought of the bias.
            let gained = recording.truth[k].angular_velocity_r - recording.truth[k - 1].angular_velocity_r;
            let error = if estimator.is_modelled() { Vector3::zeros() } else { error };
            let rate = estimator.robot_state().angular_velocity_r + gained + error;
            estimator.predict_as(Quality::Modelled, *t, &(rate + estimator.gyro_bias()), force);
        } else {
            estimator.predict(*t, gyro, force);
        }
        while let Some(pose) = waiting.next_if(|p| p.arrival <= *t) {
            estimator.update_pose(pose);
        }
    }
    estimator
}

/// While a model stands in, poses correct its rate; the gyro's own bias is there when it is heard again.
#[test]
fn a_model_does_not_touch_the_bias_of_the_gyro() {
    let recording = recording(12, 5.01);
    let error = Vector3::new(0.4, -0.3, 0.2);
    let run = |end| run_modelled(&recording, (4.0, end), error, &recording.poses);
    let (heard, modelled, again) = (run(4.0), run(6.0), run(5.0));
    assert!((modelled.gyro_bias() - heard.gyro_bias()).norm() > 0.1, "{}", modelled.gyro_bias());
    assert!((again.gyro_bias() - heard.gyro_bias()).norm() < 5e-3, "{}", again.gyro_bias());
    let rate = again.robot_state().angular_velocity_r - recording.truth.last().unwrap().angular_velocity_r;
    assert!(rate.norm() < 0.05, "{rate}");
    // Nor does its covariance forget what was known.
    let deviation = |e: &Estimator| e.covariance().fixed_view::<3, 3>(9, 9).trace().sqrt();
    assert!(deviation(&again) < 1.5 * deviation(&heard) && deviation(&modelled) > 10.0 * deviation(&heard));
}

/// A model that is suddenly wrong by several rad/s, as after a blow that nothing felt: poses find the turn and its rate.
#[test]
fn poses_find_the_rate_that_a_model_does_not_know() {
    let recording = recording(14, 3.5);
    let blow = Vector3::new(0.0, 0.0, 6.0);
    let spun: Vec<_> = recording
        .poses
        .iter()
        .map(|p| {
            let turn = so3::exp(&(blow * (p.time - 3.0).max(0.0)));
            PoseSample { rotation_wr: turn * p.rotation_wr, ..*p }
        })
        .collect();
    let found = run_modelled(&recording, (2.9, 9.0), Vector3::zeros(), &spun).robot_state();
    let (truth, (end, ..)) = (recording.truth.last().unwrap(), *recording.imu.last().unwrap());
    let rotation_wr = so3::exp(&(blow * (end - 3.0))) * truth.rotation_wr;
    let rate_r = truth.angular_velocity_r + rotation_wr.transpose() * blow;
    let turn = so3::angle(&(found.rotation_wr * rotation_wr.transpose()));
    assert!(turn < 0.1, "{turn} rad");
    assert!((found.angular_velocity_r - rate_r).norm() < 1.0, "{} {rate_r}", found.angular_velocity_r);
}

/// A gyro has a say against turned poses; a model that turned the wrong way has not.
#[test]
fn poses_turn_a_model_back_but_not_a_gyro() {
    let recording = recording(13, 4.0);
    let turn = so3::exp(&Vector3::new(0.3, -0.5, 0.2));
    let turned: Vec<_> = recording
        .poses
        .iter()
        .map(|p| if p.time > 3.0 { PoseSample { rotation_wr: turn * p.rotation_wr, ..*p } } else { *p })
        .collect();
    let truth = recording.truth.last().unwrap().rotation_wr;
    let off = |e: &Estimator| so3::angle(&(e.robot_state().rotation_wr * truth.transpose()));
    let gyro = run_modelled(&recording, (9.0, 9.0), Vector3::zeros(), &turned);
    let model = run_modelled(&recording, (2.9, 9.0), Vector3::zeros(), &turned);
    assert!(off(&gyro) < 0.05, "{}", off(&gyro));
    assert!((off(&model) - so3::angle(&turn)).abs() < 0.05, "{}", off(&model));
}
