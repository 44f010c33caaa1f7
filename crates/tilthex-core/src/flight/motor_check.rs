//! Checks each motor alone, before all of them start: whether the right motor turns at the commanded speed.

use core::fmt;

use super::{io::MotorCommand, telemetry::Motor};
use crate::{
    supervisor::limits::{MOTORS_FRESH, STOPPED},
    types::RotorVector,
};

/// A motor must turn at the commanded speed for this time, s, before the next one is checked.
const RIGHT: f64 = 0.03;
/// A motor is tried at its lowest speed times TRIED, because some links do not tell the lowest speed from standstill.
/// A speed that differs by the part OFF is wrong.
const TRIED: f64 = 1.5;
const OFF: f64 = 0.25;
/// Another motor that turns for this time, s, was started by mistake.
const ANOTHER: f64 = 0.1;

/// What is wrong with a motor. Motors count from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotorFault {
    /// It was started alone, and does not turn.
    Still {
        /// The motor.
        motor: usize,
    },
    /// It was started alone, and another one turns.
    Another {
        /// The motor that was started.
        motor: usize,
        /// The motor that turns.
        found: usize,
    },
    /// It was started alone, and turns at another speed than the commanded one.
    WrongSpeed {
        /// The motor.
        motor: usize,
        /// Measured speed, Hz.
        found: f64,
        /// Commanded speed, Hz.
        commanded: f64,
    },
    /// It turns although every motor was commanded to stand still.
    Turns {
        /// The motor.
        motor: usize,
    },
}

impl fmt::Display for MotorFault {
    /// One sentence; motors count from 1 as on the line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Still { motor } => write!(
                f,
                "motor {} was started alone and does not turn: check its controller, its number and its wires",
                motor + 1
            ),
            Self::Another { motor, found } => write!(
                f,
                "motor {} was started alone and motor {} turns: check the numbers of their controllers",
                motor + 1,
                found + 1
            ),
            Self::WrongSpeed { motor, found, commanded } => write!(
                f,
                "motor {} was started alone at {commanded:.0} Hz and measures {found:.0} Hz: check its direction, its poles, and \
                 the settings of its controller",
                motor + 1
            ),
            Self::Turns { motor } => write!(
                f,
                "motor {} turns although every motor was told to stand still: check its controller and its number",
                motor + 1
            ),
        }
    }
}

/// The progress of the check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MotorCheck {
    /// The motor that is checked; after the last one, all are right.
    motor: usize,
    /// Whether all motors stood still before it was started.
    alone: bool,
    /// Times, s: since the begin, for which the motor has turned as it should, and for which another motor has
    /// turned.
    time: f64,
    right: f64,
    another: f64,
    fault: Option<MotorFault>,
}

impl Default for MotorCheck {
    fn default() -> Self {
        Self { motor: 0, alone: false, time: 0.0, right: 0.0, another: 0.0, fault: None }
    }
}

impl MotorCheck {
    /// The fault that was found. Motors stay still until another start is ordered.
    pub(super) fn fault(&self) -> Option<MotorFault> {
        self.fault
    }

    /// Whether each of this many motors has turned alone.
    pub(super) fn passed(&self, motors: usize) -> bool {
        self.motor >= motors
    }

    /// The command to the motors; `lowest` are their lowest speeds, Hz.
    pub(super) fn command(&self, lowest: &RotorVector) -> MotorCommand {
        if self.alone { MotorCommand::Alone(self.motor, lowest * TRIED) } else { MotorCommand::Stop }
    }

    /// One tick of a vehicle that is being started: motors, now (s), the lowest speeds (Hz), and the longest duration
    /// of the whole check (s).
    pub(super) fn step(&mut self, motors: &[Motor], now: f64, lowest: &RotorVector, limit: f64, dt: f64) {
        let Some((tried, least)) = motors.get(self.motor).zip(lowest.iter().nth(self.motor)) else { return };
        let commanded = TRIED * least;
        if self.fault.is_some() {
            return;
        }
        self.time += dt;
        let late = self.time > limit / motors.len() as f64;
        let measured = |motor: &Motor| now - motor.heard <= MOTORS_FRESH;
        let turns = |motor: &Motor, least: f64| {
            motor.starting || motor.spinning || measured(motor) && motor.speed.abs() > STOPPED * least
        };
        let mut others = motors.iter().zip(lowest.iter()).enumerate();
        let other = others.find(|(i, (m, least))| *i != self.motor && turns(m, **least)).map(|(i, _)| i);
        if !self.alone {
            let still = other.is_none() && !turns(tried, *least);
            if still {
                (self.alone, self.time) = (true, 0.0);
            } else if late {
                self.fault = Some(MotorFault::Turns { motor: other.unwrap_or(self.motor) });
            }
            return;
        }
        self.another = if other.is_some() { self.another + dt } else { 0.0 };
        let follows = measured(tried) && (tried.speed - commanded).abs() < OFF * commanded;
        self.right = if tried.spinning && follows && other.is_none() { self.right + dt } else { 0.0 };
        let motor = self.motor;
        if let Some(found) = other.filter(|_| self.another > ANOTHER) {
            self.fault = Some(MotorFault::Another { motor, found });
        } else if self.right > RIGHT {
            *self = Self { motor: motor.saturating_add(1), ..Self::default() };
        } else if late && tried.spinning && measured(tried) && tried.speed.abs() > STOPPED * commanded {
            self.fault = Some(MotorFault::WrongSpeed { motor, found: tried.speed, commanded });
        } else if late {
            self.fault = Some(MotorFault::Still { motor });
        }
    }
}
