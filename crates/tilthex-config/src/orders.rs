//! Orders to a flight as text: JSON lines of the control socket and TOML
//! trajectory files. One parser for both, and for the replay of a log.

use std::path::Path;

use serde::{Deserialize, de::DeserializeOwned};
use tilthex_core::{
    Error, Matrix3, Setpoint, Vector3, Wrench,
    admittance::AdmittanceFilter,
    flight::{Command, Route},
    so3,
    trajectory::{Limits, Waypoint},
};

use crate::{AdmittanceSection, Config, ConfigError, files, section};

/// Force (N) and torque (N m), world.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrenchText {
    #[serde(default)]
    force: [f64; 3],
    #[serde(default)]
    torque: [f64; 3],
}

impl WrenchText {
    fn wrench(&self) -> Wrench {
        Wrench { force: self.force.into(), torque: self.torque.into() }
    }
}

/// A way-point: where the tool is to be, and how. At most one form of orientation; level without any.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WaypointText {
    /// m, world.
    position: [f64; 3],
    /// Row by row; maps tool coordinates to world coordinates.
    rotation: Option<[[f64; 3]; 3]>,
    /// The same, scalar last.
    quaternion_xyzw: Option<[f64; 4]>,
    /// Degrees: about z, then the new y, then the new x.
    yaw_pitch_roll_deg: Option<[f64; 3]>,
    /// N, world.
    #[serde(default)]
    force: [f64; 3],
    /// N m, world.
    #[serde(default)]
    torque: [f64; 3],
    /// Shortest time of the way here, s.
    #[serde(default)]
    duration: f64,
    /// Time to stay, s.
    #[serde(default)]
    hold: f64,
}

impl WaypointText {
    fn rotation(&self) -> Result<Matrix3, String> {
        match (self.rotation, self.quaternion_xyzw, self.yaw_pitch_roll_deg) {
            (None, None, None) => Ok(Matrix3::identity()),
            (Some(rows), None, None) => Ok(matrix3(&rows)),
            (None, Some(q), None) => so3::from_quaternion_xyzw(q).ok_or_else(|| {
                format!("quaternion_xyzw {q:?} has no direction; expected four finite numbers")
            }),
            (None, None, Some(angles)) => {
                let [yaw, pitch, roll] = angles.map(f64::to_radians);
                Ok(so3::rot_z(yaw) * so3::rot_y(pitch) * so3::rot_x(roll))
            }
            _ => Err("a way-point has several orientations; expected one of rotation, quaternion_xyzw, \
                      yaw_pitch_roll_deg"
                .into()),
        }
    }

    fn waypoint(&self) -> Result<Waypoint, String> {
        Ok(Waypoint {
            position_w: self.position.into(),
            rotation_we: self.rotation()?,
            wrench_w: Wrench { force: self.force.into(), torque: self.torque.into() },
            duration: self.duration,
            hold: self.hold,
        })
    }
}

/// Largest rates on a way; those not named are the configured ones.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct LimitsText {
    /// m/s.
    velocity: Option<f64>,
    /// m/s^2.
    acceleration: Option<f64>,
    /// rad/s.
    angular_velocity: Option<f64>,
    /// rad/s^2.
    angular_acceleration: Option<f64>,
}

