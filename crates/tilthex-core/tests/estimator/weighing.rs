//! Poses that surprise: weighed, believed or refused.

use super::{errors, params, recording, run};
use tilthex_core::{
    Matrix3, PoseSample, Vector3,
    estimator::{Estimator, EstimatorParams, Status},
    random::Random,
    so3,
};

/// A vehicle that was carried elsewhere, unseen: refused at first, then found again.
#[test]
fn a_lasting_contradiction_is_taken_up() {
    let recording = recording(5, 6.0);
    let shift = Vector3::new(0.4, -0.2, 0.1);
    let mut poses = recording.poses.clone();
    for pose in poses.iter_mut().filter(|p| p.time > 2.0) {
        pose.position_w += shift;
    }
    let mut estimator = Estimator::new(params()).unwrap();
    run(&mut estimator, &recording, &poses, |_, _| ());
    let end = recording.truth.last().unwrap();
    assert!(estimator.health().counts.rejected > 25);
    assert!((estimator.robot_state().position_w - end.position_w - shift).norm() < 0.003);
    assert_eq!(estimator.health().status, Status::Tracking);
}

/// A blow that the IMU cannot measure, as its readings leap off: position and velocity are found again from the poses,
/// and what is known of the biases stays.
#[test]
fn a_blow_is_found_in_the_poses() {
    for (seed, reading) in [(10, Vector3::new(60.0, -20.0, -78.0)), (11, Vector3::new(-50.0, 78.0, 30.0))] {
        let mut recording = recording(seed, 4.0);
        let blow = Vector3::new(2.0, -1.0, -3.0);
        for pose in recording.poses.iter_mut().filter(|p| p.time > 2.0) {
            pose.position_w += blow * (pose.time - 2.0);
        }
        let at = recording.imu.iter().position(|s| s.0 >= 2.0).unwrap();
        recording.imu[at].2 += reading;
        let mut estimator = Estimator::new(params()).unwrap();
        let (mut known, mut worst) = (0.0, 0.0f64);
        run(&mut estimator, &recording, &recording.poses, |e, k| {
            let (time, truth) = (recording.imu[k].0, &recording.truth[k]);
            let bias = e.covariance().fixed_view::<3, 3>(12, 12).trace().sqrt();
            known = if time < 1.99 { bias } else { known };
            worst = if time > 1.99 { worst.max(bias) } else { worst };
            if time > 2.3 {
                let state = e.robot_state();
                let position = state.position_w - truth.position_w - blow * (time - 2.0);
                assert!(position.norm() < 0.02, "{time}: {position}");
                assert!((state.velocity_w - truth.velocity_w - blow).norm() < 0.25, "{time}");
            }
        });
        assert!(worst < 1.1 * known, "{worst} {known}");
    }
}

/// A line that repeats a sample for some time in a blow: the motion meanwhile was not measured, and the poses show it.
#[test]
fn repeated_readings_after_a_leap_are_not_believed() {
    for (seed, reading) in [(12, Vector3::new(-12.0, -32.0, -66.0)), (13, Vector3::new(40.0, 5.0, 20.0))] {
        let mut recording = recording(seed, 3.0);
        let at = recording.imu.iter().position(|s| s.0 >= 2.0).unwrap();
        let (_, gyro, force) = recording.imu[at];
        for sample in &mut recording.imu[at..at + 6] {
            (sample.1, sample.2) = (gyro, force + reading);
        }
        let poses: Vec<_> = recording.poses.iter().step_by(5).copied().collect();
        let mut estimator = Estimator::new(params()).unwrap();
        let mut worst = 0.0f64;
        run(&mut estimator, &recording, &poses, |e, k| {
            if recording.imu[k].0 > 2.06 {
                worst = worst.max((e.robot_state().position_w - recording.truth[k].position_w).norm());
            }
        });
        assert!(worst < 0.003, "{seed}: {worst}");
    }
}

