//! The motor controllers: which controller drives which motor, and which measurements are accepted.

use super::esc_status::{ESCS, EscStatus, FIRST_MOTOR, STUCK};
use crate::{Gate, GateCounters, Verdict};
use tilthex_core::{Error, flight::Telemetry};

/// A motor spins if it is faster than this, Hz.
const SPINS: f64 = 5.0;
/// If a motor turned and its controller now measures exactly 0, the 0 is accepted after this time, s. The telemetry of PX4
/// can drop to 0 while motors turn (PX4 issue 16735).
const DROPPED: f64 = 0.1;

/// The measurements of all motors.
#[derive(Clone, Debug)]
pub(super) struct Motors {
    gates: [Gate<1>; ESCS],
    /// The time at which each controller's measurement dropped from a speed to exactly 0, s.
    dropped: [Option<f64>; ESCS],
}

impl Motors {
    /// The state before the first measurement.
    ///
    /// # Errors
    /// Never: the limits of its gates are constant.
    pub(super) fn new() -> Result<Self, Error> {
        Ok(Self { gates: [Gate::rotor_speed()?; ESCS], dropped: [None; ESCS] })
    }

    /// Takes the measurements that arrived at `now`, s.
    pub(super) fn take(&mut self, status: &EscStatus, now: f64, telemetry: &mut Telemetry) {
        let own = self.gates.iter_mut().zip(&mut self.dropped);
        for ((place, esc), (gate, dropped)) in (0..status.count).zip(&status.escs).zip(own) {
            if status.online >> place & 1 == 0 {
                continue;
            }
            // A controller that does not report its output function drives the motor with its own index.
            let index = esc.function.checked_sub(FIRST_MOTOR).unwrap_or(place);
            let Some(motor) = telemetry.motor_mut(usize::from(index)) else { continue };
            motor.current = f64::from(esc.current);
            motor.emergency = esc.failures & STUCK != 0;
            let speed = f64::from(esc.rpm) / 60.0;
            let drops = esc.rpm == 0 && motor.spinning;
            *dropped = if drops { dropped.or(Some(now)) } else { None };
            if dropped.is_some_and(|since| now - since < DROPPED) || gate.step(&[speed], 0) != Verdict::Pass {
                continue;
            }
            (motor.heard, motor.speed, motor.spinning) = (now, speed, speed.abs() > SPINS);
        }
    }

    /// What its gates have accepted and refused.
    pub(super) fn gate_counters(&self) -> impl Iterator<Item = GateCounters> + '_ {
        self.gates.iter().map(Gate::counters)
    }
}
