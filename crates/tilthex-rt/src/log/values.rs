//! Every logged value, declared once: from these tables follow the messages of the log and their schema, the state of the
//! control socket, the types of the Python client and docs/log.md.
//!
//! To log one more value, add a line with the next free number of its message, and run
//! `TILTHEX_WRITE_DOCS=1 cargo test --workspace --test log_document`. Numbers never change and are never used again: old
//! logs keep their meaning.

use tilthex_core::{Setpoint, Vector3, Wrench, types::PoseSample};
use tilthex_sim::{Truth, feed::Tick};

use super::value::{
    Get::{
        Bytes, Count, Faults, Flag, Matrix, Number, Part, Phase, Poses, Rotation, Rotors, Text, Total, Vector,
        Wrench as Force,
    },
    Message, field,
};

pub(super) const VECTOR: Message<Vector3> = Message {
    name: "Vector3",
    doc: "Three numbers.",
    fields: &[
        field(1, "x", "", "", "", Number(|v| v.x)),
        field(2, "y", "", "", "", Number(|v| v.y)),
        field(3, "z", "", "", "", Number(|v| v.z)),
    ],
};

pub(super) const QUATERNION: Message<[f64; 4]> = Message {
    name: "Quaternion",
    doc: "A rotation, scalar last; maps the body's coordinates to world coordinates.",
    fields: &[
        field(1, "x", "", "", "", Number(|q| q[0])),
        field(2, "y", "", "", "", Number(|q| q[1])),
        field(3, "z", "", "", "", Number(|q| q[2])),
        field(4, "w", "", "", "", Number(|q| q[3])),
    ],
};

pub(super) const WRENCH: Message<Wrench> = Message {
    name: "Wrench",
    doc: "A force and a torque. Each value that uses it says the point of the torque and the frame.",
    fields: &[
        field(1, "force", "N", "", "", Vector(|w| w.force)),
        field(2, "torque", "N m", "", "", Vector(|w| w.torque)),
    ],
};

pub(super) const POSE: Message<PoseSample> = Message {
    name: "Pose",
    doc: "A captured pose.",
    fields: &[
        field(1, "time", "s", "", "Time at which it was taken.", Number(|p| p.time)),
        field(2, "arrival", "s", "", "Time at which it arrived.", Number(|p| p.arrival)),
        field(3, "position_w", "m", "", "Position of the captured body.", Vector(|p| p.position_w)),
        field(4, "rotation", "", "", "Its rotation, nine numbers row by row; maps its coordinates to world coordinates.", Matrix(|p| p.rotation_wr)),
        field(5, "tracking_valid", "", "", "Whether the body is tracked.", Flag(|p| p.tracking_valid)),
    ],
};

const STATE: Message<Tick> = Message {
    name: "State",
    doc: "The state of the estimator.",
    fields: &[
        field(1, "position_w", "m", "position", "Position of the centre of mass.", Vector(|t| t.record.state.position_w)),
        field(2, "velocity_w", "m/s", "velocity", "Velocity of the centre of mass.", Vector(|t| t.record.state.velocity_w)),
        field(3, "orientation", "", "rotation", "Rotation of the robot.", Rotation(|t| t.record.state.rotation_wr)),
        field(4, "angular_velocity_r", "rad/s", "angular_velocity", "Angular velocity.", Vector(|t| t.record.state.angular_velocity_r)),
        field(5, "specific_force_r", "m/s^2", "specific_force", "Specific force at the centre of mass.", Vector(|t| t.record.specific_force_r)),
        field(6, "gyro_bias_i", "rad/s", "", "Bias of the gyroscope.", Vector(|t| t.record.gyro_bias_i)),
        field(7, "accelerometer_bias_i", "m/s^2", "", "Bias of the accelerometer.", Vector(|t| t.record.accelerometer_bias_i)),
        field(8, "position_deviation", "m", "position_deviation", "Deviation of the position: root of the summed variances.", Number(|t| t.record.deviation[0])),
        field(9, "velocity_deviation", "m/s", "velocity_deviation", "Deviation of the velocity: root of the summed variances.", Number(|t| t.record.deviation[1])),
        field(10, "rotation_deviation", "rad", "rotation_deviation", "Deviation of the rotation: root of the summed variances.", Number(|t| t.record.deviation[2])),
        field(11, "innovation", "1", "", "Normalised innovation squared of the newest pose, over its degrees of freedom.", Number(|t| t.record.innovation)),
        field(12, "pose_age", "s", "pose_age", "Age of the newest pose whose position was applied.", Number(|t| t.record.pose_age)),
        field(13, "time", "s", "", "Time of this state: that of the newest inertial sample.", Number(|t| t.record.state_time)),
        field(14, "latency", "s", "latency", "Estimated latency: mean time from the capture of a pose to its arrival.", Number(|t| t.record.latency)),
    ],
};

