//! Control over a line that has become late: slower gains, and the state at the time at which a command arrives.

use crate::{
    Error,
    controller::{Controller, ControllerInput, ControllerOutput, ControllerParams, ControllerState},
    pose_control::PoseGains,
    ring::Ring,
    so3,
    types::{RobotState, Vector3},
    wrench_observer::ObserverGains,
};

/// Rates of the position loop and of the rotation loop, both critically damped, and of the observer, 1/s, that tolerate the longest
/// delay there and back together, s, with the rotors' lag.
const POSITION: f64 = 1.5;
const ROTATION: f64 = 5.0;
const OBSERVER: f64 = 3.0;
const LONGEST: f64 = 0.1;
/// Number of ticks that are remembered.
const TICKS: usize = 64;

/// A step of the controller over a line that is `delay` s late, each way. A function of its own, so that the copy of the
/// controller takes stack only where a line is late.
#[inline(never)]
pub(super) fn step(
    controller: &Controller,
    delay: f64,
    state: &mut ControllerState,
    input: &ControllerInput,
    dt: f64,
) -> ControllerOutput {
    slowed(controller, delay).as_ref().unwrap_or(controller).step(state, input, dt)
}

/// The controller for a line that is `delay` s late, each way: its gains are not faster than the delay allows.
fn slowed(controller: &Controller, delay: f64) -> Result<Controller, Error> {
    let ControllerParams { pose, observer, .. } = controller.params();
    let lag = controller.vehicle().rotor_time_constant();
    let faster = ((LONGEST + lag) / (2.0 * delay + lag)).max(1.0);
    let most = |gain: Vector3, limit: f64| gain.map(|x| x.min(limit));
    let [position, rotation, observing] = [POSITION, ROTATION, OBSERVER].map(|rate| rate * faster);
    let pose = PoseGains {
        position: most(pose.position, position * position),
        velocity: most(pose.velocity, 2.0 * position),
        rotation: most(pose.rotation, rotation * rotation),
        angular_velocity: most(pose.angular_velocity, 2.0 * rotation),
    };
    let observer =
        ObserverGains { force: most(observer.force, observing), torque: most(observer.torque, observing) };
    controller.with_gains(pose, observer)
}

/// The rotations that the last commands will still cause.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pending {
    /// Angular acceleration, rad/s^2, robot, and the length of its tick, s.
    turns: Ring<(Vector3, f64), TICKS>,
}

impl Default for Pending {
    fn default() -> Self {
        Self { turns: Ring::new((Vector3::zeros(), 0.0)) }
    }
}

impl Pending {
    /// Takes the angular acceleration, rad/s^2, robot, that the model expects over a tick of `dt` s.
    pub(super) fn push(&mut self, angular_acceleration_r: Vector3, dt: f64) {
        self.turns.push((angular_acceleration_r, dt));
    }

    /// Predicts a state that is `delay` s old when a command of now takes effect to that time.
    pub(super) fn ahead(&self, robot: &RobotState, delay: f64) -> RobotState {
        let (mut left, mut rate, mut turn) = (delay, Vector3::zeros(), Vector3::zeros());
        // The acceleration of a tick acts until the end: its share of the angle grows with the time that is left
        // after it.
        for (alpha, dt) in self.turns.iter() {
            if left <= 0.0 {
                break;
            }
            let dt = dt.min(left);
            let since = delay - left + 0.5 * dt;
            rate += alpha * dt;
            turn += alpha * dt * since;
            left -= dt;
        }
        RobotState {
            position_w: robot.position_w + robot.velocity_w * delay,
            rotation_wr: robot.rotation_wr * so3::exp(&(robot.angular_velocity_r * delay + turn)),
            angular_velocity_r: robot.angular_velocity_r + rate,
            ..*robot
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_acceleration_is_carried_on() {
        let mut pending = Pending::default();
        for _ in 0..TICKS {
            pending.push(Vector3::new(2.0, 0.0, 0.0), 0.002);
        }
        let mut robot = RobotState::at_rest(Vector3::zeros());
        robot.angular_velocity_r.x = 0.5;
        let ahead = pending.ahead(&robot, 0.08);
        assert!((ahead.angular_velocity_r.x - 0.66).abs() < 1e-9);
        let angle = so3::log(&ahead.rotation_wr).x;
        assert!((angle - (0.5 * 0.08 + 0.5 * 2.0 * 0.08 * 0.08)).abs() < 1e-9, "{angle}");
    }
}
