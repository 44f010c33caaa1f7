//! The sockets of a NatNet client.

use std::{
    io,
    net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV4, UdpSocket},
};

use rustix::{
    event::{PollFd, PollFlags, poll},
    time::Timespec,
};
use socket2::{Domain, Socket, Type};

use super::source::PAUSE;
use tilthex_core::types::Nanos;

/// The sockets to one server.
pub(super) struct Line {
    server: SocketAddr,
    /// Socket for commands, their answers, and unicast frames.
    command: UdpSocket,
    /// Socket for multicast frames.
    group: Option<UdpSocket>,
}

impl Line {
    pub(super) fn open(server: SocketAddr) -> io::Result<Self> {
        let any: IpAddr = match server {
            SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
            SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
        };
        let command = UdpSocket::bind((any, 0))?;
        command.set_nonblocking(true)?;
        Ok(Self { server, command, group: None })
    }

    /// Joins a multicast group on its port. Other clients on this computer can use the same port.
    pub(super) fn join(&mut self, group: [u8; 4], port: u16) -> io::Result<()> {
        // Finds the network interface that leads to the server.
        let probe = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        probe.connect(self.server)?;
        let interface = match probe.local_addr()?.ip() {
            IpAddr::V4(address) => address,
            IpAddr::V6(_) => Ipv4Addr::UNSPECIFIED,
        };
        let socket = Socket::new(Domain::IPV4, Type::DGRAM, None)?;
        socket.set_reuse_address(true)?;
        let group = Ipv4Addr::from(group);
        socket.bind(&SocketAddrV4::new(group, port).into())?;
        socket.join_multicast_v4(&group, &interface)?;
        socket.set_nonblocking(true)?;
        self.group = Some(socket.into());
        Ok(())
    }

    pub(super) fn has_group(&self) -> bool {
        self.group.is_some()
    }

    /// Sends a packet to the server.
    pub(super) fn say(&self, write: impl FnOnce(&mut [u8]) -> usize) {
        let mut packet = [0; 512];
        let length = write(&mut packet);
        // If the packet cannot be sent, no answer arrives, and the client asks again.
        let _ = self.command.send_to(&packet[..length], self.server);
    }

    /// Waits for a packet, for `left` ns at most.
    pub(super) fn wait(&self, left: Nanos) {
        let timeout = Timespec { tv_sec: (left / 1_000_000_000) as _, tv_nsec: (left % 1_000_000_000) as _ };
        let command = PollFd::new(&self.command, PollFlags::IN);
        let _ = match &self.group {
            Some(group) => poll(&mut [command, PollFd::new(group, PollFlags::IN)], Some(&timeout)),
            None => poll(&mut [command], Some(&timeout)),
        };
    }

    /// The next packet from the server's host, from one of the two sockets: its length, and the port that sent it.
    pub(super) fn read(&self, buffer: &mut [u8]) -> Option<(usize, u16)> {
        [Some(&self.command), self.group.as_ref()].into_iter().flatten().find_map(|socket| {
            loop {
                match socket.recv_from(buffer) {
                    Ok((length, from)) if from.ip() == self.server.ip() => {
                        return Some((length, from.port()));
                    }
                    // Packets from other hosts are ignored.
                    Ok(_) => std::thread::sleep(PAUSE),
                    Err(_) => return None,
                }
            }
        })
    }
}