const TARGET: Message<Setpoint> = Message {
    name: "Target",
    doc: "A set-point of the tool.",
    fields: &[
        field(1, "position_w", "m", "position", "Position of the tool tip.", Vector(|s| s.position_w)),
        field(2, "orientation", "", "rotation", "Rotation of the tool.", Rotation(|s| s.rotation_we)),
        field(3, "velocity_w", "m/s", "velocity", "Velocity.", Vector(|s| s.velocity_w)),
        field(4, "angular_velocity_w", "rad/s", "angular_velocity", "Angular velocity.", Vector(|s| s.angular_velocity_w)),
        field(5, "acceleration_w", "m/s^2", "", "Acceleration.", Vector(|s| s.acceleration_w)),
        field(6, "angular_acceleration_w", "rad/s^2", "", "Angular acceleration.", Vector(|s| s.angular_acceleration_w)),
        field(7, "wrench_w", "N, N m", "force, torque", "Wrench that the tool must exert, about its tip, world axes.", Force(|s| s.wrench_w)),
    ],
};

const WRENCHES: Message<Tick> = Message {
    name: "Wrenches",
    doc: "Wrenches of the environment on the robot.",
    fields: &[
        field(1, "robot", "N, N m", "", "At the centre of mass: force in world, torque in robot axes.", Force(|t| t.record.wrench_robot)),
        field(2, "tool_w", "N, N m", "force, torque", "About the tool tip, world axes.", Force(|t| t.record.wrench_tool_w)),
        field(3, "admittance_w", "N, N m", "", "Input of the admittance filter, about the tool tip, world axes.", Force(|t| t.record.wrench_admittance_w)),
        field(4, "wind_w", "m/s", "wind", "Estimated velocity of the air; zero if `[contact] discrimination` is off.", Vector(|t| t.record.wind_w)),
        field(5, "contact_likelihood", "1", "contact_likelihood", "Likelihood that the tool is touched; near 1 if `[contact] discrimination` is off.", Number(|t| t.record.contact_likelihood())),
        field(6, "contact_w", "N, N m", "contact_force, contact_torque", "The part of the wrench about the tool tip that is no drag of the wind; all of it if `[contact] discrimination` is off.", Force(|t| t.record.wrench_contact_w)),
    ],
};

const CONTROL: Message<Tick> = Message {
    name: "Control",
    doc: "The controller.",
    fields: &[
        field(1, "position_error_w", "m", "position_error", "Position error e_p.", Vector(|t| t.record.position_error_w)),
        field(2, "rotation_error_r", "1", "", "Rotation error e_R.", Vector(|t| t.record.rotation_error_r)),
        field(3, "compliant", "", "compliant", "Whether contact moves the reference.", Flag(|t| t.record.compliant)),
        field(4, "saturated", "", "saturated", "Whether a rotor is at a limit.", Flag(|t| t.record.saturated)),
        field(5, "excursion_limited", "", "", "Whether the admittance filter is at its excursion limit.", Flag(|t| t.record.excursion_limited)),
        field(6, "given_up", "", "given_up", "The most important part of the wanted wrench that the rotors do not produce; none if they produce all of it.", Part(|t| t.record.given_up)),
        field(7, "energy_tank", "J", "energy_tank", "Energy that the reference may still put into what the tool touches.", Number(|t| t.record.energy_tank)),
    ],
};

const ROTORS: Message<Tick> = Message {
    name: "Rotors",
    doc: "Rotors and battery.",
    fields: &[
        field(1, "command", "Hz", "rotor_command", "Commanded speed of each rotor.", Rotors(|t| t.record.rotor_command)),
        field(2, "measured", "Hz", "rotor_speeds", "Measured speed of each rotor; the model's where a measurement is missing, doubted or impossible.", Rotors(|t| t.record.rotor_speeds)),
        field(3, "current", "A", "", "Sum of the motors' currents.", Number(|t| t.record.current)),
        field(4, "battery", "V", "battery", "Voltage of the battery; NaN (null) before it is known.", Number(|t| t.record.battery)),
    ],
};

