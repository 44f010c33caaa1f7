//! The base's end of the conversation: identity, streams, heartbeats, orders until they are answered, and records that are
//! put together. It never waits.

mod assembled;

use super::{
    Answer, FAMILY, FlightPart, HEARTBEAT, Order, Periods, PoseMessage, REPEAT, RemoteClock, StatePart,
    ToBase, ToVehicle, UNANSWERED, record::Facts,
};
use crate::{
    Outgoing, Severity, Text,
    tk3::{HostMessage, MotorFrame, Receiver, Stream, VehicleMessage},
};
use tilthex_core::{
    Error, PoseSample, RotorVector,
    flight::Record,
    supervisor::{Phase, limits::STREAM_SILENT},
    vehicle::Mounting,
};

/// Time between two identity requests, s, and their number.
const IDENTIFY: (f64, u32) = (0.5, 4);
/// Longest silence of the operator that a heartbeat carries, s.
const SILENT: f64 = 65.0;

/// A board whose clock is off by more than this between two records has started again, us. A line is never as late.
const CLOCK_OFF: u32 = 1_000_000;

/// Parameters of the base's end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseParams {
    /// Number of rotors of the vehicle.
    pub rotor_count: usize,
    /// Its tool.
    pub tool: Mounting,
    /// Period of the records and of the motors' stream, us.
    pub record_period_us: u32,
    /// Period of the battery's stream, us.
    pub battery_period_us: u32,
}

/// What the vehicle has told.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::large_enum_variant, reason = "passed on at once, and nothing is allocated")]
pub enum Event {
    /// A complete record. Values that the vehicle does not send are NaN.
    Record(Record),
    /// A text for the operator.
    Text(Severity, Text),
    /// The vehicle answers to an order: whether it carries it out.
    Answered(Order, bool),
    /// The vehicle has not answered to an order.
    Unanswered(Order),
    /// The vehicle's board has started again, by what its records tell. With the last part of a record before.
    Restarted(FlightPart),
    /// Streams of the vehicle have other periods than ordered; they are set again.
    WrongPeriods(Periods),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Identify {
        tries: u32,
        asked: f64,
    },
    Refused,
    /// `again` says that the streams must be set, although they run.
    Streams {
        asked: f64,
        again: bool,
    },
}

/// An order on its way.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pending {
    number: u8,
    order: Order,
    since: f64,
    sent: Option<f64>,
}

/// The base's end of the line.
#[derive(Clone, Debug)]
pub struct Base {
    params: BaseParams,
    stage: Stage,
    /// The identity of another device, which is asked for a second time. A message of tk3 has no checksum.
    stranger: Option<Text>,
    receiver: Receiver<ToBase>,
    clock: RemoteClock,
    /// When the last message arrived, s.
    heard: f64,
    flight: Option<FlightPart>,
    /// When it arrived, s.
    flight_heard: f64,
    /// Whether the board may have started again since then: an order that it never had must not be repeated.
    unsure: bool,
    state: Option<StatePart>,
    records: u64,
    last_time: Option<f64>,
    speeds: RotorVector,
    currents: RotorVector,
    battery: f64,
    pose_number: u8,
    /// The highest number of an order that was given or heard of.
    number: Option<u8>,
    pending: Option<Pending>,
    urgent: Option<Order>,
    urgent_sent: f64,
    heartbeat: f64,
}

impl Base {
    /// The base's end before the first byte.
    ///
    /// # Errors
    /// None with the parameters that it uses.
    pub fn new(params: BaseParams) -> Result<Self, Error> {
        Ok(Self {
            params,
            stage: Stage::Identify { tries: 0, asked: f64::NEG_INFINITY },
            stranger: None,
            receiver: Receiver::default(),
            clock: RemoteClock::new()?,
            heard: f64::NEG_INFINITY,
            flight: None,
            flight_heard: f64::NEG_INFINITY,
            unsure: false,
            state: None,
            records: 0,
            last_time: None,
            speeds: RotorVector::repeat(f64::NAN),
            currents: RotorVector::zeros(),
            battery: f64::NAN,
            pose_number: 0,
            number: None,
            pending: None,
            urgent: None,
            urgent_sent: f64::NEG_INFINITY,
            heartbeat: f64::NEG_INFINITY,
        })
    }

    /// Whether another device has answered, or nothing.
    #[must_use]
    pub fn refused(&self) -> bool {
        self.stage == Stage::Refused
    }

    /// Time since the last message, s.
    #[must_use]
    pub fn silence(&self, now: f64) -> f64 {
        now - self.heard
    }

    /// The newest part of a record about the supervisor.
    #[must_use]
    pub fn flight(&self) -> Option<&FlightPart> {
        self.flight.as_ref()
    }

    /// Whether it takes an order that is not urgent: not while another one is on its way, and not before the first record.
    #[must_use]
    pub fn takes_orders(&self) -> bool {
        self.pending.is_none() && self.flight.is_some()
    }

