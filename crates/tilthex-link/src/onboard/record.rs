//! The record of a flight in three messages, which are sent one after the other.

use super::{
    body::{FAR, Reader, Writer},
    clock::micros,
    order::Answer,
};
use crate::tk3::{Frame, Refusal};
use tilthex_core::{
    Matrix3, Vector3, Wrench,
    flight::Record,
    supervisor::{COUNT, FaultSet, Phase},
    types::RobotState,
};

/// Largest magnitudes in a record: rates (m/s, rad/s), wrenches (N, N m).
const FAST: f64 = 1e3;
const STRONG: f64 = 1e4;
/// The longest age of a pose that a message carries, s.
const OLDEST: f64 = 65.534;

/// Facts of a flight that are either true or not; one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Facts(pub u8);

impl Facts {
    /// Contact moves the reference.
    pub const COMPLIANT: u8 = 1;
    /// A rotor is at a limit.
    pub const SATURATED: u8 = 2;
    /// The reference is as far from the set-point as allowed.
    pub const EXCURSION_LIMITED: u8 = 4;
    /// The estimator has started.
    pub const ESTIMATES: u8 = 8;
    /// The vehicle flew and stands again.
    pub const LANDED: u8 = 16;
    /// The motors were stopped by the order to kill.
    pub const KILLED: u8 = 32;

    /// Sets a bit if `holds`.
    #[must_use]
    pub fn and_if(self, bit: u8, holds: bool) -> Self {
        if holds { Self(self.0 | bit) } else { self }
    }

    /// Whether a bit is set.
    #[must_use]
    pub fn has(self, bit: u8) -> bool {
        self.0 & bit != 0
    }
}

/// The first message: the supervisor and the set-point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightPart {
    /// Number of the record; wraps.
    pub number: u8,
    /// Its time, us, on the vehicle's clock; wraps.
    pub time: u32,
    /// The phase.
    pub phase: Phase,
    /// What is true.
    pub facts: Facts,
    /// Active faults.
    pub faults: FaultSet,
    /// The number of the fault that ended the flight.
    pub ended_by: Option<u8>,
    /// Age of the newest applied pose, ms; 65535 for none.
    pub pose_age: u16,
    /// The answer to the newest order.
    pub answer: Answer,
    /// Position at which the flight began, or would begin now, m, world.
    pub start_w: Option<Vector3>,
    /// Position of the tool's set-point, m, world.
    pub setpoint_w: Vector3,
    /// Rotation of the tool's set-point.
    pub setpoint_we: Matrix3,
}

/// The second message: the estimated state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StatePart {
    /// Number of the record.
    pub number: u8,
    /// Pose and twist of the robot.
    pub state: RobotState,
}

/// The third message: the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolPart {
    /// Number of the record.
    pub number: u8,
    /// External wrench at the tool, world.
    pub wrench_w: Wrench,
    /// Position of its reference, m, world.
    pub position_w: Vector3,
    /// Rotation of its reference.
    pub rotation_we: Matrix3,
}

/// All three messages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordParts {
    /// The supervisor.
    pub flight: FlightPart,
    /// The state.
    pub state: StatePart,
    /// The tool.
    pub tool: ToolPart,
}

impl RecordParts {
    /// The messages of a record with this number, what is true of the flight beside it, the fault that ended it, and the
    /// answer to the newest order.
    #[must_use]
    pub fn new(number: u8, record: &Record, facts: Facts, ended_by: Option<u8>, answer: Answer) -> Self {
        let age = record.pose_age;
        let pose_age = if age.is_finite() { (1e3 * age.clamp(0.0, OLDEST)) as u16 } else { u16::MAX };
        let flight = FlightPart {
            number,
            time: micros(record.input.time),
            phase: record.phase,
            facts: facts
                .and_if(Facts::COMPLIANT, record.compliant)
                .and_if(Facts::SATURATED, record.saturated)
                .and_if(Facts::EXCURSION_LIMITED, record.excursion_limited),
            faults: record.faults,
            ended_by,
            pose_age,
            answer,
            start_w: record.start_w,
            setpoint_w: record.setpoint.position_w,
            setpoint_we: record.setpoint.rotation_we,
        };
        let reference = &record.reference;
        let tool = ToolPart {
            number,
            wrench_w: record.wrench_tool_w,
            position_w: reference.position_w,
            rotation_we: reference.rotation_we,
        };
        Self { flight, state: StatePart { number, state: record.state }, tool }
    }
}

