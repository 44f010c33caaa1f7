//! The base's end of a vehicle that flies itself: numbers of orders, urgent orders, a board that starts again.

#![allow(clippy::unwrap_used)]

use tilthex_core::{
    flight::{InputRecord, Record},
    supervisor::Phase,
    vehicle::Mounting,
};
use tilthex_link::{
    Outgoing, Severity, Text,
    onboard::{
        Answer, Base, BaseParams, Event, Facts, FlightPart, IDENTITY, Order, Periods, REPEAT, RecordParts,
        ToBase, ToVehicle, UNANSWERED,
    },
    tk3::{HostMessage, MAX_FRAME, Receiver, Stream, VehicleMessage},
};

/// The input of a tick at a time of the vehicle's clock, s.
fn at(time: f64) -> InputRecord {
    InputRecord { time, ..Record::default().input }
}

/// The part of a record about the supervisor.
fn part(record: &Record, answer: Answer) -> FlightPart {
    RecordParts::new(1, record, Facts::default(), None, answer).flight
}

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
        self.tell(Text::of(&[IDENTITY]));
    }

    fn tell(&mut self, identity: Text) {
        self.hear(ToBase::Tk3(VehicleMessage::Identity(identity)));
    }

    fn record(&mut self, phase: Phase, facts: Facts, answer: Answer) {
        let record = Record { phase, input: at(self.now), ..Record::default() };
        self.hear(ToBase::Flight(RecordParts::new(1, &record, facts, None, answer).flight));
    }

    /// What it sends in a time, s.
    fn sent(&mut self, seconds: f64) -> Vec<ToVehicle> {
        let (mut receiver, mut sent) = (Receiver::<ToVehicle>::default(), Vec::new());
        let end = self.now + seconds;
        while self.now < end {
            let mut out = Outgoing::default();
            let Self { base, now, events } = self;
            base.talk(*now, 0.0, &mut out, &mut |event| events.push(event));
            sent.extend(out.bytes().iter().filter_map(|byte| receiver.push(*byte)));
            self.now += 0.01;
        }
        sent
    }

    /// The orders, with their numbers, that it sends in a time, s.
    fn orders(&mut self, seconds: f64) -> Vec<(u8, Order)> {
        let sent = self.sent(seconds).into_iter();
        sent.filter_map(|message| match message {
            ToVehicle::Order(number, order) => Some((number, order)),
            _ => None,
        })
        .collect()
    }

    /// The periods that it sets in a time, s.
    fn periods(&mut self, seconds: f64) -> Option<Periods> {
        self.sent(seconds).into_iter().fold(None, |found, message| {
            let before = found.unwrap_or_default();
            Some(match message {
                ToVehicle::Tk3(HostMessage::Rate { stream: Stream::Battery, period_us }) => {
                    Periods { battery: period_us, ..before }
                }
                ToVehicle::Tk3(HostMessage::Rate { stream: Stream::Motors, period_us }) => {
                    Periods { motors: period_us, ..before }
                }
                ToVehicle::Tk3(HostMessage::Rate { stream: Stream::Imu, period_us }) => {
                    Periods { imu: period_us, ..before }
                }
                ToVehicle::Records(records) => Periods { records, ..before },
                _ => return found,
            })
        })
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
    // It would obey an order that its former self did not get.
    assert_eq!(talk.orders(3.0 * REPEAT), []);
    talk.record(Phase::Disarmed, Facts::default(), Answer::Nothing);
    let [Event::Restarted(last)] = talk.events[..] else { panic!("{:?}", talk.events) };
    assert!(last.facts.has(Facts::LANDED));
    assert_eq!(talk.number(Order::Hold), 2);
}

/// It knows no order any more, or its clock has not gone on; its identity may be lost.
#[test]
fn a_board_that_starts_again_is_told_by_its_records() {
    let flying = |time, answer| part(&Record { input: at(time), ..Record::default() }, answer);
    for (before, after) in [
        (flying(9.0, Answer::Accepted(1)), flying(9.1, Answer::Nothing)),
        (flying(9.0, Answer::Nothing), flying(0.1, Answer::Nothing)),
        (flying(2400.0, Answer::Nothing), flying(2.0, Answer::Nothing)),
    ] {
        let mut talk = Talk::new();
        talk.identity();
        talk.hear(ToBase::Flight(before));
        talk.number(Order::Hold);
        talk.hear(ToBase::Flight(after));
        assert!(matches!(talk.events[..], [Event::Restarted(last)] if last == before));
    }
    // Its clock goes round once in 72 min.
    for silence in [0.5, 1500.0, 2400.0, 5000.0] {
        let mut talk = Talk::new();
        talk.identity();
        talk.hear(ToBase::Flight(flying(9.0, Answer::Nothing)));
        talk.now += silence;
        talk.hear(ToBase::Flight(flying(9.0 + silence, Answer::Nothing)));
        assert!(talk.events.is_empty(), "{silence}: {:?}", talk.events);
    }
}

