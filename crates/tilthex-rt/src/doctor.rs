//! Checks a computer before a flight and says what to correct.

use std::{
    fmt, fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

use rustix::thread::{CpuSet, sched_getaffinity};

use tilthex_config::Config;
use tilthex_mocap::{
    ClientParams,
    net::{Client, MocapUri},
};

use crate::{
    histogram::{Histogram, Quantiles},
    output::{self, Colour},
    port::{Port, latency_timer},
    realtime::{self, Demand},
    sleeper::{Clock, Monotonic, Nanos, Sleeper},
};

/// Number of wake-ups that are measured.
const WAKES: u32 = 1000;
/// Latest wake-up of a computer that is fit for real time, ns.
const LATE: Nanos = 500_000;
/// Number of bytes that are sent through a terminal, one in each period; and the longest wait for one of them.
const BYTES: u32 = 500;
const LONGEST_WAIT: Nanos = 200_000_000;
/// Longest accepted delays of the bytes, ns: of 99.9 % of them (one tick), and of all (then the IMU counts as silent).
const SLOW_LINE: (Nanos, Nanos) = (2_000_000, 50_000_000);
/// Time between two looks for a byte, ns.
const LOOK: Nanos = 50_000;
/// Time for which the doctor listens to motion capture.
const LISTEN: Duration = Duration::from_secs(1);

/// The result of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Good.
    Good,
    /// A flight is possible, but less good than it could be.
    Fair,
    /// It must be corrected before a flight.
    Bad,
}

/// One check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// The subject of the check.
    pub name: &'static str,
    /// Its result.
    pub verdict: Verdict,
    /// What was found, and how to correct it.
    pub text: String,
}

impl Verdict {
    /// The word for it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Good => "ok",
            Self::Fair => "fair",
            Self::Bad => "FAIL",
        }
    }
}

impl Verdict {
    /// The word as it is printed: as wide as the others, and on a terminal in its colour.
    fn printed(self) -> String {
        let colour = match self {
            Self::Good => Colour::Green,
            Self::Fair => Colour::Yellow,
            Self::Bad => Colour::Red,
        };
        output::coloured(&format!("{:5}", self.name()), colour)
    }
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:12} {}", self.verdict.printed(), self.name, self.text)
    }
}

/// The checks as JSON: `passed`, and `checks`, each with `name`, `verdict` (ok, fair, fail) and `text`.
#[must_use]
pub fn json(checks: &[Check]) -> serde_json::Value {
    let each = checks.iter().map(|check| {
        let verdict = check.verdict.name().to_ascii_lowercase();
        serde_json::json!({ "name": check.name, "verdict": verdict, "text": check.text })
    });
    let passed = checks.iter().all(|check| check.verdict != Verdict::Bad);
    serde_json::json!({ "passed": passed, "checks": each.collect::<Vec<_>>() })
}

fn check(name: &'static str, verdict: Verdict, text: impl Into<String>) -> Check {
    Check { name, verdict, text: text.into() }
}

/// Runs every check. Checks port and motion capture only if they are named.
#[must_use]
pub fn examine(config: &Config, port: Option<&str>, demand: Demand) -> Vec<Check> {
    let mut checks = vec![kernel(Path::new("/")), governor(Path::new("/sys"))];
    checks.extend(rights_and_wakes(demand));
    checks.push(clock(Path::new("/sys")));
    checks.push(line_delay(demand));
    checks.extend(port.map(|name| line(name, config.link().baud)).unwrap_or_default());
    if !config.mocap().uri.is_empty() {
        checks.push(capture(config));
    }
    checks
}

fn kernel(root: &Path) -> Check {
    let read = |path: &str| fs::read_to_string(root.join(path)).unwrap_or_default();
    let release = read("proc/sys/kernel/osrelease");
    let release = release.trim();
    if read("sys/kernel/realtime").trim() == "1" {
        check("kernel", Verdict::Good, format!("{release}, PREEMPT_RT"))
    } else if read("proc/version").contains("PREEMPT") {
        let text = format!(
            "{release}, preemptible but not PREEMPT_RT: install a real-time kernel for the best times"
        );
        check("kernel", Verdict::Fair, text)
    } else {
        check("kernel", Verdict::Bad, format!("{release} is not preemptible: install a real-time kernel"))
    }
}

