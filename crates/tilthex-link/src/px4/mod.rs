//! PX4 over uXRCE-DDS, without ROS and without another agent: the flight board is the DDS-XRCE client, the host is the
//! agent of the only session. They talk over a serial line or in datagrams.
//!
//! The host receives inertial samples, the measurements of the motor controllers, the battery and the vehicle's state. It
//! sends throttles in PX4's offboard mode (`direct_actuator`). `docs/howto/px4.md` says how to set PX4 up.

mod agent;
#[cfg(feature = "board")]
pub mod board;
mod cdr;
mod complaint;
mod engaging;
mod entity;
mod esc_status;
mod frame;
mod host;
mod inertial;
mod message;
mod motors;
mod rates;
mod streams;
mod submessages;
mod throttle;
mod topics;

pub use complaint::Complaint;
pub use entity::{Entity, TopicName};
pub use esc_status::{ESCS, EscReport, EscStatus, FIRST_MOTOR, STUCK};
pub use frame::{AGENT, CLIENT, Decoder, FrameCounters, MAX_MESSAGE, encode};
pub use host::Host;
pub use message::{
    AGENT_OBJECT, BEST_EFFORT, CLIENT_OBJECT, Draft, Header, Message, NO_STREAM, ObjectId, RELIABLE, Request,
    Time, WITHOUT_KEY,
};
pub use submessages::{FromAgent, FromClient};
pub use throttle::ThrottleMap;
pub use topics::{
    ARMED, ActuatorMotors, BatteryStatus, MOTORS, OFFBOARD, OffboardControlMode, SensorCombined, Topic,
    TopicMessage, VehicleCommand, VehicleStatus,
};
