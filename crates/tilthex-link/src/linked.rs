//! A flight behind its link: bytes in and bytes out.
//!
//! It depends only on its inputs. The real-time loop, the fault campaign on virtual time and the replay of a log run
//! this same code, and get the same result bit for bit.

use crate::{Link, LinkKind, LinkParams, VehicleLink, Wire};
use tilthex_core::{
    Error, PoseSample,
    flight::{Command, Commanded, Flight, FlightParams, HostFacts, Measured, Route},
};

/// Everything that a tick may depend on. The same inputs give the same outputs, bit for bit.
#[derive(Clone, Copy, Debug)]
pub struct WireInput<'a> {
    /// Now, s, monotonic.
    pub time: f64,
    /// Bytes read from the link since the last tick, at most [`crate::MAX_BYTES_IN`].
    pub bytes: &'a [u8],
    /// Poses that have arrived since the last tick, at most [`tilthex_core::flight::MAX_POSES`].
    pub poses: &'a [PoseSample],
    /// An order.
    pub command: Option<&'a Command>,
    /// Facts that only the host observes.
    pub host: HostFacts,
}

/// The output of a tick: bytes for the vehicle, and a record of the tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinkedOutput {
    /// The bytes of the tick; `wire.sent` is to be written.
    pub wire: Wire,
    /// The command of the flight, and its record.
    pub commanded: Commanded,
}

/// Parameters of a flight and its link.
#[derive(Clone, Copy, Debug)]
pub struct LinkedParams {
    /// The link that the vehicle speaks.
    pub kind: LinkKind,
    /// The link.
    pub link: LinkParams,
    /// The flight.
    pub flight: FlightParams,
}

/// A flight and the link to its vehicle.
#[derive(Clone, Debug)]
pub struct LinkedFlight {
    /// The link.
    pub link: Link,
    /// The flight.
    pub flight: Flight,
}

impl LinkedFlight {
    /// A flight that has not begun, over a link that has received no byte; `route` is flown after take-off.
    ///
    /// # Errors
    /// The first parameter that a block refuses.
    pub fn new(params: LinkedParams, route: Option<Route>) -> Result<Self, Error> {
        let rotor_count = params.flight.vehicle.rotor_count();
        Ok(Self {
            link: Link::new(params.kind, params.link, rotor_count)?,
            flight: Flight::new(params.flight, route)?,
        })
    }

    /// One tick: receives bytes, runs the flight, and writes the bytes to send.
    pub fn tick(&mut self, input: &WireInput<'_>, out: &mut LinkedOutput) {
        out.wire.begin(input.bytes);
        let measured = Measured {
            time: input.time,
            telemetry: self.link.receive(input.bytes, input.time),
            poses: input.poses,
            command: input.command,
            host: input.host,
            known: None,
        };
        self.flight.tick(&measured, &mut out.commanded);
        self.link.command(&out.commanded.motors, input.time, &mut out.wire.sent);
        out.wire.text = self.link.text();
    }

    /// Whether the vehicle flew, stands on the ground again, and its motors have stopped.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.flight.supervisor().landed() && !self.link.telemetry().any_spinning()
    }
}
