//! The fault conditions that hold in this tick, for the supervisor.

use super::{Telemetry, io::HostFacts, record::LinkCounters};
use crate::{
    controller::ControllerOutput,
    estimator::{Estimator, Health, Status},
    supervisor::{Fault, FaultSet, Phase, limits as l},
    types::{Matrix3, RobotState, Vector3},
};

/// Limits; crossing one is a fault (`supervisor::TABLE` has the reactions).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WatchParams {
    /// Land below this battery voltage, V; 0 for none.
    pub battery_low: f64,
    /// Critical battery voltage, V.
    pub battery_critical: f64,
    /// Largest position error of the centre of mass, and of the tool in the mission, m.
    pub max_position_error: f64,
    /// Largest rotation error, norm of e_R.
    pub max_rotation_error: f64,
    /// Largest tilt, rad.
    pub max_tilt: f64,
    /// Largest speed, m/s.
    pub max_speed: f64,
    /// Largest estimated tool force, N.
    pub max_force: f64,
    /// Largest estimated tool torque, N m.
    pub max_torque: f64,
    /// Longest time from the first start command to the last motor's spinning, s.
    pub start_timeout: f64,
    /// Whether each motor is checked alone before all of them start.
    pub motor_check: bool,
    /// Half the width of the box around the start in which the vehicle stays, m.
    pub geofence: f64,
    /// Height of that box above the start, m.
    pub geofence_height: f64,
}

/// The inputs of the watch.
pub(super) struct Seen<'a> {
    /// Now, s.
    pub(super) now: f64,
    /// Time since the last tick, s.
    pub(super) period: f64,
    /// Phase before this tick.
    pub(super) phase: Phase,
    /// The telemetry of the vehicle.
    pub(super) telemetry: &'a Telemetry,
    /// Age of the newest inertial sample that was believed, s.
    pub(super) imu_age: f64,
    /// The estimator.
    pub(super) estimator: &'a Estimator,
    /// Whether the state is known without the estimator.
    pub(super) known: bool,
    /// Pose and twist of the robot.
    pub(super) robot: &'a RobotState,
    /// Position of the tool, m, robot.
    pub(super) tool_r: Vector3,
    /// The last tick's controller output.
    pub(super) output: Option<&'a ControllerOutput>,
    /// Number of motors whose measured speed is far from the model's.
    pub(super) wrong_speeds: usize,
    /// Whether a motor says that it has stopped.
    pub(super) emergency: bool,
    /// Bit `i` is set if motor `i` has stopped, by its speed.
    pub(super) stopped: u16,
    /// Facts that only the host can observe.
    pub(super) host: HostFacts,
}

/// Counts of poses by their outcome.
#[derive(Clone, Copy, Debug, Default)]
struct Poses {
    taken: u32,
    refused: u32,
}

impl Poses {
    fn of(health: &Health) -> Self {
        let c = &health.counts;
        Self {
            taken: c.accepted.saturating_add(c.weighed).saturating_add(c.position_only),
            refused: c.rejected.saturating_add(c.too_old).saturating_add(c.invalid),
        }
    }
}

/// The state of the watch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watch {
    params: WatchParams,
    /// Cosine of the largest tilt.
    least_upright: f64,
    poses: Poses,
    refused_in_a_row: u32,
    starting: f64,
    messages: u32,
    refused: u32,
    garbage: f64,
}

impl Watch {
    /// Nothing seen yet.
    #[must_use]
    pub(super) fn new(params: WatchParams) -> Self {
        Self {
            params,
            least_upright: libm::cos(params.max_tilt.min(core::f64::consts::PI)),
            poses: Poses::default(),
            refused_in_a_row: 0,
            starting: 0.0,
            messages: 0,
            refused: 0,
            garbage: 0.0,
        }
    }

    /// Whether the vehicle is tilted by more than the largest tilt.
    #[must_use]
    pub(super) fn is_tilted(&self, rotation_wr: &Matrix3) -> bool {
        rotation_wr[(2, 2)] < self.least_upright
    }

    /// Counters for the log.
    #[must_use]
    pub(super) fn counters(&self, telemetry: &Telemetry) -> LinkCounters {
        let c = &telemetry.link;
        LinkCounters {
            messages: c.messages,
            refused_frames: c.refused_frames,
            refused_samples: c.refused_samples,
            lost_samples: c.lost_samples,
            poses: self.poses.taken,
            refused_poses: self.poses.refused,
        }
    }

