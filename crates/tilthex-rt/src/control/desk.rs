//! The desk decides about orders: who may give them, whether they can be obeyed now, and how they reach the loop.

use std::sync::{Mutex, MutexGuard, PoisonError};

use rtrb::Producer;
use tilthex_config::orders::{Orders, Place};
use tilthex_core::{flight::Command, supervisor::Phase};
use tilthex_link::onboard::Order;

use super::places::Id;
use crate::{
    carrier::Carrier,
    flags::Flags,
    recorder::{Latest, Observer},
    sleeper::Nanos,
    waiting::{Asked, Fate},
};

/// The way of orders to the flight.
#[derive(Debug)]
pub enum Way {
    /// To the loop, which obeys in its next tick.
    Loop(Producer<Command>),
    /// Through a console to a vehicle that flies itself, and which answers.
    Board(Producer<Asked>, Box<Carrier>),
}

impl Way {
    fn is_full(&self) -> bool {
        match self {
            Self::Loop(ring) => ring.is_full(),
            Self::Board(ring, _) => ring.is_full(),
        }
    }

    /// The orders to the vehicle that carry a command out; none if the loop carries it out itself.
    fn orders(&self, command: &Command) -> Result<Vec<Order>, &'static str> {
        match self {
            Self::Loop(_) => Ok(Vec::new()),
            Self::Board(ring, _) if ring.is_abandoned() => Err("the console has ended"),
            Self::Board(_, carrier) => carrier.orders(command),
        }
    }

    /// Passes a command on, or its orders. Returns where its fate will come, if it is not certain now.
    fn push(&mut self, command: Command, orders: Vec<Order>) -> Result<Option<Fate>, &'static str> {
        let passed = match self {
            Self::Loop(ring) => ring.push(command).ok().map(|()| None),
            Self::Board(ring, _) => {
                let fate = Fate::default();
                ring.push(Asked { orders, fate: fate.clone() }).ok().map(|()| Some(fate))
            }
        };
        passed.ok_or("the loop takes no orders")
    }
}

/// Passes orders to the loop and to the log, in the same sequence.
#[derive(Debug)]
pub struct Desk {
    counter: Mutex<Counter>,
    observer: Observer,
    flags: Flags,
}

/// State that only one order at a time may change.
#[derive(Debug)]
struct Counter {
    orders: Orders,
    way: Way,
    /// A change of the admittance that the vehicle has not answered, and the parser after it.
    change: Option<(Fate, Orders)>,
    holder: Option<(Id, String)>,
    /// Whether the newest motion order was a set-point of a stream.
    streams: bool,
}

impl Counter {
    /// Takes what the vehicle has answered to a change: the parser changes only with the vehicle.
    fn settle(&mut self) {
        let Some(done) = self.change.as_ref().and_then(|(fate, _)| fate.get().map(Result::is_ok)) else {
            return;
        };
        if let Some((_, orders)) = self.change.take().filter(|_| done) {
            self.orders = orders;
        }
    }
}

/// An order that is executed before all others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Urgent {
    Kill,
    Land,
}

/// The client that gives an order.
#[derive(Clone, Debug)]
pub(super) struct Client {
    pub(super) id: Id,
    pub(super) name: String,
}

impl Desk {
    /// A desk that parses with `orders`, and passes orders to the flight (`way`, `flags`) and to the recorder (`observer`).
    #[must_use]
    pub fn new(orders: Orders, way: Way, observer: Observer, flags: Flags) -> Self {
        let counter = Mutex::new(Counter { orders, way, change: None, holder: None, streams: false });
        Self { counter, observer, flags }
    }

    fn counter(&self) -> MutexGuard<'_, Counter> {
        self.counter.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn observer(&self) -> &Observer {
        &self.observer
    }

