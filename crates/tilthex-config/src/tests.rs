use super::*;
use proptest::prelude::*;

fn tilt_hex() -> Config {
    Config::default_for(VehicleSection::preset("tilt-hex").unwrap())
}

fn read(text: &str) -> Result<Config, String> {
    let text = format!("[vehicle]\npreset = \"tilt-hex\"\n{text}");
    Config::from_text(&text, Path::new("")).map_err(|e| e.to_string())
}

#[test]
fn every_preset_has_a_default_without_warnings() {
    for (name, _) in PRESETS {
        let config = Config::default_for(VehicleSection::preset(name).unwrap());
        assert!(config.warnings().is_empty(), "{name}: {:?}", config.warnings());
    }
}

#[test]
fn the_defaults_of_the_tilt_hex_are_those_of_the_core() {
    assert_eq!(*tilt_hex().controller(), ControllerParams::default());
}

#[test]
fn an_empty_set_up_is_the_default() {
    assert_eq!(read("").unwrap(), tilt_hex());
}

#[test]
fn the_printed_set_up_reads_back_and_explains_every_key() {
    let config = tilt_hex();
    let text = config.to_toml();
    assert_eq!(Config::from_text(&text, Path::new("")).unwrap(), config);
    let lines: Vec<_> = text.lines().collect();
    for (above, line) in lines.iter().zip(&lines[1..]) {
        assert!(
            line.starts_with('#') || !line.contains(" = ") || above.starts_with('#'),
            "no comment above {line}"
        );
    }
}

#[test]
fn what_is_wrong_is_said_in_one_sentence() {
    let cases = [
        ("[admitance]", "unknown section `admitance`; the nearest known one is `admittance`"),
        (
            "[pose_control]\npositon_gain = 3",
            "[pose_control]: unknown key `positon_gain`; the nearest known one is `position_gain`",
        ),
        (
            "[pose_control]\nposition_gain = -1",
            "[pose_control]: position_gain is -1; expected a number from 0 to 100000",
        ),
        (
            "[wrench_observer]\nforce_gain = 0.0",
            "[wrench_observer]: force_gain is 0; expected a number from 0.000001 to 100000",
        ),
        (
            "[pose_control]\nposition_gain = [1, 2]",
            "[pose_control]: found 2 numbers, expected one number or 3 in `position_gain`",
        ),
        (
            "[admittance]\nmass = [1, 2]",
            "[admittance]: found 2 numbers, expected 6 numbers (the diagonal) or 6x6 in `mass`",
        ),
        ("[admittance]\nforce_dead_zone = nan", "[admittance]: force_dead_zone holds a NaN"),
        (
            "[allocation]\norder = ['yaw-torq']",
            "[allocation] order: unknown part `yaw-torq`; the nearest known one is `yaw-torque`",
        ),
        (
            "[allocation]\norder = ['yaw-torque']",
            "[allocation] order: found 1 parts, expected each of 4 once",
        ),
        ("[allocation]\nhorizon = -1", "[allocation]: "),
        (
            "[link]\nbaud = 'fast'",
            "[link]: invalid type: string \"fast\", expected a whole number from 0 to 4294967295 in `baud`",
        ),
        (
            "[link]\nbaud = -1",
            "[link]: invalid value: integer `-1`, expected a whole number from 0 to 4294967295 in `baud`",
        ),
        (
            "[link]\nbaud = 4294967296",
            "[link]: invalid value: integer `4294967296`, expected a whole number from 0 to 4294967295 in `baud`",
        ),
        (
            "[admittance]\ntorque_dead_zone = 'small'",
            "[admittance]: invalid type: string \"small\", expected a number in `torque_dead_zone`",
        ),
        ("link = 3", "[link]: found an integer; expected a table"),
        ("x = = 3", "line 3: "),
    ];
    for (text, expected) in cases {
        // Texts without a header belong above [vehicle].
        let found = if text.starts_with('[') {
            read(text).unwrap_err()
        } else {
            let text = format!("{text}\n[vehicle]\npreset = \"tilt-hex\"\n");
            Config::from_text(&text, Path::new("")).unwrap_err().to_string()
        };
        let expected = expected.replace("line 3", "line 1");
        assert!(found.starts_with(&expected), "{text}: {found}");
        assert!(!found.contains('\n'));
    }
    let none = Config::from_text("", Path::new("")).unwrap_err().to_string();
    assert!(none.starts_with("no [vehicle] section"), "{none}");
}

