//! Simulates a flight of some control periods, for a counter of instructions around it:
//! `valgrind --tool=callgrind target/release/examples/instructions_of_flight "closed loop, exact state" 1000`.
//! Without arguments it names the flights. `python -m benchmarks.instructions` makes a table.

use std::{hint::black_box, ops::ControlFlow};
use tilthex_config::{Config, TruthSection, VehicleSection};
use tilthex_core::{Matrix3, Vector3, plant::SensorParams, trajectory::Trajectory};
use tilthex_sim::{
    pushes::{Push, Pushes},
    simulate::{PERIOD, Scenario, Start, run_many},
};

/// The flights: their names, whether the estimator runs, and whether the sensors have noise. Those without noise are pushed all
/// the time, as in `python -m benchmarks`.
const FLIGHTS: [(&str, bool, bool); 4] = [
    ("closed loop, exact state", false, true),
    ("closed loop, estimator", true, true),
    ("closed loop, exact state, pushed without noise", false, false),
    ("closed loop, estimator, pushed without noise", true, false),
];

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, name, count] = arguments.as_slice() else {
        FLIGHTS.iter().for_each(|(name, ..)| println!("{name}"));
        return;
    };
    let (_, estimate, noise) = FLIGHTS
        .into_iter()
        .find(|(known, ..)| known == name)
        .expect("a name that is printed without arguments");
    let config = Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset"));
    let duration = count.parse::<f64>().expect("a number") * PERIOD;
    let push = Push { at: 0.0, duration, force: [1.4, 0.0, 0.0], torque: [0.0; 3] };
    let scenario = Scenario {
        config: &config,
        start: Start::Air(Trajectory::hold(Vector3::new(0.0, 0.0, 1.0), Matrix3::identity())),
        pushes: Pushes::new(if noise { vec![] } else { vec![push] }),
        duration,
        truth: TruthSection::default(),
        sensors: if noise { SensorParams::EXPERIMENTS } else { SensorParams::IDEAL },
        seed: 1,
        estimate,
        pose_delay: 0.015,
    };
    black_box(run_many(&[scenario], &[], 1, |_| ControlFlow::Continue(())).expect("checked"));
}
