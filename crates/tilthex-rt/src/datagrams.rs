//! Datagrams instead of a serial line. Each is one message of DDS-XRCE. The link gets the messages framed as on a serial line,
//! so that the link, the log and a replay need only one form.

use std::{
    io::{self, ErrorKind},
    net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket},
    os::fd::{AsFd, BorrowedFd},
    time::{Duration, Instant},
};

use tilthex_link::px4::{AGENT, CLIENT, Decoder, MAX_MESSAGE, encode};

use crate::port::Written;

/// If the peer is silent for this time, another sender can become the peer.
const SILENT: Duration = Duration::from_secs(1);
/// Largest number of datagrams that one read drops: a flood from other senders must not delay the loop.
const DROPPED: usize = 64;
/// Largest length of a framed message, bytes.
const LONGEST: usize = 2 * MAX_MESSAGE + 13;

/// One end of a conversation in datagrams.
#[derive(Debug)]
pub(crate) struct Datagrams {
    socket: UdpSocket,
    /// The address of the other end, and the time at which its newest datagram arrived. The client knows the address from the
    /// start.
    peer: Option<(SocketAddr, Instant)>,
    /// Whether this is the agent. The agent's peer is the first sender.
    agent: bool,
    /// Finds the messages in the bytes to send.
    sent: Decoder,
    /// The newest message as a frame, and the part of it that has not been read.
    frame: [u8; LONGEST],
    left: std::ops::Range<usize>,
}

impl Datagrams {
    /// The agent's end, which listens at an address.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub(crate) fn listen(address: SocketAddr) -> io::Result<Self> {
        Self::new(UdpSocket::bind(address)?, None)
    }

    /// The client's end of a conversation with the agent at an address.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub(crate) fn to(agent: SocketAddr) -> io::Result<Self> {
        let any: IpAddr =
            if agent.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
        Self::new(UdpSocket::bind((any, 0))?, Some(agent))
    }

    fn new(socket: UdpSocket, agent: Option<SocketAddr>) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket,
            agent: agent.is_none(),
            sent: Decoder::new(if agent.is_none() { CLIENT } else { AGENT }),
            peer: agent.map(|agent| (agent, Instant::now())),
            frame: [0; LONGEST],
            left: 0..0,
        })
    }

    /// The address at which it listens.
    ///
    /// # Errors
    /// Errors of the kernel.
    #[cfg(test)]
    pub(crate) fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Reads the bytes that have arrived, framed, at most as many as `buffer` holds. Never waits; safe in the loop.
    pub(crate) fn read(&mut self, buffer: &mut [u8]) -> usize {
        let mut count = 0;
        while count < buffer.len() {
            if self.left.is_empty() && !self.receive() {
                break;
            }
            let from = self.frame.get(self.left.clone()).unwrap_or(&[]);
            let to = buffer.get_mut(count..).unwrap_or(&mut []);
            let passed = from.len().min(to.len());
            to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
            self.left.start += passed;
            count += passed;
        }
        count
    }

    /// Takes the next datagram of the peer. Returns whether one has arrived. A datagram that is longer than a message is
    /// dropped.
    fn receive(&mut self) -> bool {
        // With one byte more than the longest message, a datagram that is too long is noticed.
        let mut bytes = [0; MAX_MESSAGE + 1];
        for _ in 0..DROPPED {
            let (length, sender) = match self.socket.recv_from(&mut bytes) {
                Ok(found) => found,
                // No program listens at the address of the last datagram. This is not an error: the next one is sent.
                Err(e) if e.kind() == ErrorKind::ConnectionRefused => continue,
                Err(_) => return false,
            };
            if length > MAX_MESSAGE {
                continue;
            }
            let now = Instant::now();
            let known = self.peer.is_none_or(|(peer, heard)| {
                peer == sender || self.agent && now.saturating_duration_since(heard) > SILENT
            });
            if !known {
                continue;
            }
            self.peer = Some((sender, now));
            let (source, destination) = if self.agent { (CLIENT, AGENT) } else { (AGENT, CLIENT) };
            let message = bytes.get(..length).unwrap_or(&[]);
            self.left = 0..encode(source, destination, message, &mut self.frame);
            return true;
        }
        false
    }

    /// Sends each message in `bytes` as a datagram. Never waits; safe in the loop.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> Written {
        let Some((peer, _)) = self.peer else { return Written::Whole };
        let mut written = Written::Whole;
        for byte in bytes {
            let Some(message) = self.sent.push(*byte) else { continue };
            match self.socket.send_to(message, peer) {
                Ok(_) => {}
                Err(e) if e.kind() == ErrorKind::ConnectionRefused => {}
                Err(_) => written = Written::Short,
            }
        }
        written
    }
}

