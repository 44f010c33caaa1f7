//! The line between a base computer and a vehicle that flies itself with tilthex, in both directions.
//!
//! The vehicle speaks [tk3](crate::tk3) as any other vehicle of that family, and the messages of this module beside it:
//! poses, orders and heartbeats to the vehicle, records of the flight to the base. They have the framing of tk3; each ends
//! with a CRC-16 of the body before it. `docs/protocols.md` has the table.

mod base;
mod body;
mod clock;
mod order;
mod periods;
mod record;
mod to_base;
mod to_vehicle;

pub use base::{Base, BaseParams, Event};
pub use clock::RemoteClock;
pub use order::{Answer, GoTo, Order, Part};
pub use periods::Periods;
pub use record::{Facts, FlightPart, RecordParts, StatePart, ToolPart};
pub use to_base::ToBase;
pub use to_vehicle::{PoseMessage, ToVehicle};

/// The identity of a vehicle that flies itself. The number before the dot changes if old and new programs do not understand
/// each other.
pub const IDENTITY: &str = "tilthex1.0";
/// The part of the identity that a base must find.
const FAMILY: &[u8] = b"tilthex1.";
/// After this time without an accepted kill or a landing, and without an answer to an order, it is sent again, s.
pub const REPEAT: f64 = 0.1;
/// An order that is not answered for this time, s, is given up: it may or may not have reached the vehicle.
pub const UNANSWERED: f64 = 2.0;
/// The begin of a text of the vehicle about an order that it refuses.
pub const REFUSED: &str = "order refused: ";
/// Time between two heartbeats, s.
pub const HEARTBEAT: f64 = 0.1;
