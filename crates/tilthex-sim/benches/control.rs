//! Cost of a controller tick and of a simulated period: `cargo bench -p tilthex-sim --bench control`.

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tilthex_config::{Config, TruthSection, VehicleSection};
use tilthex_core::{
    Matrix3, Setpoint, Vector3,
    controller::{Controller, ControllerInput, ControllerState},
    plant::{Plant, SensorParams},
    trajectory::Trajectory,
};
use tilthex_sim::{
    pushes::Pushes,
    simulate::{PERIOD, Scenario, Start, run},
};

fn tilt_hex() -> Config {
    Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset"))
}

fn tick(c: &mut Criterion) {
    let config = tilt_hex();
    let vehicle = *config.vehicle().vehicle();
    let controller = Controller::new(vehicle, *config.controller()).expect("checked");
    let hover = Plant::new(vehicle).hover(Vector3::zeros());
    let input = ControllerInput {
        state: hover.robot,
        specific_force_r: Vector3::new(0.1, 0.2, 9.8),
        rotor_speeds: hover.rotor_speeds,
        setpoint: Setpoint::hold(vehicle.tool().position_r, Matrix3::identity()),
        compliant: true,
        unyielding: None,
        learn_bias: false,
        lost_rotors: 0,
        fixed_attitude: false,
    };
    let mut state = ControllerState::default();
    c.bench_function("controller tick", |b| {
        b.iter(|| controller.step(&mut state, black_box(&input), PERIOD));
    });
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
