//! From the core's records to the messages of the log.

use prost::Message;
use tilthex_core::{
    Matrix3, RobotState, Setpoint, Vector3, Wrench, flight::Record, so3, supervisor::Phase, types::PoseSample,
};
use tilthex_link::{Severity, Wire};

use super::messages::{self as m, foxglove};
use tilthex_sim::Truth;

pub(super) fn vector(v: &Vector3) -> Option<m::Vector3> {
    Some(m::Vector3 { x: v.x, y: v.y, z: v.z })
}

fn quaternion(r: &Matrix3) -> Option<m::Quaternion> {
    let [x, y, z, w] = so3::to_quaternion_xyzw(r);
    Some(m::Quaternion { x, y, z, w })
}

fn wrench(w: &Wrench) -> Option<m::Wrench> {
    Some(m::Wrench { force: vector(&w.force), torque: vector(&w.torque) })
}

fn target(s: &Setpoint) -> m::Target {
    m::Target {
        position_w: vector(&s.position_w),
        orientation: quaternion(&s.rotation_we),
        velocity_w: vector(&s.velocity_w),
        angular_velocity_w: vector(&s.angular_velocity_w),
        acceleration_w: vector(&s.acceleration_w),
        angular_acceleration_w: vector(&s.angular_acceleration_w),
        wrench_w: wrench(&s.wrench_w),
    }
}

fn pose(p: &PoseSample) -> m::Pose {
    m::Pose {
        time: p.time,
        arrival: p.arrival,
        position_w: vector(&p.position_w),
        rotation: p.rotation_wr.transpose().as_slice().to_vec(),
        tracking_valid: p.tracking_valid,
    }
}

/// The pose a message holds, to the bit; `None` where it is incomplete.
pub(crate) fn pose_from(p: &m::Pose) -> Option<PoseSample> {
    let position = p.position_w.as_ref()?;
    Some(PoseSample {
        time: p.time,
        arrival: p.arrival,
        position_w: Vector3::new(position.x, position.y, position.z),
        rotation_wr: Matrix3::from_row_iterator(<[f64; 9]>::try_from(p.rotation.as_slice()).ok()?),
        tracking_valid: p.tracking_valid,
    })
}

fn phase(phase: Phase) -> i32 {
    let phase = match phase {
        Phase::Disarmed => m::Phase::Disarmed,
        Phase::Starting => m::Phase::Starting,
        Phase::Grounded => m::Phase::Grounded,
        Phase::Flying => m::Phase::Flying,
        Phase::Holding => m::Phase::Holding,
        Phase::Landing => m::Phase::Landing,
        Phase::Emergency => m::Phase::Emergency,
    };
    phase.into()
}

/// The messages of one tick, all of which follow from its inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct TickMessages {
    /// `/state`
    pub state: m::State,
    /// `/setpoint`
    pub setpoint: m::Target,
    /// `/reference`
    pub reference: m::Target,
    /// `/wrench`
    pub wrench: m::Wrenches,
    /// `/control`
    pub control: m::Control,
    /// `/rotors`
    pub rotors: m::Rotors,
    /// `/flight`
    pub flight: m::Flight,
    /// `/link`
    pub link: m::Link,
    /// `/model`
    pub model: m::Model,
    /// `/input`
    pub input: m::Input,
    /// `/output`
    pub output: m::Output,
}

