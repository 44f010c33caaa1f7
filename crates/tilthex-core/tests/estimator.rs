//! The estimator under late, disordered, wrong and missing poses.
#![allow(clippy::unwrap_used, unreachable_pub)]

#[path = "common/flight.rs"]
mod flight;
#[path = "estimator/weighing.rs"]
mod weighing;
#[path = "estimator/without_imu.rs"]
mod without_imu;
#[path = "estimator/wrong_gyro.rs"]
mod wrong_gyro;

use flight::{Motion, Recording, flipped};
use proptest::prelude::*;
use tilthex_core::{
    GRAVITY, Matrix3, PoseSample, RobotState, Vector3,
    estimator::{Estimator, EstimatorParams, Outcome, StartError, Status},
    plant::SensorParams,
    random::Random,
    so3,
    ukf::{InitialDeviation, ProcessNoise},
};

/// Parameters that match the experiments' sensors at 500 Hz.
fn params() -> EstimatorParams {
    let per_sample = 0.002f64.sqrt();
    EstimatorParams {
        process: ProcessNoise {
            gyro: 5e-3 * per_sample,
            accelerometer: 0.15 * per_sample,
            gyro_bias: 1e-4,
            accelerometer_bias: 1e-3,
        },
        position_noise: 0.3e-3,
        rotation_noise: 2e-3,
        // The flights begin in full motion.
        initial: InitialDeviation { velocity: 2.0, ..InitialDeviation::default() },
        ..EstimatorParams::default()
    }
}

fn recording(seed: u64, duration: f64) -> Recording {
    let mut random = Random::new(seed);
    let motion = Motion::new(&mut random);
    let sensors = SensorParams {
        gyro_bias_i: random.normal3(0.01),
        accelerometer_bias_i: random.normal3(0.05),
        ..SensorParams::EXPERIMENTS
    };
    Recording::new(&motion, &sensors, &Vector3::zeros(), duration, &mut random)
}

/// Runs a recording whose poses arrive at their `arrival`; calls `each` after every sample.
fn run(
    estimator: &mut Estimator,
    recording: &Recording,
    poses: &[PoseSample],
    mut each: impl FnMut(&Estimator, usize),
) {
    let mut poses = poses.to_vec();
    poses.sort_by(|a, b| a.arrival.total_cmp(&b.arrival));
    let first = &recording.poses[0];
    estimator.initialize(first.time, &first.position_w, &first.rotation_wr).unwrap();
    let mut waiting = poses.iter().peekable();
    for (k, (t, gyro, force)) in recording.imu.iter().enumerate() {
        estimator.predict(*t, gyro, force);
        while let Some(pose) = waiting.next_if(|p| p.arrival <= *t) {
            estimator.update_pose(pose);
        }
        each(estimator, k);
    }
}

/// Errors of position (m) and rotation (rad) after the first second.
fn errors(estimator: &mut Estimator, recording: &Recording, poses: &[PoseSample]) -> Vec<(f64, f64)> {
    let mut found = Vec::new();
    run(estimator, recording, poses, |e, k| {
        if k > 500 {
            let (state, truth) = (e.robot_state(), &recording.truth[k]);
            found.push((
                (state.position_w - truth.position_w).norm(),
                so3::angle(&(state.rotation_wr * truth.rotation_wr.transpose())),
            ));
        }
    });
    found
}

fn distance(a: &RobotState, b: &RobotState) -> f64 {
    (a.position_w - b.position_w)
        .amax()
        .max((a.velocity_w - b.velocity_w).amax())
        .max((a.rotation_wr - b.rotation_wr).amax())
}

