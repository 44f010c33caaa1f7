//! The interface of every pose source, and the list of all sources.

use std::{net::SocketAddr, sync::atomic::AtomicBool, time::Duration};

use super::{SourceError, client::Sink, natnet_client, udp_client, uri::MocapUri, vrpn_client};
use crate::{natnet, udp, vrpn};

/// Pause after each packet. A client's thread may have real-time rights, and a flood of packets must not take a processor from
/// the loop.
pub(super) const PAUSE: Duration = Duration::from_micros(30);

/// A source of poses of the vehicle. It runs in its own thread and may wait there.
pub(super) trait PoseSource: Send {
    /// Finds the server and the body that an address names, and waits for the body's first pose.
    ///
    /// # Errors
    /// One sentence: no server or another server answers, the body is unknown (with the names of the bodies that the
    /// server has), or no poses arrive.
    fn connect(uri: &MocapUri, server: SocketAddr, sink: Sink) -> Result<Self, SourceError>
    where
        Self: Sized;

    /// Passes poses to the sink until `stop` is true. If the connection is lost, it connects again.
    fn run(self: Box<Self>, stop: &AtomicBool);
}

/// Declares the sources: name, scheme of its addresses, default port, type.
macro_rules! sources {
    ($( $(#[doc = $doc:literal])* $name:ident => $scheme:literal, $port:expr, $source:ty; )*) => {
        /// The protocol of a pose source.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Protocol {
            $( $(#[doc = $doc])* $name, )*
        }

        impl Protocol {
            /// Every protocol.
            pub const ALL: &[Self] = &[$( Self::$name ),*];

            /// The part of an address before `://`.
            #[must_use]
            pub fn scheme(self) -> &'static str {
                match self {
                    $( Self::$name => $scheme, )*
                }
            }

            pub(super) fn default_port(self) -> u16 {
                match self {
                    $( Self::$name => $port, )*
                }
            }

            /// Connects with this protocol.
            pub(super) fn connect(
                self, uri: &MocapUri, server: SocketAddr, sink: Sink,
            ) -> Result<Box<dyn PoseSource>, SourceError> {
                Ok(match self {
                    $( Self::$name => Box::new(<$source>::connect(uri, server, sink)?), )*
                })
            }
        }
    };
}

sources! {
    /// NatNet with unicast frames.
    NatNet => "natnet", natnet::COMMAND_PORT, natnet_client::Session;
    /// NatNet with multicast frames.
    NatNetMulticast => "natnet+multicast", natnet::COMMAND_PORT, natnet_client::Session;
    /// VRPN over TCP.
    Vrpn => "vrpn", vrpn::PORT, vrpn_client::Session;
    /// The UDP packets of tilthex, for any other source.
    Udp => "udp", udp::PORT, udp_client::Session;
}
