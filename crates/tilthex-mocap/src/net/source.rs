//! What every source of poses does, and the list of those that there are.

use std::{net::SocketAddr, sync::atomic::AtomicBool};

use super::{SourceError, client::Sink, natnet_client, udp_client, uri::MocapUri, vrpn_client};
use crate::{natnet, udp, vrpn};

/// A system that tells where the vehicle is. It runs in a thread of its own and may wait there.
pub(super) trait PoseSource: Send {
    /// Finds the system and the body that an address names, and waits for the body's first pose.
    ///
    /// # Errors
    /// One sentence: nobody there, somebody else there, no such body (with those that are there), no poses.
    fn connect(uri: &MocapUri, server: SocketAddr, sink: Sink) -> Result<Self, SourceError>
    where
        Self: Sized;

    /// Hands poses to the sink until told to stop. What is lost is found again by itself.
    fn run(self: Box<Self>, stop: &AtomicBool);
}

/// Declares the sources: name, scheme of its addresses, port where none is named, type.
macro_rules! sources {
    ($( $(#[doc = $doc:literal])* $name:ident => $scheme:literal, $port:expr, $source:ty; )*) => {
        /// How a source of poses speaks.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Protocol {
            $( $(#[doc = $doc])* $name, )*
        }

        impl Protocol {
            /// Every protocol.
            pub const ALL: &[Self] = &[$( Self::$name ),*];

            /// What stands before `://` in an address.
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

            /// Connects by this protocol.
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
    /// NatNet, frames sent to this host.
    NatNet => "natnet", natnet::COMMAND_PORT, natnet_client::Session;
    /// NatNet, frames sent to a group.
    NatNetMulticast => "natnet+multicast", natnet::COMMAND_PORT, natnet_client::Session;
    /// VRPN over TCP.
    Vrpn => "vrpn", vrpn::PORT, vrpn_client::Session;
    /// Packets of our own over UDP, for anything else.
    Udp => "udp", udp::PORT, udp_client::Session;
}
