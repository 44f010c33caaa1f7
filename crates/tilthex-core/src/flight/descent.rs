//! The begin of a landing, obstacles on the way down, and the decision whether a landing continues.

use super::{
    Flight,
    fence::Fence,
    io::{Measured, Route},
    landing::{self, FREE, Landing, Verdict},
};
use crate::{
    admittance::AdmittanceState,
    supervisor::{
        Fault, FaultSet, Phase,
        limits::{IMU_LATE, POSE_LOST_LONG, POSITION_DEVIATION},
    },
    types::{RotorVector, Setpoint, Vector3},
};

/// A landing begins at the reference if the vehicle is at most this far away from it, m; otherwise at the vehicle.
const FOLLOWED: f64 = 0.15;
/// A force at the tool above this, N, and above this part of the weight, is a contact from which the vehicle
/// retreats.
const TOUCHES: (f64, f64) = (1.0, 0.05);
/// Distance of the retreat, m.
const RETREAT: f64 = 0.15;
/// The ground is at the height of the take-off to within this, m.
const GROUND: f64 = 0.1;
/// If an estimate is this many times as fast as the largest speed, and no pose supports it, it is unusable.
const HOPELESS: f64 = 2.0;

impl Flight {
    /// Begins a landing: first away from what the tool touches, then down.
    pub(super) fn begin_landing(&mut self, before: Phase) {
        let actual = self.actual_tool();
        let near = |reference: &Setpoint| (reference.position_w - actual.position_w).norm() < FOLLOWED;
        let from = self.output.map(|o| o.reference).filter(near).unwrap_or(actual);
        let retreat_w =
            if matches!(before, Phase::Flying | Phase::Holding) { self.retreat() } else { Vector3::zeros() };
        self.land_from(&from, &retreat_w);
    }

    /// The retreat from what the tool touches, along the force on the tool, m, without a downward part.
    fn retreat(&self) -> Vector3 {
        let Some(output) = self.output.filter(|_| self.lost == 0) else { return Vector3::zeros() };
        let mut force_w = output.wrench_tool_w.force;
        force_w.z = force_w.z.max(0.0);
        let (least, part) = TOUCHES;
        let size = force_w.norm();
        if size > least.max(part * self.params.vehicle.weight()) {
            force_w * (RETREAT / size)
        } else {
            Vector3::zeros()
        }
    }

    /// Begins a descent straight down from a pose. The admittance filter stops the motion of the reference.
    pub(super) fn land_from(&mut self, from: &Setpoint, retreat_w: &Vector3) {
        self.guidance.begin_landing(from, retreat_w, self.params.vehicle.tool());
        let rest = Setpoint::hold(from.position_w, from.rotation_we);
        self.control.admittance = AdmittanceState::at(from, &rest);
    }

    /// Whether the ground carries the vehicle, by the forces of the last tick. Sets the lift of the rotors for this
    /// tick.
    pub(super) fn descend(&mut self, input: &Measured<'_>, rotor_speeds: &RotorVector, dt: f64) -> bool {
        let descends = matches!(self.supervisor.phase(), Phase::Landing | Phase::Emergency);
        self.lift = FREE;
        let Some(output) = self.output.as_ref().filter(|_| descends) else {
            self.landing = Landing::default();
            return false;
        };
        let robot = self.robot_state();
        let bias_w = robot.rotation_wr * self.control.bias_r.force;
        let thrust_w = robot.rotation_wr * self.params.vehicle.body_wrench(rotor_speeds).force;
        let weight = self.params.vehicle.weight();
        let deviation = if self.known.is_some() { 0.0 } else { self.estimator.health().position_deviation };
        let placed = self.placed();
        let height = self.bounds.height(&robot.position_w).filter(|_| placed);
        let fresh = self.returning.age(&input.telemetry.inertial, input.time) < IMU_LATE;
        let seen = landing::Seen {
            missing: weight - (thrust_w + bias_w).z,
            observed_w: fresh.then(|| output.wrench_robot.force - bias_w),
            felt: fresh.then(|| (self.specific_force_r(), robot.angular_velocity_r.norm())),
            sinks: self.guidance.sinks(self.supervisor.phase(), self.descent()),
            velocity: robot.velocity_w.z,
            speed: robot.velocity_w.norm(),
            upright: robot.rotation_wr[(2, 2)],
            above: height.map(|height| height - GROUND - 3.0 * deviation),
            toppled: self.supervisor.active().contains(Fault::Tilt),
            adrift: self.adrift,
            forced: self.supervisor.active().contains(Fault::LandingFails),
            placed,
            hopeless: self.hopeless(),
            room: self.params.watch.geofence_height,
        };
        match self.landing.step(&seen, weight, dt) {
            Verdict::Down => return true,
            Verdict::On(lift) => self.lift = lift,
            Verdict::Resume => {
                if self.supervisor.phase() == Phase::Landing {
                    let retreat_w = self.retreat();
                    self.land_from(&self.actual_tool(), &retreat_w);
                }
            }
        }
        false
    }

    /// Whether poses show where the vehicle is.
    fn placed(&self) -> bool {
        let health = self.estimator.health();
        let placed = health.position_deviation < POSITION_DEVIATION && health.position_age < POSE_LOST_LONG;
        self.known.is_some() || placed && !self.capture.lies()
    }

    /// Whether the estimate is unusable: no vehicle in a room can move like this.
    pub(super) fn hopeless(&self) -> bool {
        !self.placed() && self.robot_state().velocity_w.norm() > HOPELESS * self.params.watch.max_speed
    }

    /// The box in which the vehicle stays.
    fn fence(&self) -> Fence {
        Fence { sideways: self.params.watch.geofence, up: self.params.watch.geofence_height }
    }

    /// Position at which the flight began, or would begin now, m, world.
    pub(super) fn start(&self) -> Option<Vector3> {
        let ready = self.estimator.is_initialized() || self.known.is_some();
        self.bounds.start().or_else(|| ready.then(|| self.robot_state().position_w))
    }

    /// Whether a route stays inside the geofence; true while the place of the geofence is not known.
    pub(super) fn keeps(&self, route: &Route) -> bool {
        let leaves = |start_w| self.fence().leaves(&start_w, self.params.vehicle.tool(), route).is_some();
        !self.start().is_some_and(leaves)
    }

    /// Whether a streamed set-point is inside the geofence.
    pub(super) fn keeps_setpoint(&self, setpoint: &Setpoint) -> bool {
        let (position_w, rotation_we) = (&setpoint.position_w, &setpoint.rotation_we);
        let tool = self.params.vehicle.tool();
        let holds = |start_w| self.fence().holds(&start_w, tool, position_w, rotation_we);
        self.start().is_none_or(holds)
    }

    /// Watches the geofence and the progress of a landing. Before the start, returns whether the waiting route leaves
    /// the geofence.
    pub(super) fn watch_bounds(&mut self, phase: Phase, conditions: &mut FaultSet, dt: f64) -> bool {
        let watch = &self.params.watch;
        let robot = self.robot_state();
        let fence = self.fence();
        let fast = robot.velocity_w.norm() > watch.max_speed;
        let outside = self.bounds.step(&fence, phase, &robot, (fast, self.landing.attempts()), dt);
        let strays = !phase.in_flight() && self.route.as_ref().is_some_and(|route| !self.keeps(route));
        conditions.insert_if(Fault::Geofence, outside.fence || strays);
        conditions.insert_if(Fault::LandingFails, outside.landing);
        strays
    }
}