/// The answer to a request that was repeated, because the first one was late.
#[test]
fn a_second_identity_drops_no_order() {
    let mut talk = Talk::new();
    talk.identity();
    talk.record(Phase::Disarmed, Facts::default(), Answer::Accepted(7));
    let number = talk.number(Order::TakeOff);
    talk.identity();
    assert_eq!(talk.orders(2.0 * REPEAT), [], "until a record shows that the board has not started again");
    talk.record(Phase::Disarmed, Facts::default(), Answer::Accepted(7));
    let sent = talk.orders(2.0 * REPEAT);
    assert!(!sent.is_empty() && sent.iter().all(|sent| *sent == (number, Order::TakeOff)), "{sent:?}");
    talk.record(Phase::Disarmed, Facts::default(), Answer::Accepted(number));
    assert!(matches!(talk.events[..], [Event::Answered(Order::TakeOff, true)]), "{:?}", talk.events);
}

/// Identities have no checksum.
#[test]
fn another_device_must_say_so_twice() {
    let flipped = |bit: u32| {
        let mut bytes = IDENTITY.as_bytes().to_vec();
        bytes[bit as usize / 8] ^= 1 << (bit % 8);
        Text::new(&bytes)
    };
    for bit in 0..8 * 9 {
        let mut talk = Talk::new();
        talk.orders(0.1);
        talk.tell(flipped(bit));
        talk.orders(0.1);
        assert!(!talk.base.refused() && talk.events.is_empty(), "bit {bit}");
        talk.identity();
        talk.record(Phase::Disarmed, Facts::default(), Answer::Nothing);
        assert!(talk.base.takes_orders(), "bit {bit}");
        // In a conversation it is shown only.
        talk.tell(flipped(bit));
        talk.tell(flipped(bit));
        assert!(!talk.base.refused() && talk.base.takes_orders());
    }
    let mut talk = Talk::new();
    talk.orders(0.1);
    talk.tell(Text::of(&["chimera1.1"]));
    assert!(!talk.base.refused());
    talk.orders(0.1);
    talk.tell(Text::of(&["chimera1.1"]));
    assert!(talk.base.refused());
    assert!(matches!(talk.events[..], [Event::Text(Severity::Error, _)]), "{:?}", talk.events);
    // One that never says the same twice is given up, too.
    let mut talk = Talk::new();
    for k in 0..20_u8 {
        talk.orders(0.1);
        talk.tell(Text::new(&[b'a' + k]));
    }
    assert!(talk.base.refused());
}

/// The messages that set them have no checksum.
#[test]
fn wrong_periods_are_told_and_set_again() {
    let mut talk = Talk::new();
    talk.identity();
    talk.record(Phase::Disarmed, Facts::default(), Answer::Nothing);
    let wanted = Periods { battery: 1_000_000, motors: 20_000, imu: 0, records: 20_000 };
    assert_eq!(talk.periods(0.02), Some(wanted));
    // What was on its way is old.
    talk.hear(ToBase::Periods(Periods::default()));
    assert_eq!(talk.periods(0.1), None);
    for wrong in [
        Periods { motors: 20_000 ^ 1 << 13, ..wanted },
        Periods { battery: 1_000_000 ^ 1 << 19, ..wanted },
        Periods { imu: 20_000, ..wanted },
        Periods { records: 0, ..wanted },
    ] {
        for _ in 0..60 {
            talk.record(Phase::Disarmed, Facts::default(), Answer::Nothing);
            assert_eq!(talk.periods(0.01), None);
        }
        talk.events.clear();
        talk.hear(ToBase::Periods(wanted));
        assert_eq!((talk.periods(0.02), talk.events.len()), (None, 0));
        talk.hear(ToBase::Periods(wrong));
        assert!(matches!(talk.events[..], [Event::WrongPeriods(told)] if told == wrong), "{:?}", talk.events);
        assert_eq!(talk.periods(0.02), Some(wanted));
    }
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
