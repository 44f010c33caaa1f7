//! The server's introduction.

use super::{
    super::{Malformed, bytes::Reader},
    MessageId, Version, end_packet, start_packet,
};

/// A server's introduction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServerInfo<'a> {
    /// The name of the application, such as `Motive`, without NUL.
    pub application: &'a [u8],
    /// The version of the application.
    pub application_version: [u8; 4],
    /// The version of its NatNet stream.
    pub version: Version,
    /// Ticks of its clock per second.
    pub clock_frequency: u64,
    /// The port to which it sends frames.
    pub data_port: u16,
    /// The multicast group to which it sends frames; `None` for unicast.
    pub multicast: Option<[u8; 4]>,
}

/// The version of the NatNet stream that an introduction names. Also reads the introduction of NatNet 2, in which no field
/// follows the version.
#[must_use]
pub fn announced_version(payload: &[u8]) -> Option<Version> {
    let mut reader = Reader::new(payload);
    reader.skip(256 + 4, 1)?;
    let [major, minor, _, _] = reader.array()?;
    (major > 0).then_some(Version { major, minor })
}

impl<'a> ServerInfo<'a> {
    /// Reads the payload.
    ///
    /// # Errors
    /// If it is shorter than 279 bytes, or the frequency of the clock is 0.
    pub fn parse(payload: &'a [u8]) -> Result<Self, Malformed> {
        let malformed = Malformed("server information");
        let mut reader = Reader::new(payload);
        let mut read = || {
            let name = reader.bytes(256)?;
            let application = name.split(|&byte| byte == 0).next()?;
            let application_version = reader.array()?;
            let [major, minor, _, _] = reader.array()?;
            let clock_frequency = reader.u64().filter(|&frequency| frequency > 0)?;
            let data_port = reader.u16()?;
            let [multicast] = reader.array()?;
            let group = reader.array()?;
            Some(Self {
                application,
                application_version,
                version: Version { major, minor },
                clock_frequency,
                data_port,
                multicast: (multicast != 0).then_some(group),
            })
        };
        read().ok_or(malformed)
    }
}

/// Writes a server's introduction.
/// Returns its length, bytes; 0 if it does not fit.
#[must_use = "the length says what to send"]
pub fn write_server_info(out: &mut [u8], info: &ServerInfo<'_>) -> usize {
    let mut writer = start_packet(out, MessageId::ServerInfo);
    writer.field(info.application, 256);
    writer.put(&info.application_version);
    writer.put(&[info.version.major, info.version.minor, 0, 0]);
    writer.put(&info.clock_frequency.to_le_bytes());
    writer.put(&info.data_port.to_le_bytes());
    writer.put(&[info.multicast.is_some().into()]);
    writer.put(&info.multicast.unwrap_or_default());
    end_packet(writer)
}