    /// Executes an urgent order of any client at once. Never waits.
    pub(super) fn urgent(&self, order: Urgent, line: String, now: Nanos) {
        match order {
            Urgent::Kill => self.flags.kill(),
            Urgent::Land => self.flags.land(),
        }
        self.observer.command(now as f64 * 1e-9, line, true);
    }

    /// Takes an order of a client and passes it to the flight. Returns where its fate comes if only the vehicle knows it.
    ///
    /// # Errors
    /// One sentence: another client holds the controls, the order is wrong, or it cannot be obeyed now.
    pub(super) fn order(
        &self,
        client: &Client,
        name: &str,
        line: String,
        now: Nanos,
    ) -> Result<Option<Fate>, String> {
        let (situation, place) =
            self.observer.look(|latest| (Situation::of(latest, &self.flags), place(latest)));
        let mut counter = self.counter();
        counter.settle();
        match &counter.holder {
            Some((id, holder)) if *id != client.id => {
                return Err(format!(
                    "{name}: {holder} holds the controls; take_controls takes them; kill and land do not need them"
                ));
            }
            _ => {}
        }
        // Only an accepted order may change the parser's state.
        let mut orders = counter.orders.clone();
        let command = orders.parse(&line)?;
        if let Some(reason) = situation.refusal(&command, counter.streams) {
            return Err(format!("{name}: {reason}"));
        }
        let changes = matches!(command, Command::SetAdmittance(_));
        if changes && counter.change.is_some() {
            return Err(format!(
                "{name}: the vehicle has not answered to the change before; wait for its answer"
            ));
        }
        let passed = counter.way.orders(&command).map_err(|reason| format!("{name}: {reason}"))?;
        if let Some(place) = place {
            orders.check_place(&command, &place)?;
        }
        if counter.way.is_full() {
            return Err("the loop has not taken the orders before this one; try again".into());
        }
        match &command {
            Command::Follow(_) => counter.streams = true,
            Command::Play(_) => counter.streams = false,
            _ => {}
        }
        // The recorder gets the order first, so that it is logged before the record in which it acts.
        self.observer.command(now as f64 * 1e-9, line, false);
        counter.holder = Some((client.id, client.name.clone()));
        // From now on the operator must send messages, if this order moves the vehicle or an earlier one has.
        if moves(&command) || self.flags.has_operator() {
            self.flags.hear(now);
        }
        let fate = counter.way.push(command, passed)?;
        match &fate {
            Some(fate) if changes => counter.change = Some((fate.clone(), orders)),
            Some(_) => {}
            None => counter.orders = orders,
        }
        Ok(fate)
    }

    /// The configuration of the flight as TOML, with the changes by orders.
    pub(super) fn configuration(&self) -> String {
        let mut counter = self.counter();
        counter.settle();
        let orders = counter.orders.clone();
        drop(counter);
        orders.configuration()
    }

    /// Gives the controls to a client, even if another client holds them.
    pub(super) fn take_controls(&self, client: &Client, now: Nanos) {
        self.counter().holder = Some((client.id, client.name.clone()));
        self.hear(client.id, now);
    }

    /// Notes that a client has sent a complete line.
    pub(super) fn hear(&self, client: Id, now: Nanos) {
        if self.flags.has_operator() && self.holder().is_some_and(|(id, _)| id == client) {
            self.flags.hear(now);
        }
    }

    /// The client that holds the controls.
    pub(super) fn holder(&self) -> Option<(Id, String)> {
        self.counter().holder.clone()
    }

    /// Notes that a client is gone. If it held the controls, they are free.
    pub(super) fn leave(&self, client: Id) {
        self.counter().holder.take_if(|(id, _)| *id == client);
    }
}

/// The place from which an order is judged; `None` before the first pose.
fn place(latest: &Latest) -> Option<Place> {
    let record = &latest.tick.as_ref()?.record;
    let start_w = record.start_w?;
    let reference = (record.reference.position_w, record.reference.rotation_we);
    Some(Place { start_w, tool_w: record.phase.in_flight().then_some(reference) })
}

