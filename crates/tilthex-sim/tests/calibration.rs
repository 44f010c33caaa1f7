//! A vehicle taken from its drawings flies the calibration, and from then on feels what touches it.
#![allow(clippy::unwrap_used)]

use tilthex_config::{Config, TruthSection, VehicleSection};
use tilthex_core::{
    Vector3, Wrench,
    flight::Route,
    force_axes::ForceAxes,
    plant::SensorParams,
    so3,
    supervisor::Phase,
    trajectory::{Limits, Waypoint},
};
use tilthex_sim::{
    Push, Pushes,
    simulate::{PERIOD, Record, Scenario, Start, run},
};

/// Take-off and calibration are over by then, and the tilted hover has settled, s.
const SETTLED: f64 = 56.0;
const END: f64 = 60.0;

fn config(calibration: &str) -> Config {
    let config = Config::default_for(VehicleSection::preset("tilt-hex").unwrap());
    let changes = format!("mission = {{ calibration = \"{calibration}\" }}");
    config.overlaid(changes.parse().unwrap()).unwrap()
}

/// Takes off, calibrates, and hovers tilted by 15 degrees in a direction of the seed's own.
fn flown(calibration: &str, truth: &str, seed: u64, sensors: SensorParams, estimate: bool) -> Record {
    let direction = 2.4 * seed as f64;
    let axis = Vector3::new(direction.cos(), direction.sin(), 0.0);
    let tilted = Waypoint {
        position_w: Vector3::new(0.12, 0.0, 1.0),
        rotation_we: so3::exp(&(axis * 15f64.to_radians())),
        wrench_w: Wrench::ZERO,
        force_axes: ForceAxes::NONE,
        duration: 2.0,
        hold: 1000.0,
    };
    let limits =
        Limits { velocity: 0.4, acceleration: 0.8, angular_velocity: 0.5, angular_acceleration: 1.0 };
    run(&Scenario {
        config: &config(calibration),
        start: Start::Ground(Some(Route::new(&[tilted], &limits).unwrap())),
        pushes: Pushes::new(vec![]),
        duration: END,
        truth: TruthSection::named(truth).unwrap(),
        sensors,
        seed,
        estimate,
        pose_delay: 0.015,
    })
    .unwrap()
}

/// The gyro's bias at rest is known to a few mrad/s only, and the attitude by the IMU alone must not drift away in a long hover.
#[test]
fn a_sound_vehicle_hovers_on_and_on() {
    for seed in [101, 110, 112] {
        let record = flown("none", "exact", seed, SensorParams::EXPERIMENTS, true);
        let phases = &record.get("phase").unwrap().values;
        let left = phases.iter().rposition(|phase| *phase != Phase::Flying as i32 as f64);
        assert!(left.is_some_and(|k| k as f64 * PERIOD < 10.0), "{seed}: not flying any more at {left:?}");
    }
}

/// Mean tool force, N, and torque, N m, of the tilted hover.
fn felt(record: &Record) -> (f64, f64) {
    let rows = record.get("wrench_tool").unwrap().values.chunks_exact(6);
    let from = (SETTLED / PERIOD) as usize;
    let (mut force, mut torque, mut count) = (Vector3::zeros(), Vector3::zeros(), 0.0);
    for row in rows.skip(from) {
        force += Vector3::new(row[0], row[1], row[2]);
        torque += Vector3::new(row[3], row[4], row[5]);
        count += 1.0;
    }
    (force.norm() / count, torque.norm() / count)
}

#[test]
fn false_contact_is_gone_at_an_attitude_that_was_not_flown() {
    let mut sums = [0.0; 4];
    const SEEDS: u64 = 6;
    for seed in 71..71 + SEEDS {
        let before = felt(&flown("none", "cad", seed, SensorParams::EXPERIMENTS, true));
        let after = felt(&flown("tilts", "cad", seed, SensorParams::EXPERIMENTS, true));
        println!("{seed}: {before:.3?} {after:.3?}");
        for (sum, x) in sums.iter_mut().zip([before.0, before.1, after.0, after.1]) {
            *sum += x / SEEDS as f64;
        }
        assert!(after.0 < 0.1 && after.1 < 0.05, "{seed}: {after:?}");
    }
    println!("{sums:.3?}");
    assert!(sums[2] < 0.2 * sums[0] && sums[3] < 0.2 * sums[1], "{sums:?}");
}

