//! The simulated vehicle: its body, its sensors and its flight board, on
//! virtual time ([`Simulation`]) or behind a pseudo-terminal ([`Server`]).

pub mod battery;
mod capture;
pub mod firmware;
pub mod ground;
pub mod motor;
pub mod pushes;
mod server;

pub use capture::{CAPTURE_EVERY, CAPTURE_RATE, Capture};
pub use firmware::{Firmware, FirmwareParams};
pub use pushes::{Push, Pushes};
pub use server::{Observer, Report, Server};

use firmware::Measurements;
use ground::Ground;
use tilthex_core::{
    Matrix3, RobotState, RotorVector, Vector3, Vehicle, Wrench,
    plant::{Plant, PlantState, SensorParams, Sensors},
};

/// Microseconds since the board was powered.
pub type Micros = u64;

/// The board's cycle.
pub const STEP: Micros = 1000;

/// Steps of the body in one cycle while its feet may touch the ground.
const CONTACT_STEPS: usize = 4;

/// What is simulated.
#[derive(Clone, Debug)]
pub struct SimulationParams {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// Noise and biases of its sensors.
    pub sensors: SensorParams,
    /// Its flight board.
    pub firmware: FirmwareParams,
    /// What pushes its tool.
    pub pushes: Pushes,
    /// Chooses the noise.
    pub seed: u64,
}

impl SimulationParams {
    /// A vehicle on the ground, with the noise that the experiments are judged with, and no pushes.
    #[must_use]
    pub fn new(vehicle: Vehicle) -> Self {
        Self {
            vehicle,
            sensors: SensorParams::EXPERIMENTS,
            firmware: FirmwareParams::default(),
            pushes: Pushes::default(),
            seed: 1,
        }
    }
}

/// What is true of the simulated vehicle at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Simulated time, s.
    pub time: f64,
    /// Pose and twist.
    pub robot: RobotState,
    /// Rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
    /// Position of the tool tip, m, world.
    pub tool_position_w: Vector3,
    /// What pushes the tool, world, at its tip.
    pub tool_wrench_w: Wrench,
    /// What the ground and the pushes exert: force W, torque R about the centre of mass.
    pub external: Wrench,
}

/// The vehicle and its world in virtual time.
#[derive(Clone, Debug)]
pub struct Simulation {
    plant: Plant,
    state: PlantState,
    sensors: Sensors,
    firmware: Firmware,
    ground: Ground,
    pushes: Pushes,
    external: Wrench,
    tool_wrench_w: Wrench,
    /// Part of each rotor's speed that its motor reaches.
    health: RotorVector,
    /// Part of its thrust that each rotor has.
    thrust: RotorVector,
    now: Micros,
}

impl Simulation {
    /// A vehicle that stands on the ground over the origin, switched off.
    #[must_use]
    pub fn new(params: SimulationParams) -> Self {
        let plant = Plant::new(params.vehicle);
        // Legs that keep the tool off the ground, or at least some way under the body.
        let leg = (-params.vehicle.tool().position_r.z).max(0.1) + 0.05;
        let mut simulation = Self {
            plant,
            state: PlantState {
                robot: RobotState::at_rest(Vector3::new(0.0, 0.0, leg)),
                rotor_speeds: RotorVector::zeros(),
            },
            sensors: Sensors::new(params.sensors, params.seed),
            firmware: Firmware::new(&params.vehicle, params.firmware),
            ground: Ground { leg },
            pushes: params.pushes,
            external: Wrench::ZERO,
            tool_wrench_w: Wrench::ZERO,
            health: RotorVector::repeat(1.0),
            thrust: RotorVector::repeat(1.0),
            now: 0,
        };
        simulation.settle();
        simulation
    }

    /// Lets the legs take the weight.
    fn settle(&mut self) {
        for _ in 0..4000 {
            self.move_body(0.25e-3);
        }
    }

    /// Takes bytes from the host; answers go to `out`.
    pub fn receive(&mut self, bytes: &[u8], out: &mut Vec<u8>) {
        self.firmware.receive(bytes, self.now, out);
    }

