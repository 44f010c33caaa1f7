//! What comes from the base.

use crate::board::Board;
use tilthex_core::{Error, PoseSample, flight::MAX_POSES, supervisor::Phase, types::Matrix3, types::Vector3};
use tilthex_link::{
    onboard::{Order, PoseMessage, RemoteClock, ToVehicle},
    tk3::{HostMessage, Receiver, Stream},
};

/// Largest number of bytes that a tick takes.
const MOST_BYTES: usize = 256;
/// Bytes that are read at once.
const CHUNK: usize = 64;
/// A tk3 message that is not carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refused {
    /// The base must not turn motors.
    Motors,
    /// `x` in flight. Messages of tk3 have no checksum, and no byte of a bad line may stop the motors in the air.
    Stop,
}

/// What a tick has received.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Received {
    poses: [PoseSample; MAX_POSES],
    pose_count: usize,
    /// An order and its number.
    pub(crate) order: Option<(u8, Order)>,
    pub(crate) land: bool,
    pub(crate) kill: bool,
    /// `x` before the start.
    pub(crate) stop: bool,
    /// The operator's silence in the newest heartbeat, s.
    pub(crate) heartbeat: Option<f64>,
    pub(crate) identify: bool,
    /// The newest period of each stream, us.
    pub(crate) rates: [Option<(Stream, u32)>; 4],
    /// The period of the records, us.
    pub(crate) records: Option<u32>,
    pub(crate) refused: Option<Refused>,
}

impl Received {
    fn nothing() -> Self {
        let no_pose = PoseSample {
            time: 0.0,
            arrival: 0.0,
            position_w: Vector3::zeros(),
            rotation_wr: Matrix3::identity(),
            tracking_valid: false,
        };
        Self {
            poses: [no_pose; MAX_POSES],
            pose_count: 0,
            order: None,
            land: false,
            kill: false,
            stop: false,
            heartbeat: None,
            identify: false,
            rates: [None; 4],
            records: None,
            refused: None,
        }
    }

    /// Whether something came that ends a flight. It wins against an order that came with it, in any sequence.
    pub(crate) fn ends(&self) -> bool {
        self.land || self.kill || self.stop
    }

    /// The poses that have arrived.
    pub(crate) fn poses(&self) -> &[PoseSample] {
        self.poses.get(..self.pose_count).unwrap_or(&[])
    }
}

/// The receiving end of the line.
#[derive(Clone, Debug)]
pub(crate) struct Inbox {
    receiver: Receiver<ToVehicle>,
    clock: RemoteClock,
    pose_number: Option<u8>,
}

impl Inbox {
    pub(crate) fn new() -> Result<Self, Error> {
        Ok(Self { receiver: Receiver::default(), clock: RemoteClock::new()?, pose_number: None })
    }

    /// Takes the bytes that have arrived, in a phase of the flight.
    pub(crate) fn read(&mut self, board: &mut impl Board, micros: u64, phase: Phase) -> Received {
        let mut received = Received::nothing();
        for _ in 0..MOST_BYTES / CHUNK {
            let mut bytes = [0; CHUNK];
            let count = board.read(&mut bytes);
            for byte in bytes.iter().take(count) {
                if let Some(message) = self.receiver.push(*byte) {
                    self.take(&message, micros, phase, &mut received);
                }
            }
            if count == 0 {
                break;
            }
        }
        received
    }

    fn take(&mut self, message: &ToVehicle, micros: u64, phase: Phase, received: &mut Received) {
        match message {
            ToVehicle::Pose(pose) => self.take_pose(pose, micros as f64 * 1e-6, received),
            ToVehicle::Order(_, Order::Land) => received.land = true,
            ToVehicle::Order(_, Order::Kill) => received.kill = true,
            // An order that finds no place is sent again, because it is not answered.
            ToVehicle::Order(number, order) => received.order = received.order.or(Some((*number, *order))),
            ToVehicle::Heartbeat(silence) => received.heartbeat = Some(1e-3 * f64::from(*silence)),
            ToVehicle::Records(period) => received.records = Some(*period),
            ToVehicle::Tk3(HostMessage::Identify) => received.identify = true,
            ToVehicle::Tk3(HostMessage::Rate { stream, period_us }) => {
                let free = received.rates.iter_mut().find(|slot| slot.is_none_or(|(s, _)| s == *stream));
                if let Some(slot) = free {
                    *slot = Some((*stream, *period_us));
                }
            }
            ToVehicle::Tk3(HostMessage::StopAll) => match phase {
                Phase::Disarmed => received.stop = true,
                Phase::Starting | Phase::Grounded => received.kill = true,
                Phase::Flying | Phase::Holding | Phase::Landing | Phase::Emergency => {
                    received.refused = Some(Refused::Stop);
                }
            },
            ToVehicle::Tk3(
                HostMessage::Start(_)
                | HostMessage::Stop(_)
                | HostMessage::Speeds(_)
                | HostMessage::Throttles(_),
            ) => received.refused = Some(Refused::Motors),
            ToVehicle::Tk3(HostMessage::Beep(_)) => {}
        }
    }

    fn take_pose(&mut self, pose: &PoseMessage, arrival: f64, received: &mut Received) {
        if self.pose_number.replace(pose.number) == Some(pose.number) {
            return;
        }
        let sent = self.clock.sent(pose.sent, arrival);
        if let Some(slot) = received.poses.get_mut(received.pose_count) {
            *slot = PoseSample {
                time: sent - 1e-6 * f64::from(pose.age),
                arrival,
                position_w: pose.position_w,
                rotation_wr: pose.rotation_wr,
                tracking_valid: pose.tracking_valid,
            };
            received.pose_count += 1;
        }
    }
}
