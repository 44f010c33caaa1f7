//! The turn from the wanted to the chosen attitude, as fast as the rotors allow.
//!
//! A filter of third order. The turn follows its target with a bounded angular acceleration, which changes only as
//! fast as the rotors' lag allows. Far from the target it brakes in time; near the target the filter is linear. The
//! part of the acceleration that the lag removes is known, and is commanded in addition.

use crate::{
    Vehicle,
    allocation::{Allocator, Priority},
    so3,
    types::{Matrix3, Reference, Vector3, Vector6},
};
use libm::{cos, exp, fabs, sin, sqrt};

/// Part of the angular acceleration in a hover that turns may use; the rest is for disturbances.
const SHARE: f64 = 0.5;
/// Part of a turn's acceleration that the braking uses, because braking has the lag too.
const BRAKING: f64 = 0.5;
/// If the wanted attitude is this far, rad, from the one that its angular velocity predicts, it has jumped.
const JUMP: f64 = 0.08;
/// Largest product of bandwidth and period; a slower filter above it stays stable.
const LARGEST_STEP: f64 = 0.2;
/// No vehicle's angular acceleration is larger, rad/s^2.
const LARGEST: f64 = 1e5;
/// Turns and rates below this, rad and rad/s, count as zero.
const NONE: f64 = 1e-9;

/// Largest angular accelerations of a turn, rad/s^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnLimits {
    /// About any axis normal to the body's z axis.
    pub tilt: f64,
    /// About the body's z axis.
    pub yaw: f64,
}

impl TurnLimits {
    /// Half of the angular acceleration that the rotors can add to a level hover without losing height.
    #[must_use]
    pub fn of(vehicle: &Vehicle) -> Self {
        let allocator = Allocator::new(vehicle);
        let possible = |acceleration: Vector3| {
            let torque = vehicle.inertia() * acceleration;
            let weight = vehicle.weight();
            let out = allocator.allocate(&Vector6::new(0.0, 0.0, weight, torque.x, torque.y, torque.z));
            matches!(out.given_up, None | Some(Priority::LateralForce))
        };
        // The smaller of `least` and the largest possible acceleration about an axis.
        let smaller = |least: f64, axis: Vector3| {
            if possible(axis * least) {
                return least;
            }
            let (mut low, mut high) = (0.0, LARGEST);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if middle < least && possible(axis * middle) { low = middle } else { high = middle }
            }
            low
        };
        let around = (0..24).map(|k| f64::from(k) * core::f64::consts::PI / 12.0);
        let tilt = around.map(|a| Vector3::new(cos(a), sin(a), 0.0)).fold(LARGEST, smaller);
        let yaw = [Vector3::z(), -Vector3::z()].into_iter().fold(LARGEST, smaller);
        // A vehicle that is too heavy to hover needs limits too.
        Self { tilt: (SHARE * tilt).max(1.0), yaw: (SHARE * yaw).max(1.0) }
    }

    /// How many times the limits a vector is.
    fn times(&self, v: &Vector3) -> f64 {
        (sqrt(v.x * v.x + v.y * v.y) / self.tilt).max(fabs(v.z) / self.yaw)
    }
}

/// Moves the turn of one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TurnFilter {
    pub limits: TurnLimits,
    /// Bandwidth of the linear filter near the target, rad/s.
    pub bandwidth: f64,
    /// Time constant of the rotors, s.
    pub lag: f64,
}

/// The present turn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TurnState {
    /// Rotation vector from the wanted to the chosen attitude, rad.
    pub turn: Vector3,
    /// Its angular velocity, rad/s, chosen body coordinates.
    pub rate_r: Vector3,
    /// Its angular acceleration, rad/s^2, chosen body coordinates.
    pub acceleration_r: Vector3,
    /// Wanted attitude and angular velocity of the last call.
    wanted: Option<(Matrix3, Vector3)>,
}