/// Whether the client that gave this order must keep sending messages.
fn moves(command: &Command) -> bool {
    match command {
        Command::TakeOff | Command::Play(_) | Command::Follow(_) | Command::SetWrench(..) => true,
        Command::SetAdmittance(_) | Command::ReleaseWrench | Command::ZeroBias => false,
    }
}

/// The facts that decide whether an order can be obeyed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Situation {
    phase: Phase,
    flew: bool,
    killed: bool,
    lands: bool,
    compliant: bool,
}

impl Situation {
    fn of(latest: &Latest, flags: &Flags) -> Self {
        let record = latest.tick.as_ref().map(|tick| &tick.record);
        Self {
            phase: record.map_or(Phase::Disarmed, |record| record.phase),
            flew: latest.statistics.flew,
            killed: flags.kills(),
            lands: flags.lands(),
            compliant: record.is_some_and(|record| record.compliant),
        }
    }

    /// Why an order must be refused, because the flight would ignore it.
    fn refusal(&self, command: &Command, streams: bool) -> Option<&'static str> {
        let aloft = self.phase.in_flight();
        let landing = self.lands || matches!(self.phase, Phase::Landing | Phase::Emergency);
        match command {
            _ if self.killed => Some("the motors have been killed; the flight is over"),
            _ if landing => Some("the vehicle lands; only kill and land are accepted now"),
            _ if self.flew && !aloft => Some("the flight is over"),
            Command::TakeOff if self.phase != Phase::Disarmed => Some("the vehicle has taken off already"),
            Command::Follow(_) | Command::ZeroBias if !aloft => {
                Some("the vehicle does not fly; send take_off, and wait until the state says compliant")
            }
            Command::Follow(_) if !self.compliant => Some(
                "take-off or the learning of the bias is not complete; wait until the state says compliant",
            ),
            Command::ZeroBias if streams => Some(
                "set-points are streamed, and the bias is learnt in a hover; fly to a place with play first",
            ),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tilthex_core::{Matrix3, Setpoint, Vector3};

    const HOVER: Situation =
        Situation { phase: Phase::Flying, flew: true, killed: false, lands: false, compliant: true };

    fn follow() -> Command {
        Command::Follow(Setpoint::hold(Vector3::zeros(), Matrix3::identity()))
    }

    #[test]
    fn what_would_be_ignored_is_refused() {
        let ground = Situation::default();
        let learning = Situation { compliant: false, ..HOVER };
        for (situation, command, streams, says) in [
            (ground, Command::TakeOff, false, None),
            (ground, follow(), false, Some("does not fly")),
            (ground, Command::ZeroBias, false, Some("does not fly")),
            (Situation { phase: Phase::Grounded, ..ground }, Command::TakeOff, false, Some("already")),
            (HOVER, Command::TakeOff, false, Some("already")),
            (HOVER, follow(), true, None),
            (learning, follow(), false, Some("bias")),
            (HOVER, Command::ZeroBias, false, None),
            (HOVER, Command::ZeroBias, true, Some("streamed")),
            (Situation { lands: true, ..HOVER }, Command::ReleaseWrench, false, Some("lands")),
            (Situation { phase: Phase::Landing, ..HOVER }, follow(), false, Some("lands")),
            (Situation { phase: Phase::Emergency, ..HOVER }, Command::ZeroBias, false, Some("lands")),
            (Situation { killed: true, ..ground }, Command::TakeOff, false, Some("killed")),
            (Situation { phase: Phase::Disarmed, ..HOVER }, Command::TakeOff, false, Some("over")),
        ] {
            let found = situation.refusal(&command, streams);
            match says {
                None => assert_eq!(found, None, "{situation:?} {command:?}"),
                Some(says) => {
                    assert!(found.is_some_and(|found| found.contains(says)), "{situation:?} {found:?}")
                }
            }
        }
    }
}
