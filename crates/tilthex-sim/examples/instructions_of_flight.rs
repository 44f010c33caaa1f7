//! Simulates a flight of some control periods, for a counter of instructions around it:
//! `valgrind --tool=callgrind target/release/examples/instructions_of_flight "closed loop, exact state" 1000`.
//! Without arguments it names the flights. `python -m benchmarks.instructions` makes a table.

use std::{hint::black_box, ops::ControlFlow};
use tilthex_config::{Config, TruthSection, VehicleSection};
use tilthex_core::{Matrix3, Vector3, plant::SensorParams, trajectory::Trajectory};
use tilthex_sim::{
    pushes::Pushes,
    simulate::{PERIOD, Scenario, Start, run_many},
};

const FLIGHTS: [(&str, bool); 2] = [("closed loop, exact state", false), ("closed loop, estimator", true)];

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, name, count] = arguments.as_slice() else {
        FLIGHTS.iter().for_each(|(name, _)| println!("{name}"));
        return;
    };
    let (_, estimate) = FLIGHTS
        .into_iter()
        .find(|(known, _)| known == name)
        .expect("a name that is printed without arguments");
    let config = Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset"));
    let scenario = Scenario {
        config: &config,
        start: Start::Air(Trajectory::hold(Vector3::new(0.0, 0.0, 1.0), Matrix3::identity())),
        pushes: Pushes::default(),
        duration: count.parse::<f64>().expect("a number") * PERIOD,
        truth: TruthSection::default(),
        sensors: SensorParams::EXPERIMENTS,
        seed: 1,
        estimate,
        pose_delay: 0.015,
    };
    black_box(run_many(&[scenario], &[], 1, |_| ControlFlow::Continue(())).expect("checked"));
}
