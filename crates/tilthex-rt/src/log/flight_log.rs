//! The channels of a flight and what goes into each.

use std::io::Write;

use mcap::McapError;
use tilthex_core::supervisor::{FaultSet, Phase, TABLE};

use super::{
    convert::{self, TickMessages},
    messages::{self as m, foxglove},
    writer::{Index, LogWriter, Stamp, Topic},
};
use tilthex_sim::{Truth, feed::Tick};

/// Frames for 3D viewers are logged every so many ticks.
const TRANSFORM_EVERY: u64 = 5;

/// From the monotonic clock to time since 1970.
#[derive(Clone, Copy, Debug)]
pub struct Epoch {
    offset: i64,
}

impl Epoch {
    /// From the two clocks now.
    #[must_use]
    pub fn now() -> Self {
        use crate::sleeper::{Clock, Monotonic};
        let unix = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        Self { offset: unix.as_nanos() as i64 - Monotonic.now() as i64 }
    }

    /// Nanoseconds since 1970 of a monotonic time in seconds.
    #[must_use]
    pub fn unix_ns(self, time: f64) -> u64 {
        (self.offset + (time * 1e9) as i64).max(0) as u64
    }
}

/// What a log is attached: with the inputs, all that a replay needs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attachments {
    /// The complete effective configuration, TOML.
    pub config: String,
    /// The trajectory file, TOML, where one was flown.
    pub trajectory: Option<String>,
    /// Whether it took off without an order.
    pub take_off: bool,
}

/// Names of the attachments and of the metadata.
pub(super) const CONFIG: &str = "config.toml";
pub(super) const TRAJECTORY: &str = "trajectory.toml";
pub(super) const METADATA: &str = "tilthex";
pub(super) const TAKE_OFF: &str = "take_off";
const TOML: &str = "application/toml";

/// A log with all channels of a flight.
pub struct FlightLog<W: Write> {
    log: LogWriter<W>,
    topics: Topics,
    epoch: Epoch,
    rotor_count: usize,
    last_phase: Phase,
    last_faults: FaultSet,
}

#[derive(Clone, Copy)]
struct Topics {
    state: Topic,
    setpoint: Topic,
    reference: Topic,
    wrench: Topic,
    control: Topic,
    rotors: Topic,
    flight: Topic,
    link: Topic,
    model: Topic,
    timing: Topic,
    input: Topic,
    output: Topic,
    command: Topic,
    truth: Topic,
    lines: Topic,
    transforms: Topic,
}

impl<W: Write> FlightLog<W> {
    /// Begins a log: channels, schemas, attachments.
    ///
    /// # Errors
    /// What the file says.
    pub fn new(
        file: W,
        index: Index,
        epoch: Epoch,
        rotor_count: usize,
        attachments: &Attachments,
    ) -> Result<Self, McapError> {
        let mut log = LogWriter::new(file, index)?;
        let topics = Topics {
            state: log.topic::<m::State>("/state")?,
            setpoint: log.topic::<m::Target>("/setpoint")?,
            reference: log.topic::<m::Target>("/reference")?,
            wrench: log.topic::<m::Wrenches>("/wrench")?,
            control: log.topic::<m::Control>("/control")?,
            rotors: log.topic::<m::Rotors>("/rotors")?,
            flight: log.topic::<m::Flight>("/flight")?,
            link: log.topic::<m::Link>("/link")?,
            model: log.topic::<m::Model>("/model")?,
            timing: log.topic::<m::Timing>("/timing")?,
            input: log.topic::<m::Input>("/input")?,
            output: log.topic::<m::Output>("/output")?,
            command: log.topic::<m::Command>("/command")?,
            truth: log.topic::<m::Truth>("/truth")?,
            lines: log.topic::<foxglove::Log>("/log")?,
            transforms: log.topic::<foxglove::FrameTransform>("/tf")?,
        };
        let begun = epoch.unix_ns(0.0);
        log.attach(CONFIG, TOML, attachments.config.as_bytes(), begun)?;
        if let Some(trajectory) = &attachments.trajectory {
            log.attach(TRAJECTORY, TOML, trajectory.as_bytes(), begun)?;
        }
        let metadata = [
            (TAKE_OFF.to_string(), attachments.take_off.to_string()),
            ("version".to_string(), env!("CARGO_PKG_VERSION").to_string()),
        ];
        log.metadata(METADATA, metadata.into())?;
        log.flush()?;
        let (last_phase, last_faults) = (Phase::Disarmed, FaultSet::NONE);
        Ok(Self { log, topics, epoch, rotor_count, last_phase, last_faults })
    }