    /// Takes an order; returns false if it [cannot](Self::takes_orders). An urgent order is repeated
    /// until the vehicle obeys, and drops the order that is on its way.
    pub fn order(&mut self, order: Order, now: f64) -> bool {
        if order.is_urgent() {
            self.pending = None;
            if self.urgent != Some(Order::Kill) && self.urgent != Some(order) {
                (self.urgent, self.urgent_sent) = (Some(order), f64::NEG_INFINITY);
            }
            return true;
        }
        if !self.takes_orders() {
            return false;
        }
        // The numbers go round, without 0, which stands for no order.
        let number = self.number.map_or(1, |last| last.wrapping_add(1).max(1));
        self.number = Some(number);
        self.pending = Some(Pending { number, order, since: now, sent: None });
        true
    }

    /// Writes a pose that is sent at `now`, s.
    pub fn pose(&mut self, pose: &PoseSample, now: f64, out: &mut Outgoing) {
        self.pose_number = self.pose_number.wrapping_add(1);
        let message = ToVehicle::Pose(PoseMessage::new(self.pose_number, pose, now));
        out.append(|b| message.encode(b));
    }

    /// Takes bytes that arrive at `now`, s, and tells what is in them.
    pub fn receive(&mut self, bytes: &[u8], now: f64, tell: &mut impl FnMut(Event)) {
        for byte in bytes {
            let Some(message) = self.receiver.push(*byte) else { continue };
            self.heard = now;
            match message {
                ToBase::Tk3(message) => self.take(&message, tell),
                ToBase::Periods(periods) => self.check(periods, now, tell),
                ToBase::Flight(part) => {
                    let before = self.flight.replace(part);
                    self.state = None;
                    let elapsed = now - core::mem::replace(&mut self.flight_heard, now);
                    self.unsure = false;
                    if let Some(before) = before.filter(|before| restarted(before, &part, elapsed)) {
                        self.pending = None;
                        tell(Event::Restarted(before));
                    }
                    self.note(part.answer.number());
                    self.settle(part.answer, tell);
                }
                ToBase::State(part) => self.state = Some(part),
                ToBase::Tool(part) => {
                    if let Some(record) = self.record(&part, now) {
                        tell(Event::Record(record));
                    }
                }
            }
        }
    }

    fn take(&mut self, message: &VehicleMessage, tell: &mut impl FnMut(Event)) {
        match message {
            VehicleMessage::Identity(text) => self.identify(text, tell),
            VehicleMessage::Motor(frame) => self.take_motor(frame),
            VehicleMessage::Battery { millivolts, .. } => self.battery = 1e-3 * f64::from(*millivolts),
            VehicleMessage::Text { severity, text } => tell(Event::Text(*severity, *text)),
            VehicleMessage::Imu(_) | VehicleMessage::Magnetometer { .. } | VehicleMessage::Clock { .. } => {}
        }
    }

    /// Takes an identity. In a conversation it can be that of a board that starts again and sends nothing until it is asked;
    /// or an answer that was late, which changes nothing.
    fn identify(&mut self, text: &Text, tell: &mut impl FnMut(Event)) {
        let known = text.as_bytes().starts_with(FAMILY);
        let set = Stage::Streams { asked: f64::NEG_INFINITY, again: true };
        match &mut self.stage {
            Stage::Refused => {}
            _ if known => {
                self.unsure = true;
                self.stage = set;
            }
            Stage::Streams { .. } => tell(Event::Text(Severity::Error, *text)),
            Stage::Identify { tries, asked } => match self.stranger.replace(*text) {
                Some(before) if before == *text => {
                    tell(Event::Text(Severity::Error, *text));
                    self.stage = Stage::Refused;
                }
                before => {
                    // Answered at once, and without a try the first time: perhaps this was the answer to the last one.
                    *asked = f64::NEG_INFINITY;
                    *tries = tries.saturating_sub(before.is_none().into());
                }
            },
        }
    }

    /// The periods that the streams must have.
    fn periods(&self) -> Periods {
        Periods {
            battery: self.params.battery_period_us,
            motors: self.params.record_period_us,
            imu: 0,
            records: self.params.record_period_us,
        }
    }

    /// Compares the periods that the vehicle tells. What it told before it was asked is old.
    fn check(&mut self, told: Periods, now: f64, tell: &mut impl FnMut(Event)) {
        let wanted = self.periods();
        if let Stage::Streams { asked, again } = &mut self.stage
            && !*again
            && told != wanted
            && now - *asked >= STREAM_SILENT
        {
            *again = true;
            tell(Event::WrongPeriods(told));
        }
    }

    fn take_motor(&mut self, frame: &MotorFrame) {
        let index = usize::from(frame.state.motor()).wrapping_sub(1);
        if index < self.params.rotor_count
            && let (Some(speed), Some(current)) = (self.speeds.get_mut(index), self.currents.get_mut(index))
        {
            *speed = frame.speed();
            *current = 1e-3 * f64::from(frame.current_ma);
        }
    }

