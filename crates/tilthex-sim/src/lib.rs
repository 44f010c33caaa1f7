//! The simulated vehicle on virtual time ([`Simulation`]): its body, its sensors and its flight board. It uses no
//! clock, no socket and no terminal.

pub mod body;
pub mod campaign;
mod error;
pub mod feed;
pub mod ground;
pub mod onboard;
pub mod pushes;
pub mod simulate;

pub use body::{Body, Own};
pub use error::SimError;
pub use pushes::{Push, Pushes};
pub use tilthex_link::{
    board::Micros,
    tk3::board::{Firmware, FirmwareParams},
};

pub use tilthex_core::types::Nanos;

use body::Cycle;
use tilthex_config::TrueVehicle;
use tilthex_core::{
    MAX_ROTORS, Matrix3, RobotState, RotorVector, Vector3, Vehicle, Wrench,
    plant::{Plant, SensorParams, Sensors},
};
use tilthex_link::board::{Board, Measurements};

/// The board's cycle.
pub const STEP: Micros = 1000;

/// What is simulated.
#[derive(Clone, Debug)]
pub struct SimulationParams {
    /// The vehicle, and what acts on it.
    pub plant: Plant,
    /// Noise and errors of its sensors.
    pub sensors: SensorParams,
    /// Its flight board.
    pub firmware: FirmwareParams,
    /// The exponent of the throttles of a board with PX4; `None` for that of the link.
    pub throttle_exponent: Option<f64>,
    /// Pushes on its tool.
    pub pushes: Pushes,
    /// Seed of the noise.
    pub seed: u64,
}

impl SimulationParams {
    /// A vehicle on the ground without pushes, with the sensor noise of the experiments.
    #[must_use]
    pub fn new(vehicle: Vehicle) -> Self {
        Self {
            plant: Plant::new(vehicle),
            sensors: SensorParams::EXPERIMENTS,
            firmware: FirmwareParams::default(),
            throttle_exponent: None,
            pushes: Pushes::default(),
            seed: 1,
        }
    }

    /// A vehicle on the ground with the properties that were drawn for it.
    ///
    /// # Errors
    /// If an effect is out of its range.
    pub fn of(drawn: &TrueVehicle) -> Result<Self, SimError> {
        let plant = drawn.plant().map_err(|e| SimError::refused(e.to_string()))?;
        let sensors = drawn.sensors(&SensorParams::EXPERIMENTS);
        let firmware = FirmwareParams { battery: drawn.effects.battery, ..FirmwareParams::default() };
        let throttle_exponent = drawn.throttle_exponent();
        let seed = drawn.seed;
        Ok(Self { plant, sensors, firmware, throttle_exponent, seed, ..Self::new(*plant.vehicle()) })
    }
}

/// The true state of the simulated vehicle at a time.
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
    /// The wrench of the environment on the tool, world, at its tip.
    pub tool_wrench_w: Wrench,
    /// The wrench of the environment on the vehicle, contacts and pushes: force W, torque R about the centre of mass.
    pub external: Wrench,
}

/// The vehicle and its world in virtual time.
#[derive(Clone, Debug)]
pub struct Simulation<B = Own, F = Firmware> {
    plant: Plant,
    body: B,
    sensors: Sensors,
    own_sensors: SensorParams,
    firmware: F,
    /// The rotor that each motor controller drives.
    wiring: [usize; MAX_ROTORS],
    now: Micros,
}

impl Simulation {
    /// A vehicle that stands on the ground at the origin, switched off.
    #[must_use]
    pub fn new(params: SimulationParams) -> Self {
        let body = Own::new(params.plant, params.pushes, params.seed);
        let firmware = Firmware::new(params.plant.vehicle(), params.firmware);
        Self::with_body(body, params.plant, params.sensors, firmware, params.seed)
    }
}

impl<F: Board> Simulation<Own, F> {
    /// The same with another board.
    #[must_use]
    pub fn with_board(params: SimulationParams, board: F) -> Self {
        let body = Own::new(params.plant, params.pushes, params.seed);
        Self::with_body(body, params.plant, params.sensors, board, params.seed)
    }

    /// Limits the speed of a rotor (from 0) to a fraction of the speed that its motor is commanded.
    pub fn weaken_rotor(&mut self, rotor: usize, part: f64) {
        self.body.weaken_rotor(rotor, part);
    }

    /// Reduces thrust and drag of a rotor (from 0) to a fraction, at an unchanged speed.
    pub fn damage_rotor(&mut self, rotor: usize, part: f64) {
        self.body.damage_rotor(rotor, part);
    }

    /// Makes a rotor (from 0) turn in the opposite direction, with a propeller for that direction.
    pub fn reverse_spin(&mut self, rotor: usize) {
        self.body.reverse_spin(rotor);
    }

    /// Exchanges the wires of two motors (from 0).
    pub fn exchange_motors(&mut self, one: usize, other: usize) {
        self.wiring.swap(one, other);
    }

