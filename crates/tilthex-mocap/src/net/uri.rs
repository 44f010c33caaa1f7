//! Addresses of pose sources.

use std::{fmt, str::FromStr};

use super::{SourceError, source::Protocol};

/// The address of a captured body: `natnet://HOST[:PORT]/BODY`,
/// `natnet+multicast://HOST[:PORT]/BODY`, `vrpn://HOST[:PORT]/TRACKER[/SENSOR]` or `udp://SENDER[:PORT]/BODY`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MocapUri {
    /// The protocol.
    pub protocol: Protocol,
    /// The server's name or IP address, without brackets.
    pub host: String,
    /// The server's port for commands (NatNet) or connections (VRPN), or this computer's port for packets (UDP).
    pub port: u16,
    /// The rigid body's or tracker's name.
    pub body: String,
    /// The number of the tracker's sensor (VRPN); `None` for the first sensor that reports.
    pub sensor: Option<i32>,
}

impl FromStr for MocapUri {
    type Err = SourceError;

    fn from_str(text: &str) -> Result<Self, SourceError> {
        let wrong = |found: &str| {
            SourceError::new(format!(
                "the motion capture `{text}` {found}; expected natnet://HOST[:PORT]/BODY, \
                 natnet+multicast://HOST[:PORT]/BODY, vrpn://HOST[:PORT]/TRACKER[/SENSOR] or udp://SENDER[:PORT]/BODY"
            ))
        };
        let (scheme, rest) = text.split_once("://").ok_or_else(|| wrong("names no protocol"))?;
        let protocol = Protocol::ALL
            .iter()
            .copied()
            .find(|protocol| protocol.scheme() == scheme)
            .ok_or_else(|| wrong(&format!("has the unknown protocol `{scheme}`")))?;
        let (authority, body) = rest.split_once('/').ok_or_else(|| wrong("names no body"))?;
        let (body, sensor) = match protocol {
            Protocol::Vrpn => split_sensor(body),
            _ => (body, None),
        };
        let body = decode_percent(body).ok_or_else(|| wrong("has a broken % escape"))?;
        if body.is_empty() {
            return Err(wrong("names no body"));
        }
        // An IPv6 address is written in brackets, because it contains colons.
        let (host, port) = match authority.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            Some((host, port)) => (host, port.strip_prefix(':').or(port.is_empty().then_some(""))),
            None => {
                authority.split_once(':').map_or((authority, Some("")), |(host, port)| (host, Some(port)))
            }
        };
        let port =
            match port {
                Some("") => protocol.default_port(),
                Some(port) => port.parse().ok().filter(|&port| port > 0).ok_or_else(|| {
                    wrong(&format!("has the port `{port}`, which is not within 1 to 65535"))
                })?,
                None => return Err(wrong("has something other than a port after its address")),
            };
        if host.is_empty() {
            return Err(wrong("names no host"));
        }
        Ok(Self { protocol, host: host.into(), port, body, sensor })
    }
}

impl fmt::Display for MocapUri {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let host = if self.host.contains(':') { format!("[{}]", self.host) } else { self.host.clone() };
        write!(f, "{}://{host}:{}/", self.protocol.scheme(), self.port)?;
        let body = self.body.replace('%', "%25");
        match (self.sensor, self.protocol, body.rsplit_once('/')) {
            (Some(sensor), ..) => write!(f, "{body}/{sensor}"),
            // Without the sensor's number, the end of the name would be read as one.
            (None, Protocol::Vrpn, Some((name, end))) if split_sensor(&body).1.is_some() => {
                write!(f, "{name}%2F{end}")
            }
            _ => write!(f, "{body}"),
        }
    }
}

/// Splits a tracker's name from the number of its sensor after the last slash, if there is one.
fn split_sensor(text: &str) -> (&str, Option<i32>) {
    let number =
        |end: &str| end.bytes().all(|byte| byte.is_ascii_digit()).then(|| end.parse().ok()).flatten();
    match text.rsplit_once('/') {
        Some((name, end)) => number(end).map_or((text, None), |sensor| (name, Some(sensor))),
        None => (text, None),
    }
}

/// Replaces `%XX` by its byte: names of bodies may contain blanks.
fn decode_percent(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&byte, tail)) = rest.split_first() {
        if byte == b'%' {
            let (digits, tail) = tail.split_first_chunk::<2>()?;
            let digit = |at: usize| char::from(digits[at]).to_digit(16);
            bytes.push((digit(0)? * 16 + digit(1)?) as u8);
            rest = tail;
        } else {
            bytes.push(byte);
            rest = tail;
        }
    }
    String::from_utf8(bytes).ok()
}
