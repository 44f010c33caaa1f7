//! Cost of a controller tick and of a simulated period: `cargo bench -p tilthex-sim --bench control`.

use criterion::{Criterion, criterion_group, criterion_main};
use std::{
    hint::black_box,
    time::{Duration, Instant},
};
use tilthex_config::{Config, TruthSection, VehicleSection};
use tilthex_core::{
    GRAVITY, Matrix3, RobotState, Setpoint, Vector3, Vehicle,
    controller::{Controller, ControllerInput, ControllerState},
    plant::{Plant, SensorParams},
    random::Random,
    so3,
    trajectory::Trajectory,
};
use tilthex_sim::{
    pushes::Pushes,
    simulate::{PERIOD, Scenario, Start, run},
};

fn tilt_hex() -> Config {
    Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset"))
}

/// The input of a tick in a hover, with a small force to the side.
fn hover(vehicle: &Vehicle) -> ControllerInput {
    let state = Plant::new(*vehicle).hover(Vector3::zeros());
    ControllerInput {
        state: state.robot,
        specific_force_r: Vector3::new(0.1, 0.2, 9.8),
        rotor_speeds: state.rotor_speeds,
        setpoint: Setpoint::hold(vehicle.tool().position_r, Matrix3::identity()),
        compliant: true,
        unyielding: None,
        learn_bias: false,
        lost_rotors: 0,
        fixed_attitude: false,
    }
}

fn tick(c: &mut Criterion) {
    let config = tilt_hex();
    let vehicle = *config.vehicle().vehicle();
    let controller = Controller::new(vehicle, *config.controller()).expect("checked");
    let input = hover(&vehicle);
    println!("slowest of 1000000 random controller ticks: {:.1} us", slowest_tick(&controller, 1_000_000));
    let mut state = ControllerState::default();
    c.bench_function("controller tick", |b| {
        b.iter(|| {
            // By reference: the output is not copied.
            black_box(&controller.step(&mut state, black_box(&input), PERIOD));
        });
    });
}

/// Time of the slowest of many ticks, us: far from the set-point, pushed, tilted, and turning, so that rotors reach their
/// limits and force is given up. A machine that stands still must not count: of the ticks that took longest, each is
/// repeated from its state.
fn slowest_tick(controller: &Controller, count: usize) -> f64 {
    let mut random = Random::new(5);
    let mut state = ControllerState::default();
    let mut slowest: Vec<(Duration, ControllerState, ControllerInput)> = Vec::new();
    let timed = |state: &ControllerState, input: &ControllerInput| {
        let mut state = *state;
        let start = Instant::now();
        black_box(controller.step(&mut state, black_box(input), PERIOD));
        (start.elapsed(), state)
    };
    let hover = hover(controller.vehicle());
    for _ in 0..count {
        let size = 10f64.powf(3.0 * random.uniform() - 3.0);
        let rotation_wr = so3::exp(&random.normal3(size));
        let input = ControllerInput {
            state: RobotState {
                position_w: random.normal3(size),
                velocity_w: random.normal3(size),
                rotation_wr,
                angular_velocity_r: random.normal3(3.0 * size),
            },
            specific_force_r: rotation_wr.transpose() * Vector3::z() * GRAVITY + random.normal3(10.0 * size),
            ..hover
        };
        let (_, next) = timed(&state, &input);
        let time = (0..3).map(|_| timed(&state, &input).0).min().unwrap_or_default();
        if slowest.len() < 100 || slowest.last().is_some_and(|(least, ..)| time > *least) {
            slowest.push((time, state, input));
            slowest.sort_by_key(|tick| std::cmp::Reverse(tick.0));
            slowest.truncate(100);
        }
        state = next;
    }
    let least = |(_, state, input): &(Duration, ControllerState, ControllerInput)| {
        (0..50).map(|_| timed(state, input).0).min().unwrap_or_default()
    };
    slowest.iter().map(least).max().unwrap_or_default().as_secs_f64() * 1e6
}

fn closed_loop(c: &mut Criterion) {
    let config = tilt_hex();
    for (name, estimate) in [("exact state", false), ("estimator", true)] {
        let scenario = Scenario {
            config: &config,
            start: Start::Air(Trajectory::hold(Vector3::new(0.0, 0.0, 1.0), Matrix3::identity())),
            pushes: Pushes::default(),
            duration: 1000.0 * PERIOD,
            truth: TruthSection::default(),
            sensors: SensorParams::EXPERIMENTS,
            seed: 1,
            estimate,
            pose_delay: 0.015,
        };
        c.bench_function(&format!("closed loop, 1000 periods, {name}"), |b| {
            b.iter(|| run(black_box(&scenario)).expect("checked"));
        });
    }
}

criterion_group!(benches, tick, closed_loop);
criterion_main!(benches);
