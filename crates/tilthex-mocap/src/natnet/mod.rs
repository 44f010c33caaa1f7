//! NatNet 3.0 to 4.2, the protocol of OptiTrack Motive, client and server. A datagram holds one packet: message id, payload
//! length, payload; little-endian.

mod frame;
mod model;
mod server;

pub use frame::{Frame, FrameTimes, RigidBody, write_frame};
pub use model::{BodyName, ModelDef, write_model_def};
pub use server::{ServerInfo, announced_version, write_server_info};

use super::{
    Malformed,
    bytes::{Reader, Writer},
};

/// The server's port for commands.
pub const COMMAND_PORT: u16 = 1510;
/// The port for multicast frames.
pub const DATA_PORT: u16 = 1511;
/// The default multicast group for frames.
pub const MULTICAST_GROUP: [u8; 4] = [239, 255, 42, 99];
/// Longest datagram that this library sends, bytes. It also reads longer ones.
pub const MAX_PACKET: usize = 1400;

/// A version of the bit stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// Major.
    pub major: u8,
    /// Minor.
    pub minor: u8,
}

impl Version {
    /// Sections do not announce their sizes.
    pub const V3_0: Self = Self { major: 3, minor: 0 };
    /// From this version on, descriptions of rigid bodies hold the names of markers.
    pub const V4_0: Self = Self { major: 4, minor: 0 };
    /// From this version on, sections and descriptions announce their sizes.
    pub const V4_1: Self = Self { major: 4, minor: 1 };
    /// From this version on, descriptions of rigid bodies hold a rotation.
    pub const V4_2: Self = Self { major: 4, minor: 2 };

    /// Whether this module can try to read it: it knows the layouts of this version, or of an earlier minor version.
    #[must_use]
    pub fn is_known(self) -> bool {
        self >= Self::V3_0 && self.major <= 4
    }

    fn has_sizes(self) -> bool {
        self >= Self::V4_1
    }
}

/// The kind of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MessageId {
    /// Client: asks for the server's introduction.
    Connect,
    /// Server: its introduction.
    ServerInfo,
    /// Client: a command in text.
    Request,
    /// Server: the answer to a command.
    Response,
    /// Client: asks for the captured models.
    RequestModelDef,
    /// Server: the captured models.
    ModelDef,
    /// Server: one frame of data.
    Frame,
    /// Server: a text.
    Text,
    /// Client: leaves.
    Disconnect,
    /// Client: still listens.
    KeepAlive,
    /// Client: asks for the server's time; holds its own.
    EchoRequest,
    /// Server: the client's time and its own.
    EchoResponse,
    /// Client: like `Connect`, sent to all servers.
    Discovery,
    /// Server: it does not know the request.
    Unrecognized,
}

impl MessageId {
    const ALL: [(u16, Self); 14] = [
        (0, Self::Connect),
        (1, Self::ServerInfo),
        (2, Self::Request),
        (3, Self::Response),
        (4, Self::RequestModelDef),
        (5, Self::ModelDef),
        (7, Self::Frame),
        (8, Self::Text),
        (9, Self::Disconnect),
        (10, Self::KeepAlive),
        (12, Self::EchoRequest),
        (13, Self::EchoResponse),
        (14, Self::Discovery),
        (100, Self::Unrecognized),
    ];

    fn from_wire(number: u16) -> Option<Self> {
        Self::ALL.into_iter().find_map(|(known, id)| (known == number).then_some(id))
    }

    fn to_wire(self) -> u16 {
        Self::ALL.into_iter().find_map(|(number, id)| (id == self).then_some(number)).unwrap_or_default()
    }
}