#[test]
fn an_overlay_changes_only_its_keys() {
    let changed =
        tilt_hex().overlaid("[admittance]\nstiffness = [8, 8, 8, 1, 1, 1]".parse().unwrap()).unwrap();
    assert_eq!(changed.controller().admittance.stiffness[(0, 0)], 8.0);
    assert_eq!(changed.controller().pose, tilt_hex().controller().pose);
    assert_eq!(changed.admittance.mass, tilt_hex().admittance.mass);
    let heavier = changed.overlaid("[vehicle]\nmass = 3".parse().unwrap()).unwrap();
    assert_eq!((heavier.vehicle.vehicle().mass(), heavier.vehicle.name()), (3.0, "tilt-hex"));
    let other = heavier.overlaid("[vehicle]\npreset = 'tilt-hex-light'".parse().unwrap()).unwrap();
    assert_eq!((other.vehicle.vehicle().mass(), &other.admittance), (1.8, &changed.admittance));
}

proptest! {
    #[test]
    fn gains_and_matrices_survive_printing(
        gains in proptest::array::uniform3(0.0..1e4f64),
        diagonal in proptest::array::uniform6(0.1..15.0f64),
        coupling in -0.05..0.05f64,
    ) {
        let mut config = tilt_hex();
        config.pose_control.position_gain = Axes(gains);
        config.admittance.damping = Square::diagonal(diagonal);
        config.admittance.damping.0[(0, 4)] = coupling;
        config.admittance.damping.0[(4, 0)] = coupling;
        let back = Config::from_text(&config.to_toml(), Path::new("")).unwrap();
        prop_assert_eq!(back.pose_control, config.pose_control);
        prop_assert_eq!(back.admittance, config.admittance);
    }

    #[test]
    fn no_text_panics(text in "[\\[\\]a-z_=\"0-9.\n {}-]{0,80}") {
        let _ = Config::from_text(&text, Path::new(""));
        let _ = read(&text);
    }
}

#[test]
fn drag_of_the_rotors_is_that_of_the_vehicle_unless_contact_has_its_own() {
    let vehicle = "[vehicle]\npreset = \"tilt-hex\"\nrotor_drag = 2e-4\nflapping = -3e-7\n";
    let drag = |text: &str| {
        let config = Config::from_text(&format!("{vehicle}{text}"), Path::new("")).unwrap();
        let again = Config::from_text(&config.to_toml(), Path::new("")).unwrap();
        assert_eq!(config, again);
        let found = config.controller().contact.rotor_drag;
        (found.drag, found.flapping)
    };
    assert_eq!(drag(""), (2e-4, -3e-7));
    assert_eq!(drag("[contact]\nrotor_drag = 0.0\n"), (0.0, -3e-7));
    assert_eq!(drag("[contact]\nflapping = 1e-6\n"), (2e-4, 1e-6));
    // A change of the vehicle reaches the observer.
    let config = Config::from_text(vehicle, Path::new("")).unwrap();
    let changed = config.overlaid("vehicle.rotor_drag = 4e-4".parse().unwrap()).unwrap();
    assert_eq!(changed.controller().contact.rotor_drag.drag, 4e-4);
    let refused = Config::from_text(&vehicle.replace("2e-4", "-2e-4"), Path::new("")).unwrap_err();
    assert!(
        refused.to_string().contains("rotor_drag is -0.0002; expected a number from 0 to 1"),
        "{refused}"
    );
}
