//! The inputs and outputs of a tick, of fixed size: for the log, for the replay, and for the report after a fault.

use super::{
    Flight, ModelRecord,
    io::{HostFacts, MAX_POSES, Measured},
};
use crate::{
    allocation::Priority,
    contact::likelihood_of,
    supervisor::{FaultSet, Phase},
    types::{Matrix3, PoseSample, RobotState, RotorVector, Setpoint, Vector3, Wrench},
};

/// The inputs of a tick. With the bytes of its link the tick can be run again.
#[derive(Clone, Copy, Debug)]
pub struct InputRecord {
    /// Now, s, monotonic.
    pub time: f64,
    /// Captured poses.
    pub poses: [PoseSample; MAX_POSES],
    /// How many of them.
    pub pose_count: u8,
    /// Whether an order came with this tick. The order itself is logged separately.
    pub command: bool,
    /// Facts that only the host can observe.
    pub host: HostFacts,
}

impl InputRecord {
    /// The captured poses.
    #[must_use]
    pub fn poses(&self) -> &[PoseSample] {
        self.poses.get(..usize::from(self.pose_count)).unwrap_or(&[])
    }
}

/// Counters of what the link and the estimator refused.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounters {
    /// Accepted messages.
    pub messages: u32,
    /// Frames refused for letter, length, range or escape.
    pub refused_frames: u32,
    /// Samples refused by the gate.
    pub refused_samples: u32,
    /// Inertial samples lost, by their sequence numbers.
    pub lost_samples: u32,
    /// Applied poses.
    pub poses: u32,
    /// Poses refused.
    pub refused_poses: u32,
}

/// One tick.
#[derive(Clone, Copy, Debug)]
pub struct Record {
    /// Number of the tick, from 0.
    pub tick: u64,
    /// Time since the last tick, s.
    pub dt: f64,
    /// The inputs as they came.
    pub input: InputRecord,
    /// Phase after the tick.
    pub phase: Phase,
    /// Active faults.
    pub faults: FaultSet,
    /// Position of the robot at which the flight began, or would begin now, m, world.
    pub start_w: Option<Vector3>,
    /// Estimated pose and twist of the robot.
    pub state: RobotState,
    /// Time of this state: that of the newest inertial sample, s, on the clock of `input.time`.
    pub state_time: f64,
    /// Estimated gyroscope bias, rad/s, IMU axes.
    pub gyro_bias_i: Vector3,
    /// Estimated accelerometer bias, m/s^2, IMU axes.
    pub accelerometer_bias_i: Vector3,
    /// Deviations of the estimate: position (m), velocity (m/s), rotation (rad); roots of the summed variances.
    pub deviation: [f64; 3],
    /// Normalised innovation squared of the newest pose, over its degrees of freedom.
    pub innovation: f64,
    /// Age of the newest applied pose, s.
    pub pose_age: f64,
    /// Mean time from capture to arrival of a pose, s.
    pub latency: f64,
    /// Specific force at the centre of mass, m/s^2, R.
    pub specific_force_r: Vector3,
    /// The commanded set-point of the tool.
    pub setpoint: Setpoint,
    /// Reference of the tool: the set-point after the admittance filter.
    pub reference: Setpoint,
    /// External wrench at the centre of mass as observed (force W, torque R).
    pub wrench_robot: Wrench,
    /// External wrench at the tool, W.
    pub wrench_tool_w: Wrench,
    /// The part of it that is no drag of the wind, W; all of it if the wind is not estimated.
    pub wrench_contact_w: Wrench,
    /// Input of the admittance filter, W.
    pub wrench_admittance_w: Wrench,
    /// Estimated velocity of the air, m/s, W; zero if it is not estimated.
    pub wind_w: Vector3,
    /// Log-odds of contact; see [`Self::contact_likelihood`].
    pub contact_log_odds: f64,
    /// e_p, m, W.
    pub position_error_w: Vector3,
    /// Rotation error e_R, robot; without unit, (15).
    pub rotation_error_r: Vector3,
    /// Whether contact moves the reference.
    pub compliant: bool,
    /// Whether a rotor is at a limit.
    pub saturated: bool,
    /// The most important part of the wanted wrench that the rotors do not produce.
    pub given_up: Option<Priority>,
    /// Whether the admittance filter is at its excursion limit.
    pub excursion_limited: bool,
    /// Level of the energy tank, J.
    pub energy_tank: f64,
    /// Commanded rotor speeds, Hz.
    pub rotor_command: RotorVector,
    /// Rotor speeds that the laws used, Hz: measured, or the model's where a measurement is missing, doubted or impossible.
    pub rotor_speeds: RotorVector,
    /// Sum of the motors' currents, A.
    pub current: f64,
    /// Battery, V; NaN before it is known.
    pub battery: f64,
    /// Counters.
    pub counters: LinkCounters,
    /// The model that the laws use.
    pub model: ModelRecord,
    /// Inertial samples taken in this tick.
    pub imu_samples: u8,
}

