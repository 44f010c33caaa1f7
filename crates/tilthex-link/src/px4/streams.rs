//! What the streams of PX4 have brought.

use super::{
    esc_status::EscStatus,
    inertial::InertialStream,
    motors::Motors,
    rates::Rate,
    topics::{ARMED, BatteryStatus, OFFBOARD, SensorCombined, Topic, TopicMessage, VehicleStatus},
};
use tilthex_core::{flight::Telemetry, supervisor::limits::STREAM_SILENT};

/// What the streams have brought.
#[derive(Clone, Debug)]
pub(super) struct Streams {
    pub(super) inertial: InertialStream,
    pub(super) motors: Motors,
    pub(super) inertial_rate: Rate,
    pub(super) motor_rate: Rate,
    pub(super) telemetry: Telemetry,
    pub(super) status: Option<VehicleStatus>,
    pub(super) unreadable: Option<Topic>,
}

impl Streams {
    /// Takes the data of a topic.
    pub(super) fn take(&mut self, topic: Topic, data: &[u8], now: f64) {
        let understood = match topic {
            Topic::SensorCombined => SensorCombined::read(data).map(|sample| {
                self.inertial_rate.count();
                self.inertial.take(&sample, now, &mut self.telemetry.inertial);
            }),
            Topic::EscStatus => EscStatus::read(data).map(|status| {
                self.motor_rate.count();
                self.motors.take(&status, now, &mut self.telemetry);
            }),
            Topic::BatteryStatus => BatteryStatus::read(data).map(|battery| {
                if battery.connected && battery.voltage.is_finite() && battery.voltage > 0.0 {
                    self.telemetry.battery = Some(f64::from(battery.voltage));
                }
            }),
            Topic::VehicleStatus => VehicleStatus::read(data).map(|status| self.status = Some(status)),
            Topic::ActuatorMotors | Topic::OffboardControlMode | Topic::VehicleCommand => Some(()),
        };
        self.unreadable = if understood.is_none() { Some(topic) } else { self.unreadable };
    }

    /// Whether PX4 is armed.
    pub(super) fn armed(&self) -> bool {
        self.status.is_some_and(|status| status.arming == ARMED)
    }

    /// Whether PX4 is in the offboard mode.
    pub(super) fn offboard(&self) -> bool {
        self.status.is_some_and(|status| status.mode == OFFBOARD)
    }

    /// Whether inertial samples or motor data are missing.
    pub(super) fn silent(&self, now: f64) -> bool {
        self.telemetry.inertial.age(now) > STREAM_SILENT || self.telemetry.motor_age(now) > STREAM_SILENT
    }
}
