//! The simulated vehicle: its body, its sensors and its flight board, on
//! virtual time: [`Simulation`]. No operating system: no clock, no sockets, no terminals.

pub mod body;
pub mod campaign;
mod error;
pub mod feed;
pub mod ground;
pub mod pushes;
pub mod simulate;

pub use body::{Body, Own};
pub use error::SimError;
pub use pushes::{Push, Pushes};
pub use tilthex_link::tk3::board::{Firmware, FirmwareParams, Micros};

pub use tilthex_core::types::Nanos;

use body::Cycle;
use tilthex_config::TrueVehicle;
use tilthex_core::{
    MAX_ROTORS, Matrix3, RobotState, RotorVector, Vector3, Vehicle, Wrench,
    plant::{Plant, SensorParams, Sensors},
};
use tilthex_link::tk3::board::Measurements;

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
            plant: Plant::new(vehicle),
            sensors: SensorParams::EXPERIMENTS,
            firmware: FirmwareParams::default(),
            pushes: Pushes::default(),
            seed: 1,
        }
    }

    /// The same of a vehicle as it truly is.
    ///
    /// # Errors
    /// Where an effect is out of its range.
    pub fn of(drawn: &TrueVehicle) -> Result<Self, SimError> {
        let plant = drawn.plant().map_err(|e| SimError::refused(e.to_string()))?;
        let sensors = drawn.sensors(&SensorParams::EXPERIMENTS);
        let firmware = FirmwareParams { battery: drawn.effects.battery, ..FirmwareParams::default() };
        Ok(Self { plant, sensors, firmware, seed: drawn.seed, ..Self::new(*plant.vehicle()) })
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
    /// What touches the tool, world, at its tip.
    pub tool_wrench_w: Wrench,
    /// What the world exerts, contacts and pushes alike: force W, torque R about the centre of mass.
    pub external: Wrench,
}

/// The vehicle and its world in virtual time.
#[derive(Clone, Debug)]
pub struct Simulation<B = Own> {
    plant: Plant,
    body: B,
    sensors: Sensors,
    own_sensors: SensorParams,
    firmware: Firmware,
    /// The rotor that each motor controller drives.
    wiring: [usize; MAX_ROTORS],
    now: Micros,
}

impl Simulation {
    /// A vehicle that stands on the ground over the origin, switched off.
    #[must_use]
    pub fn new(params: SimulationParams) -> Self {
        let body = Own::new(params.plant, params.pushes, params.seed);
        Self::with_body(body, params.plant, params.sensors, params.firmware, params.seed)
    }

    /// Lets a rotor (from 0) reach only a part of the speed its motor drives it to.
    pub fn weaken_rotor(&mut self, rotor: usize, part: f64) {
        if let Some(health) = self.body.health.get_mut(rotor) {
            *health = part;
        }
    }

    /// Leaves a rotor (from 0) only a part of its thrust and drag, at the speed it turns with.
    pub fn damage_rotor(&mut self, rotor: usize, part: f64) {
        if let Some(thrust) = self.body.thrust.get_mut(rotor) {
            *thrust = part;
        }
    }

    /// Lets a rotor (from 0) turn the other way, with the propeller for it.
    pub fn reverse_spin(&mut self, rotor: usize) {
        if let Some(reversed) = self.body.reversed.get_mut(rotor) {
            *reversed = 1.0;
        }
    }

    /// Puts two motors (from 0) on each other's wires.
    pub fn exchange_motors(&mut self, one: usize, other: usize) {
        self.wiring.swap(one, other);
    }

    /// Presses on the tool (world, at its tip) and on the body (force W, torque R about the centre of mass) from now on.
    pub fn disturb(&mut self, tool_w: Wrench, body: Wrench) {
        (self.body.pressed_tool_w, self.body.pressed) = (tool_w, body);
    }

    /// What presses on the body: force W, torque R about the centre of mass.
    #[must_use]
    pub fn disturbance(&self) -> Wrench {
        self.body.pressed
    }
}

impl<B: Body> Simulation<B> {
    /// A vehicle, switched off, whose body moves in a world of its own; `seed` chooses the sensors' noise.
    #[must_use]
    pub fn with_body(
        body: B,
        plant: Plant,
        sensors: SensorParams,
        firmware: FirmwareParams,
        seed: u64,
    ) -> Self {
        Self {
            plant,
            body,
            sensors: Sensors::new(sensors, seed),
            own_sensors: sensors,
            firmware: Firmware::new(plant.vehicle(), firmware),
            wiring: std::array::from_fn(|i| i),
            now: 0,
        }
    }

    /// Takes bytes from the host; answers go to `out`.
    pub fn receive(&mut self, bytes: &[u8], out: &mut Vec<u8>) {
        self.firmware.receive(bytes, self.now, out);
    }

    /// One cycle of [`STEP`]: body, sensors, board; what it sends goes to `out`.
    pub fn advance(&mut self, out: &mut Vec<u8>) {
        self.advance_at(1000 * (self.now + STEP), out);
    }

    /// The same, for a cycle that ends at a time of the monotonic clock.
    pub fn advance_at(&mut self, at: Nanos, out: &mut Vec<u8>) {
        let dt = STEP as f64 * 1e-6;
        self.now += STEP;
        let since_start = self.firmware.first_start().map(|start| (self.now - start) as f64 * 1e-6);
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
    pub fn firmware(&self) -> &Firmware {
        &self.firmware
    }

    /// The flight board, to do something to it.
    pub fn firmware_mut(&mut self) -> &mut Firmware {
        &mut self.firmware
    }

    /// Noise and errors that the sensors have where nothing was done to them.
    #[must_use]
    pub fn own_sensors(&self) -> &SensorParams {
        &self.own_sensors
    }

    /// The sensors, to do something to them.
    pub fn sensors_mut(&mut self) -> &mut Sensors {
        &mut self.sensors
    }

    /// Whether the vehicle stands upright where it started from.
    #[must_use]
    pub fn stands(&self) -> bool {
        self.rests() && self.body.state().robot.rotation_wr[(2, 2)] > 0.98
    }

    /// Whether the vehicle lies still, no higher than where it started from, however it lies.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.body.rests()
    }

    /// Whether its body has stopped moving for good; [`Self::finish`] says why.
    #[must_use]
    pub fn failed(&self) -> bool {
        self.body.failed()
    }

    /// Ends the body's world.
    ///
    /// # Errors
    /// One sentence, where it had failed or does not end well.
    pub fn finish(&mut self) -> Result<(), SimError> {
        self.body.finish()
    }

    /// What is true now.
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
