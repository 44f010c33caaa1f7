//! The body that carries the flight board, with its rotors, and the wrenches of its environment.

use tilthex_core::{
    RobotState, RotorVector, Vector3, Wrench,
    plant::{EffectsState, ImuSample, Loads, Plant, PlantState, TimeStep},
};

use super::{Pushes, ground::Ground};
use crate::{Nanos, SimError};

/// Steps of [`Own`] in one cycle while its feet may touch the ground.
const CONTACT_STEPS: usize = 4;

/// One cycle of the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cycle {
    /// End of the cycle, ns: on the monotonic clock behind a pseudo-terminal, otherwise since power-on.
    pub at: Nanos,
    /// Length of the cycle, s.
    pub dt: f64,
    /// End of the cycle, s since the first motor was started.
    pub since_start: Option<f64>,
}

/// A body in its world. All values are true values; the sensors add the noise.
pub trait Body {
    /// Moves by one cycle. `commands` are the speeds to which the motors drive their rotors, Hz.
    fn advance(&mut self, cycle: &Cycle, commands: &RotorVector);

    /// Pose, twist and rotor speeds.
    fn state(&self) -> &PlantState;

    /// The values that a perfect IMU measures in the cycle, IMU axes.
    fn imu(&self) -> ImuSample;

    /// The wrench of the environment on the tool, world, at its tip.
    fn tool_wrench_w(&self) -> Wrench;

    /// The wrench of everything except rotors and weight: force W, torque R about the centre of mass.
    fn external(&self) -> Wrench;

    /// Whether it is at rest, not higher than its starting height.
    fn rests(&self) -> bool;

    /// Whether it can no longer move; [`Self::finish`] says why.
    fn failed(&self) -> bool {
        false
    }

    /// Ends its world.
    ///
    /// # Errors
    /// One sentence, if the world had failed or does not end properly.
    fn finish(&mut self) -> Result<(), SimError> {
        Ok(())
    }
}

/// The plant of the core on flat ground, with pushes on its tool and damage to its rotors.
#[derive(Clone, Debug)]
pub struct Own {
    plant: Plant,
    state: PlantState,
    /// The nominal wrench of its rotors.
    rotors: Wrench,
    /// The last step.
    time_step: TimeStep,
    /// Flat ground at z = 0; `None` for a body that flies high above it.
    ground: Option<Ground>,
    pushes: Pushes,
    /// The sum of all outer wrenches but that on the tool: force W, torque R about the centre of mass.
    apart: Wrench,
    tool_wrench_w: Wrench,
    /// Whether every rotor is as the plant has it.
    sound: bool,
    /// Fraction of the commanded speed that each motor reaches.
    health: RotorVector,
    /// Fraction of its thrust that each rotor has.
    thrust: RotorVector,
    /// 1 if a rotor turns in the opposite direction, with a propeller for that direction; otherwise 0.
    reversed: RotorVector,
    /// The wrench on the tool (world, at its tip) in addition to the pushes.
    pub(super) pressed_tool_w: Wrench,
    /// The wrench on the body: force W, torque R about the centre of mass.
    pub(super) pressed: Wrench,
}

impl Own {
    /// A body that stands on the ground at the origin with its rotors still; `seed` is the seed of the gusts.
    #[must_use]
    pub fn new(plant: Plant, pushes: Pushes, seed: u64) -> Self {
        // The legs keep the tool off the ground, and are at least 0.15 m long.
        let leg = (-plant.vehicle().tool().position_r.z).max(0.1) + 0.05;
        let robot = RobotState::at_rest(Vector3::new(0.0, 0.0, leg));
        let state = PlantState::new(robot, RotorVector::zeros());
        let mut body = Self::in_state(plant, pushes, state, Some(Ground { leg }));
        body.settle();
        body.state.effects = EffectsState::new(plant.effects(), seed);
        body
    }

    /// A body that hovers in a state, high above the ground. The times of the pushes count from power-on.
    #[must_use]
    pub fn airborne(plant: Plant, pushes: Pushes, state: PlantState, seed: u64) -> Self {
        let effects = EffectsState::new(plant.effects(), seed);
        Self::in_state(plant, pushes, PlantState { effects, ..state }, None)
    }

    fn in_state(plant: Plant, pushes: Pushes, state: PlantState, ground: Option<Ground>) -> Self {
        Self {
            plant,
            state,
            rotors: plant.vehicle().body_wrench(&state.rotor_speeds),
            time_step: plant.time_step(0.0),
            ground,
            pushes,
            apart: Wrench::ZERO,
            tool_wrench_w: Wrench::ZERO,
            sound: true,
            health: RotorVector::repeat(1.0),
            thrust: RotorVector::repeat(1.0),
            reversed: RotorVector::zeros(),
            pressed_tool_w: Wrench::ZERO,
            pressed: Wrench::ZERO,
        }
    }