    /// One cycle of [`STEP`]: body, sensors, board; what it sends goes to `out`.
    pub fn advance(&mut self, out: &mut Vec<u8>) {
        let dt = STEP as f64 * 1e-6;
        self.now += STEP;
        let since_start = self.firmware.first_start().map(|start| (self.now - start) as f64 * 1e-6);
        self.tool_wrench_w = since_start.map_or(Wrench::ZERO, |time| self.pushes.wrench(time));
        let steps = if self.ground.is_near(&self.state.robot) { CONTACT_STEPS } else { 1 };
        for _ in 0..steps {
            self.move_body(dt / steps as f64);
        }
        let Self { firmware, sensors, plant, state, external, .. } = self;
        let measure = || Measurements {
            imu: sensors.imu(plant, state, external),
            rotor_speeds: sensors.rotor_speeds(plant, state),
        };
        firmware.advance(self.now, dt, &state.rotor_speeds, measure, out);
    }

    fn move_body(&mut self, dt: f64) {
        let push = self.plant.from_tool(&self.state, &self.tool_wrench_w);
        self.external = self.ground.wrench(&self.state.robot) + push - self.lost_thrust();
        let commands = self.firmware.commands().component_mul(&self.health);
        self.plant.step(&mut self.state, &commands, &self.external, dt);
    }

    /// What damaged rotors do not exert: force W, torque R.
    fn lost_thrust(&self) -> Wrench {
        let (speeds, kept) = (&self.state.rotor_speeds, &self.thrust);
        let lost = speeds.zip_map(kept, |w, kept| w * (1.0 - kept).sqrt());
        let body = self.plant.vehicle().body_wrench(&lost);
        Wrench { force: self.state.robot.rotation_wr * body.force, torque: body.torque }
    }

    /// The vehicle.
    #[must_use]
    pub fn vehicle(&self) -> &Vehicle {
        self.plant.vehicle()
    }

    /// The pose as motion capture sees it now: position (m, W), rotation (R to W).
    pub fn captured_pose(&mut self) -> (Vector3, Matrix3) {
        self.sensors.pose(&self.state)
    }

    /// Time since power-on.
    #[must_use]
    pub fn now(&self) -> Micros {
        self.now
    }

    /// The flight board.
    #[must_use]
    pub fn firmware(&self) -> &Firmware {
        &self.firmware
    }

    /// The flight board, to do something to it.
    pub fn firmware_mut(&mut self) -> &mut Firmware {
        &mut self.firmware
    }

    /// The sensors, to do something to them.
    pub fn sensors_mut(&mut self) -> &mut Sensors {
        &mut self.sensors
    }

    /// Lets a rotor (from 0) reach only a part of the speed its motor drives it to.
    pub fn weaken_rotor(&mut self, rotor: usize, part: f64) {
        if let Some(health) = self.health.get_mut(rotor) {
            *health = part;
        }
    }

    /// Leaves a rotor (from 0) only a part of its thrust and drag, at the speed it turns with.
    pub fn damage_rotor(&mut self, rotor: usize, part: f64) {
        if let Some(thrust) = self.thrust.get_mut(rotor) {
            *thrust = part;
        }
    }

    /// Whether the vehicle stands on its feet.
    #[must_use]
    pub fn stands(&self) -> bool {
        let level = self.state.robot.rotation_wr[(2, 2)] > 0.98;
        level && self.rests()
    }

    /// Whether the vehicle lies still on the ground, however.
    #[must_use]
    pub fn rests(&self) -> bool {
        let robot = &self.state.robot;
        robot.position_w.z < self.ground.leg + 0.01 && robot.velocity_w.norm() < 0.1
    }

    /// What is true now.
    #[must_use]
    pub fn truth(&self) -> Truth {
        Truth {
            time: self.now as f64 * 1e-6,
            robot: self.state.robot,
            rotor_speeds: self.state.rotor_speeds,
            tool_position_w: self.plant.tool_pose(&self.state).0,
            tool_wrench_w: self.tool_wrench_w,
            external: self.external,
        }
    }
}
