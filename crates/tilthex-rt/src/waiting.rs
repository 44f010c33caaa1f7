//! Orders for a vehicle that flies itself, while they wait for the answer to the one before.

use std::{collections::VecDeque, iter};

use rtrb::Consumer;
use tilthex_core::flight::Command;
use tilthex_link::onboard::Order;

use crate::console::Carrier;

/// An order that waits for this time, s, is dropped: it must not move the vehicle when nobody expects it any more.
const LONGEST: f64 = 2.0;

/// The orders that wait. Their number is limited by the ring, in which they stay: who gives one too many is told at once.
pub struct Waiting {
    ring: Consumer<Command>,
    carrier: Carrier,
    /// Since when each command in the ring waits, s.
    since: VecDeque<f64>,
    /// The orders that carry out the command that was taken last, and since when they wait, s.
    orders: VecDeque<(Order, f64)>,
}

impl Waiting {
    /// The orders that come through a ring.
    #[must_use]
    pub fn new(ring: Consumer<Command>, carrier: Carrier) -> Self {
        Self { ring, carrier, since: VecDeque::new(), orders: VecDeque::new() }
    }

    /// Puts an order of the console itself after the one that is carried out.
    pub fn push(&mut self, order: Order, now: f64) {
        self.orders.push_back((order, now));
    }

    /// Drops all orders.
    pub fn clear(&mut self) {
        while self.ring.pop().is_ok() {}
        self.since.clear();
        self.orders.clear();
    }

    /// The next order, if the vehicle is `free` to take one. Tells about each order that has waited for too long.
    pub fn next(&mut self, free: bool, now: f64, tell: &mut impl FnMut(&Order)) -> Option<Order> {
        let new = self.ring.slots().saturating_sub(self.since.len());
        self.since.extend(iter::repeat_n(now, new));
        let late = |since: &f64| now - since >= LONGEST;
        while self.orders.front().is_some_and(|(_, since)| late(since)) {
            self.orders.pop_front().iter().for_each(|(order, _)| tell(order));
        }
        while self.since.front().is_some_and(late) {
            self.take().iter().for_each(|(order, _)| tell(order));
        }
        if !free {
            return None;
        }
        if self.orders.is_empty() {
            let orders = self.take();
            self.orders.extend(orders);
        }
        let (next, _) = self.orders.pop_front()?;
        // A command is not carried out by half: what is left of it has waited for this order only.
        self.orders.iter_mut().for_each(|(_, since)| *since = now);
        Some(next)
    }

    /// Takes a command out of the ring: the orders that carry it out, and since when they wait, s.
    fn take(&mut self) -> Vec<(Order, f64)> {
        let Some((command, since)) = self.ring.pop().ok().zip(self.since.pop_front()) else {
            return Vec::new();
        };
        // The desk has refused what the vehicle cannot get.
        let orders = self.carrier.orders(&command).unwrap_or_default();
        orders.into_iter().map(|order| (order, since)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rtrb::{Producer, RingBuffer};
    use tilthex_core::admittance::{AdmittanceFilter, AdmittanceParams};

    /// The orders behind a ring of eight, and what was told.
    fn waiting() -> (Producer<Command>, Waiting) {
        let (ring, commands) = RingBuffer::new(8);
        (ring, Waiting::new(commands, Carrier { admittance: AdmittanceParams::default() }))
    }

    #[test]
    fn the_ninth_order_finds_no_room_while_the_vehicle_is_busy() {
        let (mut ring, mut waiting) = waiting();
        for _ in 0..8 {
            ring.push(Command::ZeroBias).expect("there is room");
            assert_eq!(waiting.next(false, 0.0, &mut |order| panic!("{order:?}")), None);
        }
        assert!(ring.is_full());
        for k in 0..8 {
            let next = waiting.next(true, 0.1 * f64::from(k), &mut |order| panic!("{order:?}"));
            assert_eq!(next, Some(Order::ZeroBias));
        }
        assert_eq!(waiting.next(true, 0.9, &mut |order| panic!("{order:?}")), None);
    }

    #[test]
    fn an_order_that_waits_for_too_long_is_dropped_and_the_operator_is_told() {
        let (mut ring, mut waiting) = waiting();
        let filter = AdmittanceFilter::new(AdmittanceParams::default()).expect("valid");
        let mut dropped = Vec::new();
        let mut tell = |order: &Order| dropped.push(*order);
        ring.push(Command::SetAdmittance(filter)).expect("there is room");
        assert!(matches!(waiting.next(true, 0.0, &mut tell), Some(Order::Admittance(..))));
        ring.push(Command::TakeOff).expect("there is room");
        assert_eq!(waiting.next(false, 0.5, &mut tell), None);
        ring.push(Command::ZeroBias).expect("there is room");
        assert_eq!(waiting.next(false, 1.0, &mut tell), None);
        // The rest of the first order is as old as the order.
        assert_eq!(waiting.next(true, 2.7, &mut tell), Some(Order::ZeroBias));
        waiting.push(Order::Hold, 3.0);
        assert_eq!(waiting.next(false, 9.0, &mut tell), None);
        assert_eq!(waiting.next(true, 9.0, &mut tell), None);
        let [Order::Admittance(..), Order::Admittance(..), Order::TakeOff, Order::Hold] = dropped[..] else {
            panic!("{dropped:?}")
        };
    }

    #[test]
    fn an_order_of_the_console_itself_drops_those_that_wait() {
        let (mut ring, mut waiting) = waiting();
        ring.push(Command::ZeroBias).expect("there is room");
        assert_eq!(waiting.next(false, 0.0, &mut |_| ()), None);
        waiting.clear();
        waiting.push(Order::Hold, 0.1);
        ring.push(Command::TakeOff).expect("there is room");
        assert_eq!(waiting.next(true, 0.2, &mut |_| ()), Some(Order::Hold));
        assert_eq!(waiting.next(true, 2.1, &mut |_| ()), Some(Order::TakeOff));
    }
}
