//! Steady hovers, each reduced to the means for its balance of forces and torques.

use crate::{
    Vehicle,
    types::{RobotState, RotorVector, Vector3, Wrench},
    vehicle::inputs,
};

/// A hover is used from this time after its set-point has come to rest, s.
pub const SETTLE: f64 = 1.2;
/// Means are taken over blocks of this length, s.
const BLOCK: f64 = 0.5;
/// Number of the newest blocks of a hover that are kept, and the smallest number that is enough.
const BLOCKS: usize = 6;
const FEWEST: usize = 4;
/// A vehicle that is faster than this, m/s and rad/s, does not hover.
const STILL: (f64, f64) = (0.1, 0.2);

/// The shortest time of a hover with a set-point at rest, s.
pub const SHORTEST: f64 = SETTLE + BLOCK * (FEWEST as f64 + 0.5);

/// The measurements of a tick without contact.
#[derive(Clone, Copy, Debug)]
pub struct HoverSample {
    /// Pose and twist of the robot.
    pub robot: RobotState,
    /// Specific force at the centre of mass, m/s^2, robot.
    pub specific_force_r: Vector3,
    /// Measured rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
    /// External wrench that is known, robot: the drag in an estimated wind.
    pub external_r: Wrench,
}

/// Means over a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Hover {
    /// Specific force, m/s^2, robot.
    pub(super) specific_force_r: Vector3,
    /// Rate of the angular momentum with its gyroscopic part, N m, robot.
    pub(super) momentum_rate_r: Vector3,
    /// Rotor inputs, Hz^2.
    pub(super) inputs: RotorVector,
    /// The world's x axis, robot.
    pub(super) x_r: Vector3,
}

impl Hover {
    /// The external wrench of the hover by a vehicle's model, robot.
    pub(super) fn wrench(&self, vehicle: &Vehicle) -> Wrench {
        let given = Wrench::from_vector(&(vehicle.allocation() * self.inputs));
        Wrench {
            force: self.specific_force_r * vehicle.mass() - given.force,
            torque: self.momentum_rate_r - given.torque,
        }
    }

    /// The world's horizontal axes, robot.
    fn horizontal_r(&self) -> [Vector3; 2] {
        let normal = |v: Vector3| v / v.norm().max(1e-9);
        let up_r = normal(self.specific_force_r);
        let x_r = normal(self.x_r - up_r * up_r.dot(&self.x_r));
        [x_r, up_r.cross(&x_r)]
    }

    /// By how much the heading differs from that of another hover, rad.
    pub(super) fn turned_from(&self, other: &Self) -> f64 {
        let heading = |hover: &Self| {
            let [x_r, y_r] = hover.horizontal_r();
            libm::atan2(y_r.x, x_r.x)
        };
        let turn = heading(self) - heading(other);
        libm::fabs(libm::atan2(libm::sin(turn), libm::cos(turn)))
    }

    /// A force and a torque along each horizontal axis of the world, of these sizes.
    pub(super) fn pushes_of_air(&self, (force, torque): (f64, f64)) -> [Wrench; 4] {
        let [x_r, y_r] = self.horizontal_r();
        let pushed = |axis_r: Vector3| Wrench { force: axis_r * force, torque: Vector3::zeros() };
        let turned = |axis_r: Vector3| Wrench { force: Vector3::zeros(), torque: axis_r * torque };
        [pushed(x_r), pushed(y_r), turned(x_r), turned(y_r)]
    }

    fn scaled(&self, by: f64) -> Self {
        Self {
            specific_force_r: self.specific_force_r * by,
            momentum_rate_r: self.momentum_rate_r * by,
            inputs: self.inputs * by,
            x_r: self.x_r * by,
        }
    }

    fn sum(&self, other: &Self) -> Self {
        Self {
            specific_force_r: self.specific_force_r + other.specific_force_r,
            momentum_rate_r: self.momentum_rate_r + other.momentum_rate_r,
            inputs: self.inputs + other.inputs,
            x_r: self.x_r + other.x_r,
        }
    }
}

/// Computes the means of one hover.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct HoverMeter {
    /// For how long the set-point has been at rest, s.
    rest: f64,
    /// The block so far: its integral, its length, s, and the angular momentum at its start.
    sum: Hover,
    time: f64,
    begin_r: Option<Vector3>,
    /// The newest blocks, newest first.
    blocks: [Hover; BLOCKS],
    count: usize,
}

impl HoverMeter {
    /// One tick of a set-point at rest.
    pub(super) fn add(&mut self, vehicle: &Vehicle, sample: &HoverSample, dt: f64) {
        self.rest += dt;
        let omega = sample.robot.angular_velocity_r;
        let fast = sample.robot.velocity_w.norm() > STILL.0 || omega.norm() > STILL.1;
        let finite = sample.robot.is_finite()
            && sample.specific_force_r.iter().all(|x| x.is_finite())
            && sample.external_r.is_finite();
        if fast || !finite || !sample.rotor_speeds.iter().all(|w| w.is_finite()) {
            *self = Self { rest: self.rest, ..Self::default() };
            return;
        }
        if self.rest < SETTLE || dt <= 0.0 {
            return;
        }
        let momentum_r = vehicle.inertia() * omega;
        let begin_r = *self.begin_r.get_or_insert(momentum_r);
        let now = Hover {
            specific_force_r: sample.specific_force_r - sample.external_r.force / vehicle.mass(),
            momentum_rate_r: omega.cross(&momentum_r) - sample.external_r.torque,
            inputs: inputs(&sample.rotor_speeds),
            x_r: sample.robot.rotation_wr.transpose() * Vector3::x(),
        };
        self.sum = self.sum.sum(&now.scaled(dt));
        self.time += dt;
        if self.time >= BLOCK {
            let mut block = self.sum.scaled(1.0 / self.time);
            block.momentum_rate_r += (momentum_r - begin_r) / self.time;
            self.blocks.rotate_right(1);
            if let Some(first) = self.blocks.first_mut() {
                *first = block;
            }
            self.count = (self.count + 1).min(BLOCKS);
            (self.sum, self.time, self.begin_r) = (Hover::default(), 0.0, Some(momentum_r));
        }
    }

    /// Forgets the hover so far.
    pub(super) fn give_up(&mut self) {
        if self.rest > 0.0 {
            *self = Self::default();
        }
    }

    /// Whether it has as much as it keeps.
    pub(super) fn is_full(&self) -> bool {
        self.count == BLOCKS
    }

    /// The means of a hover that lasted long enough, and the largest difference of a block's wrench from their
    /// wrench.
    pub(super) fn finish(&mut self, vehicle: &Vehicle) -> Option<(Hover, Wrench)> {
        let done = core::mem::take(self);
        if done.count < FEWEST {
            return None;
        }
        let blocks = || done.blocks.iter().take(done.count);
        let sum = blocks().fold(Hover::default(), |sum, block| sum.sum(block));
        let mean = sum.scaled(1.0 / done.count as f64);
        let all = mean.wrench(vehicle);
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        for block in blocks() {
            let away = block.wrench(vehicle) - all;
            force = if away.force.norm() > force.norm() { away.force } else { force };
            torque = if away.torque.norm() > torque.norm() { away.torque } else { torque };
        }
        Some((mean, Wrench { force, torque }))
    }
}
