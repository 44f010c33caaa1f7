//! The bytes of one tick in both directions, for the log and for a replay.

use crate::{Outgoing, Severity, Text};

/// Largest number of bytes that a tick takes from the link: four times the bytes of a PX4 that publishes all its topics at
/// the rate of the IMU over Ethernet, which is the vehicle that sends most.
pub const MAX_BYTES_IN: usize = 2048;

/// The bytes of one tick in both directions, in buffers of fixed size.
#[derive(Clone, Copy, Debug)]
pub struct Wire {
    received: [u8; MAX_BYTES_IN],
    received_count: usize,
    /// The bytes that were sent.
    pub sent: Outgoing,
    /// A text from the vehicle.
    pub text: Option<(Severity, Text)>,
}

impl Default for Wire {
    fn default() -> Self {
        Self { received: [0; MAX_BYTES_IN], received_count: 0, sent: Outgoing::default(), text: None }
    }
}

impl Wire {
    /// Begins a tick with the bytes that were received, the first [`MAX_BYTES_IN`] of them.
    pub fn begin(&mut self, received: &[u8]) {
        for (slot, byte) in self.received.iter_mut().zip(received) {
            *slot = *byte;
        }
        self.received_count = received.len().min(MAX_BYTES_IN);
        self.sent.clear();
        self.text = None;
    }

    /// The bytes that were received.
    #[must_use]
    pub fn received(&self) -> &[u8] {
        self.received.get(..self.received_count).unwrap_or(&[])
    }
}