#[test]
fn the_model_changes_without_a_jump() {
    for seed in 3..6 {
        for estimate in [false, true] {
            let record = flown("tilts", "cad", seed, SensorParams::IDEAL, estimate);
            let command = record.get("rotor_command").unwrap();
            let wrench = record.get("wrench_tool").unwrap();
            // What was taken for contact in hover is gone from one tick to the next.
            let size = |row: &[f64]| Vector3::new(row[0], row[1], row[2]).norm();
            let rows: Vec<&[f64]> = wrench.values.chunks_exact(6).collect();
            let (change, drop) = rows
                .windows(2)
                .enumerate()
                .skip((15.0 / PERIOD) as usize)
                .map(|(i, w)| (i + 1, size(w[0]) - size(w[1])))
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap();
            assert!(drop > 0.1, "{seed}: {drop}");
            let commands: Vec<&[f64]> = command.values.chunks_exact(6).collect();
            let step = |k: usize| {
                commands[k].iter().zip(commands[k - 1]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            };
            let usual = (change - 200..change - 5).map(step).fold(0.0, f64::max);
            let at = (change - 2..change + 20).map(step).fold(0.0, f64::max);
            println!("{seed} {estimate}: {drop:.3} N, {usual:.4} Hz then {at:.4} Hz");
            assert!(at < 2.0 * usual + 0.05, "{seed} {estimate}: {usual} Hz, then {at} Hz");
        }
    }
}

/// Force at the tool in the end, N, after a hover of a minute in which something pulls down, as a function of time.
fn carried(seed: u64, slowly: bool, pull: impl Fn(f64) -> f64) -> f64 {
    const STEP: f64 = 2.0;
    let config = config("tilts");
    let config =
        config.overlaid(format!("mission = {{ slow_learning = {slowly} }}").parse().unwrap()).unwrap();
    let pushes = (0..60)
        .map(|k| Push {
            at: SETTLED + f64::from(k) * STEP,
            duration: STEP,
            force: [0.0, 0.0, -pull(f64::from(k) * STEP)],
            torque: [0.0; 3],
        })
        .collect();
    let record = run(&Scenario {
        config: &config,
        start: Start::Ground(None),
        pushes: Pushes::new(pushes),
        duration: SETTLED + 115.0,
        truth: TruthSection::named("cad").unwrap(),
        sensors: SensorParams::EXPERIMENTS,
        seed,
        estimate: true,
        pose_delay: 0.015,
    })
    .unwrap();
    let rows: Vec<&[f64]> = record.get("wrench_tool").unwrap().values.chunks_exact(6).collect();
    let last = &rows[rows.len() - (5.0 / PERIOD) as usize..];
    last.iter().map(|row| row[2]).sum::<f64>() / last.len() as f64
}

/// A load that grows slowly is learnt as the vehicle's own; one that is put on at once stays felt.
#[test]
fn a_slow_load_is_learnt_and_a_sudden_one_is_felt() {
    for seed in [91, 92] {
        let slow = |time: f64| 0.6 * (time / 100.0).min(1.0);
        let (with, without) = (carried(seed, true, slow), carried(seed, false, slow));
        let sudden = carried(seed, true, |_| 0.6);
        println!("{seed}: slow load {with:.3} N, without learning {without:.3} N; sudden load {sudden:.3} N");
        assert!(with.abs() < 0.1 && without < -0.5, "{seed}: {with} {without}");
        assert!((sudden + 0.6).abs() < 0.1, "{seed}: {sudden}");
    }
}
