//! The source of the set-point in each phase: take-off, hover, mission, landing.

mod motions;

use super::{io::Route, room::Room};
use crate::{
    Vehicle,
    force_axes::ForceAxes,
    model_learning::{Calibration, calibration_flight},
    so3,
    supervisor::{
        Phase,
        limits::{ADRIFT_SPEED, FORCED_SPEED, SETPOINT_STALE},
    },
    trajectory::{Limits, Trajectory, Waypoint},
    types::{Matrix3, RobotState, Setpoint, Vector3, Wrench},
    vehicle::Mounting,
};
use motions::{Detour, Sink};

/// How the vehicle takes off and lands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuidanceParams {
    /// Height of the first hover above the start, m.
    pub take_off_height: f64,
    /// Time at the first hover in which the wrench bias is learnt, s; 0 leaves it out.
    pub bias_time: f64,
    /// The calibration flight after the first hover, from which the model is learnt.
    pub calibration: Calibration,
    /// Limits of take-off and of the motion to a route's first way-point.
    pub limits: Limits,
    /// Speed of the descent, m/s.
    pub landing_speed: f64,
    /// Largest rates of streamed set-points.
    pub stream: Limits,
    /// Largest distance of a streamed set-point from the one before, m.
    pub max_setpoint_jump: f64,
}

/// Time in which the mission's clock stops, and in which it starts again, s.
const SLOW_DOWN: f64 = 0.5;
/// Downward acceleration if no speed is known, m/s^2. It must end a possible climb; from a height of 1 m it gives 1.7
/// m/s.
pub(super) const BLIND_ACCELERATION: f64 = 1.5;

/// The kind of descent. A landing has its own speed, and only becomes faster as [`Descent::Steady`] says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Descent {
    /// At the speed of a landing plus this, m/s.
    Steady(f64),
    /// Faster: a rotor that a hover needs is lost.
    Adrift,
    /// With a little less thrust than the weight, because no speed is known.
    Blind,
    /// At any place: an earlier descent did not come down.
    Forced,
}

/// The present part of the flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Ground,
    TakeOff,
    Calibration,
    Mission,
    Follow,
    Land,
}

/// The source of set-points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Guidance {
    params: GuidanceParams,
    stage: Stage,
    trajectory: Trajectory,
    /// Mission time, s, and how fast it passes: 1 flying, 0 holding.
    time: f64,
    rate: f64,
    hover_time: f64,
    followed: Setpoint,
    followed_age: f64,
    room: Room,
    wrench_w: Option<(Wrench, ForceAxes)>,
    /// Whether a landing first moves away from what the tool touches.
    retreats: bool,
    sink: Sink,
    detour: Detour,
}

/// The set-point of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Guided {
    /// The commanded set-point of the tool.
    pub(super) setpoint: Setpoint,
    /// Whether contact moves the reference.
    pub(super) compliant: bool,
    /// Whether the wrench bias is being learnt.
    pub(super) learn_bias: bool,
    /// Whether the model is being learnt.
    pub(super) learn_model: bool,
}

impl Guidance {
    /// Before the start.
    #[must_use]
    pub(super) fn new(params: GuidanceParams) -> Self {
        let nowhere = Trajectory::hold(Vector3::zeros(), Matrix3::identity());
        Self {
            params,
            stage: Stage::Ground,
            trajectory: nowhere,
            time: 0.0,
            rate: 1.0,
            hover_time: 0.0,
            followed: nowhere.sample(0.0),
            followed_age: 0.0,
            room: Room::full(&params.stream, params.max_setpoint_jump),
            wrench_w: None,
            retreats: false,
            sink: Sink::default(),
            detour: Detour::default(),
        }
    }

    /// Whether take-off and bias hover are over.
    #[must_use]
    pub(super) fn ready(&self) -> bool {
        matches!(self.stage, Stage::Mission | Stage::Follow) && self.hover_time >= self.params.bias_time
    }

    /// Whether the mission's trajectory has ended.
    #[must_use]
    pub(super) fn mission_done(&self) -> bool {
        self.stage == Stage::Mission && self.time >= self.trajectory.duration()
    }

    /// Commanded speed of the descent, m/s; `None` if the descent goes by thrust alone.
    pub(super) fn sinks(&self, phase: Phase, descent: Descent) -> Option<f64> {
        match (phase, descent) {
            (Phase::Emergency, Descent::Blind) => None,
            (Phase::Emergency, Descent::Adrift) => Some(ADRIFT_SPEED),
            (Phase::Emergency, Descent::Forced) => Some(FORCED_SPEED),
            (Phase::Emergency, Descent::Steady(faster)) => Some(self.params.landing_speed + faster),
            _ => Some(self.sink.speed),
        }
    }

    /// Whether streamed set-points have stopped.
    #[must_use]
    pub(super) fn stale(&self) -> bool {
        self.stage == Stage::Follow && self.followed_age > SETPOINT_STALE
    }

    /// Begins in the air, at rest on the start of a trajectory, ready for the mission.
    pub(super) fn begin_in_air(&mut self, trajectory: &Trajectory) {
        self.trajectory = *trajectory;
        self.time = 0.0;
        self.stage = Stage::Mission;
        self.hover_time = self.params.bias_time;
    }

