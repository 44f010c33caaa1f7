//! A record of the flight, put together from its parts and the streams.

use super::Base;
use crate::onboard::{ToolPart, record::Facts};
use tilthex_core::{
    RotorVector, Setpoint, Vector3, Wrench,
    admittance::centre_of_mass_reference,
    flight::{ModelRecord, Record},
};

impl Base {
    /// The record whose last part has arrived, if its other parts have.
    pub(super) fn record(&mut self, tool: &ToolPart, now: f64) -> Option<Record> {
        let flight = self.flight.filter(|part| part.number == tool.number)?;
        let state = self.state.take().filter(|part| part.number == tool.number)?.state;
        let time = self.clock.sent(flight.time, now);
        let reference = Setpoint::hold(tool.position_w, tool.rotation_we);
        let mut record = unknown();
        record.tick = self.records;
        record.dt = self.last_time.replace(time).map_or(0.0, |last| time - last);
        (record.input.time, record.state_time) = (time, time);
        (record.phase, record.faults, record.start_w) = (flight.phase, flight.faults, flight.start_w);
        record.pose_age =
            if flight.pose_age == u16::MAX { f64::NAN } else { 1e-3 * f64::from(flight.pose_age) };
        record.compliant = flight.facts.has(Facts::COMPLIANT);
        record.saturated = flight.facts.has(Facts::SATURATED);
        record.excursion_limited = flight.facts.has(Facts::EXCURSION_LIMITED);
        record.state = state;
        record.wrench_tool_w = tool.wrench_w;
        let wanted_w = centre_of_mass_reference(&reference, &self.params.tool).position_w;
        record.position_error_w = wanted_w - state.position_w;
        record.reference = reference;
        record.setpoint = Setpoint::hold(flight.setpoint_w, flight.setpoint_we);
        record.rotor_speeds = self.speeds;
        record.current = self.currents.sum();
        record.battery = self.battery;
        let counters = self.receiver.counters();
        (record.counters.messages, record.counters.refused_frames) = (counters.messages, counters.refused());
        self.records += 1;
        Some(record)
    }
}

/// A record whose values are not known.
fn unknown() -> Record {
    let (none, nowhere) = (f64::NAN, Vector3::repeat(f64::NAN));
    let wrench = Wrench { force: nowhere, torque: nowhere };
    Record {
        gyro_bias_i: nowhere,
        accelerometer_bias_i: nowhere,
        deviation: [none; 3],
        innovation: none,
        latency: none,
        specific_force_r: nowhere,
        wrench_robot: wrench,
        wrench_contact_w: wrench,
        wrench_admittance_w: wrench,
        wind_w: nowhere,
        contact_log_odds: none,
        rotation_error_r: nowhere,
        energy_tank: none,
        rotor_command: RotorVector::repeat(none),
        model: ModelRecord {
            mass: none,
            centre_of_mass_r: nowhere,
            false_force: none,
            false_torque: none,
            ..ModelRecord::default()
        },
        ..Record::default()
    }
}