fn governor(sys: &Path) -> Check {
    let cpus = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
    let file = |cpu: usize| sys.join(format!("devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor"));
    let slow: Vec<_> = (0..CpuSet::MAX_CPU)
        .filter(|cpu| cpus.is_set(*cpu))
        .filter_map(|cpu| fs::read_to_string(file(cpu)).ok().map(|text| (cpu, text)))
        .filter(|(_, text)| text.trim() != "performance")
        .collect();
    match slow.first() {
        None => check("governor", Verdict::Good, "no processor changes its speed by itself"),
        Some((cpu, text)) => check(
            "governor",
            Verdict::Fair,
            format!(
                "processor {cpu} follows \"{}\": run `sudo cpupower frequency-set -g performance`",
                text.trim()
            ),
        ),
    }
}

/// Asks for the real-time rights in a new thread, and measures how late this thread wakes.
fn rights_and_wakes(demand: Demand) -> Vec<Check> {
    let measured = std::thread::Builder::new().stack_size(realtime::LOOP_STACK).spawn(move || {
        let rights = realtime::acquire(demand);
        let period = Duration::from_millis(2);
        let mut sleeper = Sleeper::new(period, Monotonic.now() + period.as_nanos() as Nanos);
        let mut wakes = Histogram::default();
        for _ in 0..WAKES {
            wakes.record(sleeper.wait(&Monotonic).latency());
        }
        (rights, wakes.quantiles())
    });
    let Some((rights, wakes)) = measured.ok().and_then(|thread| thread.join().ok()) else {
        return vec![check("rights", Verdict::Bad, "no thread can be started")];
    };
    let mut checks = match rights {
        Ok(rights) if rights.warnings.is_empty() => {
            vec![check("rights", Verdict::Good, "SCHED_FIFO, locked memory and a processor are granted")]
        }
        Ok(rights) => rights.warnings.into_iter().map(|w| check("rights", Verdict::Fair, w)).collect(),
        Err(failure) => vec![check("rights", Verdict::Bad, failure.message)],
    };
    let verdict = if wakes.p999 > LATE { Verdict::Bad } else { Verdict::Good };
    checks.push(check("wake-up", verdict, format!("after the deadline, {} times: {wakes}", wakes.count)));
    checks
}

fn clock(sys: &Path) -> Check {
    let source = sys.join("devices/system/clocksource/clocksource0/current_clocksource");
    let source = fs::read_to_string(source).unwrap_or_default();
    match source.trim() {
        "" => check("clock", Verdict::Fair, "the kernel does not name its clock"),
        slow @ ("hpet" | "acpi_pm" | "jiffies") => check(
            "clock",
            Verdict::Bad,
            format!(
                "{slow} takes long to read: boot with `clocksource=tsc` if the processor's counter is stable"
            ),
        ),
        good => check("clock", Verdict::Good, good),
    }
}

