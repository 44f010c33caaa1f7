//! The summary at the end of a flight, and the exit status.

use std::sync::atomic::Ordering;

use nalgebra::Vector6;
use tilthex_core::{
    Vector3,
    supervisor::{Fault, TABLE},
};

use tilthex_config::Config;

use crate::{
    Failure, Kind, control_loop::End, flags::Flags, log::fault_names, output::say, recorder::Recorded,
    reference::Slept, sim::Report, summary::Deflection,
};

/// Prints the statistics of a flight.
pub(super) fn print(
    config: &Config,
    recorded: &Recorded,
    slept: Option<Slept>,
    simulated: Option<&Report>,
    refused_orders: u64,
) {
    let s = &recorded.latest.statistics;
    say!(
        "ticks               {} at {} Hz, {} with an inertial sample",
        s.ticks,
        config.link().imu_rate,
        s.with_imu
    );
    let machine = slept.map_or(String::new(), |slept| {
        format!(" (a thread that only sleeps skipped {} on this computer)", slept.skipped)
    });
    say!("late ticks          {} periods skipped{machine}", s.skipped);
    for (name, quantiles) in s.times() {
        say!("  {name:32}  {quantiles}");
    }
    if let Some(slept) = slept {
        say!("  {:32}  {}", "wake-up of that other thread", slept.wake);
    }
    if let Some(report) = simulated {
        say!("  {:32}  {}", "IMU byte out of vehicle to command in", report.imu_to_command);
    }
    if s.flew {
        say!(
            "tracking error      {:.1} mm rms, {:.1} mm at most",
            1e3 * s.tracking.rms(),
            1e3 * s.tracking.max
        );
    }
    if s.flew {
        say!(
            "latency of poses    {:.1} ms from capture to arrival, {:.1} ms at most",
            1e3 * s.latency.rms(),
            1e3 * s.latency.max
        );
        let parts: Vec<_> =
            s.given_up.iter().map(|(part, seconds)| format!("{} for {seconds:.2} s", part.name())).collect();
        let given_up = if parts.is_empty() { "nothing".into() } else { parts.join(", ") };
        say!("given up            {given_up}: parts of the wrench that the rotors' limits did not allow");
    }
    if simulated.is_some() && s.flew {
        say!(
            "tool force          estimate {:.3} N rms off the true one, {:.2} N at most",
            s.force.rms(),
            s.force.max
        );
    }
    if let Some(deflection) = &s.deflection {
        let (found, expected) = (deflection.tool_w.norm(), spring(config, deflection).norm());
        say!(
            "deflection          {:.1} mm under {:.2} N; the spring's (f - dead zone) / K is {:.1} mm: {:+.1} mm",
            1e3 * found,
            deflection.force_w.norm(),
            1e3 * expected,
            1e3 * (found - expected)
        );
    }
    if refused_orders > 0 {
        say!("control socket      {refused_orders} requests refused");
    }
    if recorded.latest.dropped > 0 {
        say!(
            "log                 {} ticks did not fit into the ring and are not logged",
            recorded.latest.dropped
        );
    }
    print_log(config, recorded);
}

/// Prints where the log is, and whether it is complete.
pub(super) fn print_log(config: &Config, recorded: &Recorded) {
    match (&recorded.latest.error, config.log().path.is_empty()) {
        (None, _) if recorded.moved => say!(
            "log                 {} is no longer there: it was moved or replaced in flight",
            config.log().path
        ),
        (Some(error), _) => say!("log                 {} breaks off: {error}", config.log().path),
        (None, false) => say!("log                 {}", config.log().path),
        (None, true) => {}
    }
    if let Some(path) = &recorded.black_box {
        say!("last 10 s           {}", path.display());
    }
}

/// The displacement of the configured spring by a push, at rest.
fn spring(config: &Config, deflection: &Deflection) -> Vector3 {
    let admittance = config.admittance();
    let norm = deflection.force_w.norm();
    let left = (norm - admittance.force_dead_zone).max(0.0) / norm;
    let f = deflection.force_w * left;
    let stiffness = admittance.stiffness.0;
    let solved = stiffness.lu().solve(&Vector6::new(f.x, f.y, f.z, 0.0, 0.0, 0.0));
    solved.map_or_else(|| Vector3::repeat(f64::NAN), |e| e.fixed_rows::<3>(0).into_owned())
}