impl AsFd for Datagrams {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read_all(line: &mut Datagrams, want: usize, step: usize) -> Vec<u8> {
        let mut got = Vec::new();
        let mut buffer = vec![0; step];
        while got.len() < want {
            let count = line.read(&mut buffer);
            got.extend_from_slice(&buffer[..count]);
        }
        got
    }

    fn framed(source: u8, destination: u8, messages: &[Vec<u8>]) -> Vec<u8> {
        let mut out = vec![0; LONGEST];
        let frame = |message: &Vec<u8>| {
            let length = encode(source, destination, message, &mut out);
            out[..length].to_vec()
        };
        messages.iter().flat_map(frame).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn both_ends_read_the_frames_that_were_written(
            messages in prop::collection::vec(prop::collection::vec(any::<u8>(), 1..200), 1..4), step in 1..600_usize,
        ) {
            let mut agent = Datagrams::listen((Ipv4Addr::LOCALHOST, 0).into()).expect("bound");
            let mut client = Datagrams::to(agent.address().expect("known")).expect("bound");
            let up = framed(CLIENT, AGENT, &messages);
            prop_assert_eq!(client.write(&up), Written::Whole);
            prop_assert_eq!(read_all(&mut agent, up.len(), step), up);
            let down = framed(AGENT, CLIENT, &messages);
            prop_assert_eq!(agent.write(&down), Written::Whole);
            prop_assert_eq!(read_all(&mut client, down.len(), step), down);
        }
    }

    #[test]
    fn addresses_of_version_6_work_where_the_computer_has_them() {
        let Ok(mut agent) = Datagrams::listen((Ipv6Addr::LOCALHOST, 0).into()) else { return };
        let mut client = Datagrams::to(agent.address().expect("known")).expect("bound");
        let frame = framed(CLIENT, AGENT, &[b"client".to_vec()]);
        assert_eq!(client.write(&frame), Written::Whole);
        assert_eq!(read_all(&mut agent, frame.len(), 64), frame);
    }

    #[test]
    fn a_datagram_that_is_too_long_is_dropped_whole() {
        let mut agent = Datagrams::listen((Ipv4Addr::LOCALHOST, 0).into()).expect("bound");
        let client = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("bound");
        let address = agent.address().expect("known");
        client.send_to(&[1; MAX_MESSAGE + 1], address).expect("sent");
        client.send_to(b"next", address).expect("sent");
        let frame = framed(CLIENT, AGENT, &[b"next".to_vec()]);
        assert_eq!(read_all(&mut agent, frame.len(), LONGEST), frame);
    }

    #[test]
    fn a_stranger_does_not_take_the_place_of_the_peer() {
        let mut agent = Datagrams::listen((Ipv4Addr::LOCALHOST, 0).into()).expect("bound");
        let address = agent.address().expect("known");
        let mut client = Datagrams::to(address).expect("bound");
        let mut stranger = Datagrams::to(address).expect("bound");
        let of_client = framed(CLIENT, AGENT, &[b"client".to_vec()]);
        client.write(&of_client);
        assert_eq!(read_all(&mut agent, of_client.len(), 64), of_client);
        stranger.write(&framed(CLIENT, AGENT, &[b"stranger".to_vec()]));
        client.write(&of_client);
        assert_eq!(read_all(&mut agent, of_client.len(), 64), of_client);
        agent.write(&framed(AGENT, CLIENT, &[b"hello".to_vec()]));
        assert_eq!(read_all(&mut client, 12, 64), framed(AGENT, CLIENT, &[b"hello".to_vec()]));
        assert_eq!(stranger.read(&mut [0; 64]), 0);
    }
}