const FLIGHT: Message<Tick> = Message {
    name: "Flight",
    doc: "The supervisor.",
    fields: &[
        field(1, "tick", "", "tick", "Number of the tick, from 0.", Total(|t| t.record.tick)),
        field(2, "time", "s", "time", "Time of the tick.", Number(|t| t.record.input.time)),
        field(3, "dt", "s", "", "Time since the last tick.", Number(|t| t.record.dt)),
        field(4, "phase", "", "phase", "Phase after the tick.", Phase(|t| t.record.phase)),
        field(5, "faults", "", "faults", "Active faults, one bit each; docs/faults.md lists bit and name.", Faults(|t| t.record.faults)),
    ],
};

const LINK: Message<Tick> = Message {
    name: "Link",
    doc: "Counters of the link and of poses, totals since the start.",
    fields: &[
        field(1, "messages", "", "", "Messages of the vehicle that were accepted.", Count(|t| t.record.counters.messages)),
        field(2, "refused_frames", "", "", "Frames that were refused.", Count(|t| t.record.counters.refused_frames)),
        field(3, "refused_samples", "", "", "Samples that their gate refused.", Count(|t| t.record.counters.refused_samples)),
        field(4, "lost_samples", "", "", "Inertial samples lost, by their sequence numbers.", Count(|t| t.record.counters.lost_samples)),
        field(5, "poses", "", "", "Poses that were applied.", Count(|t| t.record.counters.poses)),
        field(6, "refused_poses", "", "", "Poses that were refused.", Count(|t| t.record.counters.refused_poses)),
        field(7, "imu_samples", "", "", "Inertial samples in this tick.", Count(|t| t.record.imu_samples.into())),
    ],
};

const MODEL: Message<Tick> = Message {
    name: "Model",
    doc: "The vehicle's model that the laws use.",
    fields: &[
        field(1, "mass", "kg", "mass", "Mass.", Number(|t| t.record.model.mass)),
        field(2, "centre_of_mass_r", "m", "centre_of_mass", "Centre of mass, relative to the one of the configuration.", Vector(|t| t.record.model.centre_of_mass_r)),
        field(3, "false_force", "N", "false_force", "Contact force that tilted hovers may show without contact: one standard deviation.", Number(|t| t.record.model.false_force)),
        field(4, "false_torque", "N m", "false_torque", "Contact torque that tilted hovers may show without contact: one standard deviation.", Number(|t| t.record.model.false_torque)),
        field(5, "hovers", "", "hovers", "Number of hovers from which the model was learnt; 0 for the configured model.", Count(|t| t.record.model.hovers)),
        field(6, "misfit", "1", "", "Mean squared normalised innovation of these hovers.", Number(|t| t.record.model.misfit)),
    ],
};

const TIMING: Message<Tick> = Message {
    name: "Timing",
    doc: "The timing of the loop.",
    fields: &[
        field(1, "wake_latency", "ns", "", "From the deadline to the start of the tick.", Total(|t| t.timing.wake_latency)),
        field(2, "compute", "ns", "", "From the start of the tick to the end of its write.", Total(|t| t.timing.compute)),
        field(3, "period", "ns", "", "From the start of the last tick to the start of this one.", Total(|t| t.timing.period)),
        field(4, "skipped", "", "", "Whole periods that were skipped since the last tick in this log.", Total(|t| t.timing.skipped)),
        field(5, "imu_to_command", "ns", "", "From the moment at which the IMU's bytes were found to the end of the command's write; 0 if no bytes came.", Total(|t| t.timing.imu_to_command)),
        field(6, "polls", "", "", "How often the loop looked at the port before the IMU's bytes were there.", Count(|t| t.timing.polls)),
        field(7, "short_writes", "", "", "Writes of which the line took only a part, total.", Total(|t| t.timing.short_writes)),
    ],
};

const INPUT: Message<Tick> = Message {
    name: "Input",
    doc: "The inputs of the tick. From them, the attached configuration and the commands, `tilthex-rt replay` runs the flight again.",
    fields: &[
        field(1, "tick", "", "", "Number of the tick.", Total(|t| t.record.tick)),
        field(2, "time", "s", "", "Time of the tick.", Number(|t| t.record.input.time)),
        field(3, "link", "", "", "Bytes from the vehicle.", Bytes(|t| t.wire.received())),
        field(4, "poses", "", "", "Poses from motion capture.", Poses(|t| t.record.input.poses())),
        field(5, "command", "", "", "Whether the next message of /command came with this tick.", Flag(|t| t.record.input.command)),
        field(6, "land", "", "", "Whether a signal, an order or the end of the duration asks to land.", Flag(|t| t.record.input.host.land)),
        field(7, "link_lost", "", "", "Whether the port is gone.", Flag(|t| t.record.input.host.link_lost)),
        field(8, "log_lost", "", "", "Whether the log cannot be written.", Flag(|t| t.record.input.host.log_lost)),
        field(9, "kill", "", "", "Whether the operator asks to stop the motors at once.", Flag(|t| t.record.input.host.kill)),
        field(10, "operator_silent", "", "", "Whether the operator has been silent for too long.", Flag(|t| t.record.input.host.operator_silent)),
    ],
};

