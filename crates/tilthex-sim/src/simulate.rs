//! A simulated flight in memory: the vehicle's body, noisy sensors, and the same [`Flight`] as on a real vehicle. It
//! uses no clock and no link. It runs as fast as the machine can; the same seed gives the same flight.

mod many;
mod record;

use crate::{Body, Nanos, Own, Pushes, body::Cycle};
pub use many::{Outcome, Summary, run_many};
pub use record::{Column, FaultChange, NAMES, Record};
use std::collections::VecDeque;
use tilthex_config::{Config, ConfigError, TruthSection};
use tilthex_core::{
    Matrix3, PoseSample, RobotState, Setpoint, Vector3,
    admittance::centre_of_mass_reference,
    flight::{
        AirborneStart, Commanded, Flight, HostFacts, Inertial, KnownState, MAX_POSES, Measured, MotorCommand,
        Route, Telemetry,
    },
    plant::{Plant, PlantState, SensorParams, Sensors},
    random::Random,
    trajectory::Trajectory,
    types::RotorVector,
};

/// Control period, s.
pub const PERIOD: f64 = 0.002;
/// Cycles of the body in a control period. The board of a vehicle has two. One is enough for a rigid body that only rotors,
/// weight and a push on its tool move: a test compares one step with two of half its length.
const CYCLES: usize = 2;
const CYCLES_OF_RIGID_BODY: usize = 1;
/// Control periods between two captured poses.
const POSE_EVERY: usize = 5;

/// How a flight begins.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one per flight")]
pub enum Start {
    /// In the air, at rest, with the tool on the first set-point of the trajectory.
    Air(Trajectory),
    /// On the ground with stopped motors: it takes off, hovers and flies the route.
    Ground(Option<Route>),
}

/// What is simulated.
#[derive(Clone, Debug)]
pub struct Scenario<'a> {
    /// The configuration of vehicle and flight.
    pub config: &'a Config,
    /// How the flight begins, and the set-points of the tool.
    pub start: Start,
    /// Pushes on the tool. Their times count from the begin of the flight in the air, or from the start of the
    /// motors.
    pub pushes: Pushes,
    /// Duration, s.
    pub duration: f64,
    /// How the true vehicle differs from the configured one.
    pub truth: TruthSection,
    /// Noise and biases of the sensors; `truth` adds to them.
    pub sensors: SensorParams,
    /// Seed of the noise, and of the vehicle if the truth has distributions.
    pub seed: u64,
    /// Whether the flight uses its estimator. If not, it gets the true pose and twist.
    pub estimate: bool,
    /// Mean age of a captured pose when it arrives, s; used if the truth has none.
    pub pose_delay: f64,
}

/// Simulates a scenario.
///
/// # Errors
/// If the flight refuses the scenario.
pub fn run(scenario: &Scenario<'_>) -> Result<Record, ConfigError> {
    fly(scenario, &mut Prepared::default(), |_| true, |_| ())
}

/// Simulates a scenario, and records only the quantities of `wanted`, by their [`NAMES`].
///
/// # Errors
/// As [`run`].
pub fn run_recording(scenario: &Scenario<'_>, wanted: &[String]) -> Result<Record, ConfigError> {
    fly(scenario, &mut Prepared::default(), |name| wanted.iter().any(|w| w == name), |_| ())
}

/// Simulates a scenario, records the `wanted` quantities, and shows each tick.
fn fly<'c>(
    scenario: &Scenario<'c>,
    prepared: &mut Prepared<'c>,
    wanted: impl Fn(&str) -> bool,
    mut tick: impl FnMut(&World),
) -> Result<Record, ConfigError> {
    let mut world = World::new(scenario, prepared)?;
    let rows = (scenario.duration / PERIOD).round() as usize;
    let mut record = Record::new(rows, wanted);
    for row in 0..rows {
        world.tick(row as f64 * PERIOD, row % POSE_EVERY == 0);
        record.take(&world);
        record.watch(world.time, world.flight.supervisor().active());
        tick(&world);
        world.advance();
    }
    Ok(record)
}

/// A flight that has not begun, for all scenarios with the same configuration and route: it takes as long as a second of flight
/// to make one.
#[derive(Default)]
struct Prepared<'c>(Option<(&'c Config, Option<Route>, Flight)>);

impl<'c> Prepared<'c> {
    fn flight(&mut self, config: &'c Config, route: Option<Route>) -> Result<Flight, ConfigError> {
        match &self.0 {
            Some((known, along, flight)) if *known == config && *along == route => Ok(flight.clone()),
            _ => {
                let flight = Flight::new(config.flight_params(true)?, route)?;
                self.0 = Some((config, route, flight.clone()));
                Ok(flight)
            }
        }
    }
}

/// The simulated vehicle and the flight that controls it.
struct World {
    plant: Plant,
    body: Own,
    /// Whether it is a rigid body high above the ground.
    free: bool,
    sensors: Sensors,
    /// The point whose pose motion capture gives, from the centre of mass, R, m.
    captured_r: Vector3,
    estimate: bool,
    capture: Capture,
    flight: Flight,
    telemetry: Telemetry,
    commanded: Commanded,
    /// When the period began, s.
    time: f64,
    /// When a motor was first ordered to start, s.
    started: Option<f64>,
}