impl LimitsText {
    fn over(&self, base: &Limits) -> Limits {
        Limits {
            velocity: self.velocity.unwrap_or(base.velocity),
            acceleration: self.acceleration.unwrap_or(base.acceleration),
            angular_velocity: self.angular_velocity.unwrap_or(base.angular_velocity),
            angular_acceleration: self.angular_acceleration.unwrap_or(base.angular_acceleration),
        }
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RouteText {
    #[serde(default)]
    limits: LimitsText,
    #[serde(default)]
    waypoint: Vec<WaypointText>,
}

impl RouteText {
    fn route(&self, base: &Limits) -> Result<Route, String> {
        let points: Result<Vec<_>, _> = self.waypoint.iter().map(WaypointText::waypoint).collect();
        Route::new(&points?, &self.limits.over(base)).map_err(|e| e.to_string())
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FollowText {
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    #[serde(default)]
    velocity: [f64; 3],
    #[serde(default)]
    angular_velocity: [f64; 3],
    #[serde(default)]
    acceleration: [f64; 3],
    #[serde(default)]
    angular_acceleration: [f64; 3],
    #[serde(default)]
    wrench: WrenchText,
}

/// Each needs no more than its name.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Nothing {}

/// Reads orders. It remembers the section `[admittance]`, of which an order may change a part.
#[derive(Clone, Debug)]
pub struct Orders {
    limits: Limits,
    admittance: AdmittanceSection,
}

impl Orders {
    /// With the configured limits and admittance.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self { limits: config.mission().limits(), admittance: config.admittance().clone() }
    }

    /// The order a line of JSON stands for: an object with `command` and what the command takes.
    ///
    /// # Errors
    /// One sentence: what is wrong with it, and what was expected.
    pub fn parse(&mut self, line: &str) -> Result<Command, String> {
        let mut object: serde_json::Map<String, serde_json::Value> =
            serde_json::from_str(line).map_err(|e| format!("not a JSON object: {e}"))?;
        let name = match object.remove("command") {
            Some(serde_json::Value::String(name)) => name,
            _ => return Err("no command; expected a string such as \"land\"".into()),
        };
        let rest = serde_json::Value::Object(object);
        self.command(&name, rest).map_err(|e| format!("{name}: {e}"))
    }

    fn command(&mut self, name: &str, rest: serde_json::Value) -> Result<Command, String> {
        let nothing = |command| take::<Nothing>(rest.clone()).map(|_| command);
        match name {
            "take_off" => nothing(Command::TakeOff),
            "release_wrench" => nothing(Command::ReleaseWrench),
            "zero_bias" => nothing(Command::ZeroBias),
            "land" => nothing(Command::Land),
            "kill" => nothing(Command::Kill),
            "play" => take::<RouteText>(rest)?.route(&self.limits).map(Command::Play),
            "follow" => setpoint(&take(rest)?).map(Command::Follow),
            "set_wrench" => {
                let wrench = take::<WrenchText>(rest)?.wrench();
                if wrench.is_finite() { Ok(Command::SetWrench(wrench)) } else { Err(not_finite()) }
            }
            "set_admittance" => self.set_admittance(take(rest)?),
            _ => Err("no such command; expected take_off, play, follow, set_admittance, set_wrench, \
                      release_wrench, zero_bias, land or kill"
                .into()),
        }
    }

    /// Keys of `[admittance]` that may change in flight, as its file names them.
    fn set_admittance(&mut self, changes: toml::Table) -> Result<Command, String> {
        let section =
            section::changed(&self.admittance, "set_admittance", changes).map_err(|e| e.to_string())?;
        let filter = AdmittanceFilter::new(section.params()).map_err(|e: Error| e.to_string())?;
        self.admittance = section;
        Ok(Command::SetAdmittance(filter))
    }
}

/// Reads a file that people write.
///
/// # Errors
/// One sentence: the file, and why it can not be read.
pub fn read_file(path: &Path) -> Result<String, ConfigError> {
    files::read_text(path).map_err(|e| ConfigError::new(format!("{}: cannot be read: {e}", path.display())))
}

/// The route of a trajectory file's text: `[limits]` and `[[waypoint]]` tables.
///
/// # Errors
/// One sentence: the line, and what is wrong with it.
pub fn parse_route(text: &str, base: &Limits) -> Result<Route, String> {
    let route: RouteText = toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
        format!("line {line}: {}", e.message().replace('\n', " "))
    })?;
    route.route(base)
}

fn take<T: DeserializeOwned>(value: serde_json::Value) -> Result<T, String> {
    serde_json::from_value(value).map_err(|e| e.to_string())
}

fn setpoint(text: &FollowText) -> Result<Setpoint, String> {
    let rotation_we = matrix3(&text.rotation);
    so3::check_rotation("rotation", &rotation_we).map_err(|e| e.to_string())?;
    let vector = |v: &[f64; 3]| Vector3::from(*v);
    let setpoint = Setpoint {
        position_w: vector(&text.position),
        rotation_we,
        velocity_w: vector(&text.velocity),
        angular_velocity_w: vector(&text.angular_velocity),
        acceleration_w: vector(&text.acceleration),
        angular_acceleration_w: vector(&text.angular_acceleration),
        wrench_w: text.wrench.wrench(),
    };
    if setpoint.is_finite() { Ok(setpoint) } else { Err(not_finite()) }
}

fn not_finite() -> String {
    "holds a number that is not finite".into()
}

fn matrix3(rows: &[[f64; 3]; 3]) -> Matrix3 {
    Matrix3::from_fn(|i, j| rows[i][j])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VehicleSection;
    use proptest::prelude::*;

    const LIMITS: Limits =
        Limits { velocity: 0.5, acceleration: 1.0, angular_velocity: 0.5, angular_acceleration: 1.0 };

    fn orders() -> Orders {
        Orders::new(&Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset")))
    }

    #[test]
    fn orders_without_arguments() {
        for (text, command) in [
            ("take_off", Command::TakeOff),
            ("release_wrench", Command::ReleaseWrench),
            ("zero_bias", Command::ZeroBias),
            ("land", Command::Land),
            ("kill", Command::Kill),
        ] {
            assert_eq!(orders().parse(&format!("{{\"command\": \"{text}\"}}")), Ok(command));
        }
    }

    #[test]
    fn admittance_changes_add_up() {
        let mut orders = orders();
        orders.parse(r#"{"command": "set_admittance", "stiffness": [8, 8, 8, 10, 10, 5]}"#).expect("valid");
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
            (r#"{"command": "land", "now": true}"#, "unknown field `now`"),
            (r#"{"command": "play"}"#, "0 way-points"),
            (r#"{"command": "play", "waypoint": [{"position": [0, 0]}]}"#, "invalid length 2"),
            (
                r#"{"command": "follow", "position": [0,0,1], "rotation": [[1,0,0],[0,1,0],[0,0,2]]}"#,
                "rotation",
            ),
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
        let error = |text: &str| read(text).expect_err("refused");
        assert!(
            error("[[waypoint]]\nposition = [0, 0, 1]\nholds = 1\n")
                .contains("line 3: unknown field `holds`")
        );
        assert!(error("").contains("0 way-points"));
        assert!(read_file(Path::new("none.toml")).expect_err("absent").to_string().contains("none.toml"));
    }
}
