//! The ports of the server's host from which packets are accepted.

use crate::natnet::MessageId;

/// If no frame arrives for this time, s, frames may come from another port, because the server may have restarted.
const FORGOTTEN: f64 = 1.0;

/// The accepted senders. Answers are accepted from the command port only. NatNet does not specify from which port frames
/// come: servers use their command port, their data port, or another one. Frames are therefore accepted from one port: the
/// command port is preferred to the data port, and the data port to all others.
#[derive(Debug)]
pub(super) struct Sender {
    command: u16,
    /// The port from which frames come, and the time at which the last one arrived, s.
    frames: Option<(u16, f64)>,
    stranger: Option<u16>,
}

impl Sender {
    /// The state before the first frame, for a server with a known command port.
    pub(super) fn new(command: u16) -> Self {
        Self { command, frames: None, stranger: None }
    }

    /// Whether to accept a packet that came from `port` at the time `now` (s). `data_port` is the server's. `id` is `None`
    /// if it cannot be read.
    pub(super) fn admits(&mut self, port: u16, id: Option<MessageId>, data_port: u16, now: f64) -> bool {
        let rank = |port| [self.command, data_port].iter().position(|&known| known == port).unwrap_or(2);
        let admitted = match (id, self.frames) {
            (Some(MessageId::Frame), Some((known, last))) => {
                port == known || rank(port) < rank(known) || now - last > FORGOTTEN
            }
            (Some(MessageId::Frame), None) => true,
            _ => port == self.command,
        };
        if !admitted {
            self.stranger = Some(port);
        } else if id == Some(MessageId::Frame) {
            self.frames = Some((port, now));
        }
        admitted
    }

    /// The port of the last packet that was not admitted.
    pub(super) fn stranger(&self) -> Option<u16> {
        self.stranger
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COMMAND: u16 = 1510;
    const DATA: u16 = 1511;

    #[test]
    fn answers_come_from_the_command_port_only() {
        let mut sender = Sender::new(COMMAND);
        for id in [MessageId::ServerInfo, MessageId::ModelDef, MessageId::EchoResponse] {
            assert!(sender.admits(COMMAND, Some(id), DATA, 0.0));
            assert_eq!(sender.stranger(), None);
        }
        for id in [Some(MessageId::ServerInfo), Some(MessageId::EchoResponse), None] {
            assert!(!sender.admits(DATA, id, DATA, 0.0));
        }
        assert_eq!(sender.stranger(), Some(DATA));
    }

    #[test]
    fn frames_come_from_one_port_and_a_forger_never_displaces_a_known_one() {
        let frame = Some(MessageId::Frame);
        for (order, kept) in [
            ([COMMAND, 40_000, DATA], COMMAND),
            ([40_000, DATA, 40_001], DATA),
            ([40_000, 40_001, 40_002], 40_000),
        ] {
            let mut sender = Sender::new(COMMAND);
            for (i, &port) in order.iter().cycle().take(300).enumerate() {
                let admitted = sender.admits(port, frame, DATA, 0.01 * i as f64);
                assert!(i == 0 || admitted == (port == kept), "{order:?} {i}");
            }
            // After a silence, frames may come from another port.
            assert!(!sender.admits(50_000, frame, DATA, 3.5));
            assert!(sender.admits(50_000, frame, DATA, 4.5));
        }
    }
}
