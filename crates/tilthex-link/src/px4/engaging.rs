//! The orders before a flight: tells the operator if PX4 does not obey one.

use super::topics::VehicleCommand;

/// An order is refused if PX4 has not obeyed it after this time, s.
const REFUSED: f64 = 1.0;

/// The order that PX4 must obey now.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Engaging {
    /// The order, the time at which it was sent first, s, and whether the operator was told that it is refused.
    order: Option<(VehicleCommand, f64, bool)>,
}

impl Engaging {
    /// Notes that an order is sent at `now`, s.
    pub(super) fn send(&mut self, order: VehicleCommand, now: f64) {
        if self.order.is_none_or(|(before, ..)| before != order) {
            self.order = Some((order, now, false));
        }
    }

    /// Notes that no order is to be obeyed.
    pub(super) fn end(&mut self) {
        self.order = None;
    }

    /// What to tell the operator at `now`, s, once for each order.
    pub(super) fn refused(&mut self, now: f64) -> Option<&'static [u8]> {
        let (order, _, told) =
            self.order.as_mut().filter(|(_, since, told)| !*told && now - *since > REFUSED)?;
        *told = true;
        Some(match order {
            VehicleCommand::Offboard => b"PX4 does not enter the offboard mode: QGroundControl says why",
            _ => b"PX4 does not arm: QGroundControl shows which check refuses",
        })
    }
}
