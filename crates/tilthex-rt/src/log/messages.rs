//! The messages that are read: the declared ones that a replay needs, and well-known ones for viewers.

use prost::Message;
use tilthex_core::{Matrix3, PoseSample, flight::HostFacts};

/// Well-known messages, from `proto/`.
#[allow(missing_docs, unreachable_pub, clippy::all)]
pub(super) mod foxglove {
    include!(concat!(env!("OUT_DIR"), "/foxglove.rs"));
}

/// The serialised `FileDescriptorSet` of the well-known messages.
pub(super) const FOXGLOVE: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.bin"));

/// The message of `/input`.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct Input {
    #[prost(uint64, tag = "1")]
    pub(crate) tick: u64,
    #[prost(double, tag = "2")]
    pub(crate) time: f64,
    #[prost(bytes = "vec", tag = "3")]
    pub(crate) link: Vec<u8>,
    #[prost(message, repeated, tag = "4")]
    poses: Vec<Pose>,
    #[prost(bool, tag = "5")]
    pub(crate) command: bool,
    #[prost(bool, tag = "6")]
    land: bool,
    #[prost(bool, tag = "7")]
    link_lost: bool,
    #[prost(bool, tag = "8")]
    log_lost: bool,
    #[prost(bool, tag = "9")]
    kill: bool,
    #[prost(bool, tag = "10")]
    operator_silent: bool,
}

impl Input {
    /// The poses, bit for bit; `None` if one is incomplete.
    pub(crate) fn poses(&self) -> Option<Vec<PoseSample>> {
        self.poses.iter().map(Pose::sample).collect()
    }

    /// The facts that only the host could observe.
    pub(crate) fn host(&self) -> HostFacts {
        HostFacts {
            land: self.land,
            kill: self.kill,
            operator_silent: self.operator_silent,
            link_lost: self.link_lost,
            log_lost: self.log_lost,
        }
    }
}

#[derive(Clone, PartialEq, Message)]
struct Pose {
    #[prost(double, tag = "1")]
    time: f64,
    #[prost(double, tag = "2")]
    arrival: f64,
    #[prost(message, optional, tag = "3")]
    position_w: Option<Vector3>,
    #[prost(double, repeated, tag = "4")]
    rotation: Vec<f64>,
    #[prost(bool, tag = "5")]
    tracking_valid: bool,
}

impl Pose {
    fn sample(&self) -> Option<PoseSample> {
        let position = self.position_w.as_ref()?;
        Some(PoseSample {
            time: self.time,
            arrival: self.arrival,
            position_w: tilthex_core::Vector3::new(position.x, position.y, position.z),
            rotation_wr: Matrix3::from_row_iterator(<[f64; 9]>::try_from(self.rotation.as_slice()).ok()?),
            tracking_valid: self.tracking_valid,
        })
    }
}

#[derive(Clone, PartialEq, Message)]
struct Vector3 {
    #[prost(double, tag = "1")]
    x: f64,
    #[prost(double, tag = "2")]
    y: f64,
    #[prost(double, tag = "3")]
    z: f64,
}

/// The message of `/command`.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct Command {
    #[prost(string, tag = "1")]
    pub(crate) json: String,
    #[prost(bool, tag = "2")]
    pub(crate) urgent: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::values::{COMMAND, Order, REPLAYED};
    use tilthex_core::{Vector3, flight::MAX_POSES, so3};
    use tilthex_sim::feed::Tick;

    /// The structs above read what the tables write.
    #[test]
    fn an_input_is_read_as_it_was_written() {
        let mut tick = Tick::default();
        tick.record.tick = 7;
        let input = &mut tick.record.input;
        (input.time, input.command, input.pose_count) = (1.5, true, MAX_POSES as u8);
        for (k, pose) in input.poses.iter_mut().enumerate() {
            let x = k as f64 + 0.1;
            (pose.time, pose.arrival, pose.tracking_valid) = (x, 2.0 * x, k % 2 == 0);
            (pose.position_w, pose.rotation_wr) = (Vector3::new(x, -x, 0.0), so3::rot_x(x) * so3::rot_z(-x));
        }
        tick.wire.begin(b"^I..$");
        for set in [
            (|h| &mut h.land) as fn(&mut HostFacts) -> &mut bool,
            |h| &mut h.kill,
            |h| &mut h.operator_silent,
            |h| &mut h.link_lost,
            |h| &mut h.log_lost,
        ] {
            let mut host = HostFacts::default();
            *set(&mut host) = true;
            tick.record.input.host = host;
            let channel = REPLAYED.iter().find(|c| c.topic == "/input").expect("declared");
            let mut bytes = Vec::new();
            channel.encode(&tick, 6, &mut bytes);
            let read = Input::decode(&*bytes).expect("decodes");
            assert_eq!((read.tick, read.time, read.command), (7, 1.5, true));
            assert_eq!(read.link, b"^I..$");
            assert_eq!(read.poses().expect("whole"), tick.record.input.poses());
            assert_eq!(format!("{:?}", read.host()), format!("{host:?}"));
            assert_eq!(read.encode_to_vec(), bytes, "nothing that is written is left unread");
        }
        let order = Order { json: "{}".into(), urgent: true };
        let mut bytes = Vec::new();
        COMMAND.encode(&order, 0, &mut bytes);
        assert_eq!(Command::decode(&*bytes), Ok(Command { json: "{}".into(), urgent: true }));
    }
}