    /// The conditions that hold now.
    pub(super) fn conditions(&mut self, seen: &Seen<'_>, dt: f64) -> FaultSet {
        let mut set = FaultSet::NONE;
        self.link(seen, dt, &mut set);
        self.motors(seen, dt, &mut set);
        self.estimate(seen, &mut set);
        self.motion(seen, &mut set);
        set.insert_if(Fault::Overrun, seen.period > l::OVERRUN);
        set.insert_if(Fault::OverrunLong, seen.period > l::OVERRUN_LONG);
        set.insert_if(Fault::LogLost, seen.host.log_lost);
        set
    }

    fn link(&mut self, seen: &Seen<'_>, dt: f64, set: &mut FaultSet) {
        let s = seen.telemetry;
        let known = s.link.identified;
        let age = seen.imu_age;
        set.insert_if(Fault::ImuLate, known && age > l::IMU_LATE);
        set.insert_if(Fault::ImuSilent, known && age > l::IMU_SILENT);
        set.insert_if(Fault::LineLate, s.inertial.line_delay > l::LINE_LATE);
        set.insert_if(Fault::ImuFrozen, s.inertial.frozen);
        set.insert_if(Fault::ImuSaturated, s.inertial.saturated);
        set.insert_if(Fault::ImuOutOfRange, s.inertial.refused_now);
        set.insert_if(Fault::Reboot, s.link.rebooted);
        let silent = known && s.silence(seen.now) > l::LINK_SILENT;
        set.insert_if(Fault::LinkLost, seen.host.link_lost || silent);
        // A leaky counter: this share of refused frames keeps it full.
        let c = &s.link;
        let bad = c.refused_frames.wrapping_sub(self.refused);
        let good = c.messages.wrapping_sub(self.messages);
        (self.refused, self.messages) = (c.refused_frames, c.messages);
        self.garbage = (self.garbage + f64::from(bad) - l::GARBAGE * f64::from(good) - dt).clamp(0.0, 40.0);
        set.insert_if(Fault::LinkGarbage, self.garbage > 20.0);
        let p = &self.params;
        let below = |limit: f64| s.battery.is_some_and(|v| v < limit);
        set.insert_if(Fault::BatteryLow, below(p.battery_low));
        set.insert_if(Fault::BatteryCritical, below(p.battery_critical));
    }

    fn motors(&mut self, seen: &Seen<'_>, dt: f64, set: &mut FaultSet) {
        let s = seen.telemetry;
        let running = seen.phase == Phase::Grounded || seen.phase.in_flight();
        let age = s.motor_age(seen.now);
        let known = s.link.identified;
        set.insert_if(Fault::MotorsStale, known && age > l::MOTORS_STALE);
        set.insert_if(Fault::MotorsSilent, known && age > l::MOTORS_SILENT);
        // Before the start the bit is cleared by the start command itself.
        set.insert_if(Fault::MotorEmergency, running && seen.emergency);
        set.insert_if(Fault::MotorNotSpinning, running && (!s.all_spinning() || seen.stopped != 0));
        set.insert_if(Fault::MotorWrongSpeed, running && seen.wrong_speeds > 0);
        let half = s.motors().len().div_ceil(2);
        set.insert_if(Fault::CommandNotFollowed, running && seen.wrong_speeds >= half);
        self.starting = if seen.phase == Phase::Starting { self.starting + dt } else { 0.0 };
        set.insert_if(Fault::StartTimeout, self.starting > self.params.start_timeout);
    }

    fn estimate(&mut self, seen: &Seen<'_>, set: &mut FaultSet) {
        if seen.known || !seen.estimator.is_initialized() {
            return;
        }
        let health = seen.estimator.health();
        let poses = Poses::of(&health);
        if poses.taken != self.poses.taken {
            self.refused_in_a_row = 0;
        }
        let refused = poses.refused.wrapping_sub(self.poses.refused);
        self.refused_in_a_row = self.refused_in_a_row.saturating_add(refused);
        self.poses = poses;
        let age = health.position_age;
        set.insert_if(Fault::PoseLate, age > l::POSE_LATE);
        set.insert_if(Fault::PoseLost, age > l::POSE_LOST);
        set.insert_if(Fault::PoseLostLong, age > l::POSE_LOST_LONG);
        set.insert_if(Fault::PoseLostForGood, age > l::POSE_LOST_FOR_GOOD);
        set.insert_if(Fault::PoseJumping, self.refused_in_a_row >= l::POSES_REFUSED);
        set.insert_if(Fault::EstimateInconsistent, health.nis_mean > l::INCONSISTENCY);
        set.insert_if(Fault::EstimateUncertain, health.status == Status::Lost);
    }

