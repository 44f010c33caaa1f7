//! Orders for a vehicle that flies itself, while they wait for the answer to the one before.

use std::{
    collections::VecDeque,
    iter,
    sync::{Arc, OnceLock},
};

use rtrb::Consumer;
use tilthex_link::onboard::Order;

/// An order that waits for this time, s, is dropped: it must not move the vehicle when nobody expects it any more.
const LONGEST: f64 = 2.0;

/// What has become of a command, as soon as it is certain: it is carried out, or one sentence.
pub type Fate = Arc<OnceLock<Result<(), String>>>;

/// The orders that carry out a command, one at least, and what becomes of it.
#[derive(Debug)]
pub struct Asked {
    /// The orders.
    pub orders: Vec<Order>,
    /// Where the console tells what has become of the command.
    pub fate: Fate,
}

/// A command whose orders are given one after the other.
#[derive(Debug)]
struct Job {
    orders: VecDeque<Order>,
    /// Since when it waits, s.
    since: f64,
    /// How many of its orders were given, and how many of them the vehicle has accepted.
    given: usize,
    accepted: usize,
    fate: Fate,
}

impl Job {
    fn ends(self, done: Result<(), &str>) {
        let told = done.map_err(|reason| match self.accepted {
            0 => reason.into(),
            _ => format!("{reason}; a part of it is in effect"),
        });
        // It is told once.
        let _ = self.fate.set(told);
    }
}

/// The orders that wait. Their number is limited by the ring, in which they stay: who gives one too many is told at once.
pub struct Waiting {
    ring: Consumer<Asked>,
    /// Since when each command in the ring waits, s.
    since: VecDeque<f64>,
    /// The command that is carried out, and after it the orders of the console itself.
    jobs: VecDeque<Job>,
}

impl Waiting {
    /// The orders that come through a ring.
    #[must_use]
    pub fn new(ring: Consumer<Asked>) -> Self {
        Self { ring, since: VecDeque::new(), jobs: VecDeque::new() }
    }

    /// Puts an order of the console itself after the one that is carried out.
    pub fn push(&mut self, order: Order, now: f64) {
        self.jobs.push_back(Job {
            orders: [order].into(),
            since: now,
            given: 0,
            accepted: 0,
            fate: Fate::default(),
        });
    }

    /// Drops all orders, for a reason.
    pub fn clear(&mut self, reason: &str) {
        while let Some(job) = self.take() {
            self.jobs.push_back(job);
        }
        self.jobs.drain(..).for_each(|job| job.ends(Err(reason)));
    }

    /// The next order, if the vehicle is `free` to take one. Tells about each order that has waited for too long.
    pub fn next(&mut self, free: bool, now: f64, tell: &mut impl FnMut(&Order)) -> Option<Order> {
        let new = self.ring.slots().saturating_sub(self.since.len());
        self.since.extend(iter::repeat_n(now, new));
        let late = |since: f64| now - since >= LONGEST;
        let mut dropped = |job: Job| {
            job.orders.iter().for_each(&mut *tell);
            job.ends(Err("it has waited for the vehicle for too long, and is dropped"));
        };
        // Those behind a command that is carried out wait for it.
        while let Some(at) = self.jobs.iter().position(|job| job.given == 0 && late(job.since)) {
            self.jobs.remove(at).into_iter().for_each(&mut dropped);
        }
        while self.since.front().is_some_and(|since| late(*since)) {
            self.take().into_iter().for_each(&mut dropped);
        }
        if !free {
            return None;
        }
        if self.jobs.is_empty() {
            let job = self.take();
            self.jobs.extend(job);
        }
        let job = self.jobs.front_mut()?;
        job.given += 1;
        job.orders.pop_front()
    }

    /// Takes what has become of the order that was given last. If it is not carried out, nor is the rest of its command.
    pub fn settle(&mut self, done: Result<(), &str>) {
        if let Some(job) = self.jobs.front_mut().filter(|job| job.given > 0) {
            job.accepted += usize::from(done.is_ok());
        }
        let ended = |job: &Job| job.given > 0 && (done.is_err() || job.orders.is_empty());
        if self.jobs.front().is_some_and(ended) {
            self.jobs.pop_front().into_iter().for_each(|job| job.ends(done));
        }
    }

