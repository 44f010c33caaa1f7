//! How a session handles the packets of its server.

use tilthex_core::clock_sync::ClockEvent;

use super::{Session, add, now, seconds};
use crate::{
    Malformed,
    natnet::{
        Frame, MessageId, ModelDef, ServerInfo, Version, announced_version, parse_echo_response, write_bare,
    },
};

/// Number of names that are kept for a message.
const MAX_NAMES: usize = 64;

/// The id of the body with the wanted name, or the names of the other bodies if there is none.
pub(super) enum Found {
    Body(i32),
    Others(Vec<Vec<u8>>),
}

/// What a frame holds.
pub(super) enum Taken {
    /// It holds the body.
    Body,
    /// It holds not the body, but this number of others.
    Others(usize),
    /// It has an unknown layout.
    Unreadable(Malformed),
}

/// The result of an introduction.
pub(super) enum Introduction {
    /// A server, and the multicast group to which it sends frames, if it uses one.
    Server(Option<[u8; 4]>),
    /// A version that this client cannot read.
    Version(Version),
}

impl Session {
    pub(super) fn take_info(&mut self, payload: &[u8]) -> Option<Introduction> {
        if let Some(version) = announced_version(payload).filter(|version| !version.is_known()) {
            return Some(Introduction::Version(version));
        }
        let Ok(info) = ServerInfo::parse(payload) else {
            add(&self.sink.counters.refused, 1);
            return None;
        };
        self.version = info.version;
        self.frequency = info.clock_frequency as f64;
        self.data_port = info.data_port;
        Some(Introduction::Server(info.multicast))
    }

    pub(super) fn take_models(&mut self, payload: &[u8]) -> Option<Found> {
        let mut names = Vec::new();
        let Ok(models) = ModelDef::new_either(payload, self.version) else {
            add(&self.sink.counters.refused, 1);
            return None;
        };
        for body in models.flatten() {
            if body.name == self.uri.body.as_bytes() {
                return Some(Found::Body(body.id));
            }
            if names.len() < MAX_NAMES {
                names.push(body.name.to_vec());
            }
        }
        Some(Found::Others(names))
    }

    pub(super) fn take_echo(&mut self, payload: &[u8]) {
        let Ok((asked, server)) = parse_echo_response(payload) else {
            add(&self.sink.counters.refused, 1);
            return;
        };
        if self.echo.step(seconds(asked), server as f64 / self.frequency, now()) {
            add(&self.sink.counters.clock_resets, 1);
        }
    }

    /// Passes the body's pose to the sink, if the frame holds it.
    pub(super) fn take_frame(&mut self, payload: &[u8]) -> Taken {
        let arrival = now();
        let (frame, version) = match Frame::parse_either(payload, self.version) {
            Ok(read) => read,
            Err(what) => {
                add(&self.sink.counters.refused, 1);
                return Taken::Unreadable(what);
            }
        };
        self.version = version;
        let Some(body) = frame.body(self.body) else { return Taken::Others(frame.bodies().count()) };
        if frame.models_changed {
            self.line.say(|out| write_bare(out, MessageId::RequestModelDef));
        }
        if !self.count(frame.number) {
            return Taken::Body;
        }
        let exposed = (frame.times.mid_exposure != 0)
            .then(|| self.echo.to_ours(frame.times.mid_exposure as f64 / self.frequency, arrival))
            .flatten();
        let time = exposed.map_or_else(
            || {
                let stamp = self.passive.step(frame.times.timestamp, arrival);
                add(&self.sink.counters.clock_resets, (stamp.event == ClockEvent::Reset).into());
                stamp.time - self.sink.params.latency
            },
            |(time, _)| time,
        );
        let position = body.position.map(f64::from);
        let quaternion = body.quaternion_xyzw.map(f64::from);
        self.sink.pose((time, arrival), position, quaternion, body.tracking_valid);
        Taken::Body
    }

    /// Counts the frames that were lost before this one. Returns false if a newer frame has already arrived.
    fn count(&mut self, number: i32) -> bool {
        let ahead = self.newest.map_or(1, |newest| number.wrapping_sub(newest));
        if ahead > 0 {
            // A long jump means that the server has restarted.
            add(&self.sink.counters.lost, if ahead < 1000 { ahead.unsigned_abs() - 1 } else { 0 });
        }
        if !(-1000..=0).contains(&ahead) {
            self.newest = Some(number);
        }
        ahead != 0
    }
}
