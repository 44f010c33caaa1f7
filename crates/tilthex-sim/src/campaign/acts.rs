//! What a fault acts on.

use std::collections::VecDeque;

use tilthex_core::{flight::HostFacts, random::Random, types::PoseSample};
use tilthex_link::tk3::ImuFrame;

use super::Injection;
use crate::{Micros, Simulation};

/// What an act on the vehicle has.
pub(super) struct OnVehicle<'a> {
    pub(super) simulation: &'a mut Simulation,
    /// What its board says because of the act.
    pub(super) out: &'a mut Vec<u8>,
    pub(super) random: &'a mut Random,
}

/// One thing that a fault acts on, and how.
pub(super) enum Act {
    /// The vehicle: as the fault begins, in every period, as it ends.
    Vehicle {
        begin: fn(&Injection, &mut OnVehicle<'_>),
        during: fn(&Injection, &mut OnVehicle<'_>),
        end: fn(&Injection, &mut OnVehicle<'_>),
    },
    /// The bytes from the vehicle, once in each cycle of its board.
    Received(fn(&Injection, &mut Bytes<'_>)),
    /// The bytes to the vehicle, once in each tick.
    Sent(fn(&Injection, &mut Bytes<'_>)),
    /// A captured pose; none where it is lost.
    Pose(fn(&Injection, PoseSample, &mut Memory, &mut Random) -> Option<PoseSample>),
    /// What only the host sees; told each period whether the fault is on.
    Host(fn(&mut HostFacts, bool)),
    /// The disk of the log: it stands still.
    Disk,
    /// The program: it does not run for a while.
    Stopped,
    /// The program: it does not run for a while from the middle of a tick, between reading and writing.
    Stalled,
}

/// Bytes on the line that a fault may change.
pub(super) struct Bytes<'a> {
    pub(super) bytes: &'a mut Vec<u8>,
    /// What the fault holds back, with the time at which it goes on.
    pub(super) held: &'a mut Held,
    /// The first inertial sample that the fault met.
    pub(super) imu: &'a mut Option<ImuFrame>,
    pub(super) random: &'a mut Random,
    pub(super) now: Micros,
    pub(super) rotors: usize,
}

/// Bytes that are held back, with the time at which they go on.
pub(super) type Held = VecDeque<(Micros, Vec<u8>)>;

/// What a fault remembers while it lasts.
#[derive(Clone, Debug, Default)]
pub(super) struct Memory {
    /// The first pose it met.
    pub(super) pose: Option<PoseSample>,
    /// The first inertial sample it met.
    pub(super) imu: Option<ImuFrame>,
    /// Bytes from the vehicle that it holds back.
    pub(super) received: Held,
    /// Bytes to the vehicle that it holds back.
    pub(super) sent: Held,
}
