//! The filter against every sigma point evaluated, and its covariance over many steps.
#![allow(clippy::unwrap_used, unreachable_pub)]

#[path = "common/unstructured.rs"]
mod unstructured;

use proptest::prelude::*;
use tilthex_core::{
    Matrix3, Vector3,
    random::Random,
    so3,
    ukf::{Covariance, InitialDeviation, Navigation, PoseNoise, ProcessNoise, Ukf, UkfState},
};
use unstructured::{Points, difference};

fn vector(scale: f64) -> impl Strategy<Value = Vector3> {
    prop::array::uniform3(-scale..scale).prop_map(Vector3::from)
}

fn noise() -> ProcessNoise {
    ProcessNoise { gyro: 0.02, accelerometer: 0.3, gyro_bias: 0.01, accelerometer_bias: 0.1 }
}

/// A state with all its correlations, after some flight.
fn flown(seed: u64, initial: &InitialDeviation, steps: usize) -> (Ukf, UkfState, Random) {
    let filter = Ukf::new(noise()).unwrap();
    let mean = Navigation { rotation_wi: so3::exp(&Vector3::new(0.4, -0.3, 2.0)), ..Navigation::ORIGIN };
    let mut state = UkfState::new(mean, initial);
    let mut random = Random::new(seed);
    for k in 0..steps {
        let force = Vector3::new(0.0, 0.0, 9.81) + random.normal3(2.0);
        filter.predict(&mut state, &random.normal3(1.0), &force, 0.002);
        if k % 7 == 6 {
            let m = state.mean;
            let turned = so3::exp(&random.normal3(0.01)) * m.rotation_wi;
            let pose_noise = PoseNoise::new(0.02, 0.03, &Vector3::new(0.1, 0.2, -0.1));
            let found =
                state.pose_innovation(&(m.position_w + random.normal3(0.01)), &turned, &pose_noise).unwrap();
            state.apply(&found);
        }
    }
    (filter, state, random)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The structured prediction is that of the 31 points, at small and at very large covariances.
    #[test]
    fn equals_every_point_evaluated(
        seed in any::<u64>(), steps in 0usize..60, gyro in vector(8.0), force in vector(30.0), dt in 1e-4..0.02f64,
        rotation in prop_oneof![1e-4..0.03f64, 0.03..0.4f64], gyro_bias in 1e-4..0.5f64, accelerometer_bias in 1e-3..5.0f64,
    ) {
        let initial = InitialDeviation { position: 0.1, velocity: 0.5, rotation, gyro_bias, accelerometer_bias };
        let (filter, mut state, _) = flown(seed, &initial, steps);
        let (mean, covariance) = (state.mean, state.covariance());
        let expected = unstructured::predict(Points::Pairs, &mean, &covariance, &noise(), (&gyro, &force), dt);
        filter.predict(&mut state, &gyro, &force, dt);
        prop_assert!(difference(&state.mean, &expected.0).amax() < 1e-11);
        let found = state.covariance();
        for i in 0..15 {
            for j in 0..15 {
                let scale = (expected.1[(i, i)] * expected.1[(j, j)]).sqrt();
                prop_assert!(
                    (found[(i, j)] - expected.1[(i, j)]).abs() < 1e-10 * scale,
                    "{i} {j}: {} {}", found[(i, j)], expected.1[(i, j)]
                );
            }
        }
        prop_assert_eq!(state.recoveries(), 0);
    }

    /// The update is the textbook's, P - K S K^T, by a general inverse.
    #[test]
    fn update_is_the_kalman_update(seed in any::<u64>(), steps in 1usize..60, arm in vector(0.3)) {
        let (_, mut state, mut random) = flown(seed, &InitialDeviation::default(), steps);
        let (mean, p) = (state.mean, state.covariance());
        let position = mean.position_w + random.normal3(0.02);
        let turn = random.normal3(0.02);
        let (sp, sr) = (0.01, 0.02);
        let found = state.pose_innovation(&position, &(so3::exp(&turn) * mean.rotation_wi), &PoseNoise::new(sp, sr, &arm));
        let found = found.unwrap();
        state.apply(&found);

        let mut h = nalgebra::SMatrix::<f64, 6, 15>::zeros();
        let mut g = nalgebra::SMatrix::<f64, 6, 6>::identity() ;
        for i in 0..3 {
            h[(i, i)] = 1.0;
            h[(3 + i, 6 + i)] = 1.0;
        }
        g.fixed_view_mut::<3, 3>(0, 3).copy_from(&so3::hat(&arm));
        let n = nalgebra::SMatrix::<f64, 6, 6>::from_diagonal(
            &nalgebra::Vector6::new(sp * sp, sp * sp, sp * sp, sr * sr, sr * sr, sr * sr));
        let s = h * p * h.transpose() + g * n * g.transpose();
        let y = nalgebra::Vector6::from_iterator((position - mean.position_w).iter().chain(turn.iter()).copied());
        let s_inverse = s.try_inverse().unwrap();
        let k = p * h.transpose() * s_inverse;
        let expected = unstructured::retract(&mean, &(k * y));
        prop_assert!(difference(&state.mean, &expected).amax() < 1e-11);
        prop_assert!((state.covariance() - (p - k * s * k.transpose())).amax() < 1e-11);
        prop_assert!((found.squared(6) - (y.transpose() * s_inverse * y)[0]).abs() < 1e-8 * found.squared(6));
        let position_only = s.fixed_view::<3, 3>(0, 0).try_inverse().unwrap();
        let yp = y.fixed_rows::<3>(0);
        prop_assert!((found.squared(3) - (yp.transpose() * position_only * yp)[0]).abs() < 1e-8 * found.squared(3) + 1e-12);
    }

    /// Near pi, where a rotation's logarithm changes its sign, nothing happens.
    #[test]
    fn the_frame_near_pi_does_not_matter(axis in vector(1.0), off in -1e-9..1e-9f64, error in vector(0.05)) {
        prop_assume!(axis.norm() > 0.1);
        let rotation = so3::exp(&(axis.normalize() * (core::f64::consts::PI + off)));
        let noise = PoseNoise::new(1e-3, 1e-2, &Vector3::zeros());
        let update = |rotation: Matrix3| {
            let mut state = UkfState::new(
                Navigation { rotation_wi: rotation, ..Navigation::ORIGIN }, &InitialDeviation::default());
            let found = state.pose_innovation(&Vector3::zeros(), &(so3::exp(&error) * rotation), &noise).unwrap();
            state.apply(&found);
            (so3::log(&(state.mean.rotation_wi * rotation.transpose())), state.covariance())
        };
        let (turned, level) = (update(rotation), update(Matrix3::identity()));
        prop_assert!((turned.0 - level.0).amax() < 1e-12);
        prop_assert!((turned.1 - level.1).amax() < 1e-15);
    }
}

