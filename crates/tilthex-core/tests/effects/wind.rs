//! Wind: gusts against Dryden's spectra, and a body that drifts with it.

use super::{DT, common::tilt_hex};
use std::f64::consts::{PI, TAU};
use tilthex_core::{
    GRAVITY, RobotState, RotorVector, Vector3, Wrench,
    plant::{BodyDrag, Effects, Plant, PlantState, RISES, Wind, WindState},
};

/// One-sided power density of a series by averaged periodograms of `count` samples with a Hann window.
fn spectrum(series: &[f64], count: usize, bin: usize) -> f64 {
    let window: Vec<f64> = (0..count).map(|k| 0.5 - 0.5 * (TAU * k as f64 / count as f64).cos()).collect();
    let power: f64 = window.iter().map(|w| w * w).sum();
    let blocks = series.chunks_exact(count);
    let number = blocks.len() as f64;
    let sum: f64 = blocks
        .map(|block| {
            let (mut re, mut im) = (0.0, 0.0);
            for (k, (x, w)) in block.iter().zip(&window).enumerate() {
                let angle = TAU * (bin * k % count) as f64 / count as f64;
                re += w * x * angle.cos();
                im += w * x * angle.sin();
            }
            re * re + im * im
        })
        .sum();
    2.0 * sum / number / power
}

#[test]
fn gusts_have_dryden_spectra() {
    let (deviation, length, speed, dt) = (0.8, 5.0, 4.0, 0.02);
    let wind = Wind {
        mean_w: Vector3::new(0.0, speed, 0.0),
        gust_deviation: deviation,
        gust_length: length,
        begin: 0.0,
    };
    let mut state = WindState::new(11);
    let count = 1024;
    let samples: Vec<Vector3> = (0..count * 800)
        .map(|_| {
            wind.step(&mut state, &Vector3::zeros(), dt);
            wind.velocity(&state) - wind.mean_w
        })
        .collect();
    // Along the mean wind is y; across it x; up z. 800 blocks: 3.5 % of standard error each.
    for (axis, along) in [(1, true), (0, false), (2, false)] {
        let series: Vec<f64> = samples.iter().map(|v| v[axis]).collect();
        let variance = series.iter().map(|x| x * x).sum::<f64>() / series.len() as f64;
        assert!((variance.sqrt() - deviation).abs() < 0.02 * deviation, "{axis}: {}", variance.sqrt());
        for bin in [3, 6, 12, 25, 50, 100] {
            let frequency = bin as f64 / (count as f64 * dt);
            // Spatial frequency w = 2 pi f / V; densities over f in Hz are 2 pi / V times those over w in rad/m.
            let x = length * TAU * frequency / speed;
            let one_sided = deviation * deviation * length / PI * TAU / speed;
            let closed = if along {
                2.0 * one_sided / (1.0 + x * x)
            } else {
                one_sided * (1.0 + 3.0 * x * x) / (1.0 + x * x).powi(2)
            };
            let found = spectrum(&series, count, bin) * dt;
            assert!((found / closed - 1.0).abs() < 0.15, "axis {axis} at {frequency} Hz: {found} {closed}");
        }
    }
}

#[test]
fn a_wind_that_begins_later_rises_to_the_same_wind() {
    let whole =
        Wind { mean_w: Vector3::new(3.0, 1.0, -0.5), gust_deviation: 0.5, gust_length: 5.0, begin: 0.0 };
    let (dt, begin) = (0.05, 4.0);
    for wind in [whole, Wind { gust_deviation: 0.0, ..whole }] {
        let later = Wind { begin, ..wind };
        let (mut of_whole, mut of_later) = (WindState::new(3), WindState::new(3));
        for k in 1..200 {
            let time = f64::from(k) * dt;
            wind.step(&mut of_whole, &Vector3::zeros(), dt);
            later.step(&mut of_later, &Vector3::zeros(), dt);
            let part = ((time - begin) / RISES).clamp(0.0, 1.0);
            let off = later.velocity(&of_later) - part * wind.velocity(&of_whole);
            assert!(off.norm() < 1e-9, "{time}: {off}");
        }
    }
}

#[test]
fn gusts_are_as_strong_at_any_step_and_of_their_own_for_every_seed() {
    let wind =
        Wind { mean_w: Vector3::new(3.0, 0.0, 0.0), gust_deviation: 0.5, gust_length: 2.0, begin: 0.0 };
    for dt in [1e-3, 0.05, 1.0] {
        let (mut sum, mut count) = (0.0, 0.0);
        for seed in 0..2000 {
            let mut state = WindState::new(seed);
            for _ in 0..3 {
                wind.step(&mut state, &Vector3::zeros(), dt);
            }
            sum += (wind.velocity(&state) - wind.mean_w).norm_squared();
            count += 3.0;
        }
        let deviation = f64::sqrt(sum / count);
        assert!((deviation - 0.5).abs() < 0.02, "{dt}: {deviation}");
    }
    assert_ne!(wind.velocity(&WindState::new(1)), wind.velocity(&WindState::new(2)));
}

#[test]
fn still_rotors_in_wind_drift_with_it() {
    // Body drag alone brings a body without weight to the wind's velocity.
    let effects = Effects {
        body_drag: BodyDrag { area_r: Vector3::repeat(2.0), centre_r: Vector3::zeros() },
        wind: Wind { mean_w: Vector3::new(2.0, 0.0, 0.0), ..Wind::CALM },
        ..Effects::OFF
    };
    let plant = Plant::with_effects(tilt_hex(), effects).unwrap();
    let mut state = PlantState::new(RobotState::at_rest(Vector3::zeros()), RotorVector::zeros());
    let weight = Wrench { force: Vector3::new(0.0, 0.0, 2.4 * GRAVITY), torque: Vector3::zeros() };
    let rate = 0.5 * effects.air_density * 2.0 / 2.4;
    for step in 1..=5000 {
        plant.step(&mut state, &RotorVector::zeros(), &weight, DT);
        // (v - w)' = -rate (v - w)^2.
        let closed = 2.0 - 2.0 / (1.0 + 2.0 * rate * f64::from(step) * DT);
        assert!((state.robot.velocity_w.x - closed).abs() < 1e-6);
    }
}
