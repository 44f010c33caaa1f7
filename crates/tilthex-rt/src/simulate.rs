//! A whole closed loop in memory: plant, noisy sensors, estimator, controller.
//! No clock and no link: as fast as the machine, and the same for the same seed.

use crate::{
    config::{Config, ConfigError},
    sim::pushes::Pushes,
};
use std::collections::VecDeque;
use tilthex_core::{
    Matrix3, PoseSample, Setpoint,
    admittance::centre_of_mass_reference,
    controller::{Controller, ControllerInput, ControllerState},
    estimator::Estimator,
    plant::{ImuSample, Plant, PlantState, SensorParams, Sensors},
    trajectory::Trajectory,
    wrench_observer::remove_lever_arm,
};

/// Control period, s.
pub const PERIOD: f64 = 0.002;
/// Steps of the plant in a control period.
const PLANT_STEPS: u32 = 2;
/// Control periods from one captured pose to the next.
const POSE_EVERY: usize = 5;

/// What is simulated.
#[derive(Clone, Debug)]
pub struct Scenario<'a> {
    /// Vehicle and controller.
    pub config: &'a Config,
    /// What the tool is asked to do; the vehicle begins at rest on its start.
    pub trajectory: Trajectory,
    /// What pushes the tool, and when.
    pub pushes: Pushes,
    /// Length, s.
    pub duration: f64,
    /// Noise and biases of the sensors.
    pub sensors: SensorParams,
    /// Chooses the noise.
    pub seed: u64,
    /// Whether the controller is given the estimator's state; otherwise the true pose and twist.
    pub estimate: bool,
    /// Age of a captured pose when it arrives, s.
    pub pose_delay: f64,
}

/// One recorded quantity, `width` numbers a control period.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Its name.
    pub name: &'static str,
    /// Numbers a row.
    pub width: usize,
    /// Row after row.
    pub values: Vec<f64>,
}

/// Everything that was recorded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    columns: Vec<Column>,
    rows: usize,
    next: usize,
}

impl Record {
    /// The columns, all of equal length.
    #[must_use]
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// The column of that name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|c| c.name == name)
    }

    /// Adds to the next column; every row adds to the same ones in the same order.
    fn put(&mut self, name: &'static str, row: &[f64]) {
        if self.next == self.columns.len() {
            let values = Vec::with_capacity(self.rows * row.len());
            self.columns.push(Column { name, width: row.len(), values });
        }
        self.columns[self.next].values.extend_from_slice(row);
        self.next += 1;
    }

    /// Likewise a matrix, row by row.
    fn put_matrix(&mut self, name: &'static str, m: &Matrix3) {
        self.put(name, m.transpose().as_slice());
    }

    fn end_row(&mut self) {
        self.next = 0;
    }
}

/// Simulates.
///
/// # Errors
/// What the estimator or the controller refuses.
pub fn run(scenario: &Scenario<'_>) -> Result<Record, ConfigError> {
    let vehicle = *scenario.config.vehicle.vehicle();
    let controller = Controller::new(vehicle, *scenario.config.controller())?;
    let mut controller_state = ControllerState::default();
    let plant = Plant::new(vehicle);
    let mut state = at_rest_on(&plant, &scenario.trajectory.sample(0.0));
    let mut sensors = Sensors::new(scenario.sensors, scenario.seed);
    let mut capture = Capture { delay: scenario.pose_delay, on_the_way: VecDeque::new() };
    let mut estimator = if scenario.estimate { Some(started(scenario, &mut sensors, &state)?) } else { None };

    let rotors = vehicle.rotor_count();
    let rows = (scenario.duration / PERIOD).round() as usize;
    let mut record = Record { rows, ..Record::default() };
    for row in 0..rows {
        let time = row as f64 * PERIOD;
        let push_w = scenario.pushes.wrench(time);
        let external = plant.from_tool(&state, &push_w);
        let imu = sensors.imu(&plant.imu(&state, &external));
        let rotor_speeds = sensors.rotor_speeds(&plant, &state);
        let (robot, specific_force_r) = match &mut estimator {
            Some(estimator) => {
                estimator.predict(time, &imu.gyro_i, &imu.specific_force_i);
                if row % POSE_EVERY == 0 {
                    let (position_w, rotation_wr) = sensors.pose(&state);
                    capture.take(time, position_w, rotation_wr);
                }
                while let Some(pose) = capture.arrived(time) {
                    estimator.update_pose(&pose);
                }
                (estimator.robot_state(), estimator.specific_force_r())
            }
            None => {
                let (_, angular_acceleration_r) = plant.accelerations(&state, &external);
                (state.robot, at_centre_of_mass(&plant, &state, &imu, &angular_acceleration_r))
            }
        };
        let input = ControllerInput {
            state: robot,
            specific_force_r,
            rotor_speeds,
            setpoint: scenario.trajectory.sample(time),
            compliant: true,
            learn_bias: false,
            lost_rotors: 0,
            fixed_attitude: false,
        };
        let output = controller.step(&mut controller_state, &input, PERIOD);

        let (tool_position_w, tool_rotation_we) = plant.tool_pose(&state);
        record.put("time", &[time]);
        record.put("position", state.robot.position_w.as_slice());
        record.put("velocity", state.robot.velocity_w.as_slice());
        record.put_matrix("rotation", &state.robot.rotation_wr);
        record.put("angular_velocity", state.robot.angular_velocity_r.as_slice());
        record.put("tool_position", tool_position_w.as_slice());
        record.put_matrix("tool_rotation", &tool_rotation_we);
        record.put("estimated_position", robot.position_w.as_slice());
        record.put("estimated_velocity", robot.velocity_w.as_slice());
        record.put_matrix("estimated_rotation", &robot.rotation_wr);
        record.put("setpoint_position", input.setpoint.position_w.as_slice());
        record.put_matrix("setpoint_rotation", &input.setpoint.rotation_we);
        record.put("reference_position", output.reference.position_w.as_slice());
        record.put_matrix("reference_rotation", &output.reference.rotation_we);
        record.put("position_error", output.pose.position_error_w.as_slice());
        record.put("rotation_error", output.pose.rotation_error_r.as_slice());
        record.put("wrench_robot", output.wrench_robot.to_vector().as_slice());
        record.put("wrench_tool", output.wrench_tool_w.to_vector().as_slice());
        record.put("wrench_true", push_w.to_vector().as_slice());
        record.put("rotor_speeds", &state.rotor_speeds.as_slice()[..rotors]);
        record.put("rotor_command", &output.rotor_speeds.as_slice()[..rotors]);
        record.put("saturated", &[f64::from(u8::from(output.allocation.saturated))]);
        record.end_row();

        for _ in 0..PLANT_STEPS {
            let external = plant.from_tool(&state, &push_w);
            plant.step(&mut state, &output.rotor_speeds, &external, PERIOD / f64::from(PLANT_STEPS));
        }
    }
    Ok(record)
}

