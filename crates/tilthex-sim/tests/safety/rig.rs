//! A body to be cruel to: pushed anywhere, with a tool that may stand below its feet, and motors wired wrongly.

use std::{cell::RefCell, rc::Rc};

use tilthex_core::{
    RobotState, RotorVector, Vector3, Wrench,
    plant::{EffectsState, ImuSample, Plant, PlantState},
};
use tilthex_sim::{Body, body::Cycle, ground::Ground};

/// Stiffness (N/m) and damping (N s/m) of the tool's tip on the ground.
const TIP: (f64, f64) = (3000.0, 40.0);

/// What a test does to the body, at any time.
#[derive(Clone, Debug)]
pub(crate) struct Cruelty {
    /// A force, N, world, and where on the vehicle it acts, m, robot.
    pub(crate) push: (Vector3, Vector3),
    /// Motor `i` drives rotor `order[i]`.
    pub(crate) order: Vec<usize>,
    /// Whether the tool's tip touches the ground: what it stood on at the begin is gone.
    pub(crate) tip: bool,
    /// This motor (from 0) turns the wrong way round, with its propeller, or, where it is true, the other one.
    pub(crate) reversed: Option<(usize, bool)>,
    /// This motor's telemetry says that it stands still.
    pub(crate) silent: Option<usize>,
}

/// The body.
#[derive(Debug)]
pub(crate) struct Rig {
    plant: Plant,
    body: PlantState,
    /// The same with the rotors in the order of the motors.
    shown: PlantState,
    ground: Ground,
    cruelty: Rc<RefCell<Cruelty>>,
    external: Wrench,
}

impl Rig {
    /// It stands over the origin, rotors still, its centre of mass `leg` metres over its feet. Where the tool is
    /// longer than that, the feet stand on blocks that are gone once it has taken off.
    pub(crate) fn new(plant: Plant, leg: f64, seed: u64) -> (Self, Rc<RefCell<Cruelty>>) {
        let order = (0..plant.vehicle().rotor_count()).collect();
        let cruelty = Cruelty {
            push: (Vector3::zeros(), Vector3::zeros()),
            order,
            tip: false,
            reversed: None,
            silent: None,
        };
        let cruelty = Rc::new(RefCell::new(cruelty));
        let at = RobotState::at_rest(Vector3::new(0.0, 0.0, leg));
        let state = PlantState::new(at, RotorVector::zeros());
        let ground = Ground { leg };
        let mut rig = Self {
            plant,
            body: state,
            shown: state,
            ground,
            cruelty: cruelty.clone(),
            external: Wrench::ZERO,
        };
        for _ in 0..4000 {
            rig.step(&RotorVector::zeros(), 0.25e-3);
        }
        rig.body.effects = EffectsState::new(plant.effects(), seed);
        rig.shown = rig.body;
        (rig, cruelty)
    }

    fn step(&mut self, commands: &RotorVector, dt: f64) {
        let robot = self.body.robot;
        let mut external = self.ground.wrench(&robot);
        let (force_w, arm_r) = self.cruelty.borrow().push;
        external = external + at(&robot, &force_w, &arm_r);
        if let Some((rotor, propeller)) = self.cruelty.borrow().reversed {
            let mut alone = RotorVector::zeros();
            alone[rotor] = self.body.rotor_speeds[rotor];
            let mut given = self.plant.vehicle().body_wrench(&alone);
            if propeller {
                let kind = self.plant.vehicle().rotors()[rotor];
                given.force = Vector3::zeros();
                given.torque = kind.axis_r * (kind.spin * kind.drag_coefficient * alone[rotor].powi(2));
            }
            let lost = Wrench { force: robot.rotation_wr * given.force, torque: given.torque };
            external = external - lost - lost;
        }
        let tip_r = self.plant.vehicle().tool().position_r;
        let tip = robot.position_w + robot.rotation_wr * tip_r;
        if tip.z < 0.0 && self.cruelty.borrow().tip {
            let sinks = (robot.velocity_w + robot.rotation_wr * robot.angular_velocity_r.cross(&tip_r)).z;
            let force = (-TIP.0 * tip.z - TIP.1 * sinks).max(0.0);
            external = external + at(&robot, &Vector3::new(0.0, 0.0, force), &tip_r);
        }
        self.external = external;
        self.plant.step(&mut self.body, commands, &external, dt);
    }
}

/// A force, world, at a place of the vehicle.
fn at(robot: &RobotState, force_w: &Vector3, arm_r: &Vector3) -> Wrench {
    Wrench { force: *force_w, torque: arm_r.cross(&(robot.rotation_wr.transpose() * force_w)) }
}

impl Body for Rig {
    fn advance(&mut self, cycle: &Cycle, commands: &RotorVector) {
        let order = self.cruelty.borrow().order.clone();
        let mut driven = RotorVector::zeros();
        for (motor, rotor) in order.iter().enumerate() {
            driven[*rotor] = commands[motor];
        }
        for _ in 0..4 {
            self.step(&driven, cycle.dt / 4.0);
        }
        self.shown = self.body;
        for (motor, rotor) in order.iter().enumerate() {
            self.shown.rotor_speeds[motor] = self.body.rotor_speeds[*rotor];
        }
        if let Some(motor) = self.cruelty.borrow().silent {
            self.shown.rotor_speeds[motor] = 0.0;
        }
    }

    fn state(&self) -> &PlantState {
        &self.shown
    }

    fn imu(&self) -> ImuSample {
        self.plant.imu(&self.body, &self.external)
    }

    fn tool_wrench_w(&self) -> Wrench {
        Wrench::ZERO
    }

    fn external(&self) -> Wrench {
        self.external
    }

    fn rests(&self) -> bool {
        self.body.robot.position_w.z < self.ground.leg + 0.01 && self.body.robot.velocity_w.norm() < 0.1
    }
}