    /// Limits the speed of a rotor (from 0) to a fraction of the speed that its motor is commanded.
    pub fn weaken_rotor(&mut self, rotor: usize, part: f64) {
        if let Some(health) = self.health.get_mut(rotor) {
            (*health, self.sound) = (part, false);
        }
    }

    /// Reduces thrust and drag of a rotor (from 0) to a fraction, at an unchanged speed.
    pub fn damage_rotor(&mut self, rotor: usize, part: f64) {
        if let Some(thrust) = self.thrust.get_mut(rotor) {
            (*thrust, self.sound) = (part, false);
        }
    }

    /// Makes a rotor (from 0) turn in the opposite direction, with a propeller for that direction.
    pub fn reverse_spin(&mut self, rotor: usize) {
        if let Some(reversed) = self.reversed.get_mut(rotor) {
            (*reversed, self.sound) = (1.0, false);
        }
    }

    /// Moves the body until the legs carry the weight.
    fn settle(&mut self) {
        for _ in 0..4000 {
            self.step(&RotorVector::zeros(), 0.25e-3);
        }
    }

    /// Updates the wrenches that act now, `since_start` (s) after the start of the motors. The body does not move.
    pub fn feel(&mut self, since_start: Option<f64>) {
        self.tool_wrench_w = self.presses(since_start);
        self.sum_up();
    }

    /// The wrench on the tool, world, at its tip.
    fn presses(&self, since_start: Option<f64>) -> Wrench {
        self.pressed_tool_w + since_start.map_or(Wrench::ZERO, |time| self.pushes.wrench(time))
    }

    /// The values of a perfect IMU, and the specific force at the centre of mass, m/s^2, R.
    #[must_use]
    pub fn inertial(&self) -> (ImuSample, Vector3) {
        self.plant.imu_by(&self.state, &self.rotors, &self.external())
    }

    fn sum_up(&mut self) {
        let mut sum = self.ground.map_or(Wrench::ZERO, |ground| ground.wrench(&self.state.robot));
        sum = sum + self.pressed;
        if !self.sound {
            sum = sum - self.lost_thrust();
        }
        self.apart = sum;
    }

    fn step(&mut self, commands: &RotorVector, dt: f64) {
        self.sum_up();
        if self.time_step.dt() != dt {
            self.time_step = self.plant.time_step(dt);
        }
        let limited;
        let commands = if self.sound {
            commands
        } else {
            limited = commands.component_mul(&self.health);
            &limited
        };
        let loads = Loads { external: self.apart, tool_w: self.tool_wrench_w };
        self.plant.step_by(&self.time_step, &mut self.state, &mut self.rotors, commands, &loads);
    }

    /// The part of the nominal wrench that damaged and reversed rotors do not exert: force W, torque R.
    fn lost_thrust(&self) -> Wrench {
        let (speeds, kept) = (&self.state.rotor_speeds, &self.thrust);
        if kept.iter().all(|part| *part >= 1.0) && self.reversed.iter().all(|reversed| *reversed == 0.0) {
            return Wrench::ZERO;
        }
        let lost = speeds.zip_map(kept, |w, kept| w * (1.0 - kept).sqrt());
        let mut body = self.plant.vehicle().body_wrench(&lost);
        for ((rotor, speed), reversed) in self.plant.vehicle().rotors().iter().zip(speeds).zip(&self.reversed)
        {
            // The drag moment acts in the opposite direction.
            let moment = rotor.spin * rotor.drag_coefficient * speed * speed.abs();
            body.torque += 2.0 * reversed * moment * rotor.axis_r;
        }
        Wrench { force: self.state.robot.rotation_wr * body.force, torque: body.torque }
    }
}

impl Body for Own {
    fn advance(&mut self, cycle: &Cycle, commands: &RotorVector) {
        self.tool_wrench_w = self.presses(cycle.since_start);
        let near = self.ground.is_some_and(|ground| ground.is_near(&self.state.robot));
        let steps = if near { CONTACT_STEPS } else { 1 };
        for _ in 0..steps {
            self.step(commands, cycle.dt / steps as f64);
        }
    }

    fn state(&self) -> &PlantState {
        &self.state
    }

    fn imu(&self) -> ImuSample {
        self.inertial().0
    }

    fn tool_wrench_w(&self) -> Wrench {
        self.tool_wrench_w
    }

    fn external(&self) -> Wrench {
        if self.tool_wrench_w == Wrench::ZERO {
            return self.apart;
        }
        self.apart + self.plant.from_tool(&self.state, &self.tool_wrench_w)
    }

    fn rests(&self) -> bool {
        let robot = &self.state.robot;
        self.ground.is_some_and(|ground| robot.position_w.z < ground.leg + 0.01)
            && robot.velocity_w.norm() < 0.1
    }
}
