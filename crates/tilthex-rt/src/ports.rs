//! The list of serial ports, and the port that a name denotes.

use std::path::{Path, PathBuf};

use rustix::io::Errno;
use serialport::{SerialPortInfo, SerialPortType};

use crate::Failure;

/// The serial ports of this computer. Empty if the kernel does not list them.
pub(crate) fn there() -> Vec<SerialPortInfo> {
    serialport::available_ports().unwrap_or_default()
}

/// The device that a name denotes. A name is a path, or the serial number of a USB adapter.
pub(crate) fn resolve(name: &str, ports: &[SerialPortInfo]) -> Result<PathBuf, Failure> {
    if name.contains('/') {
        return Ok(PathBuf::from(name));
    }
    let has_number = |port: &&SerialPortInfo| match &port.port_type {
        SerialPortType::UsbPort(usb) => usb.serial_number.as_deref() == Some(name),
        _ => false,
    };
    match ports.iter().find(has_number) {
        Some(port) => Ok(PathBuf::from(&port.port_name)),
        None => Err(Failure::link(format!(
            "no USB serial adapter has the serial number \"{name}\" ({}): name one of these or a path such as \
             /dev/ttyUSB0",
            listed(ports)
        ))),
    }
}

/// Why a port could not be opened, and how to correct it.
pub(crate) fn cannot_open(path: &Path, e: Errno) -> Failure {
    let path = path.display();
    Failure::link(match e {
        Errno::NOENT => format!(
            "{path} does not exist ({}): plug the vehicle in, or name its port with --port",
            listed(&there())
        ),
        Errno::ACCESS => format!(
            "this user has no right to open {path}: join its group with `sudo usermod -aG dialout $USER` and log in again"
        ),
        Errno::BUSY => {
            format!("{path} is in use by another program: end it first (`fuser -v {path}` names it)")
        }
        _ => format!("{path} cannot be opened: {e}"),
    })
}

/// Lists the ports in a sentence: device, product, serial number.
fn listed(ports: &[SerialPortInfo]) -> String {
    let describe = |port: &SerialPortInfo| match &port.port_type {
        SerialPortType::UsbPort(usb) => {
            let product = usb.product.as_deref().unwrap_or("USB adapter");
            let number = usb.serial_number.as_deref().unwrap_or("none");
            format!("{} ({product}, serial number {number})", port.port_name)
        }
        _ => port.port_name.clone(),
    };
    let mut all: Vec<_> = ports.iter().map(describe).collect();
    all.sort();
    if all.is_empty() { "no port is plugged in".into() } else { format!("there are {}", all.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serialport::UsbPortInfo;

    fn adapter(port_name: &str, product: &str, serial_number: Option<&str>) -> SerialPortInfo {
        let usb = UsbPortInfo {
            vid: 0x0403,
            pid: 0x6001,
            serial_number: serial_number.map(Into::into),
            manufacturer: None,
            product: Some(product.into()),
        };
        SerialPortInfo { port_name: port_name.into(), port_type: SerialPortType::UsbPort(usb) }
    }

    #[test]
    fn adapters_are_found_by_their_serial_number() {
        let ports = [
            adapter("/dev/ttyUSB7", "FT232R USB UART", Some("FT4711")),
            adapter("/dev/ttyACM0", "chimera", None),
            SerialPortInfo { port_name: "/dev/ttyS0".into(), port_type: SerialPortType::PciPort },
        ];
        assert_eq!(resolve("FT4711", &ports).expect("found"), Path::new("/dev/ttyUSB7"));
        assert_eq!(resolve("/dev/ttyACM0", &ports).expect("a path"), Path::new("/dev/ttyACM0"));
        let message = resolve("FT0815", &ports).expect_err("absent").message;
        for part in [
            "\"FT0815\"",
            "/dev/ttyUSB7 (FT232R USB UART, serial number FT4711)",
            "/dev/ttyACM0 (chimera, serial number none)",
            "/dev/ttyS0",
        ] {
            assert!(message.contains(part), "{part}: {message}");
        }
        assert!(resolve("FT0815", &[]).expect_err("absent").message.contains("no port is plugged in"));
    }
}