impl TurnFilter {
    /// Moves the turn towards a target rotation vector, wanted body coordinates, and turns the reference, which has the wanted
    /// attitude, by it. Returns
    /// the angular acceleration, rad/s^2, to demand in addition to the reference's, because the rotors follow with a lag.
    #[inline]
    pub(super) fn step(
        &self,
        state: &mut TurnState,
        reference: &mut Reference,
        target: &Vector3,
        dt: f64,
    ) -> Vector3 {
        Self::absorb_jump(state, reference, dt);
        state.wanted = Some((reference.rotation_wr, reference.angular_velocity_r));
        let still = [&state.rate_r, &state.acceleration_r, &state.turn]
            .iter()
            .all(|v| v.norm_squared() < NONE * NONE);
        if still && target.norm_squared() == 0.0 {
            *state = TurnState { wanted: state.wanted, ..TurnState::default() };
            return Vector3::zeros();
        }
        let lead_r = if dt > 0.0 { self.advance(state, target, dt) } else { Vector3::zeros() };
        let turn = so3::exp(&state.turn);
        let carried = turn.transpose() * reference.angular_velocity_r;
        *reference = Reference {
            rotation_wr: reference.rotation_wr * turn,
            angular_velocity_r: carried + state.rate_r,
            angular_acceleration_r: turn.transpose() * reference.angular_acceleration_r
                - state.rate_r.cross(&carried)
                + state.acceleration_r,
            ..*reference
        };
        lead_r
    }

    /// Keeps the chosen attitude and its rate if the wanted ones jump: no rotor can follow a jump.
    #[inline]
    fn absorb_jump(state: &mut TurnState, wanted: &Reference, dt: f64) {
        let Some((rotation_wr, velocity_r)) = &state.wanted else { return };
        let turn_r = dt * wanted.angular_velocity_r;
        if so3::follows(rotation_wr, &turn_r, &wanted.rotation_wr, JUMP) {
            return;
        }
        // The wanted attitude one period ago, by its present angular velocity.
        let origin_wr = wanted.rotation_wr * so3::exp(&-turn_r);
        let jump = origin_wr.transpose() * rotation_wr;
        let before = so3::exp(&state.turn);
        let turn = jump * before;
        state.turn = so3::log(&turn);
        state.rate_r += before.transpose() * velocity_r - turn.transpose() * wanted.angular_velocity_r;
    }

    /// One period; returns the acceleration that compensates the lag.
    fn advance(&self, state: &mut TurnState, target: &Vector3, dt: f64) -> Vector3 {
        let bandwidth = self.bandwidth.min(LARGEST_STEP / dt);
        // Without lag the poles of the linear filter are those of (s + bandwidth)^2.
        let (approach, braking) = (0.5 * bandwidth, 2.0 * bandwidth);
        let following = (3.0 * bandwidth).max(if self.lag > 0.0 { 1.0 / self.lag } else { 0.0 });
        let turn = so3::exp(&state.turn);
        let away = so3::log(&(turn.transpose() * so3::exp(target)));
        let mut command = (self.approach_rate(&away, approach) - state.rate_r) * braking;
        command /= self.limits.times(&command).max(1.0);
        let before = state.acceleration_r;
        state.acceleration_r = command + (before - command) * exp(-following * dt);
        let change = state.acceleration_r - before;
        let rate = state.rate_r;
        state.rate_r += 0.5 * dt * (before + state.acceleration_r);
        state.turn = so3::log(&(turn * so3::exp(&(0.5 * dt * (rate + state.rate_r)))));
        change * (self.lag / dt)
    }

    /// The rate towards a target at this distance: proportional near the target, otherwise as fast as braking in time
    /// allows.
    fn approach_rate(&self, away: &Vector3, gain: f64) -> Vector3 {
        let distance = away.norm();
        let limit = distance / self.limits.times(away).max(f64::MIN_POSITIVE) * BRAKING;
        let near = limit / (gain * gain);
        if distance <= near {
            away * gain
        } else {
            away * (sqrt(2.0 * limit * (distance - 0.5 * near)) / distance)
        }
    }
}