#[test]
fn fits_into_32_kilobytes() {
    let size = size_of::<Estimator>();
    assert!(size < 32 * 1024, "{size}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// However late and in whatever order poses come (within the history): once all are
    /// there, state and covariance are those of poses without latency.
    #[test]
    fn late_and_disordered_poses_change_nothing(
        seed in any::<u64>(), latency in 0.0..0.15f64, jitter in 0.0..0.1f64,
    ) {
        let recording = recording(seed, 1.5);
        let mut random = Random::new(seed);
        let poses: Vec<_> = recording.poses.iter().skip(1).filter(|p| p.time < 1.2).copied().collect();
        let late: Vec<_> = poses
            .iter()
            .map(|p| PoseSample { arrival: p.time + latency + jitter * random.uniform(), ..*p })
            .collect();
        // No gate: whether one pose in ten thousand is weighed may depend on the order.
        let params = EstimatorParams { gate_probability: 1.0, ..params() };
        let (mut prompt, mut delayed) = (Estimator::new(params).unwrap(), Estimator::new(params).unwrap());
        run(&mut prompt, &recording, &poses, |_, _| ());
        run(&mut delayed, &recording, &late, |_, _| ());
        prop_assert_eq!(delayed.health().counts.accepted, prompt.health().counts.accepted);
        prop_assert_eq!(delayed.health().counts.too_old, 0);
        prop_assert!(distance(&prompt.robot_state(), &delayed.robot_state()) < 1e-10);
        let (a, b) = (prompt.covariance(), delayed.covariance());
        prop_assert!((a - b).amax() < 1e-9 * a.amax());
    }

    /// A sensor with scale and misalignment, and the matrices that remove them, give the estimate of an exact sensor.
    #[test]
    fn matrices_of_the_sensors_remove_scale_and_misalignment(
        seed in any::<u64>(), off in prop::array::uniform18(-0.05..0.05f64),
    ) {
        let exact = recording(seed, 0.6);
        let [gyro, force] = [&off[..9], &off[9..]].map(|off| Matrix3::identity() + Matrix3::from_row_slice(off));
        let mut read = exact.clone();
        for (_, rate_i, force_i) in &mut read.imu {
            (*rate_i, *force_i) = (gyro * *rate_i, force * *force_i);
        }
        let matrices = EstimatorParams {
            gyro_matrix_i: gyro.try_inverse().unwrap(),
            accelerometer_matrix_i: force.try_inverse().unwrap(),
            ..params()
        };
        let (mut a, mut b) = (Estimator::new(params()).unwrap(), Estimator::new(matrices).unwrap());
        run(&mut a, &exact, &exact.poses[1..], |_, _| ());
        run(&mut b, &read, &exact.poses[1..], |_, _| ());
        prop_assert!(distance(&a.robot_state(), &b.robot_state()) < 1e-8);
        prop_assert!((a.specific_force_r() - b.specific_force_r()).amax() < 1e-8);
    }

    /// Matrices that are not finite, or far from the identity, are refused, whichever entry it is.
    #[test]
    fn matrices_that_cannot_be_are_refused(entry in 0..9usize, wrong in prop::sample::select(vec![f64::NAN, 2.0])) {
        let mut matrix = Matrix3::identity();
        matrix[entry] = wrong;
        for params in [
            EstimatorParams { gyro_matrix_i: matrix, ..params() },
            EstimatorParams { accelerometer_matrix_i: matrix, ..params() },
        ] {
            prop_assert!(Estimator::new(params).is_err());
        }
    }

    /// Turning the world about its vertical turns the estimate, and changes nothing else.
    #[test]
    fn a_turned_world_turns_the_estimate(seed in any::<u64>(), angle in -3.0..3.0f64) {
        let recording = recording(seed, 0.6);
        let turn = so3::rot_z(angle);
        let mut turned = recording.clone();
        for pose in &mut turned.poses {
            pose.position_w = turn * pose.position_w;
            pose.rotation_wr = turn * pose.rotation_wr;
        }
        let (mut a, mut b) = (Estimator::new(params()).unwrap(), Estimator::new(params()).unwrap());
        run(&mut a, &recording, &recording.poses, |_, _| ());
        run(&mut b, &turned, &turned.poses, |_, _| ());
        let (a_state, b_state) = (a.robot_state(), b.robot_state());
        prop_assert!((turn * a_state.position_w - b_state.position_w).amax() < 1e-8);
        prop_assert!((turn * a_state.velocity_w - b_state.velocity_w).amax() < 1e-7);
        prop_assert!((turn * a_state.rotation_wr - b_state.rotation_wr).amax() < 1e-7);
        prop_assert!((a.gyro_bias() - b.gyro_bias()).amax() < 1e-7);
        prop_assert!((a.accelerometer_bias() - b.accelerometer_bias()).amax() < 1e-6);
    }

    /// No input, whatever its numbers and order, makes the state anything but finite.
    #[test]
    fn any_input_leaves_a_finite_state(
        samples in prop::collection::vec(
            (prop::num::f64::ANY, prop::num::f64::ANY, -0.1..0.3f64, prop::num::f64::ANY, any::<bool>()), 1..200),
    ) {
        let mut estimator = Estimator::new(params()).unwrap();
        estimator.initialize(0.0, &Vector3::zeros(), &Matrix3::identity()).unwrap();
        let mut time = 0.0;
        for (a, b, dt, c, sane) in samples {
            time += dt;
            let (gyro, force) = if sane { (Vector3::y(), Vector3::z()) } else { (Vector3::new(a, b, c), Vector3::new(b, c, a)) };
            estimator.predict(if sane { time } else { c }, &gyro, &force);
            let position = if sane { Vector3::x() * dt } else { Vector3::new(c, a, b) };
            let pose = PoseSample {
                time: if sane { time - dt } else { a }, arrival: b, position_w: position,
                rotation_wr: Matrix3::identity(), tracking_valid: true,
            };
            estimator.update_pose(&pose);
            prop_assert!(estimator.robot_state().is_finite());
            prop_assert!(estimator.covariance().iter().all(|x| x.is_finite()));
            prop_assert!(estimator.covariance().cholesky().is_some());
        }
    }
}

/// Poses of a constant latency are expected when they come, although their times are rounded: after the first one the
/// filter never goes back.
#[test]
fn regular_poses_are_expected() {
    let (place_w, level) = (Vector3::new(0.0, 0.0, 1.0), Matrix3::identity());
    let mut estimator = Estimator::new(EstimatorParams::default()).unwrap();
    estimator.initialize(0.0, &place_w, &level).unwrap();
    let mut time = 0.0;
    for k in 1..500u32 {
        time += 0.002;
        estimator.predict(time, &Vector3::zeros(), &Vector3::new(0.0, 0.0, GRAVITY));
        if k > 8 && k % 5 == 3 {
            let taken = 0.002 * f64::from(k - 8);
            let pose = PoseSample {
                time: taken,
                arrival: time,
                position_w: place_w,
                rotation_wr: level,
                tracking_valid: true,
            };
            assert_eq!(estimator.update_pose(&pose), Outcome::Accepted, "pose of {taken} s");
            assert!(estimator.health().lag < 0.0161, "{:?}", estimator.health());
        }
    }
}

/// What 30 ms of latency cost at the newest sample is what physics takes: the IMU's noise over
/// 30 ms, as the covariance has it, and at most 5 % more. (At the time of capture they cost nothing, see above.)
#[test]
fn latency_costs_what_the_imu_adds_and_no_more() {
    let measure = |latency: f64| {
        let (mut squared, mut expected, mut count) = (Vector3::zeros(), Vector3::zeros(), 0.0);
        for seed in 0..8 {
            let recording = recording(seed, 6.0);
            let late: Vec<_> =
                recording.poses.iter().map(|p| PoseSample { arrival: p.time + latency, ..*p }).collect();
            run(&mut Estimator::new(params()).unwrap(), &recording, &late, |e, k| {
                if k > 1000 && k % 7 == 0 {
                    let (state, truth) = (e.robot_state(), &recording.truth[k]);
                    let covariance = e.covariance();
                    squared += Vector3::new(
                        (state.position_w - truth.position_w).norm_squared(),
                        (state.velocity_w - truth.velocity_w).norm_squared(),
                        so3::angle(&(state.rotation_wr * truth.rotation_wr.transpose())).powi(2),
                    );
                    expected += Vector3::from_fn(|i, _| covariance.fixed_view::<3, 3>(3 * i, 3 * i).trace());
                    count += 1.0;
                }
            });
        }
        ((squared / count).map(f64::sqrt), (expected / count).map(f64::sqrt))
    };
    let (prompt, late) = (measure(0.0), measure(0.03));
    println!("rms of position, velocity, rotation: without latency {}, with 30 ms {}", prompt.0, late.0);
    for i in 0..3 {
        let (found, bound) = (late.0[i] / prompt.0[i], late.1[i] / prompt.1[i]);
        println!("ratio {found:.3}, bound {bound:.3}");
        assert!(found < 1.05 * bound, "{i}: {found} {bound}");
        assert!((late.0[i] / late.1[i] - 1.0).abs() < 0.1, "{i}: {} {}", late.0[i], late.1[i]);
    }
}

/// Swapped markers for half a second: the position is kept to the millimetre, the rotation is not turned.
#[test]
fn flips_are_refused() {
    let recording = recording(3, 4.0);
    let poses: Vec<_> =
        recording.poses.iter().map(|p| if (2.0..2.5).contains(&p.time) { flipped(p) } else { *p }).collect();
    let mut estimator = Estimator::new(params()).unwrap();
    let found = errors(&mut estimator, &recording, &poses);
    assert!(found.iter().all(|e| e.0 < 0.005 && e.1 < 0.03), "{found:?}");
    let counts = estimator.health().counts;
    assert_eq!((counts.flipped, counts.position_only, counts.rejected), (50, 50, 0));
}

/// Two seconds without poses: the covariance covers the error, health says so, and poses are taken again.
#[test]
fn loss_is_admitted_and_ends() {
    let recording = recording(4, 6.0);
    let poses: Vec<_> = recording.poses.iter().filter(|p| !(2.0..4.0).contains(&p.time)).copied().collect();
    let mut estimator = Estimator::new(params()).unwrap();
    let mut statuses = Vec::new();
    run(&mut estimator, &recording, &poses, |e, k| {
        let error = (e.robot_state().position_w - recording.truth[k].position_w).norm();
        let deviation = e.covariance().fixed_view::<3, 3>(0, 0).trace().sqrt();
        assert!(error < 4.0 * deviation, "at sample {k}: {error} m, deviation {deviation} m");
        if k % 250 == 249 {
            statuses.push(e.health().status);
        }
    });
    use Status::{Coasting, Lost, Tracking};
    assert_eq!(statuses[..4], [Tracking; 4]);
    assert_eq!(statuses[4], Coasting);
    assert!(statuses[5..8].iter().all(|s| matches!(s, Coasting | Lost)));
    assert_eq!(statuses[8..], [Tracking; 4]);
    assert_eq!(estimator.health().counts.rejected, 0);
}

/// The first poses after half a second of loss are outliers: refused, not taken for a new beginning.
#[test]
fn loss_does_not_make_outliers_credible() {
    let recording = recording(9, 4.0);
    let mut poses: Vec<_> =
        recording.poses.iter().filter(|p| !(2.0..2.5).contains(&p.time)).copied().collect();
    let outliers = poses.iter_mut().filter(|p| (2.5..2.535).contains(&p.time));
    let count = outliers.map(|p| p.position_w.x += 0.8).count();
    let mut estimator = Estimator::new(params()).unwrap();
    let found = errors(&mut estimator, &recording, &poses);
    assert!(found.iter().all(|e| e.0 < 0.05), "{found:?}");
    let counts = estimator.health().counts;
    assert_eq!((counts.rejected + counts.position_only) as usize, count, "{counts:?}");
}

/// All poses of a quarter of a second at once: the output goes on meanwhile, and is right after it.
#[test]
fn a_burst_is_caught_up_with() {
    let recording = recording(6, 3.0);
    let late: Vec<_> = recording
        .poses
        .iter()
        .map(|p| PoseSample { arrival: if (2.0..2.25).contains(&p.time) { 2.25 } else { p.time }, ..*p })
        .collect();
    let mut estimator = Estimator::new(params()).unwrap();
    let found = errors(&mut estimator, &recording, &late);
    assert_eq!(estimator.health().counts.too_old, 0);
    assert_eq!(estimator.health().counts.rejected, 0);
    let after = &found[(2.35 * 500.0) as usize - 501..];
    assert!(after.iter().all(|e| e.0 < 0.003), "{after:?}");
}

#[test]
fn poses_that_are_none_are_counted() {
    let recording = recording(7, 1.0);
    let mut estimator = Estimator::new(params()).unwrap();
    let good = recording.poses[50];
    assert_eq!(estimator.update_pose(&good), Outcome::Uninitialized);
    run(&mut estimator, &recording, &recording.poses, |_, _| ());
    let before = estimator.robot_state();
    let nan = PoseSample { position_w: Vector3::new(f64::NAN, 0.0, 0.0), ..good };
    for (pose, expected) in [
        (nan, Outcome::Invalid),
        (PoseSample { rotation_wr: Matrix3::zeros(), ..good }, Outcome::Invalid),
        (PoseSample { tracking_valid: false, ..good }, Outcome::Invalid),
        (PoseSample { time: 1e6, ..good }, Outcome::Invalid),
        (PoseSample { time: 0.1, ..good }, Outcome::TooOld),
        (recording.poses[98], Outcome::Duplicate),
    ] {
        assert_eq!(estimator.update_pose(&pose), expected, "{pose:?}");
    }
    assert_eq!(estimator.robot_state(), before);
}

/// A start at rest finds the biases; a moving or tilted-otherwise vehicle is refused with the reason.
#[test]
fn starts_at_rest() {
    let mut random = Random::new(8);
    let (gyro_bias, force_bias) = (Vector3::new(0.01, -0.02, 0.015), Vector3::new(0.05, 0.02, -0.1));
    let rotation = so3::exp(&Vector3::new(0.1, -0.2, 1.0));
    let up = rotation.transpose() * Vector3::new(0.0, 0.0, 9.81);
    let mut estimator = Estimator::new(params()).unwrap();
    let refused = estimator.initialize_at_rest(0.0, &Vector3::zeros(), &rotation);
    assert!(matches!(refused, Err(StartError::TooShort { .. })), "{refused:?}");
    for k in 0..600 {
        let t = f64::from(k) * 0.002;
        let (gyro, force) = (gyro_bias + random.normal3(5e-3), up + force_bias + random.normal3(0.15));
        estimator.predict(t, &gyro, &force);
    }
    let refused = estimator.initialize_at_rest(1.198, &Vector3::zeros(), &so3::rot_x(1.5));
    assert!(matches!(refused, Err(StartError::GravityDisagrees { .. })), "{refused:?}");
    estimator.initialize_at_rest(1.198, &Vector3::zeros(), &rotation).unwrap();
    assert!(estimator.health().at_rest);
    assert!((estimator.gyro_bias() - gyro_bias).amax() < 1e-3);
    assert!((estimator.accelerometer_bias() - force_bias).amax() < 0.03);

    for k in 600..1800 {
        let t = f64::from(k) * 0.002;
        estimator.predict(t, &Vector3::new(0.5 * (20.0 * t).sin(), 0.0, 0.0), &up);
    }
    let refused = estimator.initialize_at_rest(3.6, &Vector3::zeros(), &rotation);
    assert!(matches!(refused, Err(StartError::Moving { .. })), "{refused:?}");
    assert!(refused.unwrap_err().to_string().contains("the vehicle moves: the gyro's"));
}