impl World {
    fn new<'c>(scenario: &Scenario<'c>, prepared: &mut Prepared<'c>) -> Result<Self, ConfigError> {
        let route = match &scenario.start {
            Start::Air(_) => None,
            Start::Ground(route) => *route,
        };
        let mut flight = prepared.flight(scenario.config, route)?;
        let drawn = scenario.truth.draw(scenario.config.vehicle(), scenario.seed)?;
        let (plant, pushes) = (drawn.plant()?, scenario.pushes.clone());
        let sensor_params = drawn.sensors(&scenario.sensors);
        let (body, motors, started) = match &scenario.start {
            Start::Air(trajectory) => {
                let state = at_rest_on(&plant, &trajectory.sample(0.0));
                flight.begin_in_air(&AirborneStart {
                    time: -PERIOD,
                    position_w: captured(&state.robot, &sensor_params.captured_r).position_w,
                    rotation_wc: state.robot.rotation_wr,
                    trajectory: Some(*trajectory),
                })?;
                let turning = MotorCommand::Turn(state.rotor_speeds);
                (Own::airborne(plant, pushes, state, scenario.seed), turning, Some(0.0))
            }
            Start::Ground(_) => (Own::new(plant, pushes, scenario.seed), MotorCommand::Stop, None),
        };
        let effects = plant.effects();
        let free =
            matches!(scenario.start, Start::Air(_)) && effects.are_off() && effects.throttle_voltage == 0.0;
        Ok(Self {
            plant,
            body,
            free,
            sensors: Sensors::new(sensor_params, scenario.seed),
            captured_r: sensor_params.captured_r,
            estimate: scenario.estimate,
            capture: Capture {
                delay: drawn.delays.pose.unwrap_or(scenario.pose_delay),
                jitter: drawn.delays.pose_jitter.unwrap_or(0.0),
                random: Random::new(scenario.seed ^ 0x504F_5345),
                on_the_way: VecDeque::new(),
            },
            flight,
            telemetry: Telemetry::new(plant.vehicle().rotor_count()),
            commanded: Commanded { motors, ..Commanded::default() },
            time: 0.0,
            started,
        })
    }

    /// Measures, and calls the flight once.
    fn tick(&mut self, time: f64, captures: bool) {
        self.time = time;
        self.body.feel(self.started.map(|started| time - started));
        let state = self.body.state();
        let (imu, specific_force_r) = self.body.inertial();
        let sample = self.sensors.imu(&imu);
        self.telemetry.begin_tick();
        self.telemetry.inertial.push(
            time,
            Inertial {
                time,
                gyro_i: sample.gyro_i,
                specific_force_i: sample.specific_force_i,
                shaken: false,
            },
        );
        self.telemetry.hear_motors(time, &self.sensors.rotor_speeds(&self.plant, state));
        // A motor that is heard spins, unless its command says otherwise.
        let spinning = match self.commanded.motors {
            MotorCommand::Stop | MotorCommand::Kill => Some(0..0),
            MotorCommand::Alone(one, _) => Some(one..one + 1),
            MotorCommand::Start(_) | MotorCommand::Turn(_) => None,
        };
        if let Some(spinning) = spinning {
            for motor in 0..self.plant.vehicle().rotor_count() {
                self.telemetry.set_spinning(motor, spinning.contains(&motor));
            }
        }
        if captures {
            let (position_w, rotation_wr) = self.sensors.pose(state);
            self.capture.take(time, position_w, rotation_wr);
        }
        let measured = Measured {
            time,
            telemetry: &self.telemetry,
            poses: &self.capture.arrived(time),
            command: None,
            host: HostFacts::default(),
            known: (!self.estimate)
                .then(|| KnownState { robot: captured(&state.robot, &self.captured_r), specific_force_r }),
        };
        self.flight.tick(&measured, &mut self.commanded);
        if self.started.is_none() && matches!(self.commanded.motors, MotorCommand::Start(_)) {
            self.started = Some(time);
        }
    }

    /// The true pose of the tool under the wrench on it.
    #[inline(always)]
    fn tool_pose(&self) -> (Vector3, Matrix3) {
        self.plant.loaded_tool_pose(self.body.state(), &self.body.tool_wrench_w())
    }

    /// Moves the body by one period.
    fn advance(&mut self) {
        let alone;
        let speeds = match &self.commanded.motors {
            MotorCommand::Stop | MotorCommand::Kill => &RotorVector::zeros(),
            MotorCommand::Alone(one, speeds) => {
                alone = RotorVector::from_fn(|i, _| if i == *one { speeds[i] } else { 0.0 });
                &alone
            }
            MotorCommand::Start(speeds) | MotorCommand::Turn(speeds) => speeds,
        };
        // The pushes of a whole period are those at its begin, when they were measured.
        let since_start = self.started.map(|started| self.time - started);
        let cycles = if self.free { CYCLES_OF_RIGID_BODY } else { CYCLES };
        let dt = PERIOD / cycles as f64;
        for k in 1..=cycles {
            let at = ((self.time + k as f64 * dt) * 1e9) as Nanos;
            self.body.advance(&Cycle { at, dt, since_start }, speeds);
            self.sensors.pass(&self.plant, self.body.state(), dt);
        }
    }
}

