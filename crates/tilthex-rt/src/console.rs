//! The base's end of a vehicle that flies itself: forwards poses and orders, and passes on what the vehicle tells.
//!
//! It is not a real-time loop. The vehicle does not need it in time: each pose says how old it is.

use std::{
    collections::VecDeque,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use rtrb::Consumer;
use rustix::{
    event::{PollFd, PollFlags, poll},
    time::Timespec,
};
use tilthex_core::{
    PoseSample,
    flight::Record,
    supervisor::{FaultSet, Phase, Reaction, TABLE},
};
use tilthex_link::{
    Outgoing, Severity, Text,
    onboard::{Base, Event, Facts, FlightPart, Order, REFUSED},
};
use tilthex_sim::feed::{Feed, Tick};

use crate::{
    app::status::clear,
    control_loop::End,
    flags::Flags,
    output,
    port::{Port, Written},
    realtime,
    sleeper::{Clock, Monotonic},
    waiting::Waiting,
};

/// Longest wait for bytes of the vehicle; a pose waits as long.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 2_000_000 };
/// Bytes that are read at once.
const CHUNK: usize = 1024;
/// After this silence of the vehicle, s, an interrupt ends the console, and the operator is told.
const SILENT: f64 = 1.0;
/// An interrupt before the start ends the console after this time, s: the vehicle must have heard it.
const CALLED_OFF: f64 = 0.5;

/// When the console ends by itself, and what it orders by itself.
#[derive(Clone, Copy, Debug)]
pub struct ConsoleParams {
    /// Whether to order the take-off as soon as the vehicle is ready.
    pub take_off: bool,
    /// Time in which the vehicle must begin to start its motors, s; `None` to wait for orders without a limit.
    pub patience: Option<f64>,
}

/// What the console works with.
pub struct Console {
    /// The base's end of the conversation.
    pub base: Base,
    /// The line to the vehicle.
    pub port: Port,
    /// Poses from motion capture.
    pub poses: Consumer<PoseSample>,
    /// Orders.
    pub waiting: Waiting,
    /// The ring to the recorder.
    pub feed: Feed,
    /// Flags of other threads: to land, to kill, and the time of the operator's last message.
    pub flags: Flags,
    /// Set by the key that holds; the console clears it.
    pub hold: Arc<AtomicBool>,
    /// When to order or end.
    pub params: ConsoleParams,
}

/// What the console keeps from look to look.
struct Memory {
    begin: f64,
    /// Texts that are not logged yet.
    texts: VecDeque<(Severity, Text)>,
    /// Why the vehicle has refused an order, until its answer comes.
    reason: Option<String>,
    take_off: bool,
    pose_seen: bool,
    flew: bool,
    /// The last that the vehicle told before its board started again.
    before: Option<FlightPart>,
    interrupted: Option<f64>,
    silent: bool,
    gone: bool,
    killed: Option<f64>,
}

impl Console {
    /// Runs until the flight is over.
    pub fn run(&mut self) -> End {
        // Poses shall not wait for a processor. Without the rights they may.
        realtime::acquire_helper();
        let begin = seconds();
        let mut memory = Memory {
            begin,
            texts: VecDeque::new(),
            reason: None,
            take_off: self.params.take_off,
            pose_seen: false,
            flew: false,
            before: None,
            interrupted: None,
            silent: false,
            gone: false,
            killed: None,
        };
        loop {
            // Whatever ends the wait, everything is looked at.
            let _ = poll(&mut [PollFd::new(&self.port, PollFlags::IN)], Some(&LOOK));
            self.receive(&mut memory);
            self.send(&mut memory);
            if let Some(end) = self.end(&mut memory) {
                let mut out = Outgoing::default();
                self.base.part(&mut out);
                self.port.write(out.bytes());
                self.waiting.clear("the console ends");
                return end;
            }
        }
    }

    /// Takes the bytes that have arrived.
    fn receive(&mut self, memory: &mut Memory) {
        let mut bytes = [0; CHUNK];
        let Some(count) = self.port.read(&mut bytes) else {
            memory.gone = true;
            return;
        };
        let Self { base, feed, waiting, .. } = self;
        base.receive(&bytes[..count], seconds(), &mut |event| match event {
            Event::Record(record) => {
                memory.flew |= record.phase.in_flight();
                feed.push(&tick(record, memory.texts.pop_front()));
            }
            Event::Text(severity, text) => {
                let said = text.to_string();
                say(&format!("the vehicle says: {said}"));
                memory.reason = said.strip_prefix(REFUSED).map(String::from).or(memory.reason.take());
                memory.texts.push_back((severity, text));
            }
            Event::Answered(_, true) => {
                memory.reason = None;
                waiting.settle(Ok(()));
            }
            Event::Answered(order, false) => {
                memory.take_off &= order != Order::TakeOff;
                let reason = memory.reason.take().map_or_else(String::new, |reason| format!(": {reason}"));
                waiting.settle(Err(&format!("the vehicle refuses it{reason}")));
            }
            Event::Unanswered(order) => {
                memory.reason = None;
                waiting.settle(Err(&unanswered(&order)));
            }
            Event::Restarted(before) => {
                (memory.before, memory.reason) = (Some(before), None);
                // They were given to a board that flew, or was ready.
                waiting.clear("the vehicle's board has started again");
                say("warning: the vehicle's board has started again");
            }
            Event::WrongPeriods(told) => say(&format!(
                "warning: the vehicle's streams had other periods than ordered, and are set again: {told}; check the line"
            )),
        });
    }

    /// Sends poses, orders and heartbeats.
    fn send(&mut self, memory: &mut Memory) {
        while let Ok(pose) = self.poses.pop() {
            memory.pose_seen |= pose.tracking_valid;
            let mut out = Outgoing::default();
            self.base.pose(&pose, seconds(), &mut out);
            memory.gone |= self.port.write(out.bytes()) == Written::Gone;
        }
        let now = seconds();
        if self.flags.kills() {
            self.waiting.clear("the motors are stopped");
            self.base.order(Order::Kill, now);
        } else if self.flags.lands() {
            self.waiting.clear("the vehicle lands");
            self.base.order(Order::Land, now);
        } else {
            self.pass_on(memory, now);
        }
        let silence = self.flags.operator_silence(Monotonic.now()) as f64 * 1e-9;
        let mut out = Outgoing::default();
        let Self { base, waiting, .. } = self;
        base.talk(now, silence, &mut out, &mut |event| {
            if let Event::Unanswered(order) = event {
                waiting.settle(Err(&unanswered(&order)));
            }
        });
        if !out.bytes().is_empty() {
            memory.gone |= self.port.write(out.bytes()) == Written::Gone;
        }
        let silent = self.base.flight().is_some() && self.base.silence(now) > SILENT;
        if silent && !memory.silent {
            say("warning: the vehicle is silent; without poses it holds, then lands by itself");
        }
        memory.silent = silent;
    }

    /// Gives the next order to the base.
    fn pass_on(&mut self, memory: &mut Memory, now: f64) {
        if self.hold.swap(false, Ordering::Relaxed) {
            self.waiting.clear("the vehicle was told to hold");
            self.waiting.push(Order::Hold, now);
        }
        let ready = |part: &FlightPart| part.phase == Phase::Disarmed && part.facts.has(Facts::ESTIMATES);
        if memory.take_off && self.base.flight().is_some_and(ready) {
            self.waiting.push(Order::TakeOff, now);
            memory.take_off = false;
        }
        let mut dropped = |order: &Order| {
            let name = order.name();
            say(&format!(
                "warning: the order to {name} has waited for the vehicle for too long, and is dropped"
            ));
        };
        if let Some(order) = self.waiting.next(self.base.takes_orders(), now, &mut dropped) {
            self.base.order(order, now);
        }
    }

    fn end(&self, memory: &mut Memory) -> Option<End> {
        let now = seconds();
        if self.base.refused() {
            return Some(End::NoVehicle);
        }
        if memory.gone {
            return Some(End::LinkLost { in_flight: memory.flew });
        }
        let interrupted = self.flags.lands().then(|| *memory.interrupted.get_or_insert(now));
        let waited = interrupted.is_some_and(|since| now - since >= CALLED_OFF);
        let Some(flight) = self.base.flight().filter(|_| !memory.silent) else {
            let silent = if memory.flew { End::LinkLost { in_flight: true } } else { End::Interrupted };
            return waited.then_some(silent);
        };
        if flight.facts.has(Facts::KILLED) {
            let since = *memory.killed.get_or_insert(now);
            return (now - since >= CALLED_OFF).then_some(End::Killed { in_flight: memory.flew });
        }
        if flight.phase != Phase::Disarmed {
            return None;
        }
        if memory.flew {
            return Some(ending(memory.before.as_ref(), flight));
        }
        if waited {
            return Some(End::Interrupted);
        }
        let late = self.params.patience.is_some_and(|limit| now - memory.begin >= limit);
        late.then(|| End::NotReady {
            estimator: None,
            faults: refusals(flight.faults),
            pose_seen: memory.pose_seen,
            link_ready: true,
            complaint: None,
        })
    }
}

/// How a flight has ended, from the newest part of a record, and from the last one `before` the board started again.
fn ending(before: Option<&FlightPart>, newest: &FlightPart) -> End {
    let told = [Some(newest), before].into_iter().flatten().find(|part| part.facts.has(Facts::LANDED));
    let fault = |part: &FlightPart| TABLE.get(usize::from(part.ended_by?)).map(|row| row.fault);
    told.map_or(End::NotLanded, |part| End::Landed(fault(part)))
}

/// Faults that keep the motors from starting.
fn refusals(active: FaultSet) -> FaultSet {
    let mut set = FaultSet::NONE;
    active.rows().for_each(|row| set.insert_if(row.fault, row.on_ground == Reaction::Refuse));
    set
}

/// A record for the log, with a text of the vehicle.
fn tick(record: Record, text: Option<(Severity, Text)>) -> Tick {
    let mut tick = Tick { record, ..Tick::default() };
    tick.wire.text = text;
    tick
}

/// Tells that an order was not answered, and returns it as the fate of its command.
fn unanswered(order: &Order) -> String {
    let found = format!("the vehicle does not answer to the order to {}; check the line", order.name());
    say(&format!("warning: {found}"));
    found
}

fn say(text: &str) {
    output::error(format_args!("{}tilthex-rt: {text}", clear()));
}

fn seconds() -> f64 {
    Monotonic.now() as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;
    use tilthex_core::supervisor::Fault;
    use tilthex_link::onboard::{Answer, RecordParts};

    #[test]
    fn motors_that_are_off_after_a_flight_are_no_landing() {
        let part = |facts: u8, fault: Option<Fault>| {
            let ended_by = fault.map(|fault| fault as u8);
            RecordParts::new(1, &Record::default(), Facts(facts), ended_by, Answer::Nothing).flight
        };
        let (landed, lost) = (part(Facts::LANDED, None), part(Facts::LANDED, Some(Fault::PoseLostLong)));
        let (flying, started) = (part(Facts::COMPLIANT, None), part(Facts::ESTIMATES, None));
        for (before, newest, end) in [
            (None, landed, End::Landed(None)),
            (None, lost, End::Landed(Some(Fault::PoseLostLong))),
            // The board starts again: in flight, and after a landing.
            (None, started, End::NotLanded),
            (Some(flying), started, End::NotLanded),
            (Some(lost), started, End::Landed(Some(Fault::PoseLostLong))),
        ] {
            assert_eq!(ending(before.as_ref(), &newest), end, "{before:?} {newest:?}");
        }
    }
}