/// Poses that leave as no blow shows in the IMU: they are another body's. None is believed, and health says that
/// there is none, while the state is as good as without poses.
#[test]
fn poses_that_the_imu_contradicts_are_not_believed() {
    let recording = recording(10, 4.0);
    let mut poses = recording.poses.clone();
    for pose in poses.iter_mut().filter(|p| p.time > 2.0) {
        pose.position_w += Vector3::new(2.0, -1.0, -3.0) * (pose.time - 2.0) + Vector3::new(0.5, 0.0, 0.0);
    }
    let mut estimator = Estimator::new(params()).unwrap();
    run(&mut estimator, &recording, &poses, |e, k| {
        let (time, truth) = (recording.imu[k].0, &recording.truth[k]);
        if time > 2.0 {
            let deviation = e.covariance().fixed_view::<3, 3>(0, 0).trace().sqrt();
            let error = (e.robot_state().position_w - truth.position_w).norm();
            assert!(error < 4.0 * deviation && error < 0.2, "{time}: {error} {deviation}");
            assert!(e.health().position_age > time - 2.02, "{time}");
        }
    });
    assert!(estimator.health().nis_mean > 4.0);
    assert_eq!(estimator.health().counts.rejected, 199);
}

/// Poses of another body that a certain state has refused are not believed because samples are missing afterwards, long
/// after or soon.
#[test]
fn what_was_refused_is_not_believed_after_a_gap() {
    for begin in [2.0, 2.9] {
        let mut recording = recording(10, 4.0);
        let mut poses = recording.poses.clone();
        let turn = so3::exp(&Vector3::new(0.0, 0.0, 0.6));
        for pose in poses.iter_mut().filter(|p| (begin..3.5).contains(&p.time)) {
            pose.position_w += Vector3::new(0.3, 0.6, 0.1);
            pose.rotation_wr = turn * pose.rotation_wr;
        }
        let kept: Vec<bool> = recording.imu.iter().map(|s| !(3.0..3.1).contains(&s.0)).collect();
        let mut keep = kept.iter();
        recording.imu.retain(|_| *keep.next().unwrap());
        let mut keep = kept.iter();
        recording.truth.retain(|_| *keep.next().unwrap());
        let mut estimator = Estimator::new(params()).unwrap();
        run(&mut estimator, &recording, &poses, |e, k| {
            let (time, truth) = (recording.imu[k].0, &recording.truth[k]);
            let error = (e.robot_state().position_w - truth.position_w).norm();
            assert!(error < 0.25, "{begin} {time}: {error}");
            let age = e.health().position_age;
            assert!(!(begin + 0.2..3.5).contains(&time) || age > time - begin - 0.1, "{begin} {time}");
            assert!(time < 3.7 || error < 0.02, "{begin} {time}: {error}");
        });
    }
}

/// Poses of another body that begin soon after a pose that agreed are not believed because some samples are missing: the vehicle
/// cannot have come there since that pose. Nor because flipped bits look like a blow.
#[test]
fn missing_samples_explain_only_what_can_be_flown_since_the_last_pose() {
    let turn = so3::exp(&Vector3::new(0.0, 0.1, 0.4));
    for (flipped, distance) in [(false, 0.5), (false, 0.8), (true, 0.4), (true, 0.8), (true, 1.5)] {
        let away = distance * Vector3::new(0.7, -0.7, 0.14);
        let mut recording = recording(14, 3.5);
        let mut poses = recording.poses.clone();
        for pose in poses.iter_mut().filter(|p| (2.0..2.5).contains(&p.time)) {
            pose.position_w += away;
            pose.rotation_wr = turn * pose.rotation_wr;
        }
        let imu = recording.imu.clone();
        for (k, (at, _, force)) in imu.iter().enumerate().filter(|(_, s)| (1.9..2.4).contains(&s.0)) {
            if flipped && k % 20 == 0 {
                recording.imu[k].2.y += if k % 40 == 0 { 60.0 } else { -60.0 };
            } else if !flipped && ((at * 20.0) as u32).is_multiple_of(2) {
                recording.imu[k].2 = Vector3::new(f64::NAN, force.y, force.z);
            }
        }
        let mut estimator = Estimator::new(params()).unwrap();
        run(&mut estimator, &recording, &poses, |e, k| {
            let (time, truth) = (recording.imu[k].0, &recording.truth[k]);
            let error = (e.robot_state().position_w - truth.position_w).norm();
            assert!(error < 0.25, "{flipped} {distance} {time}: {error}");
            let age = e.health().position_age + time - e.time();
            assert!(!(2.1..2.5).contains(&time) || age > time - 2.02, "{flipped} {distance} {time}: {age}");
            assert!(time < 3.0 || error < 0.01, "{flipped} {time}: {error}");
        });
    }
}

