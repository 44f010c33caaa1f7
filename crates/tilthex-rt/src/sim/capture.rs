//! Motion capture of the simulated vehicle: servers send its pose to the same clients as real systems.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4, ToSocketAddrs};

use tilthex_link::board::Board;
use tilthex_mocap::{
    UpAxis,
    net::{
        LineParams, MocapUri, NatNetServer, NatNetServerParams, Protocol, Publication, VrpnServer,
        VrpnServerParams,
    },
};
use tilthex_sim::{Body, STEP, Simulation};

use crate::{Failure, sleeper::Nanos};

/// Poses per second.
pub const CAPTURE_RATE: u64 = 100;
/// Cycles of the simulation between two poses.
pub const CAPTURE_EVERY: u64 = 1_000_000 / STEP / CAPTURE_RATE;
/// The default multicast address of NatNet frames.
const GROUP: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(239, 255, 42, 99), 1511);

/// A running capture system.
#[derive(Debug)]
pub enum Capture {
    /// NatNet, the protocol of OptiTrack.
    NatNet(NatNetServer),
    /// VRPN over TCP.
    Vrpn(VrpnServer),
}

impl Capture {
    /// Starts the server that a URI names, on this computer.
    ///
    /// # Errors
    /// One sentence: the address does not belong to this computer, or is in use.
    pub fn start(uri: &MocapUri, up_axis: UpAxis, line: LineParams) -> Result<Self, Failure> {
        let refuse = |e: std::io::Error| {
            Failure::usage(format!(
                "no motion capture server can run at {}:{}: {e}; name an address of this computer and a free port",
                uri.host, uri.port
            ))
        };
        let found = (uri.host.as_str(), uri.port).to_socket_addrs().map_err(refuse)?.find_map(|a| match a {
            SocketAddr::V4(address) => Some(address),
            SocketAddr::V6(_) => None,
        });
        let address = found.ok_or_else(|| refuse(std::io::ErrorKind::AddrNotAvailable.into()))?;
        let server = match uri.protocol {
            Protocol::NatNet | Protocol::NatNetMulticast => {
                let multicast = (uri.protocol == Protocol::NatNetMulticast).then_some(GROUP);
                let params = NatNetServerParams::new(&uri.body);
                NatNetServer::start(NatNetServerParams { address, multicast, up_axis, line, ..params })
                    .map(Self::NatNet)
            }
            Protocol::Udp => {
                return Err(Failure::usage(format!(
                    "the simulated vehicle serves natnet://, natnet+multicast:// and vrpn://; found {uri}"
                )));
            }
            Protocol::Vrpn => {
                let params = VrpnServerParams::new(&uri.body);
                let sensor = uri.sensor.unwrap_or(params.sensor);
                VrpnServer::start(VrpnServerParams { address, sensor, up_axis, line, ..params })
                    .map(Self::Vrpn)
            }
        };
        server.map_err(refuse)
    }

    /// A capture system on loopback at any free port, and its address for clients.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn on_loopback(up_axis: UpAxis, line: LineParams) -> Result<(Self, MocapUri), Failure> {
        let host = IpAddr::from(Ipv4Addr::LOCALHOST).to_string();
        let body = "TILTHEX".into();
        let mut uri = MocapUri { protocol: Protocol::NatNet, host, port: 0, body, sensor: None };
        let capture = Self::start(&uri, up_axis, line)?;
        uri.port = capture.address().port();
        Ok((capture, uri))
    }

    /// The address at which it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        match self {
            Self::NatNet(server) => server.address(),
            Self::Vrpn(server) => server.address(),
        }
    }

    /// Publishes the pose of the vehicle at a time of the monotonic clock.
    pub fn show<B: Body, F: Board>(&mut self, time: Nanos, simulation: &mut Simulation<B, F>) {
        let (position_w, rotation_wr) = simulation.captured_pose();
        let publication = Publication { time, position_w, rotation_wr, tracking_valid: true };
        // If there is no room for a pose, it is lost, like one that the network loses.
        let _ = match self {
            Self::NatNet(server) => server.publish(publication),
            Self::Vrpn(server) => server.publish(publication),
        };
    }
}
