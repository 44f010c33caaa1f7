//! The argument of `--port`: a device, or a URI that also names the link's protocol.

use std::net::{Ipv4Addr, SocketAddr};

use tilthex_link::LinkKind;

use crate::{
    Failure,
    port::{DATAGRAMS, SOCKET},
};

/// The vehicle's port, and what its name says about the line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VehicleUri {
    /// The name for [`crate::port::Port::open`].
    pub name: String,
    /// The link; `None` if the configuration decides.
    pub link: Option<LinkKind>,
    /// The speed of the line, bits/s; `None` if the configuration decides.
    pub baud: Option<u32>,
}

impl VehicleUri {
    /// Reads the name of a device, `px4://DEVICE[?baud=N]` or `px4+udp://[ADDRESS]:PORT`.
    ///
    /// # Errors
    /// One sentence.
    pub fn parse(text: &str) -> Result<Self, Failure> {
        if let Some(place) = text.strip_prefix("px4+udp://") {
            let full = if place.starts_with(':') {
                format!("{}{place}", Ipv4Addr::UNSPECIFIED)
            } else {
                place.into()
            };
            let address: SocketAddr = full.parse().map_err(|_| {
                Failure::usage(format!(
                    "--port {text} names no address to listen at; expected px4+udp://:PORT or px4+udp://ADDRESS:PORT, such as \
                     px4+udp://:8888"
                ))
            })?;
            return Ok(Self {
                name: format!("{DATAGRAMS}{address}"),
                link: Some(LinkKind::Px4),
                baud: Some(0),
            });
        }
        let Some(rest) = text.strip_prefix("px4://") else {
            return Ok(Self { name: text.into(), link: None, baud: None });
        };
        let refuse = || {
            Failure::usage(format!(
                "--port {text} cannot be read; expected px4://DEVICE or px4://DEVICE?baud=N, such as \
                 px4:///dev/ttyUSB0?baud=921600"
            ))
        };
        let (name, baud) = match rest.split_once('?') {
            None => (rest, None),
            Some((name, query)) => {
                let baud = query.strip_prefix("baud=").and_then(|number| number.parse().ok());
                (name, Some(baud.ok_or_else(refuse)?))
            }
        };
        if name.is_empty() {
            return Err(refuse());
        }
        let baud = baud.or_else(|| name.starts_with(SOCKET).then_some(0));
        Ok(Self { name: name.into(), link: Some(LinkKind::Px4), baud })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_what_they_say() {
        let px4 = Some(LinkKind::Px4);
        for (text, name, link, baud) in [
            ("/dev/ttyUSB0", "/dev/ttyUSB0", None, None),
            ("FT4711", "FT4711", None, None),
            ("px4:///dev/ttyUSB0?baud=921600", "/dev/ttyUSB0", px4, Some(921_600)),
            ("px4://FT4711", "FT4711", px4, None),
            ("px4://unix:/run/vehicle", "unix:/run/vehicle", px4, Some(0)),
            ("px4+udp://:8888", "udp:0.0.0.0:8888", px4, Some(0)),
            ("px4+udp://[::1]:8888", "udp:[::1]:8888", px4, Some(0)),
        ] {
            let found = VehicleUri::parse(text).expect(text);
            assert_eq!(found, VehicleUri { name: name.into(), link, baud }, "{text}");
        }
        for text in
            ["px4://", "px4://x?baud=fast", "px4://x?speed=1", "px4+udp://8888", "px4+udp://host:8888"]
        {
            let message = VehicleUri::parse(text).expect_err(text).message;
            assert!(message.contains(text) && message.contains("such as px4"), "{message}");
        }
    }
}