/// The number that stands for no fault.
const NO_FAULT: u8 = u8::MAX;

impl FlightPart {
    pub(super) fn frame(&self) -> Frame {
        let start_w = self.start_w.unwrap_or_else(|| Vector3::repeat(f64::NAN));
        Writer::new(b'F')
            .bytes(&[self.number])
            .bytes(&self.time.to_be_bytes())
            .bytes(&[self.phase as u8, self.facts.0])
            .bytes(&self.faults.0.to_be_bytes())
            .bytes(&[self.ended_by.unwrap_or(NO_FAULT)])
            .bytes(&self.pose_age.to_be_bytes())
            .bytes(&self.answer.to_bytes())
            .floats(&start_w)
            .floats(&self.setpoint_w)
            .rotation(&self.setpoint_we)
            .finish()
    }

    pub(super) fn parse(body: &[u8]) -> Result<Self, Refusal> {
        let mut from = Reader::new(body)?;
        let wrong = from.out_of_range();
        let (number, time) = (from.u8()?, from.u32()?);
        let phase = Phase::ALL.get(usize::from(from.u8()?)).copied().ok_or(wrong)?;
        let (facts, faults) = (Facts(from.u8()?), from.u64()?);
        let ended_by = Some(from.u8()?).filter(|fault| *fault != NO_FAULT);
        let pose_age = from.u16()?;
        let answer = Answer::from_bytes(from.bytes()?).ok_or(wrong)?;
        let start: [[u8; 4]; 3] = [from.bytes()?, from.bytes()?, from.bytes()?];
        let start_w = Vector3::from(start.map(|x| f64::from(f32::from_be_bytes(x))));
        let known = start_w.iter().all(|x| (-FAR..=FAR).contains(x));
        if faults >> COUNT != 0
            || ended_by.is_some_and(|fault| usize::from(fault) >= COUNT)
            || !(known || start_w.iter().all(|x| x.is_nan()))
        {
            return Err(wrong);
        }
        let (faults, start_w) = (FaultSet(faults), known.then_some(start_w));
        let (setpoint_w, setpoint_we) = (from.vector(FAR)?, from.rotation()?);
        from.end(Self {
            number,
            time,
            phase,
            facts,
            faults,
            ended_by,
            pose_age,
            answer,
            start_w,
            setpoint_w,
            setpoint_we,
        })
    }
}

impl StatePart {
    pub(super) fn frame(&self) -> Frame {
        Writer::new(b'S')
            .bytes(&[self.number])
            .floats(&self.state.position_w)
            .rotation(&self.state.rotation_wr)
            .floats(&self.state.velocity_w)
            .floats(&self.state.angular_velocity_r)
            .finish()
    }

    pub(super) fn parse(body: &[u8]) -> Result<Self, Refusal> {
        let mut from = Reader::new(body)?;
        let number = from.u8()?;
        let state = RobotState {
            position_w: from.vector(FAR)?,
            rotation_wr: from.rotation()?,
            velocity_w: from.vector(FAST)?,
            angular_velocity_r: from.vector(FAST)?,
        };
        from.end(Self { number, state })
    }
}

impl ToolPart {
    pub(super) fn frame(&self) -> Frame {
        Writer::new(b'W')
            .bytes(&[self.number])
            .floats(&self.wrench_w.force)
            .floats(&self.wrench_w.torque)
            .floats(&self.position_w)
            .rotation(&self.rotation_we)
            .finish()
    }

    pub(super) fn parse(body: &[u8]) -> Result<Self, Refusal> {
        let mut from = Reader::new(body)?;
        let number = from.u8()?;
        let wrench_w = Wrench { force: from.vector(STRONG)?, torque: from.vector(STRONG)? };
        let (position_w, rotation_we) = (from.vector(FAR)?, from.rotation()?);
        from.end(Self { number, wrench_w, position_w, rotation_we })
    }
}
