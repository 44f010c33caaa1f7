//! Pushes of the tool while the simulated vehicle flies, from packets of another program on this computer.

use std::{io, net::UdpSocket};

use tilthex_core::{Vector3, Wrench};

use crate::sleeper::Nanos;

/// Time from the last packet to the end of the push, ns.
const LEFT: Nanos = 300_000_000;
/// Length of a packet, bytes: force and torque, six f64.
const PACKET: usize = 48;

/// A hand on the tool of the simulated vehicle. A packet has 48 bytes, little-endian: force (three f64, N) and torque
/// (three f64, N m, about the tool tip), world axes. Packets of another size and numbers that are not finite are ignored.
#[derive(Debug)]
pub struct Hand {
    socket: UdpSocket,
    wrench_w: Wrench,
    /// Time at which the newest packet arrived.
    newest: Nanos,
}

impl Hand {
    /// Listens at a port of 127.0.0.1; 0 means any free port.
    ///
    /// # Errors
    /// Errors of the kernel, for example if the port is in use.
    pub fn new(port: u16) -> io::Result<Self> {
        let socket = UdpSocket::bind(("127.0.0.1", port))?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, wrench_w: Wrench::ZERO, newest: 0 })
    }

    /// The port.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub fn port(&self) -> io::Result<u16> {
        Ok(self.socket.local_addr()?.port())
    }

    /// The wrench on the tool (world, at its tip) at a time: that of the newest packet, or zero if the packets have ended.
    pub fn wrench(&mut self, now: Nanos) -> Wrench {
        let mut bytes = [0; PACKET + 1];
        while let Ok(count) = self.socket.recv(&mut bytes) {
            if let Some(wrench_w) = parse(bytes.get(..count).unwrap_or_default()) {
                (self.wrench_w, self.newest) = (wrench_w, now);
            }
        }
        if now.saturating_sub(self.newest) > LEFT {
            self.wrench_w = Wrench::ZERO;
        }
        self.wrench_w
    }
}

fn parse(bytes: &[u8]) -> Option<Wrench> {
    let bytes: &[u8; PACKET] = bytes.try_into().ok()?;
    let mut numbers = [0.0; 6];
    for (number, bytes) in numbers.iter_mut().zip(bytes.as_chunks().0) {
        *number = f64::from_le_bytes(*bytes);
    }
    let [fx, fy, fz, tx, ty, tz] = numbers;
    let wrench = Wrench { force: Vector3::new(fx, fy, fz), torque: Vector3::new(tx, ty, tz) };
    numbers.iter().all(|x| x.is_finite()).then_some(wrench)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(numbers: [f64; 6]) -> Vec<u8> {
        numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
    }

    #[test]
    fn a_push_is_felt_until_it_ends_or_falls_silent() {
        let mut hand = Hand::new(0).expect("a free port");
        let other = UdpSocket::bind("127.0.0.1:0").expect("a free port");
        let to = ("127.0.0.1", hand.port().expect("bound"));
        let mut at = LEFT;
        let mut felt = |bytes: &[u8], now: Nanos| {
            other.send_to(bytes, to).expect("sent");
            hand.wrench(now)
        };
        let push = Wrench { force: Vector3::new(1.5, 0.0, -2.0), torque: Vector3::new(0.0, 0.25, 0.0) };
        let bytes = packet([1.5, 0.0, -2.0, 0.0, 0.25, 0.0]);
        assert_eq!(felt(&bytes, at), push);
        // A packet that is not a push changes nothing, and does not prolong the push.
        for bad in [&bytes[..47], &[&bytes[..], &[0]].concat(), &packet([f64::NAN; 6]), &[]] {
            assert_eq!(felt(bad, at + LEFT), push);
        }
        assert_eq!(felt(&[], at + LEFT + 1), Wrench::ZERO);
        at += 2 * LEFT;
        assert_eq!(felt(&bytes, at), push);
        assert_eq!(felt(&packet([0.0; 6]), at + 1), Wrench::ZERO);
    }
}