    /// Notes the number of an answered order. It is above another one if it is less than half a round ahead.
    fn note(&mut self, number: u8) {
        if number != 0 && self.number.is_none_or(|last| number.wrapping_sub(last) <= u8::MAX / 2) {
            self.number = Some(number);
        }
    }

    /// Ends the wait for an answer, if this is the one.
    fn settle(&mut self, answer: Answer, tell: &mut impl FnMut(Event)) {
        let Some(pending) = self.pending.filter(|p| p.sent.is_some() && p.number == answer.number()) else {
            return;
        };
        self.pending = None;
        tell(Event::Answered(pending.order, matches!(answer, Answer::Accepted(_))));
    }

    /// Writes what the conversation needs at `now`, s: requests, the heartbeat of an operator who was last heard `silence` s
    /// ago, and orders that are not answered. Tells about an order to which no answer came.
    pub fn talk(&mut self, now: f64, silence: f64, out: &mut Outgoing, tell: &mut impl FnMut(Event)) {
        // Also before the vehicle has identified itself: perhaps it flies, and only its answers are lost.
        self.insist(now, out);
        match self.stage {
            Stage::Refused => return,
            Stage::Identify { tries, asked } => {
                if now - asked < IDENTIFY.0 {
                    return;
                }
                if tries < IDENTIFY.1 {
                    out.append(|b| ToVehicle::Tk3(HostMessage::Identify).encode(b));
                    self.stage = Stage::Identify { tries: tries + 1, asked: now };
                } else {
                    self.stage = Stage::Refused;
                }
                return;
            }
            Stage::Streams { asked, again } => {
                let silent = self.silence(now) >= STREAM_SILENT || self.flight.is_none();
                if again || silent && now - asked >= STREAM_SILENT {
                    set(&self.periods(), out);
                    self.stage = Stage::Streams { asked: now, again: false };
                }
            }
        }
        if now - self.heartbeat >= HEARTBEAT {
            let silence = (1e3 * silence.clamp(0.0, SILENT)) as u16;
            out.append(|b| ToVehicle::Heartbeat(silence).encode(b));
            self.heartbeat = now;
        }
        let sure = !self.unsure && self.silence(now) < STREAM_SILENT;
        if let Some(pending) = &mut self.pending {
            if now - pending.since >= UNANSWERED {
                tell(Event::Unanswered(pending.order));
                self.pending = None;
            } else if sure && pending.sent.is_none_or(|sent| now - sent >= REPEAT) {
                let message = ToVehicle::Order(pending.number, pending.order);
                out.append(|b| message.encode(b));
                pending.sent = Some(now);
            }
        }
    }

    /// Repeats the urgent order until the vehicle obeys.
    fn insist(&mut self, now: f64, out: &mut Outgoing) {
        let Some(order) = self.urgent else { return };
        let obeyed = self.flight.is_some_and(|flight| match order {
            Order::Kill => flight.facts.has(Facts::KILLED),
            _ => flight.facts.has(Facts::LANDED) || matches!(flight.phase, Phase::Landing | Phase::Emergency),
        });
        if !obeyed && now - self.urgent_sent >= REPEAT {
            out.append(|b| ToVehicle::Order(0, order).encode(b));
            self.urgent_sent = now;
        }
    }

    /// Writes the messages that end the conversation: the streams stop.
    pub fn part(&self, out: &mut Outgoing) {
        set(&Periods::default(), out);
    }
}

/// Writes the messages that set the periods of the streams.
fn set(periods: &Periods, out: &mut Outgoing) {
    let rate = |stream, period_us| ToVehicle::Tk3(HostMessage::Rate { stream, period_us });
    for message in [
        rate(Stream::Battery, periods.battery),
        rate(Stream::Motors, periods.motors),
        rate(Stream::Imu, periods.imu),
        ToVehicle::Records(periods.records),
    ] {
        out.append(|b| message.encode(b));
    }
}

/// Whether a board has started again between two of its records, which arrived `elapsed` s apart. Then it knows no order and no
/// flight any more, or its clock did not go on as that of the base; its first messages may be lost. Records have a checksum and
/// keep their sequence.
fn restarted(before: &FlightPart, after: &FlightPart, elapsed: f64) -> bool {
    // In the board's time, which goes round.
    let expected = (1e6 * elapsed.max(0.0)) as u64 as u32;
    let off = after.time.wrapping_sub(before.time).wrapping_sub(expected) as i32;
    let forgets = |fact| before.facts.has(fact) && !after.facts.has(fact);
    before.answer.number() != 0 && after.answer.number() == 0
        || forgets(Facts::LANDED)
        || forgets(Facts::KILLED)
        || off.unsigned_abs() > CLOCK_OFF
}
