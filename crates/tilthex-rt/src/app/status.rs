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

/// Prints the status until the loop ends, and why the link is not ready.
pub(super) fn watch(running: &Running, observer: &Observer) -> Option<End> {
    let terminal = output::is_terminal();
    let begin = Instant::now();
    let mut complaints = Complaints::default();
    let end = loop {
        let pause = if terminal { ON_A_TERMINAL } else { IN_A_FILE };
        match running.end.recv_timeout(pause) {
            Ok(end) => break Some(end),
            Err(RecvTimeoutError::Disconnected) => break None,
            Err(RecvTimeoutError::Timeout) => {
                let latest = observer.latest();
                if let Some(complaint) = latest.tick.as_ref().and_then(|tick| complaints.next(tick)) {
                    let clear = if terminal { "\r\x1b[K" } else { "" };
                    output::error(format_args!("{clear}tilthex-rt: warning: {complaint}"));
                }
                let line = line(begin.elapsed().as_secs_f64(), &latest);
                output::text(if terminal { format!("\r{line}\x1b[K") } else { format!("{line}\n") });
            }
        }
    };
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