/// The vehicle at rest with its tool on a set-point.
fn at_rest_on(plant: &Plant, setpoint: &Setpoint) -> PlantState {
    let reference = centre_of_mass_reference(setpoint, plant.vehicle().tool());
    let mut state = plant.hover(reference.position_w);
    state.robot.rotation_wr = reference.rotation_wr;
    state.rotor_speeds = plant.vehicle().hover_speeds(&reference.rotation_wr);
    state
}

/// The robot's state with another point of the airframe as its origin.
fn captured(robot: &RobotState, point_r: &Vector3) -> RobotState {
    if *point_r == Vector3::zeros() {
        return *robot;
    }
    RobotState {
        position_w: robot.position_w + robot.rotation_wr * point_r,
        velocity_w: robot.velocity_w + robot.rotation_wr * robot.angular_velocity_r.cross(point_r),
        ..*robot
    }
}

/// Captured poses that have not arrived yet.
struct Capture {
    delay: f64,
    jitter: f64,
    random: Random,
    on_the_way: VecDeque<PoseSample>,
}

impl Capture {
    fn take(&mut self, time: f64, position_w: Vector3, rotation_wr: Matrix3) {
        let arrival = time + (self.delay + self.jitter * (2.0 * self.random.uniform() - 1.0)).max(0.0);
        let pose = PoseSample { time, arrival, position_w, rotation_wr, tracking_valid: true };
        self.on_the_way.push_back(pose);
    }

    fn arrived(&mut self, now: f64) -> Vec<PoseSample> {
        let arrived = self.on_the_way.iter().take_while(|pose| pose.arrival <= now + 1e-9).count();
        self.on_the_way.drain(..arrived.min(MAX_POSES)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pushes::Push;
    use tilthex_config::VehicleSection;

    fn pushed(config: &Config, estimate: bool, seed: u64) -> Record {
        let push = Push { at: 1.0, duration: 20.0, force: [1.4, 0.0, 0.0], torque: [0.0; 3] };
        let scenario = Scenario {
            config,
            start: Start::Air(Trajectory::hold(Vector3::new(0.0, 0.0, 1.0), Matrix3::identity())),
            pushes: Pushes::new(vec![push]),
            duration: 12.0,
            truth: TruthSection::default(),
            sensors: SensorParams::EXPERIMENTS,
            seed,
            estimate,
            pose_delay: 0.015,
        };
        run(&scenario).unwrap()
    }

    #[test]
    fn the_tool_yields_as_its_spring() {
        let config = Config::default_for(VehicleSection::preset("tilt-hex").unwrap());
        for estimate in [false, true] {
            let record = pushed(&config, estimate, 1);
            let x = &record.get("tool_position").unwrap().values;
            let settled: Vec<f64> = x.chunks(3).skip(5000).map(|p| p[0]).collect();
            let mean = settled.iter().sum::<f64>() / settled.len() as f64;
            assert!((mean - (1.4 - 0.2) / 6.0).abs() < 2e-3, "{estimate}: {mean}");
        }
    }

    #[test]
    fn a_flight_from_the_ground_takes_off_hovers_and_yields() {
        let config = Config::default_for(VehicleSection::preset("tilt-hex").unwrap());
        let push = Push { at: 12.0, duration: 20.0, force: [1.4, 0.0, 0.0], torque: [0.0; 3] };
        for estimate in [false, true] {
            let record = run(&Scenario {
                config: &config,
                start: Start::Ground(None),
                pushes: Pushes::new(vec![push]),
                duration: 24.0,
                truth: TruthSection::default(),
                sensors: SensorParams::EXPERIMENTS,
                seed: 1,
                estimate,
                pose_delay: 0.015,
            })
            .unwrap();
            let last = |name: &str| {
                let column = record.get(name).unwrap();
                column.values[column.values.len() - column.width..].to_vec()
            };
            assert_eq!(
                last("phase"),
                [f64::from(tilthex_core::supervisor::Phase::Flying as u8)],
                "{estimate}"
            );
            let offset = last("tool_position")[0] - last("setpoint_position")[0];
            assert!((offset - 0.2).abs() < 0.01, "{estimate}: {offset}");
        }
    }

    #[test]
    fn a_seed_is_a_flight() {
        let config = Config::default_for(VehicleSection::preset("tilt-hex-light").unwrap());
        assert_eq!(pushed(&config, true, 3), pushed(&config, true, 3));
        assert_ne!(pushed(&config, true, 3), pushed(&config, true, 4));
    }
}
