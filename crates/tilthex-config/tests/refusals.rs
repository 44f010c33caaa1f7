//! Configurations that cannot fly, or are in another unit: one sentence when they are read, or before a motor starts.

use std::path::Path;

use proptest::prelude::*;
use tilthex_config::Config;

fn read(text: &str) -> Result<Config, String> {
    Config::from_text(text, Path::new("")).map_err(|e| e.to_string())
}

/// What is said of a Tilt-Hex with some keys, when it is read or before it flies.
fn said(text: &str) -> String {
    let whole = format!("vehicle.preset = \"tilt-hex\"\n{text}");
    let found = read(&whole).and_then(|config| config.linked_params(true).map_err(|e| e.to_string()));
    let said = found.map_or_else(|sentence| sentence, |_| "flies".into());
    assert!(!said.contains('\n'), "{said}");
    said
}

proptest! {
    #[test]
    fn poses_too_old_to_fly_on_are_refused(mocap in 0.0..1.0f64, constant in -0.05..0.15f64) {
        let said = said(&format!("mocap.latency = {mocap}\nestimator.latency = {constant}"));
        prop_assert_eq!(said == "flies", mocap + constant.max(0.0) <= 0.08 || mocap == 0.0, "{}", said);
        prop_assert!(said == "flies" || said.contains("count as lost"), "{}", said);
    }

    /// The line carries a tenth of its bits a second in bytes; nine tenths of that may be used.
    #[test]
    fn a_line_too_slow_for_its_streams_is_refused(
        baud in prop::sample::select(vec![57_600, 115_200, 500_000, 2_000_000]), imu in 100.0..1000.0f64, motor in 10.0..1000.0f64,
    ) {
        let said = said(&format!("link.baud = {baud}\nlink.imu_rate = {imu}\nlink.motor_rate = {motor}"));
        // A frame has two marks: 16 bytes of the IMU with its temperature, 9 of each motor.
        let needed = imu * 18.0 + 6.0 * motor * 11.0 + 6.0;
        prop_assert_eq!(said == "flies", needed <= 0.09 * f64::from(baud), "{}", said);
        prop_assert!(said == "flies" || said.contains("bytes/s each way; the streams need"), "{}", said);
    }

    /// Three moments of any body: the integrals of y^2 + z^2, x^2 + z^2 and x^2 + y^2.
    #[test]
    fn only_inertia_that_no_body_has_is_refused(x in 1e-4..1e-2f64, y in 1e-4..1e-2f64, z in 1e-4..1e-2f64, over in 1.05..3.0f64) {
        let body = [y + z, x + z, x + y];
        let text = |i: [f64; 3]| format!("vehicle.inertia = [{}, {}, {}]", i[0], i[1], i[2]);
        prop_assert_eq!(said(&text(body)), "flies");
        let none = [body[0], body[1], over * (body[0] + body[1])];
        let said = said(&text(none));
        prop_assert!(said.contains("none above the sum of the other two"), "{}", said);
    }

    #[test]
    fn a_vehicle_flies_where_its_rotors_carry_it(mass in 0.5..20.0f64, max in 30.0..200.0f64) {
        let said = said(&format!("vehicle.mass = {mass}\nvehicle.tilted_hexarotor.max_speed = {max}"));
        // The preset's 2.4 kg hover at some 73 Hz; thrust goes with the square of the speed.
        let level = read("vehicle.preset = \"tilt-hex\"").expect("valid");
        let hover = level.vehicle().vehicle().hover_speeds(&tilthex_core::Matrix3::identity()).amax() * (mass / 2.4).sqrt();
        prop_assume!((hover / max - 1.0).abs() > 0.02);
        if hover < max {
            prop_assert_eq!(said, "flies");
        } else {
            prop_assert!(said.contains("it cannot hover"), "{}", said);
            prop_assert!(said.contains(&format!("{hover:.1} Hz")), "{}", said);
        }
    }
}

#[test]
fn the_default_line_flies_and_the_slow_one_is_refused_with_the_arithmetic() {
    assert_eq!(said("link.baud = 500000"), "flies");
    assert_eq!(said("link.baud = 0"), "flies");
    assert_eq!(
        said("link.baud = 115200"),
        "[link]: baud is 115200, which carries 11520 bytes/s each way; the streams need 25506 from the vehicle (500 Hz x 18 \
         bytes of the IMU + 6 x 250 Hz x 11 bytes of the motors + 1 Hz x 6 bytes of the battery) and 7500 to it: use a faster \
         line, or lower imu_rate and motor_rate"
    );
}

#[test]
fn numbers_in_another_unit_are_questioned() {
    for (text, expected) in [
        ("vehicle.tilted_hexarotor.arm = 390.0", "is it in mm?"),
        ("vehicle.tool_position = [120.0, 0.0, -400.0]", "tool_position is 417.6123 m"),
        ("vehicle.imu_position = [10.0, 0.0, 0.0]", "imu_position is 10.0000 m"),
        ("vehicle.tilted_hexarotor.max_speed = 6600.0", "is it in rpm?"),
        ("vehicle.tilted_hexarotor.thrust_coefficient = 3.2e-7", "it cannot hover"),
        (
            "vehicle.tilted_hexarotor.min_speed = 100.0\nvehicle.tilted_hexarotor.max_speed = 110.0",
            "it cannot hover",
        ),
        ("vehicle.mass = 2400.0", "mass is 2400 kg; expected 1000 kg at most: is it in grams?"),
        ("mocap.latency = 0.158", "latency is 0.158 s; expected 0.08 s at most"),
    ] {
        let said = said(text);
        assert!(said.contains(expected), "{text}: {said}");
    }
    let warnings = |text: &str| {
        read(&format!("vehicle.preset = \"tilt-hex\"\n{text}")).expect("valid").warnings().join("; ")
    };
    assert_eq!(warnings(""), "");
    let retired = warnings("estimator.coast_after = 0.2\nestimator.lost_position = 1.0");
    assert!(retired.contains("[estimator] coast_after has no effect"), "{retired}");
    assert!(retired.contains("[estimator] lost_position has no effect"), "{retired}");
    assert!(warnings("vehicle.mass = 240.0").contains("in grams?"));
    assert!(warnings("vehicle.inertia = [11500.0, 11400.0, 19400.0]").contains("in kg m^2?"));
    assert!(warnings("vehicle.inertia = [1.15e-8, 1.14e-8, 1.94e-8]").contains("in kg m^2?"));
}

#[test]
fn every_preset_hovers_and_asks_nothing() {
    for (name, _) in tilthex_config::PRESETS {
        let config = read(&format!("vehicle.preset = \"{name}\"")).expect("valid");
        config.linked_params(true).expect("flies");
        let questions = config.warnings().into_iter().filter(|text| text.contains("is it in")).count();
        assert_eq!(questions, 0, "{name}");
    }
}
