//! What a fault changes: the vehicle, the line, the poses, the host.

use std::collections::VecDeque;

use tilthex_core::{flight::HostFacts, random::Random, types::PoseSample};
use tilthex_link::tk3::ImuFrame;

use super::Injection;
use crate::{Micros, Simulation};

/// The parts of the world that a fault of the vehicle can change.
pub(super) struct OnVehicle<'a> {
    pub(super) simulation: &'a mut Simulation,
    /// The bytes that the board sends because of the fault.
    pub(super) out: &'a mut Vec<u8>,
    pub(super) random: &'a mut Random,
}

/// One thing that a fault changes, and the function that changes it.
pub(super) enum Act {
    /// The vehicle. Called when the fault begins, in every period, and when it ends.
    Vehicle {
        begin: fn(&Injection, &mut OnVehicle<'_>),
        during: fn(&Injection, &mut OnVehicle<'_>),
        end: fn(&Injection, &mut OnVehicle<'_>),
    },
    /// The bytes from the vehicle, once in each cycle of its board.
    Received(fn(&Injection, &mut Bytes<'_>)),
    /// The bytes to the vehicle, once in each tick.
    Sent(fn(&Injection, &mut Bytes<'_>)),
    /// A captured pose; returns `None` if it is lost.
    Pose(fn(&Injection, PoseSample, &mut Memory, &mut Random) -> Option<PoseSample>),
    /// A fact that only the host observes; called in each period with whether the fault is active.
    Host(fn(&mut HostFacts, bool)),
    /// The disk of the log: it stands still.
    Disk,
    /// The program does not run for some time.
    Stopped,
    /// The program does not run for some time, from the middle of a tick: after it read and before it writes.
    Stalled,
}

/// Bytes on the line that a fault may change.
pub(super) struct Bytes<'a> {
    pub(super) bytes: &'a mut Vec<u8>,
    /// Bytes that the fault holds back, each with the time at which they continue.
    pub(super) held: &'a mut Held,
    /// The first inertial sample while the fault was active.
    pub(super) imu: &'a mut Option<ImuFrame>,
    pub(super) random: &'a mut Random,
    pub(super) now: Micros,
    pub(super) rotors: usize,
}

/// Bytes that are held back, each with the time at which they continue.
pub(super) type Held = VecDeque<(Micros, Vec<u8>)>;

/// What a fault remembers while it is active.
#[derive(Clone, Debug, Default)]
pub(super) struct Memory {
    /// The first pose while it was active.
    pub(super) pose: Option<PoseSample>,
    /// The first inertial sample while it was active.
    pub(super) imu: Option<ImuFrame>,
    /// Bytes from the vehicle that it holds back.
    pub(super) received: Held,
    /// Bytes to the vehicle that it holds back.
    pub(super) sent: Held,
}
