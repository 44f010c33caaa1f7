//! What is drawn is what the tables say, and what is wrong is said.

use super::*;
use crate::PRESETS;
use tilthex_core::{Vehicle, plant::RotorDrag, vehicle::Rotor};

fn model() -> VehicleSection {
    VehicleSection::preset("tilt-hex").unwrap()
}

fn truth(text: &str) -> Result<TruthSection, ConfigError> {
    TruthSection::from_table(text.parse().unwrap())
}

/// Mean and standard deviation of a number over draws, as parts of `sigma`.
fn statistics(section: &TruthSection, sigma: f64, number: impl Fn(&TrueVehicle) -> f64) -> (f64, f64) {
    let all: Vec<f64> =
        (0..2000).map(|seed| number(&section.draw(&model(), seed).unwrap()) / sigma).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    (mean, (all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt())
}

#[test]
fn an_exact_truth_is_the_model() {
    for (name, _) in PRESETS {
        let model = VehicleSection::preset(name).unwrap();
        let drawn = TruthSection::default().draw(&model, 5).unwrap();
        assert_eq!(drawn.vehicle, model);
        assert_eq!(
            drawn.effects,
            Effects { battery: drawn.effects.battery, rod: drawn.effects.rod, ..Effects::OFF }
        );
        assert!(drawn.effects.are_off());
        assert_eq!(drawn.sensors(&SensorParams::EXPERIMENTS), SensorParams::EXPERIMENTS);
    }
    assert_eq!(TruthSection::named("exact").unwrap(), TruthSection::default());
}

#[test]
fn the_levels_are_the_table_of_deviations() {
    let hex = model();
    let m: Vehicle = *hex.vehicle();
    let rotor = |v: &TrueVehicle, i: usize| -> Rotor { v.vehicle.vehicle().rotors()[i] };
    for (level, mass, common, each, drag, axis_deg, centre, inertia, lag, tip, gyro, accelerometer) in [
        ("measured", 0.01, 0.02, 0.01, 0.05, 0.5f64, 0.002, 0.05, 0.1, 0.001, 0.005, 0.05),
        ("cad", 0.03, 0.05, 0.03, 0.15, 1.5, 0.006, 0.15, 0.3, 0.003, 0.01, 0.1),
    ] {
        let section = TruthSection::named(level).unwrap();
        assert_eq!(section.name(), level);
        // A normal distribution cut at three deviations has 0.987 of its deviation; 2000 draws know it to 2 %.
        let check = |what: &str, sigma: f64, number: &dyn Fn(&TrueVehicle) -> f64| {
            let (mean, deviation) = statistics(&section, sigma, number);
            assert!(mean.abs() < 0.1, "{level} {what}: mean {mean}");
            assert!((deviation - 0.987).abs() < 0.06, "{level} {what}: deviation {deviation}");
        };
        check("mass", mass, &|v| v.vehicle.vehicle().mass() / m.mass() - 1.0);
        check("lag", lag, &|v| v.vehicle.vehicle().rotor_time_constant() / m.rotor_time_constant() - 1.0);
        check("each", each * 2f64.sqrt(), &|v| {
            (rotor(v, 0).thrust_coefficient - rotor(v, 3).thrust_coefficient)
                / m.rotors()[0].thrust_coefficient
        });
        let spread = (common * common + each * each).sqrt();
        check("thrust", spread, &|v| rotor(v, 2).thrust_coefficient / m.rotors()[2].thrust_coefficient - 1.0);
        check("drag", drag, &|v| rotor(v, 4).drag_coefficient / m.rotors()[4].drag_coefficient - 1.0);
        let side = m.rotors()[1].axis_r.cross(&Vector3::z()).normalize();
        check("axis", axis_deg.to_radians(), &|v| rotor(v, 1).axis_r.dot(&side));
        check("centre of mass", centre, &|v| v.centre_of_mass_r.y);
        check("tool", tip, &|v| {
            (v.vehicle.vehicle().tool().position_r + v.centre_of_mass_r - m.tool().position_r).x
        });
        check("gyro", gyro, &|v| v.sensors(&SensorParams::IDEAL).gyro_bias_i.z);
        check("accelerometer", accelerometer, &|v| v.sensors(&SensorParams::IDEAL).accelerometer_bias_i.x);
        // Moments that no body has are left out, which makes their deviation smaller.
        let (_, deviation) = statistics(&section, inertia, |v| {
            v.vehicle.vehicle().inertia()[(1, 1)] / m.inertia()[(1, 1)] - 1.0
        });
        assert!((0.7..1.05).contains(&deviation), "{level} inertia: {deviation}");
    }
}

#[test]
fn what_is_fixed_to_the_airframe_stays_when_the_centre_of_mass_is_elsewhere() {
    let hex = model();
    let drawn =
        truth("[error]\ncentre_of_mass = { mean = 0.004, std = 0.0 }").unwrap().draw(&hex, 1).unwrap();
    let (true_, m) = (drawn.vehicle.vehicle(), hex.vehicle());
    let c = Vector3::repeat(0.004);
    assert_eq!(drawn.centre_of_mass_r, c);
    for (a, b) in true_.rotors().iter().zip(m.rotors()) {
        assert!((a.position_r + c - b.position_r).amax() < 1e-15);
    }
    assert!((true_.tool().position_r + c - m.tool().position_r).amax() < 1e-15);
    assert!((true_.imu().position_r + c - m.imu().position_r).amax() < 1e-15);
    assert_eq!(drawn.sensors(&SensorParams::IDEAL).captured_r, -c);
}

#[test]
fn a_seed_is_a_vehicle() {
    let outdoors = TruthSection::named("outdoors").unwrap();
    let draw = |seed| outdoors.draw(&model(), seed).unwrap();
    assert_eq!(draw(3), draw(3));
    assert_ne!(draw(3), draw(4));
    let measured = TruthSection::named("measured").unwrap().draw(&model(), 3).unwrap();
    // The level beneath is drawn as without what lies on it.
    assert_eq!(draw(3).vehicle, measured.vehicle);
    assert!(draw(3).effects.wind.mean_w.norm() > 1.0 && !draw(3).effects.are_off());
}

#[test]
fn every_preset_can_be_drawn_at_every_level() {
    for (name, _) in PRESETS {
        let model = VehicleSection::preset(name).unwrap();
        for (level, _) in LEVELS {
            let section = TruthSection::named(level).unwrap();
            for seed in 0..100 {
                let drawn = section.draw(&model, seed).unwrap();
                assert_eq!(drawn.vehicle.name(), *name);
                let moments = drawn.vehicle.vehicle().inertia().symmetric_eigenvalues();
                assert!(
                    moments.iter().all(|j| 2.0 * j <= moments.sum() * (1.0 + 1e-12)),
                    "{name} {level} {seed}"
                );
            }
        }
    }
}

#[test]
fn keys_of_the_vehicle_and_distributions_over_levels() {
    let section = truth(
        "level = 'cad'\n[vehicle]\nmass = { mean = 3.0, std = 0.0 }\nimu_position = [0.01, 0.0, 0.02]\n\
         [error]\nmass = 0.0\ncentre_of_mass = 0.0\n[aerodynamics]\nwind_speed = { min = 2.0, max = 2.0 }\n\
         wind_direction_deg = 90\n[delays]\npose = 0.02\n",
    )
    .unwrap();
    assert_eq!(section.name(), "cad with own keys");
    let drawn = section.draw(&model(), 2).unwrap();
    assert_eq!(drawn.vehicle.vehicle().mass(), 3.0);
    assert_eq!(drawn.vehicle.vehicle().imu().position_r, Vector3::new(0.01, 0.0, 0.02));
    assert!((drawn.effects.wind.mean_w - Vector3::new(0.0, 2.0, 0.0)).amax() < 1e-15);
    assert_eq!(drawn.delays.pose, Some(0.02));
    let text = drawn.to_toml();
    assert!(text.contains("mass = 3.0") && text.contains("wind_speed = 2.0") && text.contains("seed 2"));
}

#[test]
fn the_drag_of_the_rotors_is_that_of_the_vehicle_unless_the_truth_has_its_own() {
    let keys = "rotor_drag = 2e-4\nflapping = 3e-7".parse().unwrap();
    let model = model().overlaid(keys).unwrap();
    let drag = |text: &str| truth(text).unwrap().draw(&model, 4).unwrap();
    let of = |drawn: TrueVehicle| (drawn.effects.rotor_drag.drag, drawn.effects.rotor_drag.flapping);
    assert_eq!(of(drag("")), (2e-4, 3e-7));
    // Another vehicle than the model's keeps them too.
    let cad = drag("level = 'cad'");
    assert_ne!(cad.vehicle, model);
    assert_eq!(cad.vehicle.rotor_drag(), model.rotor_drag());
    assert_eq!(of(cad), (2e-4, 3e-7));
    assert_eq!(of(drag("[aerodynamics]\nrotor_drag = 0.0")), (0.0, 3e-7));
    assert_eq!(of(drag("[vehicle]\nflapping = 0.0")), (2e-4, 0.0));
    assert_eq!(drag("").throttle_exponent(), None);
    assert_eq!(drag("[structure]\nthrottle_exponent = 0.7").throttle_exponent(), Some(0.7));
}

#[test]
fn the_wall_is_where_its_direction_says() {
    let drawn =
        truth("[aerodynamics]\nwall = 2.0\nwall_direction_deg = 90\nrotor_radius = 0.1\nground = 0.5")
            .unwrap()
            .draw(&model(), 0)
            .unwrap();
    let distance = |s: Surface, p: Vector3| s.normal_w.dot(&p) - s.offset;
    let [Some(ground), Some(wall)] = drawn.effects.surfaces else { panic!("two surfaces") };
    assert!((distance(wall, Vector3::new(7.0, 1.5, 0.0)) - 0.5).abs() < 1e-12);
    assert!((distance(ground, Vector3::new(7.0, 1.5, 1.0)) - 0.5).abs() < 1e-12);
}

#[test]
fn a_vehicle_that_is_there_prints_and_reads_as_itself() {
    for seed in 0..20 {
        let drawn = TruthSection::named("cad").unwrap().draw(&model(), seed).unwrap().vehicle;
        let mut turned = *drawn.vehicle();
        let angle = 0.3 * seed as f64 - 3.0;
        let rotation_r = so3::rot_z(angle) * so3::rot_y(0.5 * angle) * so3::rot_x(1.0 - angle);
        turned = turned.with_tool(tilthex_core::vehicle::Mounting { rotation_r, ..*turned.tool() }).unwrap();
        let section = VehicleSection::of("own", turned, RotorDrag { drag: 2e-4, flapping: -3e-7 });
        let text = section.to_toml();
        let table = text.parse::<Table>().unwrap().remove("vehicle").unwrap();
        let again = VehicleSection::from_table(table.as_table().unwrap().clone(), Path::new("")).unwrap();
        assert_eq!(again.vehicle().rotors(), turned.rotors());
        assert_eq!(again.vehicle().mass(), turned.mass());
        assert_eq!(again.rotor_drag(), section.rotor_drag());
        assert!((again.vehicle().tool().rotation_r - rotation_r).amax() < 1e-12);
        assert_eq!(again.vehicle().tool().position_r, turned.tool().position_r);
    }
}

#[test]
fn what_is_wrong_is_said() {
    let sentence = |text: &str| truth(text).unwrap_err().to_string();
    assert_eq!(
        sentence("level = 'cda'"),
        "[truth]: unknown level `cda`; the nearest known one is `cad`; a file's name ends in .toml"
    );
    // A text of TOML in the place of a level's name is not repeated in the sentence.
    assert_eq!(
        TruthSection::named("level = 'cad'\n").unwrap_err().to_string(),
        "[truth]: found a text of several lines; expected a level, or the name of a file, which ends in .toml"
    );
    assert_eq!(
        sentence("[aerodynamic]\nwind_speed = 1"),
        "[truth]: unknown key `aerodynamic`; the nearest known one is `aerodynamics`"
    );
    assert_eq!(
        sentence("[aerodynamics]\nwind_sped = 1"),
        "[truth.aerodynamics]: unknown key `wind_sped`; the nearest known one is `wind_speed`"
    );
    assert_eq!(
        sentence("[error]\nmass = { std = -0.1 }"),
        "[truth.error] mass: has mean = 0 and std = -0.1; expected finite numbers, std 0 or above"
    );
    assert!(sentence("[sensors]\ngyro_bias = 'x'").starts_with("[truth.sensors]: "));
    assert!(sentence("[structure]\nrotor_inertia = -1").contains("rotor_inertia is -1"));
    assert!(sentence("[delays]\nrotor_speeds = 0.2").contains("rotor_speeds is 0.2"));
    let refused = |text: &str| truth(text).unwrap().draw(&model(), 3).unwrap_err().to_string();
    assert_eq!(
        refused("[error]\nmass = -2.0"),
        "[truth] exact with own keys, seed 3: mass is -2.4; expected a number from 0.001 to 1000"
    );
    assert!(refused("[vehicle]\nmas = 2").contains("unknown key `mas`"));
    assert!(TruthSection::named("nowhere.toml").unwrap_err().to_string().contains("nowhere.toml"));
}