    /// Logs a tick.
    ///
    /// # Errors
    /// What the file says.
    pub fn tick(&mut self, tick: &Tick) -> Result<(), McapError> {
        let (t, record, timing) = (self.topics, &tick.record, &tick.timing);
        let publish = self.epoch.unix_ns(record.input.time);
        let stamp = Stamp { publish, log: publish + timing.compute };
        let messages = TickMessages::new(record, &tick.wire, self.rotor_count);
        let log = &mut self.log;
        log.put(t.state, stamp, &messages.state)?;
        log.put(t.setpoint, stamp, &messages.setpoint)?;
        log.put(t.reference, stamp, &messages.reference)?;
        log.put(t.wrench, stamp, &messages.wrench)?;
        log.put(t.control, stamp, &messages.control)?;
        log.put(t.rotors, stamp, &messages.rotors)?;
        log.put(t.flight, stamp, &messages.flight)?;
        log.put(t.link, stamp, &messages.link)?;
        log.put(t.model, stamp, &messages.model)?;
        log.put(t.input, stamp, &messages.input)?;
        log.put(t.output, stamp, &messages.output)?;
        let timing = m::Timing {
            wake_latency: timing.wake_latency,
            compute: timing.compute,
            period: timing.period,
            skipped: timing.skipped,
            imu_to_command: timing.imu_to_command,
            polls: timing.polls,
            short_writes: timing.short_writes,
        };
        log.put(t.timing, stamp, &timing)?;
        if record.tick.is_multiple_of(TRANSFORM_EVERY) {
            let reference = &record.reference;
            log.put(t.transforms, stamp, &convert::robot_transform(publish, &record.state))?;
            let reference =
                convert::transform(publish, "tool_reference", &reference.position_w, &reference.rotation_we);
            log.put(t.transforms, stamp, &reference)?;
        }
        self.changes(tick, stamp)
    }

    /// A line for each text from the vehicle, new phase and new fault.
    fn changes(&mut self, tick: &Tick, stamp: Stamp) -> Result<(), McapError> {
        let record = &tick.record;
        if let Some((severity, text)) = tick.wire.text {
            self.line_at(stamp, convert::level(severity), "vehicle", text.to_string())?;
        }
        let level = foxglove::log::Level::Warning;
        for row in FaultSet(record.faults.0 & !self.last_faults.0).rows() {
            self.line_at(stamp, level, "fault", format!("{}: {}", row.name, row.detection))?;
        }
        for row in FaultSet(self.last_faults.0 & !record.faults.0).rows() {
            self.line_at(stamp, level, "fault", format!("{} is over", row.name))?;
        }
        if record.phase != self.last_phase {
            let text = format!("{} -> {}", self.last_phase.name(), record.phase.name());
            self.line_at(stamp, foxglove::log::Level::Info, "phase", text)?;
        }
        (self.last_phase, self.last_faults) = (record.phase, record.faults);
        Ok(())
    }

    fn line_at(
        &mut self,
        stamp: Stamp,
        level: foxglove::log::Level,
        name: &str,
        text: String,
    ) -> Result<(), McapError> {
        self.log.put(self.topics.lines, stamp, &convert::line(stamp.publish, level, name, text))
    }

    /// Logs an order, as it was given at a monotonic time in seconds; an urgent one is a flag of the next input.
    ///
    /// # Errors
    /// What the file says.
    pub fn command(&mut self, time: f64, json: &str, urgent: bool) -> Result<(), McapError> {
        let at = self.epoch.unix_ns(time);
        self.log.put(
            self.topics.command,
            Stamp { publish: at, log: at },
            &m::Command { json: json.into(), urgent },
        )
    }

    /// Logs what is true of the simulated vehicle at a monotonic time in seconds.
    ///
    /// # Errors
    /// What the file says.
    pub fn truth(&mut self, time: f64, truth: &Truth) -> Result<(), McapError> {
        let at = self.epoch.unix_ns(time);
        let message = convert::truth(time, truth, self.rotor_count);
        self.log.put(self.topics.truth, Stamp { publish: at, log: at }, &message)
    }

    /// Writes what is held back.
    ///
    /// # Errors
    /// What the file says.
    pub fn flush(&mut self) -> Result<(), McapError> {
        self.log.flush()
    }

    /// Ends the log with its index.
    ///
    /// # Errors
    /// What the file says.
    pub fn finish(self) -> Result<W, McapError> {
        self.log.finish()
    }
}

/// The names of faults, comma separated.
#[must_use]
pub fn fault_names(faults: FaultSet) -> String {
    let names: Vec<_> = TABLE.iter().filter(|row| faults.contains(row.fault)).map(|row| row.name).collect();
    names.join(", ")
}