/// The exit status of an end. `vehicles` says in words which vehicles are expected, and `alone` what they do without messages.
pub(super) fn outcome(
    end: Option<End>,
    port: &str,
    (vehicles, alone): (&str, &str),
    flags: &Flags,
    recorded: &Recorded,
) -> Result<(), Failure> {
    let asked = flags.interrupted.load(Ordering::Relaxed);
    match end {
        Some(End::Landed(None | Some(Fault::Operator))) if asked => {
            Err(interrupted("the vehicle has landed"))
        }
        Some(End::Landed(None | Some(Fault::Operator))) => Ok(()),
        Some(End::Landed(Some(fault))) => {
            let row = &TABLE[fault as usize];
            let remark = if row.remark.is_empty() { String::new() } else { format!("; {}", row.remark) };
            Err(Failure::fault(format!(
                "the vehicle landed because of a fault: {} ({}){remark}",
                row.name, row.detection
            )))
        }
        Some(End::NotLanded) => Err(Failure::fault(
            "the vehicle flew, and its motors are off, but it has told of no landing: its board has started again; look at the vehicle",
        )),
        Some(End::Interrupted) => Err(interrupted("the vehicle has not started")),
        Some(End::Killed { in_flight: true }) => {
            Err(Failure::fault("killed by order: the motors were stopped in flight, and the vehicle fell"))
        }
        Some(End::Killed { in_flight: false }) => {
            Err(Failure::fault("killed by order: the motors were stopped on the ground"))
        }
        Some(End::NoVehicle) => {
            let heard = match &recorded.latest.statistics.last_text {
                Some(text) => format!("the answer was \"{text}\""),
                None => "no answer could be decoded".into(),
            };
            Err(Failure::link(format!(
                "{port}: no vehicle identified itself: {heard}; expected {}: check port, power and speed of the line",
                vehicles
            )))
        }
        Some(End::LinkLost { in_flight: true }) => Err(Failure::link(format!(
            "{port} disappeared in flight: the vehicle {}; check cable and adapter",
            alone
        ))),
        Some(End::LinkLost { in_flight: false }) => {
            Err(Failure::link(format!("{port} disappeared: check cable and adapter")))
        }
        Some(End::Refused(_, Some(motor))) => {
            Err(Failure::fault(format!("the motors were not started: {motor}")))
        }
        Some(End::Refused(faults, None)) => {
            Err(Failure::fault(format!("the motors were not started: {}", causes(faults))))
        }
        Some(End::NotReady { complaint: Some(complaint), .. }) => {
            Err(Failure::link(format!("{port}: {complaint}")))
        }
        Some(End::NotReady { link_ready: false, .. }) => Err(Failure::link(format!(
            "{port}: the vehicle's streams did not start; check speed and load of the line"
        ))),
        Some(End::NotReady { faults, .. }) if !faults.is_empty() => {
            Err(Failure::fault(format!("not ready to start: {}", causes(faults))))
        }
        Some(End::NotReady { pose_seen: false, .. }) => Err(Failure::fault(
            "not ready to start: no pose arrived from motion capture; name it with --mocap, and check that the body is tracked",
        )),
        Some(End::NotReady { estimator: Some(reason), .. }) => {
            Err(Failure::fault(format!("not ready to start: {reason}")))
        }
        Some(End::NotReady { .. }) => Err(Failure::fault("not ready to start: the streams are not complete")),
        None => {
            Err(Failure::fault("the loop ended unexpectedly; the vehicle keeps the last command for 0.5 s"))
        }
    }
}

fn interrupted(how: &str) -> Failure {
    Failure { kind: Kind::Interrupted, message: format!("interrupted: {how}") }
}

fn causes(faults: tilthex_core::supervisor::FaultSet) -> String {
    let one = |row: &tilthex_core::supervisor::Row| {
        let remark = if row.remark.is_empty() { String::new() } else { format!(": {}", row.remark) };
        format!("{} ({}){remark}", row.name, row.detection)
    };
    let all: Vec<_> = faults.rows().map(one).collect();
    if all.is_empty() { fault_names(faults) } else { all.join("; ") }
}