/// Covariance of many random states sent through the model.
fn monte_carlo(
    mean: &Navigation,
    covariance: &Covariance,
    (gyro, force): (&Vector3, &Vector3),
    dt: f64,
    count: usize,
) -> Covariance {
    let l = covariance.cholesky().unwrap().l();
    let mut random = Random::new(17);
    let next = unstructured::model(mean, gyro, force, dt);
    let mut sums = (unstructured::Error::zeros(), Covariance::zeros());
    for _ in 0..count {
        let e = l * unstructured::Error::from_fn(|_, _| random.normal());
        let moved =
            difference(&unstructured::model(&unstructured::retract(mean, &e), gyro, force, dt), &next);
        sums.0 += moved;
        sums.1 += moved * moved.transpose();
    }
    let centre = sums.0 / count as f64;
    sums.1 / count as f64 - centre * centre.transpose()
}

/// Worst relative difference of a standard deviation.
fn difference_of_deviations(a: &Covariance, b: &Covariance) -> f64 {
    (0..15).map(|i| ((a[(i, i)] / b[(i, i)]).sqrt() - 1.0).abs()).fold(0.0, f64::max)
}

/// Pairs and simplex against random states, over a step long enough (0.1 s) for the
/// model's curvature to show: the pairs are nearer throughout.
#[test]
fn pairs_are_at_least_as_good_as_the_simplex() {
    let none = ProcessNoise { gyro: 0.0, accelerometer: 0.0, gyro_bias: 0.0, accelerometer_bias: 0.0 };
    let readings = (&Vector3::new(1.0, -2.0, 0.5), &Vector3::new(3.0, -1.0, 12.0));
    for (rotation, limit) in [(0.01, 0.005), (0.05, 0.01), (0.3, 0.7)] {
        let initial = InitialDeviation {
            position: 0.02,
            velocity: 0.05,
            rotation,
            gyro_bias: rotation,
            accelerometer_bias: 0.2,
        };
        let state = UkfState::new(Navigation::ORIGIN, &initial);
        let (mean, p) = (state.mean, state.covariance());
        let truth = monte_carlo(&mean, &p, readings, 0.1, 200_000);
        let of = |points| {
            difference_of_deviations(
                &unstructured::predict(points, &mean, &p, &none, readings, 0.1).1,
                &truth,
            )
        };
        let (pairs, simplex) = (of(Points::Pairs), of(Points::Simplex));
        println!(
            "rotation {rotation} rad: worst deviation off by {pairs:.2e} (pairs), {simplex:.2e} (simplex)"
        );
        assert!(pairs < limit && pairs < simplex + 0.005, "{rotation}: {pairs} {simplex}");
    }
}

/// `steps` steps with poses, long outages, rough motion and whatever readings.
fn survives(steps: u64) {
    for params in [
        ProcessNoise::default(),
        ProcessNoise { gyro: 1e-6, accelerometer: 1e-5, gyro_bias: 1e-8, accelerometer_bias: 1e-7 },
    ] {
        let filter = Ukf::new(params).unwrap();
        let mut random = Random::new(5);
        let mut state = UkfState::new(Navigation::ORIGIN, &InitialDeviation::default());
        let noise = PoseNoise::new(1e-4, 1e-4, &Vector3::zeros());
        let mut outage = false;
        for k in 0..steps / 2 {
            if k % 20_000 == 0 {
                outage = random.uniform() < 0.3;
            }
            let rough = if k % 1000 < 20 { 50.0 } else { 1.0 };
            let force = Vector3::new(0.0, 0.0, 9.81) + random.normal3(rough);
            filter.predict(&mut state, &random.normal3(0.3 * rough), &force, 0.002);
            if k % 5 == 0 && !outage {
                let found =
                    state.pose_innovation(&random.normal3(1e-3), &so3::exp(&random.normal3(1e-3)), &noise);
                state.apply(&found.unwrap());
            }
            if k % 5000 == 0 || k > steps / 2 - 10 {
                assert!(state.is_sound(), "step {k} of {params:?}");
                assert!(so3::rotation_defect(&state.mean.rotation_wi) < 1e-13);
            }
        }
        assert_eq!(state.recoveries(), 0, "{params:?}");
    }
}

#[test]
fn covariance_stays_positive_definite() {
    survives(400_000);
}

/// About five minutes in an optimised build: `cargo test --release -p tilthex-core --test ukf -- --ignored`.
#[test]
#[ignore = "1e8 steps"]
fn covariance_stays_positive_definite_over_1e8_steps() {
    survives(100_000_000);
}
