//! Orders as text, and their bounds.

use super::*;
use proptest::prelude::*;

use crate::VehicleSection;

const LIMITS: Limits =
    Limits { velocity: 0.5, acceleration: 1.0, angular_velocity: 0.5, angular_acceleration: 1.0 };

fn orders() -> Orders {
    Orders::new(&Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset")))
}

/// The refusal of an order.
fn refused(line: &str) -> String {
    orders().parse(line).expect_err(line)
}

const LEVEL: &str = r#""position": [0, 0, 1], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]"#;

#[test]
fn what_the_vehicle_cannot_do_is_refused_with_the_number() {
    for (line, says) in [
        (r#"{"command": "set_wrench", "force": [0, 0, -1e308]}"#.to_string(), "force"),
        (r#"{"command": "set_wrench", "force": [0, 1000, 0]}"#.to_string(), "force"),
        (r#"{"command": "set_wrench", "force": [25, 0, 0]}"#.to_string(), "exert this wrench at its tool"),
        (r#"{"command": "set_wrench", "torque": [0, 0, 900]}"#.to_string(), "torque"),
        (r#"{"command": "set_wrench", "force_axes": ["w"]}"#.to_string(), "expected any of x, y, z, rx, ry, rz"),
        (
            r#"{"command": "set_wrench", "force_axes": ["z"], "surface": [[1, 0, 0], [0, 1, 0], [0, 0, 2]]}"#.to_string(),
            "surface",
        ),
        (format!(r#"{{"command": "follow", {LEVEL}, "velocity": [0, 0, -100]}}"#), "velocity"),
        (format!(r#"{{"command": "follow", {LEVEL}, "acceleration": [50, 0, 0]}}"#), "acceleration"),
        (format!(r#"{{"command": "follow", {LEVEL}, "angular_velocity": [0, 0, 10]}}"#), "angular velocity"),
        (format!(r#"{{"command": "follow", {LEVEL}, "angular_acceleration": [0, 99, 0]}}"#), "angular acceleration"),
        (format!(r#"{{"command": "follow", {LEVEL}, "wrench": {{"force": [500, 0, 0]}}}}"#), "force"),
        (
            r#"{"command": "follow", "position": [0, 0, 1], "rotation": [[1, 0, 0], [0, -1, 0], [0, 0, -1]]}"#
                .to_string(),
            "attitude",
        ),
        (
            r#"{"command": "play", "waypoint": [{"position": [0, 0, 1]}], "limits": {"velocity": 100}}"#.to_string(),
            "velocity",
        ),
        (
            r#"{"command": "play", "waypoint": [{"position": [0, 0, 1], "yaw_pitch_roll_deg": [0, 180, 0]}]}"#
                .to_string(),
            "attitude",
        ),
        (
            r#"{"command": "play", "waypoint": [{"position": [0, 0, 1], "force": [0, 0, 300]}]}"#.to_string(),
            "force",
        ),
        (r#"{"command": "set_admittance", "mass": [1e-3, 1e-3, 1e-3, 0.01, 0.01, 0.02]}"#.to_string(), "mass"),
        (r#"{"command": "set_admittance", "mass": [1.5, 1.5, 1.5, 1e-9, 0.01, 0.02]}"#.to_string(), "mass"),
        (r#"{"command": "set_admittance", "damping": [0, 0, 0, 0, 0, 0]}"#.to_string(), "damping"),
        (r#"{"command": "set_admittance", "max_translation": 99}"#.to_string(), "max_translation"),
        (r#"{"command": "set_admittance", "max_rotation_deg": 170}"#.to_string(), "max_rotation_deg"),
    ] {
        let error = refused(&line);
        assert!(error.contains(says), "{line}: {error}");
    }
}

#[test]
fn what_the_vehicle_can_do_is_taken() {
    for line in [
        r#"{"command": "set_wrench", "force": [3, 0, 2], "torque": [0.1, 0, 0]}"#.to_string(),
        r#"{"command": "set_wrench", "force": [0, 0, -7]}"#.to_string(),
        r#"{"command": "set_wrench", "force": [0, 0, -7], "force_axes": ["z", "rx"]}"#.to_string(),
        r#"{"command": "play", "waypoint": [{"position": [0, 0, 1], "force_axes": ["y"],
            "surface": [[1, 0, 0], [0, 0, -1], [0, 1, 0]]}]}"#
            .replace('\n', " "),
        format!(r#"{{"command": "follow", {LEVEL}, "velocity": [0.5, 0, 0], "wrench": {{"force": [2, 0, 0]}}}}"#),
        r#"{"command": "play", "waypoint": [{"position": [0, 0, 1], "yaw_pitch_roll_deg": [90, 8, 0]}]}"#.to_string(),
        r#"{"command": "set_admittance", "mass": [0.75, 0.75, 0.75, 0.01, 0.01, 0.02]}"#.to_string(),
        r#"{"command": "set_admittance", "damping": [3.5, 5, 40, 1.5, 1.5, 1.5], "stiffness": [0, 0, 0, 0, 0, 0]}"#
            .to_string(),
        r#"{"command": "set_admittance", "max_translation": 0.3, "max_rotation_deg": 20}"#.to_string(),
    ] {
        if let Err(error) = orders().parse(&line) {
            panic!("{line}: {error}");
        }
    }
}

#[test]
fn orders_without_arguments() {
    for (text, command) in [
        ("take_off", Command::TakeOff),
        ("release_wrench", Command::ReleaseWrench),
        ("zero_bias", Command::ZeroBias),
    ] {
        assert_eq!(orders().parse(&format!("{{\"command\": \"{text}\"}}")), Ok(command));
    }
}

#[test]
fn admittance_changes_add_up() {
    let mut orders = orders();
    let line = r#"{"command": "set_admittance", "stiffness": [8, 8, 8, 10, 10, 5]}"#;
    orders.parse(line).expect("valid");
    let Ok(Command::SetAdmittance(filter)) =
        orders.parse(r#"{"command": "set_admittance", "max_translation": 0.5}"#)
    else {
        panic!("an admittance filter")
    };
    assert_eq!(filter.params().stiffness[(0, 0)], 8.0);
    assert_eq!(filter.params().max_translation, 0.5);
    let error = orders.parse(r#"{"command": "set_admittance", "mass": [0, 0, 0, 0, 0, 0]}"#);
    assert!(error.expect_err("refused").contains("mass"));
}

#[test]
fn each_form_of_orientation_means_the_same() {
    let forms = [
        r#""rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]"#,
        r#""quaternion_xyzw": [0, 0, 0.7071067811865476, 0.7071067811865476]"#,
        r#""yaw_pitch_roll_deg": [90, 0, 0]"#,
    ];
    let rotations = forms.map(|form| {
        let line = format!(r#"{{"command": "play", "waypoint": [{{"position": [0, 0, 1], {form}}}]}}"#);
        match orders().parse(&line) {
            Ok(Command::Play(route)) => route.waypoints()[0].rotation_we,
            other => panic!("{other:?}"),
        }
    });
    for rotation in rotations {
        assert!((rotation - rotations[0]).norm() < 1e-12, "{rotation}");
    }
}

#[test]
fn what_is_malformed_is_refused_with_a_reason() {
    for (line, reason) in [
        ("land", "not a JSON object"),
        ("{}", "no command"),
        (r#"{"command": "fly"}"#, "no such command"),
        (r#"{"command": "take_off", "now": true}"#, "unknown field `now`"),
        (r#"{"command": "play"}"#, "0 way-points"),
        (r#"{"command": "play", "waypoint": [{"position": [0, 0]}]}"#, "invalid length 2"),
        (r#"{"command": "follow", "position": [0,0,1], "rotation": [[1,0,0],[0,1,0],[0,0,2]]}"#, "rotation"),
        (r#"{"command": "set_wrench", "force": [1e999, 0, 0]}"#, "number out of range"),
    ] {
        let error = orders().parse(line).expect_err(line);
        assert!(error.contains(reason), "{line}: {error}");
    }
}

proptest! {
    #[test]
    fn no_line_panics(line in "\\PC*") {
        let _ = orders().parse(&line);
    }

    #[test]
    fn no_object_panics(name in "[a-z_]{0,12}", key in "[a-z]{0,8}", value in "[-0-9.e\\[\\]\"a-z]{0,12}") {
        let _ = orders().parse(&format!(r#"{{"command": "{name}", "{key}": {value}}}"#));
    }
}

#[test]
fn a_trajectory_file() {
    let read = |text: &str| parse_route(text, &LIMITS);
    let route = read(
        "[limits]\nvelocity = 0.1\n[[waypoint]]\nposition = [0.0, 0.0, 1.0]\nhold = 2.0\n\
         [[waypoint]]\nposition = [0.5, 0.0, 1.0]\nyaw_pitch_roll_deg = [0.0, 10.0, 0.0]\nforce = [0.0, 0.0, -1.0]\n",
    )
    .expect("valid");
    assert_eq!(route.waypoints().len(), 2);
    assert_eq!(route.limits().velocity, 0.1);
    assert_eq!(route.limits().acceleration, LIMITS.acceleration);
    let page = include_str!("../../../../docs/protocols.md");
    let example =
        page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).expect("an example");
    assert_eq!(read(example).expect("valid").waypoints().len(), 2);
    let error = |text: &str| read(text).expect_err("refused");
    assert!(
        error("[[waypoint]]\nposition = [0, 0, 1]\nholds = 1\n").contains("line 3: unknown field `holds`")
    );
    assert!(error("").contains("0 way-points"));
    assert!(read_file(Path::new("none.toml")).expect_err("absent").to_string().contains("none.toml"));
}

const START: Vector3 = Vector3::new(1.0, -2.0, 0.3);

/// The place of a vehicle that hovers in a flight that began at [`START`].
fn place() -> Place {
    Place { start_w: START, tool_w: Some((START + Vector3::new(0.12, 0.0, 0.2), Matrix3::identity())) }
}

proptest! {
    #[test]
    fn orders_stay_inside_the_geofence(x in -5.0..5.0_f64, y in -5.0..5.0_f64, z in -1.0..5.0_f64) {
        let mut orders = orders();
        // The tool of the Tilt-Hex is 0.12 m in front of its robot's origin and 0.4 m below it.
        let tool = START + Vector3::new(x + 0.12, y, z - 0.4);
        let inside = x.abs().max(y.abs()) <= 2.9 && z <= 2.9;
        let at = format!("[{}, {}, {}]", tool.x, tool.y, tool.z);
        for line in [
            format!(r#"{{"command": "play", "waypoint": [{{"position": {at}}}]}}"#),
            format!(r#"{{"command": "follow", "position": {at}, "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}}"#),
        ] {
            let command = orders.parse(&line).expect("valid");
            let found = orders.check_place(&command, &place());
            prop_assert_eq!(found.is_ok(), inside, "{:?}", found);
            let said = found.err().unwrap_or_default();
            prop_assert!(inside || said.contains("outside the geofence") && !said.contains('\n'), "{}", said);
        }
    }
}

#[test]
fn a_wrench_that_would_carry_the_tool_out_is_refused() {
    let mut orders = orders();
    let push = orders.parse(r#"{"command": "set_wrench", "force": [3, 0, 0]}"#).expect("valid");
    assert_eq!(orders.check_place(&push, &place()), Ok(()));
    let near = START + Vector3::new(2.8, 0.0, 0.2);
    let edge = Place { start_w: START, tool_w: Some((near, Matrix3::identity())) };
    let said = orders.check_place(&push, &edge).expect_err("refused");
    assert!(
        said.contains("set_wrench") && said.contains("after 0.3 m") && said.contains("[supervisor] geofence"),
        "{said}"
    );
    // On the ground a wrench does not move the vehicle.
    assert_eq!(orders.check_place(&push, &Place { start_w: START, tool_w: None }), Ok(()));
}