    fn motion(&mut self, seen: &Seen<'_>, set: &mut FaultSet) {
        let p = &self.params;
        let state = seen.robot;
        if seen.phase.in_flight() {
            set.insert_if(Fault::Tilt, self.is_tilted(&state.rotation_wr));
            set.insert_if(Fault::Speed, state.velocity_w.norm() > p.max_speed);
        }
        if let Some(o) = seen.output.filter(|_| seen.phase.in_flight()) {
            let position = o.pose.position_error_w.norm() > p.max_position_error;
            let rotation = o.pose.rotation_error_r.norm() > p.max_rotation_error;
            set.insert_if(Fault::TrackingError, position || rotation);
            // The tool has to be where set-point and admittance want it, also if the attitude yields.
            let tool_w = state.position_w + state.rotation_wr * seen.tool_r;
            let strays = (tool_w - o.reference.position_w).norm() > p.max_position_error;
            let mission = matches!(seen.phase, Phase::Flying | Phase::Holding);
            set.insert_if(Fault::ToolAstray, mission && strays);
            set.insert_if(Fault::Excursion, o.excursion_limited);
            let force = o.wrench_tool_w.force.norm() > p.max_force;
            set.insert_if(Fault::WrenchLimit, force || o.wrench_tool_w.torque.norm() > p.max_torque);
            set.insert_if(Fault::SetpointInfeasible, o.allocation.saturated);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        GRAVITY,
        controller::{Controller, ControllerInput, ControllerParams, ControllerState},
        estimator::EstimatorParams,
        examples,
        plant::Plant,
        so3,
        types::Setpoint,
    };

    const PARAMS: WatchParams = WatchParams {
        battery_low: 0.0,
        battery_critical: 0.0,
        max_position_error: 0.1,
        max_rotation_error: 1.0,
        max_tilt: 1.0,
        max_speed: 1.0,
        max_force: 1e3,
        max_torque: 1e3,
        start_timeout: 1.0,
        motor_check: false,
        geofence: 10.0,
        geofence_height: 10.0,
    };

    /// Whether the tool of a vehicle is astray whose centre of mass is at its reference, but which is turned by an angle, rad.
    fn strays(turned: f64, phase: Phase) -> bool {
        let vehicle = examples::tilt_hex().expect("a vehicle");
        let controller = Controller::new(vehicle, ControllerParams::default()).expect("checked");
        let hover = Plant::new(vehicle).hover(Vector3::zeros());
        let tool_r = vehicle.tool().position_r;
        let input = ControllerInput {
            state: hover.robot,
            specific_force_r: Vector3::new(0.0, 0.0, GRAVITY),
            rotor_speeds: hover.rotor_speeds,
            setpoint: Setpoint::hold(tool_r, Matrix3::identity()),
            compliant: true,
            learn_bias: false,
            lost_rotors: 0,
            fixed_attitude: false,
            unyielding: None,
        };
        let output = controller.step(&mut ControllerState::default(), &input, 0.002);
        let about = Vector3::z().cross(&tool_r).normalize();
        let robot = RobotState { rotation_wr: so3::exp(&(turned * about)), ..hover.robot };
        let seen = Seen {
            now: 1.0,
            period: 0.002,
            phase,
            telemetry: &Telemetry::new(6),
            imu_age: 0.0,
            estimator: &Estimator::new(EstimatorParams::default()).expect("valid"),
            known: true,
            robot: &robot,
            tool_r,
            output: Some(&output),
            wrong_speeds: 0,
            emergency: false,
            stopped: 0,
            host: HostFacts::default(),
        };
        Watch::new(PARAMS).conditions(&seen, 0.002).contains(Fault::ToolAstray)
    }

    /// The centre of mass is at its reference, and the tool at the end of its lever is not.
    #[test]
    fn a_tool_that_is_not_where_it_is_told_is_astray() {
        assert!(!strays(0.0, Phase::Flying) && !strays(0.1, Phase::Flying));
        assert!(strays(0.5, Phase::Flying) && strays(0.5, Phase::Holding));
        // A landing does not have to keep the tool at its place.
        assert!(!strays(0.5, Phase::Landing));
    }
}