    /// Applies a wrench to the tool (world, at its tip) and a wrench to the body (force W, torque R about the centre
    /// of mass) from now on.
    pub fn disturb(&mut self, tool_w: Wrench, body: Wrench) {
        (self.body.pressed_tool_w, self.body.pressed) = (tool_w, body);
    }

    /// The wrench that [`Self::disturb`] applies to the tool (world, at its tip).
    #[must_use]
    pub fn pressed_tool_w(&self) -> Wrench {
        self.body.pressed_tool_w
    }

    /// The wrench that [`Self::disturb`] applies to the body: force W, torque R about the centre of mass.
    #[must_use]
    pub fn disturbance(&self) -> Wrench {
        self.body.pressed
    }
}

impl<B: Body, F: Board> Simulation<B, F> {
    /// A vehicle, switched off, whose body moves in its own world; `seed` is the seed of the sensors' noise.
    #[must_use]
    pub fn with_body(body: B, plant: Plant, sensors: SensorParams, firmware: F, seed: u64) -> Self {
        Self {
            plant,
            body,
            sensors: Sensors::new(sensors, seed),
            own_sensors: sensors,
            firmware,
            wiring: std::array::from_fn(|i| i),
            now: 0,
        }
    }

    /// Takes bytes from the host; writes the answers to `out`.
    pub fn receive(&mut self, bytes: &[u8], out: &mut Vec<u8>) {
        self.firmware.receive(bytes, self.now, out);
    }

    /// Simulates one cycle of [`STEP`]: body, sensors, board. Writes the bytes that the board sends to `out`.
    pub fn advance(&mut self, out: &mut Vec<u8>) {
        self.advance_at(1000 * (self.now + STEP), out);
    }

    /// Simulates one cycle that ends at a given time of the monotonic clock.
    pub fn advance_at(&mut self, at: Nanos, out: &mut Vec<u8>) {
        let dt = STEP as f64 * 1e-6;
        self.now += STEP;
        let since_start = self.firmware.noted().first_start.map(|start| (self.now - start) as f64 * 1e-6);
        let driven = self.firmware.commands();
        let mut commands = driven;
        self.wiring.iter().zip(&driven).for_each(|(&rotor, speed)| commands[rotor] = *speed);
        self.body.advance(&Cycle { at, dt, since_start }, &commands);
        let Self { firmware, sensors, plant, body, wiring, .. } = self;
        sensors.pass(plant, body.state(), dt);
        let measure = || {
            let speeds = sensors.rotor_speeds(plant, body.state());
            Measurements {
                imu: sensors.imu(&body.imu()),
                rotor_speeds: RotorVector::from_fn(|i, _| speeds[wiring[i]]),
            }
        };
        firmware.advance(self.now, dt, &body.state().rotor_speeds, measure, out);
    }

    /// The vehicle.
    #[must_use]
    pub fn vehicle(&self) -> &Vehicle {
        self.plant.vehicle()
    }

    /// The pose as motion capture sees it now: position (m, W), rotation (R to W).
    pub fn captured_pose(&mut self) -> (Vector3, Matrix3) {
        self.sensors.pose(self.body.state())
    }

    /// Time since power-on.
    #[must_use]
    pub fn now(&self) -> Micros {
        self.now
    }

    /// The flight board.
    #[must_use]
    pub fn firmware(&self) -> &F {
        &self.firmware
    }

    /// The flight board, to be changed.
    pub fn firmware_mut(&mut self) -> &mut F {
        &mut self.firmware
    }

    /// The noise and the errors of the sensors before any change.
    #[must_use]
    pub fn own_sensors(&self) -> &SensorParams {
        &self.own_sensors
    }

    /// The sensors, to be changed.
    pub fn sensors_mut(&mut self) -> &mut Sensors {
        &mut self.sensors
    }

    /// Whether the vehicle stands upright at its starting height.
    #[must_use]
    pub fn stands(&self) -> bool {
        self.rests() && self.body.state().robot.rotation_wr[(2, 2)] > 0.98
    }

    /// Whether the vehicle is at rest in any attitude, not higher than its starting height.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.body.rests()
    }

    /// Whether its body can no longer move; [`Self::finish`] says why.
    #[must_use]
    pub fn failed(&self) -> bool {
        self.body.failed()
    }

    /// Ends the body's world.
    ///
    /// # Errors
    /// One sentence, if the world had failed or does not end properly.
    pub fn finish(&mut self) -> Result<(), SimError> {
        self.body.finish()
    }

    /// The true state now.
    #[must_use]
    pub fn truth(&self) -> Truth {
        let state = self.body.state();
        Truth {
            time: self.now as f64 * 1e-6,
            robot: state.robot,
            rotor_speeds: state.rotor_speeds,
            tool_position_w: self.plant.loaded_tool_pose(state, &self.body.tool_wrench_w()).0,
            tool_wrench_w: self.body.tool_wrench_w(),
            external: self.body.external(),
        }
    }
}
