//! The base's end of a vehicle that flies itself: numbers of orders, urgent orders, a board that starts again.

#![allow(clippy::unwrap_used)]

use tilthex_core::{flight::Record, supervisor::Phase, vehicle::Mounting};
use tilthex_link::{
    Outgoing, Text,
    onboard::{
        Answer, Base, BaseParams, Event, Facts, IDENTITY, Order, REPEAT, RecordParts, ToBase, ToVehicle,
        UNANSWERED,
    },
    tk3::{MAX_FRAME, Receiver, VehicleMessage},
};

/// The base, its clock, and what it tells.
struct Talk {
    base: Base,
    now: f64,
    events: Vec<Event>,
}

impl Talk {
    fn new() -> Self {
        let params = BaseParams {
            rotor_count: 6,
            tool: Mounting::default(),
            record_period_us: 20_000,
            battery_period_us: 1_000_000,
        };
        Self { base: Base::new(params).unwrap(), now: 100.0, events: Vec::new() }
    }

    fn hear(&mut self, message: ToBase) {
        let mut bytes = [0; MAX_FRAME];
        let length = message.encode(&mut bytes);
        let Self { base, now, events } = self;
        base.receive(&bytes[..length], *now, &mut |event| events.push(event));
    }

    fn identity(&mut self) {
        self.hear(ToBase::Tk3(VehicleMessage::Identity(Text::of(&[IDENTITY]))));
    }

    fn record(&mut self, phase: Phase, facts: Facts, answer: Answer) {
        let record = Record { phase, ..Record::default() };
        self.hear(ToBase::Flight(RecordParts::new(1, &record, facts, None, answer).flight));
    }

    /// The orders, with their numbers, that it sends in a time, s.
    fn orders(&mut self, seconds: f64) -> Vec<(u8, Order)> {
        let (mut receiver, mut orders) = (Receiver::<ToVehicle>::default(), Vec::new());
        let end = self.now + seconds;
        while self.now < end {
            let mut out = Outgoing::default();
            let Self { base, now, events } = self;
            base.talk(*now, 0.0, &mut out, &mut |event| events.push(event));
            let sent = out.bytes().iter().filter_map(|byte| receiver.push(*byte));
            orders.extend(sent.filter_map(|message| match message {
                ToVehicle::Order(number, order) => Some((number, order)),
                _ => None,
            }));
            self.now += 0.01;
        }
        orders
    }

    /// Gives an order, and returns its number.
    fn number(&mut self, order: Order) -> u8 {
        assert!(self.base.order(order, self.now), "{order:?}");
        self.orders(0.02)[0].0
    }
}

/// Perhaps the vehicle has obeyed an order to which no answer came. The next one must not look like it.
#[test]
fn two_orders_never_share_a_number() {
    let mut talk = Talk::new();
    talk.identity();
    talk.record(Phase::Flying, Facts::default(), Answer::Accepted(254));
    let mut numbers = Vec::new();
    for order in [Order::ZeroBias, Order::Hold, Order::ZeroBias] {
        numbers.push(talk.number(order));
        talk.orders(UNANSWERED);
        assert!(matches!(talk.events.last(), Some(Event::Unanswered(_))));
        // Records that were on their way tell of an older order.
        talk.record(Phase::Flying, Facts::default(), Answer::Accepted(254));
    }
    // 0 stands for no order.
    assert_eq!(numbers, [255, 1, 2]);
    talk.record(Phase::Flying, Facts::default(), Answer::Accepted(9));
    assert_eq!(talk.number(Order::Hold), 10);
    talk.record(Phase::Flying, Facts::default(), Answer::Refused(10));
    assert!(matches!(talk.events.last(), Some(Event::Answered(Order::Hold, false))));
}

#[test]
fn a_board_that_starts_again_does_not_get_an_old_number() {
    let mut talk = Talk::new();
    talk.identity();
    talk.record(Phase::Flying, Facts(Facts::LANDED), Answer::Nothing);
    assert_eq!(talk.number(Order::Hold), 1);
    talk.identity();
    let [Event::Unanswered(Order::Hold), Event::Restarted(Some(last))] = talk.events[..] else {
        panic!("{:?}", talk.events)
    };
    assert!(last.facts.has(Facts::LANDED));
    talk.record(Phase::Disarmed, Facts::default(), Answer::Nothing);
    assert_eq!(talk.number(Order::Hold), 2);
}

/// A vehicle whose answers do not arrive can fly.
#[test]
fn kill_and_land_are_sent_before_the_vehicle_has_identified_itself() {
    for order in [Order::Kill, Order::Land] {
        let mut talk = Talk::new();
        assert!(talk.base.order(order, talk.now));
        let sent = talk.orders(1.0);
        assert!((1.0 / REPEAT - 2.0..1.0 / REPEAT + 2.0).contains(&(sent.len() as f64)), "{sent:?}");
        assert!(sent.iter().all(|sent| *sent == (0, order)), "{sent:?}");
        assert!(!talk.base.order(Order::Hold, talk.now));
    }
}