/// Measures the delay of bytes through a terminal of the kernel while other threads keep every processor busy. A work queue
/// with ordinary priority moves the bytes.
fn line_delay(demand: Demand) -> Check {
    let busy = AtomicBool::new(true);
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let delays = std::thread::scope(|scope| {
        for _ in 0..2 * processors {
            scope.spawn(|| {
                while busy.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let delays = scope.spawn(move || delays(demand)).join();
        busy.store(false, Ordering::Relaxed);
        delays
    });
    let Ok(Ok(delays)) = delays else {
        return check(
            "line delay",
            Verdict::Fair,
            "it cannot be measured: the kernel gives no pseudo-terminal",
        );
    };
    let text = format!("a byte through the kernel's work queue, beside busy processors: {delays}");
    let (usual, longest) = SLOW_LINE;
    let verdict = match () {
        () if delays.max > longest => Verdict::Bad,
        () if delays.p999 > usual => Verdict::Fair,
        () => return check("line delay", Verdict::Good, text),
    };
    let mends = "run less beside it, keep the queue off the loop's processor (a mask in \
                 /sys/devices/virtual/workqueue/cpumask), or install a PREEMPT_RT kernel";
    check("line delay", verdict, format!("{text}: {mends}"))
}

/// The delays from one end of a pseudo-terminal to the other.
fn delays(demand: Demand) -> Result<Quantiles, crate::Failure> {
    // Rights that are refused have already been reported.
    let _rights = realtime::acquire(demand);
    let (mut far, path) =
        Port::pseudo_terminal().map_err(|e| crate::Failure::link(format!("no pseudo-terminal: {e}")))?;
    let mut near = Port::open(&path.to_string_lossy(), 0)?;
    let period = Duration::from_millis(2);
    let mut sleeper = Sleeper::new(period, Monotonic.now() + period.as_nanos() as Nanos);
    let mut delays = Histogram::default();
    for _ in 0..BYTES {
        sleeper.wait(&Monotonic);
        let sent = Monotonic.now();
        far.write(&[0]);
        while near.read(&mut [0; 16]) == Some(0) && Monotonic.now() - sent < LONGEST_WAIT {
            Monotonic.sleep_until(Monotonic.now() + LOOK);
        }
        delays.record(Monotonic.now() - sent);
    }
    Ok(delays.quantiles())
}

fn line(name: &str, baud: u32) -> Vec<Check> {
    match Port::open(name, baud) {
        Err(failure) => vec![check("port", Verdict::Bad, failure.message)],
        Ok(port) => {
            let timer = latency_timer(port.path(), Path::new("/sys"));
            let delay = timer.map_or("none".into(), |(_, ms): (PathBuf, u32)| format!("{ms} ms"));
            let speed = if baud > 0 { format!(" at {baud} baud") } else { String::new() };
            let text = format!("{} opens{speed}; delay of its adapter: {delay}", port.path().display());
            vec![check("port", Verdict::Good, text)]
        }
    }
}

fn capture(config: &Config) -> Check {
    let connect = || -> Result<_, crate::Failure> {
        let uri: MocapUri = config.mocap().uri.parse()?;
        let up_axis = config.mocap().up_axis()?;
        Ok(Client::start(&uri, ClientParams { up_axis, latency: 0.0 })?)
    };
    match connect() {
        Err(failure) => check("capture", Verdict::Bad, failure.message),
        Ok((client, _poses)) => {
            let before = client.status();
            std::thread::sleep(LISTEN);
            let now = client.status();
            let rate = f64::from(now.poses - before.poses) / LISTEN.as_secs_f64();
            let text = format!(
                "{rate:.0} poses per second, {:.1} ms old, {} lost, {} untracked",
                1e3 * now.latency,
                now.lost - before.lost,
                now.untracked - before.untracked
            );
            let verdict = if rate >= 50.0 { Verdict::Good } else { Verdict::Bad };
            check("capture", verdict, text)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tilthex_config::VehicleSection;

    #[test]
    fn every_check_says_something_and_a_bad_one_how_to_mend_it() {
        let config = Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset"));
        let checks = examine(&config, Some("/dev/no-such-port"), Demand::Off);
        let names: Vec<_> = checks.iter().map(|c| c.name).collect();
        assert_eq!(names, ["kernel", "governor", "rights", "wake-up", "clock", "line delay", "port"]);
        assert!(checks.iter().all(|c| !c.text.is_empty()));
        assert_eq!(checks[6].verdict, Verdict::Bad);
        assert!(checks[6].text.contains("does not exist"));
        let said = json(&checks);
        assert_eq!(said["passed"], false);
        let one = serde_json::json!({ "name": "port", "verdict": "fail", "text": checks[6].text });
        assert_eq!(said["checks"].as_array().map(|all| (all.len(), &all[6])), Some((7, &one)));
    }

    #[test]
    fn a_computer_that_needs_mending() {
        let root = tempfile::tempdir().expect("a directory");
        let write = |path: &str, text: &str| {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().expect("a parent")).expect("made");
            fs::write(path, text).expect("written");
        };
        write("proc/version", "Linux version 6.1 SMP");
        assert_eq!(kernel(root.path()).verdict, Verdict::Bad);
        write("sys/kernel/realtime", "1\n");
        assert_eq!(kernel(root.path()).verdict, Verdict::Good);
        let sys = root.path().join("sys");
        for cpu in 0..64 {
            write(&format!("sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor"), "powersave\n");
        }
        assert!(governor(&sys).text.contains("cpupower frequency-set -g performance"));
        write("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n");
        assert_eq!(clock(&sys).verdict, Verdict::Bad);
    }
}
