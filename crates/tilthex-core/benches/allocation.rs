//! The allocator of the Tilt-Hex: without active limits, with some, and for the slowest of many random wrenches; and
//! the attitude selector.

#![allow(missing_docs)] // criterion's macros

use criterion::{Criterion, criterion_group, criterion_main};
use std::{hint::black_box, time::Instant};
use tilthex_core::{
    GRAVITY, Matrix3, Reference, Vector3, Vector6, Vehicle,
    allocation::{Allocator, AllocatorState, RotorStatus},
    attitude::{AttitudeParams, AttitudeSelector, AttitudeState},
    examples,
    random::Random,
};

fn tilt_hex() -> Vehicle {
    examples::tilt_hex().expect("a vehicle")
}

/// The random wrench whose allocation takes longest, by the least time of a few runs.
fn slowest(allocator: &Allocator) -> Vector6 {
    let mut random = Random::new(3);
    let mut worst = (None, Vector6::zeros());
    for _ in 0..20_000 {
        let (force, torque) = (10.0 * random.normal(), 3.0 * random.normal());
        let mut w = Vector6::from_fn(|i, _| if i < 3 { force } else { torque } * random.normal());
        w[2] += 2.4 * GRAVITY;
        let time = (0..5)
            .map(|_| {
                let start = Instant::now();
                black_box(allocator.allocate(black_box(&w)));
                start.elapsed().as_nanos()
            })
            .min();
        if time > worst.0 {
            worst = (time, w);
        }
    }
    worst.1
}

fn allocation(c: &mut Criterion) {
    let vehicle = tilt_hex();
    let allocator = Allocator::new(&vehicle);
    let weight = 2.4 * GRAVITY;
    let within = Vector6::new(2.0, 1.0, weight, 0.1, -0.1, 0.05);
    let beyond = Vector6::new(30.0, 5.0, weight, 0.5, -0.5, 0.2);
    let worst = slowest(&allocator);
    let (status, level) = (RotorStatus::default(), Matrix3::identity());
    let out = allocator.allocate(&worst);
    println!(
        "slowest of 20000: {} steps, {} rotors at limits",
        out.iterations,
        (out.at_lower | out.at_upper).count_ones()
    );
    let mut group = c.benchmark_group("allocation");
    group.bench_function("no limit", |b| b.iter(|| allocator.allocate(black_box(&within))));
    group.bench_function("limits, cold", |b| b.iter(|| allocator.allocate(black_box(&beyond))));
    group.bench_function("limits, warm", |b| {
        let mut state = AllocatorState::default();
        b.iter(|| allocator.step(&mut state, black_box(&beyond), &level, &status));
    });
    group.bench_function("slowest, cold", |b| b.iter(|| allocator.allocate(black_box(&worst))));
    group.bench_function("slowest, warm", |b| {
        let mut state = AllocatorState::default();
        b.iter(|| allocator.step(&mut state, black_box(&worst), &level, &status));
    });
    let selector = AttitudeSelector::new(&vehicle, AttitudeParams::default()).expect("an attitude");
    let reference = Reference::hold(Vector3::zeros(), Matrix3::identity());
    for (name, lateral) in
        [("attitude, none needed", 3.0), ("attitude, turned", 20.0), ("attitude, cut", 80.0)]
    {
        let force = Vector3::new(lateral, 0.3 * lateral, weight);
        group.bench_function(name, |b| {
            let mut state = AttitudeState::default();
            b.iter(|| selector.step(&mut state, &reference, black_box(&force), &status, 0.002));
        });
    }
    group.finish();
}

criterion_group!(benches, allocation);
criterion_main!(benches);
