//! Telemetry: the measurements and states that a vehicle reports, over any link.

use super::LONG_AGO;
use crate::{
    supervisor::limits::IMU_FROZEN,
    types::{MAX_ROTORS, RotorVector, Vector3},
};

/// Largest number of inertial samples that are kept in one tick: more than those in the bytes that a tick takes from a link at its
/// default rates.
pub const MAX_SAMPLES: usize = 64;

/// An inertial sample in IMU coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertial {
    /// When it was taken, s, on the host's clock.
    pub time: f64,
    /// Angular velocity, rad/s.
    pub gyro_i: Vector3,
    /// Specific force, m/s^2.
    pub specific_force_i: Vector3,
    /// Whether readings before it left the range, or jumped from sample to sample.
    pub shaken: bool,
}

/// The inertial stream in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialTelemetry {
    samples: [Inertial; MAX_SAMPLES],
    count: usize,
    /// When the newest usable sample arrived, s.
    pub heard: f64,
    /// How much later than usual samples arrive, s; 0 if the line is not late.
    pub line_delay: f64,
    /// Whether the IMU repeats its readings exactly.
    pub frozen: bool,
    /// How many readings in a row are equal to the one before.
    equal: u32,
    /// Whether the newest reading is at the end of its range.
    pub saturated: bool,
    /// Whether a sample was refused in this tick.
    pub refused_now: bool,
}

impl InertialTelemetry {
    /// Counts a reading: whether it is equal to the one before, in all its numbers.
    pub fn note_reading(&mut self, equal: bool) {
        self.equal = if equal { self.equal.saturating_add(1) } else { 0 };
        self.frozen = self.equal >= IMU_FROZEN;
    }

    /// Keeps a usable sample that arrived at `now`, s; samples after [`MAX_SAMPLES`] are dropped.
    pub fn push(&mut self, now: f64, sample: Inertial) {
        self.heard = now;
        if let Some(slot) = self.samples.get_mut(self.count) {
            *slot = sample;
            self.count += 1;
        }
    }

    /// Usable samples of this tick, oldest first.
    #[must_use]
    pub fn samples(&self) -> &[Inertial] {
        self.samples.get(..self.count).unwrap_or(&[])
    }

    /// Age of the newest usable sample, s.
    #[must_use]
    pub fn age(&self, now: f64) -> f64 {
        now - self.heard
    }
}

/// The newest measurements and states of one motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// When it arrived, s.
    pub heard: f64,
    /// Measured speed, Hz.
    pub speed: f64,
    /// It is being started.
    pub starting: bool,
    /// It spins.
    pub spinning: bool,
    /// It has stopped by itself and reports it.
    pub emergency: bool,
    /// Current, A.
    pub current: f64,
}

/// The state of the link, and counts since its beginning; they saturate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkState {
    /// A vehicle that the link knows has answered.
    pub identified: bool,
    /// All streams run.
    pub ready: bool,
    /// When the last byte arrived, s.
    pub heard: f64,
    /// The board announced itself without a request in this tick.
    pub rebooted: bool,
    /// Accepted messages.
    pub messages: u32,
    /// Frames refused for their form.
    pub refused_frames: u32,
    /// Samples refused by a gate.
    pub refused_samples: u32,
    /// Inertial samples that never came.
    pub lost_samples: u32,
}

/// The measurements and states that a vehicle has reported up to a tick. A link fills it in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Telemetry {
    /// The inertial stream.
    pub inertial: InertialTelemetry,
    motors: [Motor; MAX_ROTORS],
    motor_count: usize,
    /// Battery, V, once it is known.
    pub battery: Option<f64>,
    /// The link.
    pub link: LinkState,
}

impl Telemetry {
    /// The telemetry of a vehicle with `motor_count` motors, at most [`MAX_ROTORS`], that has sent nothing yet.
    #[must_use]
    pub fn new(motor_count: usize) -> Self {
        let sample = Inertial {
            time: 0.0,
            gyro_i: Vector3::zeros(),
            specific_force_i: Vector3::zeros(),
            shaken: false,
        };
        let motor = Motor {
            heard: LONG_AGO,
            speed: 0.0,
            starting: false,
            spinning: false,
            emergency: false,
            current: 0.0,
        };
        Self {
            inertial: InertialTelemetry {
                samples: [sample; MAX_SAMPLES],
                count: 0,
                heard: LONG_AGO,
                line_delay: 0.0,
                frozen: false,
                equal: 0,
                saturated: false,
                refused_now: false,
            },
            motors: [motor; MAX_ROTORS],
            motor_count: motor_count.min(MAX_ROTORS),
            battery: None,
            link: LinkState {
                identified: false,
                ready: false,
                heard: LONG_AGO,
                rebooted: false,
                messages: 0,
                refused_frames: 0,
                refused_samples: 0,
                lost_samples: 0,
            },
        }
    }

    /// Removes what belongs only to the last tick.
    pub fn begin_tick(&mut self) {
        self.inertial.count = 0;
        self.inertial.refused_now = false;
        self.link.rebooted = false;
    }

    /// Takes the speeds, Hz, of motors that all spin, which arrived at `now`, s, over a link that is ready.
    pub fn hear_motors(&mut self, now: f64, speeds: &RotorVector) {
        for (motor, speed) in self.motors.iter_mut().take(self.motor_count).zip(speeds.iter()) {
            (motor.heard, motor.speed, motor.spinning) = (now, *speed, true);
        }
        (self.link.identified, self.link.ready, self.link.heard) = (true, true, now);
    }

    /// Sets whether a motor, from 0, spins, for motors that start and stop at once.
    pub fn set_spinning(&mut self, index: usize, spinning: bool) {
        if let Some(motor) = self.motor_mut(index) {
            motor.spinning = spinning;
        }
    }

    /// The newest measurements and states of all motors.
    #[must_use]
    pub fn motors(&self) -> &[Motor] {
        self.motors.get(..self.motor_count).unwrap_or(&[])
    }

    /// One motor, from 0.
    #[must_use]
    pub fn motor_mut(&mut self, index: usize) -> Option<&mut Motor> {
        self.motors.get_mut(..self.motor_count)?.get_mut(index)
    }

    /// Age of the oldest motor's measurement, s.
    #[must_use]
    pub fn motor_age(&self, now: f64) -> f64 {
        let oldest =
            self.motors().iter().fold(now, |oldest, m| if m.heard < oldest { m.heard } else { oldest });
        now - oldest
    }

    /// Time since the last byte arrived, s.
    #[must_use]
    pub fn silence(&self, now: f64) -> f64 {
        now - self.link.heard
    }

    /// Whether every motor spins.
    #[must_use]
    pub fn all_spinning(&self) -> bool {
        self.motors().iter().all(|m| m.spinning)
    }

    /// Whether a motor spins or starts.
    #[must_use]
    pub fn any_spinning(&self) -> bool {
        self.motors().iter().any(|m| m.spinning || m.starting)
    }
}