    /// Begins a take-off from the ground, straight up and level, with the present heading.
    pub(super) fn begin_take_off(&mut self, robot: &RobotState, tool: &Mounting) {
        let level = level(&robot.rotation_wr);
        let here = tool_waypoint(robot.position_w, &level, tool);
        let up = Vector3::new(0.0, 0.0, self.params.take_off_height);
        let above = tool_waypoint(robot.position_w + up, &level, tool);
        let limits = self.params.limits;
        self.fly(here, &[above], &limits);
        self.stage = Stage::TakeOff;
        self.detour = Detour::default();
        self.hover_time = 0.0;
    }

    /// Begins what follows the take-off: the calibration, after which there is no bias to learn, or the mission.
    fn begin_calibration(&mut self, vehicle: &Vehicle) {
        self.stage = Stage::Mission;
        let kind = self.params.calibration;
        if kind == Calibration::None {
            return;
        }
        let from = self.trajectory.sample(self.time);
        let heading = heading(&(from.rotation_we * vehicle.tool().rotation_r.transpose()));
        if let Ok(flight) = calibration_flight(vehicle, kind, from.position_w, heading, &self.params.limits) {
            self.trajectory = flight;
            self.time = 0.0;
            self.stage = Stage::Calibration;
            self.hover_time = self.params.bias_time;
        }
    }

    /// Begins a landing straight down from a reference of the tool; the vehicle turns level meanwhile. Before it
    /// sinks, it moves by `retreat_w`, m, away from what it touches.
    pub(super) fn begin_landing(&mut self, from: &Setpoint, retreat_w: &Vector3, tool: &Mounting) {
        let rotation_wr = from.rotation_we * tool.rotation_r.transpose();
        let robot_w = from.position_w - rotation_wr * tool.position_r;
        let start = Waypoint {
            position_w: from.position_w,
            rotation_we: from.rotation_we,
            ..tool_waypoint(robot_w, &rotation_wr, tool)
        };
        let limits = self.params.limits;
        self.fly(start, &[tool_waypoint(robot_w + retreat_w, &level(&rotation_wr), tool)], &limits);
        self.retreats = *retreat_w != Vector3::zeros();
        self.stage = Stage::Land;
        self.sink = Sink::default();
        self.detour = Detour::default();
        self.wrench_w = None;
    }

    /// Flies a route from the present set-point. Returns false if the route is refused.
    pub(super) fn play(&mut self, route: &Route) -> bool {
        let now = self.sample();
        let from = Waypoint {
            position_w: now.position_w,
            rotation_we: now.rotation_we,
            wrench_w: now.wrench_w,
            force_axes: now.force_axes,
            duration: 0.0,
            hold: 0.0,
        };
        match Trajectory::new(from, route.waypoints(), route.limits()) {
            Ok(trajectory) => {
                self.trajectory = trajectory;
                self.time = 0.0;
                self.stage = Stage::Mission;
                true
            }
            Err(_) => false,
        }
    }

    /// Takes a streamed set-point. Returns false, and keeps the last one, if it is not finite, not a rotation, or
    /// farther from the last one than the rates allow.
    pub(super) fn follow(&mut self, setpoint: &Setpoint) -> bool {
        let last = self.sample();
        let sound = setpoint.is_finite()
            && so3::check_rotation("rotation", &setpoint.rotation_we).is_ok()
            && setpoint.force_axes.check().is_ok();
        let good = sound && self.room.take(&last, setpoint);
        if good {
            self.followed = *setpoint;
            self.followed_age = 0.0;
            self.stage = Stage::Follow;
        }
        good
    }

    /// The wrench to exert instead of the trajectory's, and the axes along which it is controlled.
    pub(super) fn set_wrench(&mut self, wrench_w: Option<(Wrench, ForceAxes)>) {
        self.wrench_w = wrench_w;
    }

    /// Moves the set-points together with a world that has jumped by `by_w`, m.
    pub(super) fn shift(&mut self, by_w: Vector3) {
        self.detour.offset_w += by_w;
    }

    /// Learns the bias once more, from a hover at the set-point. Returns false if the set-point moves.
    pub(super) fn zero_bias(&mut self) -> bool {
        let at_rest = self.mission_done() || self.stale();
        if at_rest {
            let here = self.sample();
            self.trajectory = Trajectory::hold(here.position_w, here.rotation_we);
            (self.stage, self.time, self.hover_time) = (Stage::Mission, 0.0, 0.0);
        }
        at_rest
    }

    /// Ends the hover for learning before its time.
    pub(super) fn end_learning(&mut self) {
        self.hover_time = self.params.bias_time;
    }