impl TickMessages {
    /// The messages of a tick's record and bytes, for a vehicle's number of rotors.
    #[must_use]
    pub fn new(r: &Record, wire: &Wire, rotor_count: usize) -> Self {
        let rotors = |speeds: &[f64]| speeds.iter().take(rotor_count).copied().collect();
        let [position_deviation, velocity_deviation, rotation_deviation] = r.deviation;
        Self {
            state: m::State {
                position_w: vector(&r.state.position_w),
                velocity_w: vector(&r.state.velocity_w),
                orientation: quaternion(&r.state.rotation_wr),
                angular_velocity_r: vector(&r.state.angular_velocity_r),
                specific_force_r: vector(&r.specific_force_r),
                gyro_bias_i: vector(&r.gyro_bias_i),
                accelerometer_bias_i: vector(&r.accelerometer_bias_i),
                position_deviation,
                velocity_deviation,
                rotation_deviation,
                innovation: r.innovation,
                pose_age: r.pose_age,
                time: r.state_time,
            },
            setpoint: target(&r.setpoint),
            reference: target(&r.reference),
            wrench: m::Wrenches {
                robot: wrench(&r.wrench_robot),
                tool_w: wrench(&r.wrench_tool_w),
                admittance_w: wrench(&r.wrench_admittance_w),
            },
            control: m::Control {
                position_error_w: vector(&r.position_error_w),
                rotation_error_r: vector(&r.rotation_error_r),
                compliant: r.compliant,
                saturated: r.saturated,
                excursion_limited: r.excursion_limited,
            },
            rotors: m::Rotors {
                command: rotors(r.rotor_command.as_slice()),
                measured: rotors(r.rotor_speeds.as_slice()),
                current: r.current,
                battery: r.battery,
            },
            flight: m::Flight {
                tick: r.tick,
                time: r.input.time,
                dt: r.dt,
                phase: phase(r.phase),
                faults: r.faults.0,
            },
            link: m::Link {
                messages: r.counters.messages,
                refused_frames: r.counters.refused_frames,
                refused_samples: r.counters.refused_samples,
                lost_samples: r.counters.lost_samples,
                poses: r.counters.poses,
                refused_poses: r.counters.refused_poses,
                imu_samples: r.imu_samples.into(),
            },
            model: m::Model {
                mass: r.model.mass,
                centre_of_mass_r: vector(&r.model.centre_of_mass_r),
                false_force: r.model.false_force,
                false_torque: r.model.false_torque,
                hovers: r.model.hovers.into(),
                misfit: r.model.misfit,
            },
            input: m::Input {
                tick: r.tick,
                time: r.input.time,
                link: wire.received().to_vec(),
                poses: r.input.poses().iter().map(pose).collect(),
                command: r.input.command,
                land: r.input.host.land,
                link_lost: r.input.host.link_lost,
                log_lost: r.input.host.log_lost,
                kill: r.input.host.kill,
                operator_silent: r.input.host.operator_silent,
            },
            output: m::Output { tick: r.tick, link: wire.sent.bytes().to_vec() },
        }
    }
}

impl TickMessages {
    /// Each message's topic and bytes, in the order in which they are logged.
    #[must_use]
    pub fn encoded(&self) -> [(&'static str, Vec<u8>); 11] {
        [
            ("/state", self.state.encode_to_vec()),
            ("/setpoint", self.setpoint.encode_to_vec()),
            ("/reference", self.reference.encode_to_vec()),
            ("/wrench", self.wrench.encode_to_vec()),
            ("/control", self.control.encode_to_vec()),
            ("/rotors", self.rotors.encode_to_vec()),
            ("/flight", self.flight.encode_to_vec()),
            ("/link", self.link.encode_to_vec()),
            ("/model", self.model.encode_to_vec()),
            ("/input", self.input.encode_to_vec()),
            ("/output", self.output.encode_to_vec()),
        ]
    }
}

/// The truth of the simulated vehicle at a monotonic time, s.
pub(super) fn truth(time: f64, t: &Truth, rotor_count: usize) -> m::Truth {
    m::Truth {
        time,
        position_w: vector(&t.robot.position_w),
        velocity_w: vector(&t.robot.velocity_w),
        orientation: quaternion(&t.robot.rotation_wr),
        angular_velocity_r: vector(&t.robot.angular_velocity_r),
        tool_position_w: vector(&t.tool_position_w),
        tool_wrench_w: wrench(&t.tool_wrench_w),
        rotor_speeds: t.rotor_speeds.iter().take(rotor_count).copied().collect(),
    }
}

fn timestamp(ns: u64) -> Option<prost_types::Timestamp> {
    Some(prost_types::Timestamp { seconds: (ns / 1_000_000_000) as i64, nanos: (ns % 1_000_000_000) as i32 })
}

/// A line for log viewers.
pub(super) fn line(ns: u64, level: foxglove::log::Level, name: &str, message: String) -> foxglove::Log {
    foxglove::Log {
        timestamp: timestamp(ns),
        level: level.into(),
        message,
        name: name.into(),
        ..foxglove::Log::default()
    }
}

/// The level of a text from the vehicle.
pub(super) fn level(severity: Severity) -> foxglove::log::Level {
    match severity {
        Severity::Note => foxglove::log::Level::Info,
        Severity::Warning => foxglove::log::Level::Warning,
        Severity::Error => foxglove::log::Level::Error,
    }
}

/// Where a frame is in the world, for 3D viewers.
pub(super) fn transform(
    ns: u64,
    child: &str,
    position_w: &Vector3,
    rotation: &Matrix3,
) -> foxglove::FrameTransform {
    let [x, y, z, w] = so3::to_quaternion_xyzw(rotation);
    foxglove::FrameTransform {
        timestamp: timestamp(ns),
        parent_frame_id: "world".into(),
        child_frame_id: child.into(),
        translation: Some(foxglove::Vector3 { x: position_w.x, y: position_w.y, z: position_w.z }),
        rotation: Some(foxglove::Quaternion { x, y, z, w }),
    }
}

/// The robot's pose.
pub(super) fn robot_transform(ns: u64, state: &RobotState) -> foxglove::FrameTransform {
    transform(ns, "robot", &state.position_w, &state.rotation_wr)
}
