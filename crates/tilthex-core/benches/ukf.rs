//! Cost of the estimator's filter: `cargo bench -p tilthex-core --bench ukf`.
use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tilthex_core::{
    Matrix3, Vector3,
    ukf::{InitialDeviation, Navigation, PoseNoise, ProcessNoise, Ukf, UkfState},
};

/// A filter that has settled on a slow turn.
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

criterion_group!(benches, ukf);
criterion_main!(benches);
