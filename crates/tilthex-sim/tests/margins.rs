//! The predicted gain margin against simulated flights: below it what a tap excites dies out, above it grows.

#![allow(clippy::unwrap_used)]

use tilthex_config::{
    Config, TruthSection, VehicleSection,
    margins::{AXES, HoverMargins, LoopModel},
};
use tilthex_core::{Matrix3, Vector3, plant::SensorParams, random::Random, trajectory::Trajectory};
use tilthex_sim::{
    pushes::{Push, Pushes},
    simulate::{Scenario, Start, run},
};

/// How far from the predicted margin a flight decides.
const OFF: f64 = 0.05;

/// A Tilt-Hex of another lag and inertia, on a line without delay, with gains of its own.
fn config(lag: f64, inertia: [f64; 3], gains: [f64; 4]) -> Config {
    let vehicle = VehicleSection::preset("tilt-hex").unwrap();
    let changes = format!("rotor_time_constant = {lag}\ninertia = {inertia:?}");
    let vehicle = vehicle.overlaid(changes.parse().unwrap()).unwrap();
    let [p, v, r, w] = gains;
    // The simulated rotors are commanded at once.
    let text = format!(
        "[link]\nloop_delay = 0\n[pose_control]\nposition_gain = {p}\nvelocity_gain = {v}\n\
         rotation_gain = {r}\nangular_velocity_gain = {w}\n"
    );
    Config::default_for(vehicle).overlaid(text.parse().unwrap()).unwrap()
}

/// The simulated rotors' speeds are measured without an age.
fn margins(config: &Config) -> HoverMargins {
    let mut model = LoopModel::of(config);
    model.delays.rotor_speeds = 0.0;
    model.hover()
}

/// By how much the oscillation of an axis grows over 0.9 s, some time after a tap.
fn growth(config: &Config, axis: usize) -> f64 {
    let mut direction = Vector3::zeros();
    direction[axis % 3] = 1.0;
    let tap = if axis < 3 { 1e-3 * config.vehicle().vehicle().weight() } else { 1e-3 } * direction;
    let (force, torque) = if axis < 3 { (tap, Vector3::zeros()) } else { (Vector3::zeros(), tap) };
    let push = Push { at: 0.1, duration: 0.02, force: force.into(), torque: torque.into() };
    let record = run(&Scenario {
        config,
        start: Start::Air(Trajectory::hold(Vector3::new(0.0, 0.0, 2.0), Matrix3::identity())),
        pushes: Pushes::new(vec![push]),
        duration: 2.0,
        truth: TruthSection::default(),
        sensors: SensorParams::IDEAL,
        seed: 1,
        estimate: false,
        pose_delay: 0.0,
    })
    .unwrap();
    let name = if axis < 3 { "velocity" } else { "angular_velocity" };
    let values: Vec<f64> = record.get(name).unwrap().values.chunks(3).map(|v| v[axis % 3]).collect();
    // Second differences, in which nothing slow is left.
    let fast: Vec<f64> = values.windows(3).map(|v| v[2] - 2.0 * v[1] + v[0]).collect();
    let size = |from: usize, to: usize| fast[from..to].iter().map(|x| x * x).sum::<f64>().sqrt();
    size(750, 950) / size(300, 500)
}

/// The configuration with the gains of one axis times a factor.
fn scaled(config: &Config, axis: usize, factor: f64) -> Config {
    let pose = config.controller().pose;
    let of = |gain: Vector3| {
        let mut gain = gain;
        gain[axis % 3] *= factor;
        format!("{:?}", [gain.x, gain.y, gain.z])
    };
    let (proportional, rate) = if axis < 3 {
        (("position_gain", pose.position), ("velocity_gain", pose.velocity))
    } else {
        (("rotation_gain", pose.rotation), ("angular_velocity_gain", pose.angular_velocity))
    };
    let text =
        format!("[pose_control]\n{} = {}\n{} = {}", proportional.0, of(proportional.1), rate.0, of(rate.1));
    config.overlaid(text.parse().unwrap()).unwrap()
}

#[test]
fn the_loop_is_stable_up_to_its_predicted_gain_margin() {
    // Two vehicles for each axis.
    for seed in 0..12 {
        let axis = seed as usize % 6;
        let mut random = Random::new(9100 + seed);
        let mut between = |low: f64, high: f64| low + (high - low) * random.uniform();
        let (lag, scale) = (between(0.02, 0.1), between(0.5, 2.0));
        let (p, r) = (between(3.0, 8.0), between(3.0, 8.0));
        let (of_p, of_r) = (between(0.6, 1.2), between(0.6, 1.2));
        let inertia = [11.5e-3 * scale, 11.4e-3 * scale, 19.4e-3 * scale];
        let config = config(lag, inertia, [p * p, 2.0 * of_p * p, r * r, 2.0 * of_r * r]);
        let found = margins(&config);
        let margin = found.axes[axis].gain_margin;
        assert!(found.stable && margin.is_finite(), "seed {seed}: {found:?}");
        let (below, above) =
            (scaled(&config, axis, margin * (1.0 - OFF)), scaled(&config, axis, margin * (1.0 + OFF)));
        assert!(margins(&below).stable && !margins(&above).stable, "seed {seed}");
        let (dies, grows) = (growth(&below, axis), growth(&above, axis));
        assert!(
            dies < 1.0 && grows > 1.0,
            "seed {seed}, {}: margin {margin}, below {dies}, above {grows}",
            AXES[axis]
        );
    }
}