/// While no poses come, the gyro's bias steps, so that the direction of gravity drifts. The poses that return show this in their
/// rotations, positions and velocities together, and are believed; those of a displaced body are not.
#[test]
fn a_drift_of_the_gyro_is_found_in_the_poses_that_return() {
    for displaced in [false, true] {
        let mut recording = recording(15, 5.0);
        let step = Vector3::new(0.08, -0.1, 0.03);
        for sample in recording.imu.iter_mut().filter(|s| s.0 > 2.0) {
            sample.1 += step;
        }
        let away = if displaced { Vector3::new(0.5, 0.5, 0.0) } else { Vector3::zeros() };
        let mut poses: Vec<_> =
            recording.poses.iter().filter(|p| !(2.0..2.9).contains(&p.time)).copied().collect();
        for pose in poses.iter_mut().filter(|p| p.time > 2.0) {
            pose.position_w += away;
        }
        let mut estimator = Estimator::new(params()).unwrap();
        let (mut drift, mut known) = (0.0f64, Vector3::zeros());
        run(&mut estimator, &recording, &poses, |e, k| {
            let (time, truth) = (recording.imu[k].0, &recording.truth[k]);
            let error = (e.robot_state().position_w - truth.position_w).norm();
            known = if time < 2.0 { e.gyro_bias() } else { known };
            drift = if time < 2.9 { drift.max(error) } else { drift };
            assert!(displaced || time < 3.2 || error < 0.02, "{time}: {error}");
            assert!(
                !displaced || !(2.9..3.4).contains(&time) || e.health().position_age > time - 2.02,
                "{time}"
            );
        });
        assert!(drift > 0.05, "{drift}");
        assert!(displaced || (estimator.gyro_bias() - known - step).norm() < 0.01);
    }
}

/// The poses of a body that stands still are not believed by a vehicle that flies past it.
#[test]
fn a_standing_body_is_not_taken_for_an_error_of_the_imu() {
    for (speed, ahead) in [(0.4, 0.15), (0.5, 0.3), (0.7, 0.3), (1.0, 0.5)] {
        let mut estimator = Estimator::new(params()).unwrap();
        let way = |time: f64| Vector3::new(speed * time, 0.0, 1.0);
        estimator.initialize(0.0, &way(0.0), &Matrix3::identity()).unwrap();
        for k in 1..2000 {
            let time = 0.002 * f64::from(k);
            estimator.predict(time, &Vector3::zeros(), &(tilthex_core::GRAVITY * Vector3::z()));
            if k % 5 == 0 {
                let stands = time > 2.0;
                let position_w = if stands { way(2.0) + Vector3::new(ahead, 0.03, 0.0) } else { way(time) };
                let rotation_wr = so3::exp(&Vector3::new(0.0, 0.0, if stands { 0.06 } else { 0.0 }));
                let pose = PoseSample { time, arrival: time, position_w, rotation_wr, tracking_valid: true };
                estimator.update_pose(&pose);
            }
        }
        let age = estimator.health().position_age;
        let error = (estimator.robot_state().position_w - way(estimator.time())).norm();
        assert!(age > 1.9 && error < 0.05, "{speed} {ahead}: {age} {error}");
    }
}

/// A gap that has ended before poses contradicted the state does not keep them from being believed in time: neither true poses
/// after those of another body, nor those of a vehicle that was carried elsewhere.
#[test]
fn an_old_gap_does_not_shut_poses_out() {
    for (begin, end, gap) in [(2.0, 9.0, (2.0, 2.03)), (2.0, 2.5, (2.48, 2.505))] {
        let mut recording = recording(5, 6.0);
        let shift = Vector3::new(0.4, -0.2, 0.1);
        let mut poses = recording.poses.clone();
        for pose in poses.iter_mut().filter(|p| (begin..end).contains(&p.time)) {
            pose.position_w += shift;
        }
        for sample in recording.imu.iter_mut().filter(|s| (gap.0..gap.1).contains(&s.0)) {
            sample.2.x = f64::NAN;
        }
        let mut estimator = Estimator::new(params()).unwrap();
        run(&mut estimator, &recording, &poses, |_, _| ());
        let truth = recording.truth.last().unwrap().position_w;
        let expected = if end > 6.0 { truth + shift } else { truth };
        let error = (estimator.robot_state().position_w - expected).norm();
        assert!(error < 0.01, "{begin} {end}: {error}");
    }
}