/// The vehicle at rest with its tool on a set-point.
fn at_rest_on(plant: &Plant, setpoint: &Setpoint) -> PlantState {
    let reference = centre_of_mass_reference(setpoint, plant.vehicle().tool());
    let mut state = plant.hover(reference.position_w);
    state.robot.rotation_wr = reference.rotation_wr;
    state.rotor_speeds = plant.vehicle().hover_speeds(&reference.rotation_wr);
    state
}

/// The estimator, started from a first captured pose.
fn started(
    scenario: &Scenario<'_>,
    sensors: &mut Sensors,
    state: &PlantState,
) -> Result<Estimator, ConfigError> {
    let mut estimator = Estimator::new(scenario.config.estimator_params()?)?;
    let (position_w, rotation_wr) = sensors.pose(state);
    estimator.initialize(0.0, &position_w, &rotation_wr)?;
    Ok(estimator)
}

/// Specific force at the centre of mass as a perfect lever-arm correction gives it.
fn at_centre_of_mass(
    plant: &Plant,
    state: &PlantState,
    imu: &ImuSample,
    angular_acceleration_r: &tilthex_core::Vector3,
) -> tilthex_core::Vector3 {
    let mounting = plant.vehicle().imu();
    remove_lever_arm(
        &(mounting.rotation_r * imu.specific_force_i),
        &state.robot.angular_velocity_r,
        angular_acceleration_r,
        &mounting.position_r,
    )
}

/// Captured poses on their way.
struct Capture {
    delay: f64,
    on_the_way: VecDeque<PoseSample>,
}

impl Capture {
    fn take(&mut self, time: f64, position_w: tilthex_core::Vector3, rotation_wr: Matrix3) {
        let arrival = time + self.delay;
        let pose = PoseSample { time, arrival, position_w, rotation_wr, tracking_valid: true };
        self.on_the_way.push_back(pose);
    }

    fn arrived(&mut self, now: f64) -> Option<PoseSample> {
        let arrived = self.on_the_way.front().is_some_and(|pose| pose.arrival <= now + 1e-9);
        if arrived { self.on_the_way.pop_front() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{config::VehicleSection, sim::pushes::Push};
    use tilthex_core::Vector3;

    fn pushed(config: &Config, estimate: bool, seed: u64) -> Record {
        let push = Push { at: 1.0, duration: 20.0, force: [1.4, 0.0, 0.0], torque: [0.0; 3] };
        let scenario = Scenario {
            config,
            trajectory: Trajectory::hold(Vector3::new(0.0, 0.0, 1.0), Matrix3::identity()),
            pushes: Pushes::new(vec![push]),
            duration: 12.0,
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
    fn a_seed_is_a_flight() {
        let config = Config::default_for(VehicleSection::preset("tilt-hex-light").unwrap());
        assert_eq!(pushed(&config, true, 3), pushed(&config, true, 3));
        assert_ne!(pushed(&config, true, 3), pushed(&config, true, 4));
    }
}