    /// Takes a command out of the ring.
    fn take(&mut self) -> Option<Job> {
        let Asked { orders, fate } = self.ring.pop().ok()?;
        let since = self.since.pop_front().unwrap_or(f64::NEG_INFINITY);
        Some(Job { orders: orders.into(), since, given: 0, accepted: 0, fate })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rtrb::{Producer, RingBuffer};
    use tilthex_core::types::Vector6;
    use tilthex_link::onboard::Part;

    /// The orders behind a ring of eight.
    fn waiting() -> (Producer<Asked>, Waiting) {
        let (ring, commands) = RingBuffer::new(8);
        (ring, Waiting::new(commands))
    }

    fn ask(ring: &mut Producer<Asked>, orders: &[Order]) -> Fate {
        let fate = Fate::default();
        ring.push(Asked { orders: orders.into(), fate: fate.clone() }).expect("there is room");
        fate
    }

    fn refusal(fate: &Fate) -> &str {
        fate.get().expect("a fate").as_ref().expect_err("refused")
    }

    #[test]
    fn the_ninth_order_finds_no_room_while_the_vehicle_is_busy() {
        let (mut ring, mut waiting) = waiting();
        let mut fates = Vec::new();
        for _ in 0..8 {
            fates.push(ask(&mut ring, &[Order::ZeroBias]));
            assert_eq!(waiting.next(false, 0.0, &mut |order| panic!("{order:?}")), None);
        }
        assert!(ring.is_full());
        for (k, fate) in (0..).zip(&fates) {
            let next = waiting.next(true, 0.1 * f64::from(k), &mut |order| panic!("{order:?}"));
            assert_eq!(next, Some(Order::ZeroBias));
            assert!(fate.get().is_none(), "the vehicle has not answered");
            waiting.settle(Ok(()));
            assert_eq!(fate.get(), Some(&Ok(())));
        }
        assert_eq!(waiting.next(true, 0.9, &mut |order| panic!("{order:?}")), None);
    }

    #[test]
    fn a_command_of_several_orders_is_carried_out_whole_or_ends() {
        let (mut ring, mut waiting) = waiting();
        let parts = [Part::Mass, Part::Damping, Part::Stiffness];
        let three = parts.map(|part| Order::Admittance(part, Vector6::repeat(2.0)));
        let whole = ask(&mut ring, &three);
        for _ in 0..3 {
            assert!(whole.get().is_none());
            assert!(matches!(waiting.next(true, 0.0, &mut |_| ()), Some(Order::Admittance(..))));
            waiting.settle(Ok(()));
        }
        assert_eq!(whole.get(), Some(&Ok(())));
        let ended = ask(&mut ring, &three);
        let next = ask(&mut ring, &[Order::ZeroBias]);
        assert!(waiting.next(true, 0.0, &mut |_| ()).is_some());
        waiting.settle(Err("the mass is too small"));
        assert_eq!(refusal(&ended), "the mass is too small");
        let half = ask(&mut ring, &three);
        assert_eq!(waiting.next(true, 0.0, &mut |_| ()), Some(Order::ZeroBias));
        waiting.settle(Ok(()));
        assert_eq!(next.get(), Some(&Ok(())));
        for done in [Ok(()), Err("the damping is too weak")] {
            assert!(waiting.next(true, 0.0, &mut |_| ()).is_some());
            waiting.settle(done);
        }
        assert_eq!(refusal(&half), "the damping is too weak; a part of it is in effect");
        let cleared = ask(&mut ring, &three);
        assert!(waiting.next(true, 0.0, &mut |_| ()).is_some());
        waiting.settle(Ok(()));
        waiting.clear("H holds");
        assert_eq!(refusal(&cleared), "H holds; a part of it is in effect");
    }

    #[test]
    fn an_order_that_waits_for_too_long_is_dropped_and_the_operator_is_told() {
        let (mut ring, mut waiting) = waiting();
        let mut dropped = Vec::new();
        let mut tell = |order: &Order| dropped.push(*order);
        let given = ask(&mut ring, &[Order::ZeroBias]);
        assert_eq!(waiting.next(true, 0.0, &mut tell), Some(Order::ZeroBias));
        let late = ask(&mut ring, &[Order::TakeOff]);
        assert_eq!(waiting.next(false, 0.5, &mut tell), None);
        let next = ask(&mut ring, &[Order::ZeroBias]);
        assert_eq!(waiting.next(false, 1.0, &mut tell), None);
        assert_eq!(waiting.next(false, 2.7, &mut tell), None);
        assert!(refusal(&late).contains("too long"));
        waiting.settle(Err("no answer"));
        assert_eq!(refusal(&given), "no answer");
        assert_eq!(waiting.next(true, 2.8, &mut tell), Some(Order::ZeroBias));
        waiting.push(Order::Hold, 3.0);
        waiting.settle(Ok(()));
        assert_eq!(next.get(), Some(&Ok(())));
        assert_eq!(waiting.next(true, 9.0, &mut tell), None);
        assert_eq!(dropped, [Order::TakeOff, Order::Hold]);
    }

    #[test]
    fn an_order_of_the_console_itself_drops_those_that_wait() {
        let (mut ring, mut waiting) = waiting();
        let (given, behind) = (ask(&mut ring, &[Order::ZeroBias]), ask(&mut ring, &[Order::ZeroBias]));
        assert!(waiting.next(true, 0.0, &mut |_| ()).is_some());
        waiting.clear("H holds");
        assert_eq!([refusal(&given), refusal(&behind)], ["H holds", "H holds"]);
        // The answer to the order that was given comes nevertheless.
        waiting.push(Order::Hold, 0.1);
        waiting.settle(Ok(()));
        let next = ask(&mut ring, &[Order::TakeOff]);
        assert_eq!(waiting.next(true, 0.2, &mut |_| ()), Some(Order::Hold));
        waiting.settle(Ok(()));
        assert_eq!(waiting.next(true, 0.3, &mut |_| ()), Some(Order::TakeOff));
        waiting.settle(Ok(()));
        assert_eq!(next.get(), Some(&Ok(())));
    }
}
