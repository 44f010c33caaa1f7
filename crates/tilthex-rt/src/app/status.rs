//! The live status: one line, printed by another thread than the loop's.

use std::{
    sync::mpsc::RecvTimeoutError,
    time::{Duration, Instant},
};

use tilthex_core::supervisor::Phase;
use tilthex_link::Complaint;
use tilthex_sim::feed::Tick;

use super::fly::Running;
use crate::{
    control_loop::End,
    log::fault_names,
    output,
    recorder::{Latest, Observer},
};

const ON_A_TERMINAL: Duration = Duration::from_millis(200);
const IN_A_FILE: Duration = Duration::from_secs(2);

/// A complaint of the link is printed after it has lasted for this time: a board opens its streams one after the other.
const LASTS: Duration = Duration::from_secs(5);

/// Decides when to print a complaint of the link: once each time that the link begins to complain.
#[derive(Default)]
struct Complaints {
    since: Option<Instant>,
    said: bool,
}

impl Complaints {
    /// Takes the newest tick, and returns the complaint that must be printed now. After the start, faults report it instead.
    fn next(&mut self, tick: &Tick) -> Option<Complaint> {
        let Some(complaint) = tick.complaint.filter(|_| tick.record.phase == Phase::Disarmed) else {
            *self = Self::default();
            return None;
        };
        let lasts = self.since.get_or_insert_with(Instant::now).elapsed() >= LASTS;
        (lasts && !std::mem::replace(&mut self.said, lasts)).then_some(complaint)
    }
}

/// Decides when to print a text of the vehicle: once each time that it changes.
#[derive(Default)]
struct Texts {
    said: Option<String>,
}

impl Texts {
    /// Takes the newest text, and returns it if it must be printed now.
    fn next(&mut self, newest: Option<&String>) -> Option<&str> {
        if newest.is_none() || newest == self.said.as_ref() {
            return None;
        }
        self.said = newest.cloned();
        self.said.as_deref()
    }
}

/// The texts of the vehicle that are printed here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Says {
    /// The last one, when it has changed.
    Last,
    /// None: the console prints all of them.
    Nothing,
}

/// What begins a line beside the status line.
pub(crate) fn clear() -> &'static str {
    if output::is_terminal() { "\r\x1b[K" } else { "" }
}

/// Prints the status until the loop ends, why the link is not ready, and what the vehicle says.
pub(super) fn watch(running: &Running, observer: &Observer, says: Says) -> Option<End> {
    let terminal = output::is_terminal();
    let begin = Instant::now();
    let (mut complaints, mut texts) = (Complaints::default(), Texts::default());
    let clear = clear();
    let mut say = |latest: &Latest| {
        let newest = latest.statistics.last_text.as_ref().filter(|_| says == Says::Last);
        if let Some(text) = texts.next(newest) {
            output::error(format_args!("{clear}tilthex-rt: the vehicle says: {text}"));
        }
    };
    let end = loop {
        let pause = if terminal { ON_A_TERMINAL } else { IN_A_FILE };
        match running.end.recv_timeout(pause) {
            Ok(end) => break Some(end),
            Err(RecvTimeoutError::Disconnected) => break None,
            Err(RecvTimeoutError::Timeout) => {
                let latest = observer.latest();
                say(&latest);
                if let Some(complaint) = latest.tick.as_ref().and_then(|tick| complaints.next(tick)) {
                    output::error(format_args!("{clear}tilthex-rt: warning: {complaint}"));
                }
                let line = line(begin.elapsed().as_secs_f64(), &latest);
                output::text(if terminal { format!("\r{line}\x1b[K") } else { format!("{line}\n") });
            }
        }
    };
    say(&observer.latest());
    if terminal {
        output::line("");
    }
    end
}

fn line(elapsed: f64, latest: &Latest) -> String {
    let Some(tick) = &latest.tick else { return format!("{elapsed:6.1} s  no tick yet") };
    let record = &tick.record;
    let tool = &record.reference.position_w;
    let force = &record.wrench_tool_w.force;
    let mut line = format!("{elapsed:6.1} s  {:9}", record.phase.name());
    if record.phase.in_flight() {
        line += &format!(
            "  tool [{:+.3} {:+.3} {:+.3}] m  force [{:+.2} {:+.2} {:+.2}] N  error {:4.1} mm",
            tool.x,
            tool.y,
            tool.z,
            force.x,
            force.y,
            force.z,
            1e3 * record.position_error_w.norm()
        );
    }
    if record.battery.is_finite() {
        line += &format!("  battery {:.1} V", record.battery);
    }
    line += &format!("  late {}", latest.statistics.skipped);
    if !record.faults.is_empty() {
        line += &format!("  [{}]", fault_names(record.faults));
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_printed_once_each_time_that_it_changes() {
        let mut texts = Texts::default();
        let [first, second] = ["PX4 has left the offboard mode", "low battery"].map(String::from);
        let heard = [None, Some(&first), Some(&first), Some(&second), Some(&first)];
        let printed: Vec<_> =
            heard.into_iter().filter_map(|text| texts.next(text).map(str::to_owned)).collect();
        assert_eq!(printed, [first.clone(), second, first]);
    }
}