/// A gyro that is badly scaled and aligned: its poses' rotations are not locked out, the errors are those without a gate.
#[test]
fn a_wrong_gyro_does_not_lock_rotations_out() {
    let mut recording = recording(12, 8.0);
    let turn = so3::exp(&Vector3::new(0.02, 0.0, 0.02));
    for (_, gyro, _) in &mut recording.imu {
        *gyro = turn * *gyro * 1.1;
    }
    let poses: Vec<_> = recording.poses.iter().step_by(10).copied().collect();
    let worst = |gate_probability: f64| {
        let mut estimator = Estimator::new(EstimatorParams { gate_probability, ..params() }).unwrap();
        let found = errors(&mut estimator, &recording, &poses);
        found.iter().fold((0.0f64, 0.0f64), |worst, e| (worst.0.max(e.0), worst.1.max(e.1)))
    };
    let (gated, open) = (worst(0.9999), worst(1.0));
    assert!(gated.0 < 1.1 * open.0 && gated.1 < 1.1 * open.1, "{gated:?} {open:?}");
    assert!(open.1 > 0.01, "{open:?}");
}

/// A pose beyond the gate by little is weighed: it moves the state by less than a good one, and not past the gate.
#[test]
fn a_surprise_is_weighed() {
    let recording = recording(13, 3.0);
    let at = recording.poses.iter().position(|p| p.time >= 2.5).unwrap();
    let moved = |off: f64, gate_probability: f64| {
        let poses = recording.poses.iter().enumerate();
        let poses: Vec<_> = poses
            .filter(|(k, _)| *k <= at)
            .map(|(k, p)| {
                if k == at { PoseSample { position_w: p.position_w + Vector3::x() * off, ..*p } } else { *p }
            })
            .collect();
        let mut estimator = Estimator::new(EstimatorParams { gate_probability, ..params() }).unwrap();
        run(&mut estimator, &recording, &poses, |_, _| ());
        (estimator.robot_state().position_w.x, estimator.health().counts)
    };
    let (still, _) = moved(0.0, 0.9999);
    for (off, weighed, rejected) in [(4e-3, 1, 0), (10e-3, 1, 0), (0.5, 0, 1)] {
        let (found, counts) = moved(off, 0.9999);
        assert_eq!((counts.weighed, counts.rejected), (weighed, rejected), "{off}");
        let (open, counts) = moved(off, 1.0);
        assert_eq!((counts.weighed, counts.rejected), (0, 0), "{off}");
        assert!((found - still).abs() < 0.6 * (open - still).abs(), "{off}: {found} {open} {still}");
        assert!((found - still).abs() < 1.5e-3, "{off}: {found} {still}");
    }
}

/// Poses fifty times as noisy as configured: weighed as what they are, and health says so.
#[test]
fn noisier_poses_than_configured_are_weighed() {
    let recording = recording(11, 5.0);
    let mut random = Random::new(11);
    let mut poses = recording.poses.clone();
    for pose in poses.iter_mut().filter(|p| (2.0..4.0).contains(&p.time)) {
        pose.position_w += random.normal3(50.0 * 0.3e-3);
        pose.rotation_wr *= so3::exp(&random.normal3(30.0 * 2e-3));
    }
    let mut estimator = Estimator::new(params()).unwrap();
    let mut inconsistency = 0.0f64;
    let mut worst = (0.0f64, 0.0f64);
    run(&mut estimator, &recording, &poses, |e, k| {
        let (state, truth) = (e.robot_state(), &recording.truth[k]);
        if recording.imu[k].0 > 1.0 {
            worst.0 = worst.0.max((state.position_w - truth.position_w).norm());
            worst.1 = worst.1.max(so3::angle(&(state.rotation_wr * truth.rotation_wr.transpose())));
            inconsistency = inconsistency.max(e.health().nis_mean);
        }
    });
    assert!(worst.0 < 0.05 && worst.1 < 0.05, "{worst:?}");
    assert!(inconsistency > 4.0, "{inconsistency}");
    // The trust comes back with the poses.
    let end = recording.truth.last().unwrap();
    assert!((estimator.robot_state().position_w - end.position_w).norm() < 0.003);
    assert!(estimator.health().nis_mean < 2.0, "{}", estimator.health().nis_mean);
}