const OUTPUT: Message<Tick> = Message {
    name: "Output",
    doc: "The output of the tick.",
    fields: &[
        field(1, "tick", "", "", "Number of the tick.", Total(|t| t.record.tick)),
        field(2, "link", "", "", "Bytes to the vehicle.", Bytes(|t| t.wire.sent.bytes())),
    ],
};

/// An order, as the client sent it.
pub(super) struct Order {
    pub(super) json: String,
    pub(super) urgent: bool,
}

pub(super) const COMMAND: Message<Order> = Message {
    name: "Command",
    doc: "An order, as the client sent it.",
    fields: &[
        field(1, "json", "", "", "One line of JSON.", Text(|o| &o.json)),
        field(2, "urgent", "", "", "Whether it was executed before all others (`kill`, `land`); its effect is in /input.", Flag(|o| o.urgent)),
    ],
};

/// A true state of the simulated vehicle, with its monotonic time in seconds.
pub(super) type Timed = (f64, Truth);

pub(super) const TRUTH: Message<Timed> = Message {
    name: "Truth",
    doc: "The true state of the simulated vehicle.",
    fields: &[
        field(1, "time", "s", "", "Time of this state, on the clock of /state and /flight.", Number(|t| t.0)),
        field(2, "position_w", "m", "", "Position of the centre of mass.", Vector(|t| t.1.robot.position_w)),
        field(3, "velocity_w", "m/s", "", "Velocity of the centre of mass.", Vector(|t| t.1.robot.velocity_w)),
        field(4, "orientation", "", "", "Rotation of the robot.", Rotation(|t| t.1.robot.rotation_wr)),
        field(5, "angular_velocity_r", "rad/s", "", "Angular velocity.", Vector(|t| t.1.robot.angular_velocity_r)),
        field(6, "tool_position_w", "m", "", "Position of the tool tip.", Vector(|t| t.1.tool_position_w)),
        field(7, "tool_wrench_w", "N, N m", "", "Wrench of the environment on the tool, world axes.", Force(|t| t.1.tool_wrench_w)),
        field(8, "rotor_speeds", "Hz", "", "Speed of each rotor.", Rotors(|t| t.1.rotor_speeds)),
    ],
};

/// The content of a channel of a tick.
pub(super) enum Content {
    Tick(&'static Message<Tick>),
    Target(&'static Message<Setpoint>, fn(&Tick) -> &Setpoint),
}

/// A channel with one message per tick.
pub(super) struct TickChannel {
    pub(super) topic: &'static str,
    pub(super) doc: &'static str,
    pub(super) content: Content,
    /// The name of the group of its values in the state of the control socket; empty if they are not a group.
    pub(super) state: &'static str,
}

const fn channel(topic: &'static str, message: &'static Message<Tick>, state: &'static str) -> TickChannel {
    TickChannel { topic, doc: message.doc, content: Content::Tick(message), state }
}

/// The channels that depend only on the inputs of a tick, in the order in which they are logged. A replay compares them.
pub(super) const REPLAYED: [TickChannel; 11] = [
    channel("/state", &STATE, ""),
    TickChannel {
        topic: "/setpoint",
        doc: "The commanded set-point of the tool.",
        content: Content::Target(&TARGET, |t| &t.record.setpoint),
        state: "setpoint",
    },
    TickChannel {
        topic: "/reference",
        doc: "The reference of the tool: the set-point after the admittance filter.",
        content: Content::Target(&TARGET, |t| &t.record.reference),
        state: "reference",
    },
    channel("/wrench", &WRENCHES, ""),
    channel("/control", &CONTROL, ""),
    channel("/rotors", &ROTORS, ""),
    channel("/flight", &FLIGHT, ""),
    channel("/link", &LINK, ""),
    channel("/model", &MODEL, "model"),
    channel("/input", &INPUT, ""),
    channel("/output", &OUTPUT, ""),
];

/// The timing of the tick, which a replay cannot repeat.
pub(super) const TIMED: TickChannel = channel("/timing", &TIMING, "");