/// Splits a datagram into its message id and its payload.
///
/// # Errors
/// If it is shorter than it announces, or its kind is not known.
pub fn parse_packet(datagram: &[u8]) -> Result<(MessageId, &[u8]), Malformed> {
    let mut reader = Reader::new(datagram);
    let id = reader.u16().and_then(MessageId::from_wire).ok_or(Malformed("message id"))?;
    let length = reader.u16().ok_or(Malformed("length"))?;
    let payload = reader.bytes(length.into()).ok_or(Malformed("length"))?;
    Ok((id, payload))
}

/// Starts a packet. [`end_packet`] writes its length.
fn start_packet(out: &mut [u8], id: MessageId) -> Writer<'_> {
    let mut writer = Writer::new(out);
    writer.put(&id.to_wire().to_le_bytes());
    writer.zeros(2);
    writer
}

/// Ends a packet and returns its length, bytes; 0 if it does not fit into its buffer, or is too long for a packet.
fn end_packet(mut writer: Writer<'_>) -> usize {
    let payload = u16::try_from(writer.position().saturating_sub(4));
    writer.patch(2, &payload.unwrap_or_default().to_le_bytes());
    if payload.is_ok() { writer.finish() } else { 0 }
}

/// Writes a packet without payload, such as [`MessageId::KeepAlive`], [`MessageId::RequestModelDef`] and
/// [`MessageId::Disconnect`]. Returns its length, bytes; 0 if it does not fit.
#[must_use = "the length says what to send"]
pub fn write_bare(out: &mut [u8], id: MessageId) -> usize {
    end_packet(start_packet(out, id))
}

/// Writes the client's introduction in its full form of 268 bytes. `id` is [`MessageId::Connect`] or
/// [`MessageId::Discovery`]. Returns its length, bytes; 0 if it does not fit.
#[must_use = "the length says what to send"]
pub fn write_connect(out: &mut [u8], id: MessageId, name: &str, version: Version) -> usize {
    let mut writer = start_packet(out, id);
    writer.field(name.as_bytes(), 256);
    for _ in 0..2 {
        writer.put(&[version.major, version.minor, 0, 0]);
    }
    end_packet(writer)
}

/// The version that a client's introduction asks for; `None` for the short forms, which do not ask for a version.
#[must_use]
pub fn parse_connect(payload: &[u8]) -> Option<Version> {
    let mut reader = Reader::new(payload);
    reader.skip(260, 1)?;
    let [major, minor, _, _] = reader.array()?;
    (major > 0).then_some(Version { major, minor })
}

/// Writes an echo request with the client's time, in ticks of the client's clock.
/// Returns the packet's length, bytes; 0 if it does not fit.
#[must_use = "the length says what to send"]
pub fn write_echo_request(out: &mut [u8], client: u64) -> usize {
    let mut writer = start_packet(out, MessageId::EchoRequest);
    writer.put(&client.to_le_bytes());
    end_packet(writer)
}

/// The client's time in an echo request.
///
/// # Errors
/// If the length is wrong.
pub fn parse_echo_request(payload: &[u8]) -> Result<u64, Malformed> {
    payload.try_into().map(u64::from_le_bytes).map_err(|_| Malformed("echo request"))
}

/// Writes the answer to an echo request: the client's time, and the server's time in ticks of its clock.
/// Returns its length, bytes; 0 if it does not fit.
#[must_use = "the length says what to send"]
pub fn write_echo_response(out: &mut [u8], client: u64, server: u64) -> usize {
    let mut writer = start_packet(out, MessageId::EchoResponse);
    writer.put(&client.to_le_bytes());
    writer.put(&server.to_le_bytes());
    end_packet(writer)
}

/// The client's time and the server's time in the answer to an echo request.
///
/// # Errors
/// If the length is wrong.
pub fn parse_echo_response(payload: &[u8]) -> Result<(u64, u64), Malformed> {
    let malformed = Malformed("echo response");
    let (client, server) = payload.split_first_chunk::<8>().ok_or(malformed)?;
    let server = server.try_into().map_err(|_| malformed)?;
    Ok((u64::from_le_bytes(*client), u64::from_le_bytes(server)))
}
