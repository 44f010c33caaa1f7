//! One motor controller (ESC), as the vehicle's firmware drives it.

use crate::{
    board::Micros,
    tk3::{MotorFrame, MotorState, nearest_half_period},
};

/// A motor without set-points for this time falls back to its lowest speed.
pub const FALL_BACK: Micros = 500_000;
/// A motor disarms this time after it fell back.
pub const DISARM: Micros = 10_000_000;
/// Duration of a start.
pub const START: Micros = 400_000;
/// Throttle at full scale.
const FULL_THROTTLE: f64 = 1023.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Stopped,
    Starting { until: Micros },
    Spinning,
}

/// An event that a motor reports without a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// It spins now.
    Started,
    /// No set-point came for [`FALL_BACK`].
    FellBack,
    /// No set-point came for [`DISARM`] after that.
    Disarmed,
}

/// A motor and its controller.
#[derive(Clone, Copy, Debug)]
pub struct Motor {
    lowest: f64,
    highest: f64,
    phase: Phase,
    emergency: bool,
    fallen_back: bool,
    /// Commanded speed, Hz; used while the motor spins.
    target: f64,
    last_set: Micros,
    sequence: u8,
}

impl Motor {
    /// A stopped motor with a range of speeds, Hz.
    #[must_use]
    pub fn new(lowest: f64, highest: f64) -> Self {
        Self {
            lowest,
            highest,
            phase: Phase::Stopped,
            emergency: false,
            fallen_back: false,
            target: lowest,
            last_set: 0,
            sequence: 0,
        }
    }

    /// `g`: starts at the lowest speed and clears the emergency bit.
    pub fn start(&mut self, now: Micros) {
        self.emergency = false;
        if self.phase == Phase::Stopped {
            self.phase = Phase::Starting { until: now + START };
        }
    }

    /// `x`.
    pub fn stop(&mut self) {
        self.phase = Phase::Stopped;
        self.fallen_back = false;
    }

    /// The controller stops by itself and sets its emergency bit until the next start.
    pub fn fail(&mut self) {
        self.stop();
        self.emergency = true;
    }

    /// `w`: a speed, Hz, negative in reverse. It neither starts nor stops a motor.
    pub fn set_speed(&mut self, speed: f64, now: Micros) {
        if self.phase == Phase::Spinning {
            self.target = speed.abs().clamp(self.lowest, self.highest).copysign(speed);
            self.last_set = now;
            self.fallen_back = false;
        }
    }

    /// `q`: a throttle from -1023 to 1023.
    pub fn set_throttle(&mut self, throttle: i16, now: Micros) {
        self.set_speed(f64::from(throttle) / FULL_THROTTLE * self.highest, now);
    }

    /// Lets time pass; returns the event of this time.
    pub fn advance(&mut self, now: Micros) -> Option<Event> {
        match self.phase {
            Phase::Starting { until } if now >= until => {
                self.phase = Phase::Spinning;
                self.target = self.lowest;
                self.last_set = now;
                self.fallen_back = false;
                Some(Event::Started)
            }
            Phase::Spinning if now >= self.last_set + FALL_BACK + DISARM => {
                self.stop();
                Some(Event::Disarmed)
            }
            Phase::Spinning if !self.fallen_back && now >= self.last_set + FALL_BACK => {
                self.fallen_back = true;
                self.target = self.lowest;
                Some(Event::FellBack)
            }
            _ => None,
        }
    }

    /// The speed to which it drives its rotor, Hz.
    #[must_use]
    pub fn command(&self) -> f64 {
        match self.phase {
            Phase::Stopped => 0.0,
            Phase::Starting { .. } => 0.5 * self.lowest,
            Phase::Spinning => self.target,
        }
    }

    /// Whether it spins.
    #[must_use]
    pub fn is_spinning(&self) -> bool {
        self.phase == Phase::Spinning
    }

    /// Whether it is being started.
    #[must_use]
    pub fn is_starting(&self) -> bool {
        matches!(self.phase, Phase::Starting { .. })
    }

    /// The state that it reports, from the measured speed of its rotor, Hz, and its current, A.
    pub fn report(&mut self, number: u8, speed: f64, current: f64) -> MotorFrame {
        self.sequence = self.sequence.wrapping_add(1);
        let phase = match self.phase {
            Phase::Stopped => 0,
            Phase::Starting { .. } => MotorState::STARTING,
            Phase::Spinning => MotorState::SPINNING,
        };
        let emergency = if self.emergency { MotorState::EMERGENCY } else { 0 };
        MotorFrame {
            sequence: self.sequence,
            state: MotorState(number & 0x0f | phase | emergency),
            half_period: nearest_half_period(speed),
            throttle: (FULL_THROTTLE * speed / self.highest) as i16,
            current_ma: (1e3 * current) as u16,
        }
    }
}
