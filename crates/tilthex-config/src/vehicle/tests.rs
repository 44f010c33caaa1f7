//! The presets, what overrides them, and what is said of what is wrong.

use super::*;
use tilthex_core::{Matrix3, Vector3};

#[test]
fn the_presets_are_the_two_vehicles_of_the_paper() {
    for (name, mass, alpha) in [("tilt-hex", 2.4, 35f64), ("tilt-hex-light", 1.8, 30f64)] {
        let section = VehicleSection::preset(name).unwrap();
        assert_eq!(section.name(), name);
        let vehicle = section.vehicle();
        assert_eq!(vehicle.mass(), mass);
        assert_eq!(vehicle.inertia(), &Matrix3::from_diagonal(&Vector3::new(11.5e-3, 11.4e-3, 19.4e-3)));
        assert_eq!(vehicle.tool().position_r, Vector3::new(0.12, 0.0, -0.4));
        // Thrust axes lean by alpha about the arm and beta towards the centre.
        let lean = alpha.to_radians().cos() * 10f64.to_radians().cos();
        for rotor in vehicle.rotors() {
            assert!((rotor.axis_r.z - lean).abs() < 1e-15);
        }
    }
}

#[test]
fn keys_beside_a_preset_override_it() {
    let table = "preset = \"tilt-hex\"\nmass = 3\n[tilted_hexarotor]\nalpha_deg = 20".parse().unwrap();
    let section = VehicleSection::from_table(table, Path::new("")).unwrap();
    assert_eq!(section.vehicle().mass(), 3.0);
    assert_eq!(section.name(), "tilt-hex");
}

#[test]
fn rotors_beside_a_preset_replace_its_own() {
    let listed = VehicleSection::preset("tilt-hex").unwrap().vehicle().rotors().iter().fold(
        String::from("preset = \"tilt-hex-light\"\n"),
        |text, r| {
            let axes = |v: &Vector3| format!("[{}, {}, {}]", v.x, v.y, v.z);
            text + &format!(
                "[[rotors]]\nposition = {}\naxis = {}\nspin = {}\nthrust_coefficient = {}\n\
                 drag_coefficient = {}\nmin_speed = {}\nmax_speed = {}\n",
                axes(&r.position_r),
                axes(&r.axis_r),
                r.spin,
                r.thrust_coefficient,
                r.drag_coefficient,
                r.min_speed,
                r.max_speed
            )
        },
    );
    let section = VehicleSection::from_table(listed.parse().unwrap(), Path::new("")).unwrap();
    assert_eq!(section.vehicle().mass(), 1.8);
    assert_eq!(section.vehicle().rotors(), VehicleSection::preset("tilt-hex").unwrap().vehicle().rotors());
}

#[test]
fn what_is_wrong_is_said() {
    let sentence = |text: &str| {
        VehicleSection::from_table(text.parse().unwrap(), Path::new("")).unwrap_err().to_string()
    };
    assert_eq!(
        sentence("preset = 'tilthex'"),
        "[vehicle]: unknown preset `tilthex`; the nearest known one is `tilt-hex`"
    );
    assert_eq!(
        sentence("preset = 'tilt-hex'\nmas = 2"),
        "[vehicle]: unknown key `mas`; the nearest known one is `mass`"
    );
    assert_eq!(sentence("mass = 2"), "[vehicle]: `inertia` is missing; expected it to be given");
    assert_eq!(
        sentence("preset = 'tilt-hex'\nmass = -1"),
        "[vehicle]: mass is -1; expected a number from 0.001 to 1000"
    );
    assert!(sentence("preset = 'tilt-hex'\nmass = 'two'").starts_with("[vehicle]: "));
    assert!(
        sentence("preset = 'tilt-hex'\ninertia = [1, 2]").contains("found 2 numbers, expected 3 numbers")
    );
}
