//! Cost of the estimator's filter: `cargo bench -p tilthex-core --bench ukf`.
#![allow(unreachable_pub)]

#[path = "../tests/common/unstructured.rs"]
mod unstructured;

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tilthex_core::{
    Matrix3, PoseSample, Vector3,
    estimator::{Estimator, EstimatorParams},
    ukf::{InitialDeviation, Navigation, PoseNoise, ProcessNoise, Ukf, UkfState},
};
use unstructured::Points;

/// A filter that has settled in a slow rotation.
fn settled() -> (Ukf, UkfState, Vector3, Vector3, PoseNoise) {
    let filter = Ukf::new(ProcessNoise::default()).expect("valid");
    let mut state = UkfState::new(Navigation::ORIGIN, &InitialDeviation::default());
    let (gyro, force) = (Vector3::new(0.1, -0.2, 0.3), Vector3::new(0.3, 0.2, 9.8));
    let noise = PoseNoise::new(5e-4, 3e-3, &Vector3::zeros());
    for k in 0..5000 {
        filter.predict(&mut state, &gyro, &force, 0.002);
        if k % 5 == 0 {
            let innovation = state.pose_innovation(&Vector3::zeros(), &Matrix3::identity(), &noise);
            state.apply(&innovation.expect("finite"));
        }
    }
    (filter, state, gyro, force, noise)
}

fn ukf(c: &mut Criterion) {
    let (filter, state, gyro, force, noise) = settled();
    c.bench_function("ukf predict", |b| {
        let mut s = state;
        b.iter(|| {
            s = state;
            filter.predict(&mut s, black_box(&gyro), black_box(&force), 0.002);
            black_box(&s);
        });
    });
    c.bench_function("ukf update", |b| {
        let mut s = state;
        b.iter(|| {
            s = state;
            let innovation = s.pose_innovation(
                black_box(&state.mean.position_w),
                black_box(&state.mean.rotation_wi),
                &noise,
            );
            if let Some(i) = innovation {
                s.apply(&i);
            }
            black_box(&s);
        });
    });
}

/// The cost without the structure: every point of both sets is evaluated, on the same state.
fn every_point(c: &mut Criterion) {
    let (_, state, gyro, force, _) = settled();
    let (covariance, noise) = (state.covariance(), ProcessNoise::default());
    for (name, points) in
        [("31 points, each evaluated", Points::Pairs), ("17 simplex points, each evaluated", Points::Simplex)]
    {
        c.bench_function(name, |b| {
            b.iter(|| {
                let readings = (black_box(&gyro), black_box(&force));
                unstructured::predict(points, &state.mean, &covariance, &noise, readings, 0.002)
            });
        });
    }
}

/// A tick of 500 Hz with a pose in every fifth tick, as in flight: with history, gate and output.
fn tick(c: &mut Criterion) {
    for (name, latency) in [("estimator tick", 0.0), ("estimator tick, poses 30 ms late", 0.03)] {
        let mut estimator = Estimator::new(EstimatorParams::default()).expect("valid");
        estimator.initialize(0.0, &Vector3::zeros(), &Matrix3::identity()).expect("valid");
        let mut k = 0u32;
        c.bench_function(name, |b| {
            b.iter(|| {
                k += 1;
                let time = f64::from(k) * 0.002;
                estimator.predict(
                    time,
                    black_box(&Vector3::zeros()),
                    black_box(&Vector3::new(0.0, 0.0, 9.81)),
                );
                if k.is_multiple_of(5) && time > latency {
                    estimator.update_pose(&PoseSample {
                        time: time - latency,
                        arrival: time,
                        position_w: Vector3::zeros(),
                        rotation_wr: Matrix3::identity(),
                        tracking_valid: true,
                    });
                }
                black_box(estimator.robot_state())
            });
        });
        let health = estimator.health();
        assert_eq!(health.counts.accepted + 1, k / 5 - (latency / 0.01) as u32 + 1, "{health:?}");
    }
}

criterion_group!(benches, ukf, every_point, tick);
criterion_main!(benches);