impl Default for Record {
    fn default() -> Self {
        let zero = Vector3::zeros();
        let hold = Setpoint::hold(zero, Matrix3::identity());
        let pose = PoseSample {
            time: 0.0,
            arrival: 0.0,
            position_w: zero,
            rotation_wr: Matrix3::identity(),
            tracking_valid: false,
        };
        Self {
            tick: 0,
            dt: 0.0,
            input: InputRecord {
                time: 0.0,
                poses: [pose; MAX_POSES],
                pose_count: 0,
                command: false,
                host: HostFacts::default(),
            },
            phase: Phase::Disarmed,
            faults: FaultSet::NONE,
            start_w: None,
            state: RobotState::at_rest(zero),
            state_time: 0.0,
            gyro_bias_i: zero,
            accelerometer_bias_i: zero,
            deviation: [0.0; 3],
            innovation: 0.0,
            pose_age: 0.0,
            latency: 0.0,
            specific_force_r: zero,
            setpoint: hold,
            reference: hold,
            wrench_robot: Wrench::ZERO,
            wrench_tool_w: Wrench::ZERO,
            wrench_contact_w: Wrench::ZERO,
            wrench_admittance_w: Wrench::ZERO,
            wind_w: zero,
            contact_log_odds: f64::NEG_INFINITY,
            position_error_w: zero,
            rotation_error_r: zero,
            compliant: false,
            saturated: false,
            given_up: None,
            excursion_limited: false,
            energy_tank: 0.0,
            rotor_command: RotorVector::zeros(),
            rotor_speeds: RotorVector::zeros(),
            current: 0.0,
            battery: f64::NAN,
            counters: LinkCounters::default(),
            model: ModelRecord::default(),
            imu_samples: 0,
        }
    }
}

impl Record {
    /// Likelihood of contact, 0 to 1: near 1 if it is not estimated, and 0 before the laws run.
    #[must_use]
    pub fn contact_likelihood(&self) -> f64 {
        likelihood_of(self.contact_log_odds)
    }
}

impl Flight {
    /// Writes the record of the tick.
    pub(super) fn record(
        &self,
        input: &Measured<'_>,
        period: f64,
        rotor_speeds: &RotorVector,
        record: &mut Record,
    ) {
        // What follows writes everything but the outputs of the laws, if there are none.
        if self.output.is_none() {
            *record = Record::default();
        }
        (record.tick, record.dt) = (self.tick, period);
        let taken = &mut record.input;
        (taken.time, taken.host, taken.command) = (input.time, input.host, input.command.is_some());
        for (slot, pose) in taken.poses.iter_mut().zip(input.poses) {
            *slot = *pose;
        }
        taken.pose_count = input.poses.len().min(MAX_POSES) as u8;
        record.phase = self.supervisor.phase();
        record.faults = self.supervisor.active();
        let estimator = &self.estimator;
        record.start_w = self.start();
        record.state = self.robot_state();
        record.state_time = if input.known.is_some() { input.time } else { estimator.time() };
        record.gyro_bias_i = estimator.gyro_bias();
        record.accelerometer_bias_i = estimator.accelerometer_bias();
        record.specific_force_r = self.specific_force_r();
        let health = estimator.health();
        record.deviation = [health.position_deviation, health.velocity_deviation, health.rotation_deviation];
        record.innovation = health.nis;
        record.pose_age = health.position_age;
        record.latency = health.latency;
        if let Some(o) = &self.output {
            record.setpoint = o.setpoint;
            record.reference = o.reference;
            record.wrench_robot = o.wrench_robot;
            record.wrench_tool_w = o.wrench_tool_w;
            record.wrench_contact_w = o.wrench_contact_w;
            record.wrench_admittance_w = o.wrench_admittance_w;
            record.wind_w = o.told.wind_w;
            record.contact_log_odds = o.told.log_odds;
            record.position_error_w = o.pose.position_error_w;
            record.rotation_error_r = o.pose.rotation_error_r;
            record.compliant = o.compliant;
            record.saturated = o.allocation.saturated;
            record.given_up = o.allocation.given_up;
            record.excursion_limited = o.excursion_limited;
            record.energy_tank = o.energy_tank;
        }
        record.rotor_command = self.command;
        record.rotor_speeds = *rotor_speeds;
        let telemetry = input.telemetry;
        record.current = telemetry.motors().iter().map(|m| m.current).sum();
        record.battery = telemetry.battery.unwrap_or(f64::NAN);
        record.counters = self.watch.counters(telemetry);
        record.model = self.model_record();
        record.imu_samples = telemetry.inertial.samples().len() as u8;
    }
}