    /// The set-point of this tick; `descent` is how a landing or an emergency goes down.
    pub(super) fn step(
        &mut self,
        phase: Phase,
        descent: Descent,
        robot: &RobotState,
        vehicle: &Vehicle,
        dt: f64,
    ) -> Guided {
        let stopped = phase == Phase::Holding;
        let change = dt / SLOW_DOWN;
        let rate = if stopped { self.rate - change } else { self.rate + change };
        let rate = rate.clamp(0.0, 1.0);
        let rate_change = if dt > 0.0 { (rate - self.rate) / dt } else { 0.0 };
        self.rate = rate;
        self.time += rate * dt;
        self.followed_age += dt;
        self.room.fill(&self.params.stream, self.params.max_setpoint_jump, dt);
        if self.stage == Stage::TakeOff && self.time >= self.trajectory.duration() {
            self.begin_calibration(vehicle);
        } else if self.stage == Stage::Calibration && self.time >= self.trajectory.duration() {
            self.stage = Stage::Mission;
        }
        if phase == Phase::Emergency {
            let mut setpoint = descend(robot, vehicle.tool());
            match descent {
                Descent::Steady(faster) => setpoint.velocity_w.z = -self.params.landing_speed - faster,
                Descent::Adrift => setpoint.velocity_w.z = -ADRIFT_SPEED,
                Descent::Forced => setpoint.velocity_w.z = -FORCED_SPEED,
                Descent::Blind => {
                    setpoint.velocity_w = robot.velocity_w;
                    setpoint.acceleration_w.z = -BLIND_ACCELERATION;
                }
            }
            return Guided { setpoint, compliant: false, learn_bias: false, learn_model: false };
        }
        let mut setpoint = self.sample();
        // A clock that runs at `rate` scales velocities, and its change adds to the acceleration.
        if self.stage != Stage::Follow {
            let (v, w) = (setpoint.velocity_w, setpoint.angular_velocity_w);
            setpoint.acceleration_w = setpoint.acceleration_w * (rate * rate) + v * rate_change;
            setpoint.angular_acceleration_w =
                setpoint.angular_acceleration_w * (rate * rate) + w * rate_change;
            setpoint.velocity_w = v * rate;
            setpoint.angular_velocity_w = w * rate;
        }
        if self.stage == Stage::Land {
            if !self.retreats || self.time >= self.trajectory.duration() {
                let faster = if let Descent::Steady(faster) = descent { faster } else { 0.0 };
                self.sink.step(self.params.landing_speed + faster, dt);
            }
            setpoint.position_w.z -= self.sink.depth;
            setpoint.velocity_w.z -= self.sink.speed;
            setpoint.acceleration_w.z -= self.sink.rate;
        }
        self.detour.step(self.params.limits.velocity, self.stage != Stage::Land, dt);
        setpoint.position_w += self.detour.offset_w;
        setpoint.velocity_w += self.detour.velocity_w;
        setpoint.acceleration_w += self.detour.acceleration_w;
        // The time also passes while the vehicle holds, so that a hover that never comes delays nothing.
        let learning = self.stage == Stage::Mission && self.hover_time < self.params.bias_time;
        if self.stage == Stage::Mission {
            self.hover_time += dt;
        }
        let learn_bias = learning && phase == Phase::Flying;
        let compliant = matches!(self.stage, Stage::Mission | Stage::Follow) && !learning;
        let learn_model = self.stage == Stage::Calibration;
        Guided { setpoint, compliant, learn_bias, learn_model }
    }

    fn sample(&self) -> Setpoint {
        let mut setpoint = match self.stage {
            Stage::Follow if self.stale() => {
                Setpoint::hold(self.followed.position_w, self.followed.rotation_we)
            }
            Stage::Follow => self.followed,
            _ => self.trajectory.sample(self.time),
        };
        if let Some((wrench_w, force_axes)) = self.wrench_w {
            (setpoint.wrench_w, setpoint.force_axes) = (wrench_w, force_axes);
        }
        setpoint
    }

    fn fly(&mut self, from: Waypoint, way: &[Waypoint], limits: &Limits) {
        // Way-points from a finite state and validated limits are accepted; otherwise the vehicle stays.
        self.trajectory = Trajectory::new(from, way, limits)
            .unwrap_or_else(|_| Trajectory::hold(from.position_w, from.rotation_we));
        self.time = 0.0;
        self.rate = 1.0;
    }
}

/// A level set-point at the present position: neither a position nor a heading is commanded.
fn descend(robot: &RobotState, tool: &Mounting) -> Setpoint {
    let w = tool_waypoint(robot.position_w, &level(&robot.rotation_wr), tool);
    Setpoint::hold(w.position_w, w.rotation_we)
}

/// A level rotation with the same heading: body x stays in its vertical plane.
fn level(rotation_wr: &Matrix3) -> Matrix3 {
    so3::rot_z(heading(rotation_wr))
}

/// Angle of body x in the horizontal plane from world x, rad.
fn heading(rotation_wr: &Matrix3) -> f64 {
    libm::atan2(rotation_wr[(1, 0)], rotation_wr[(0, 0)])
}

fn tool_waypoint(position_w: Vector3, rotation_wr: &Matrix3, tool: &Mounting) -> Waypoint {
    Waypoint {
        position_w: position_w + rotation_wr * tool.position_r,
        rotation_we: rotation_wr * tool.rotation_r,
        wrench_w: Wrench::ZERO,
        force_axes: ForceAxes::NONE,
        duration: 0.0,
        hold: 0.0,
    }
}
