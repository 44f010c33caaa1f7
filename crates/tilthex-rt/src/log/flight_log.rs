//! The channels of a flight, and their content.

use std::io::Write;

use mcap::McapError;
use prost::{Message, Name};
use tilthex_core::supervisor::{FaultSet, Phase, TABLE};

use super::{
    messages::{FOXGLOVE, foxglove},
    schema::{DESCRIPTORS, full_name},
    values::{COMMAND, Order, REPLAYED, TIMED, TRUTH},
    viewers,
    writer::{Index, LogWriter, Topic},
};
use tilthex_sim::{Truth, feed::Tick};

/// Number of ticks from one log of the frames for 3D viewers to the next.
const TRANSFORM_EVERY: u64 = 5;

/// Converts times of the monotonic clock to times since 1970.
#[derive(Clone, Copy, Debug)]
pub struct Epoch {
    offset: i64,
}

impl Epoch {
    /// Compares the two clocks now.
    #[must_use]
    pub fn now() -> Self {
        use crate::sleeper::{Clock, Monotonic};
        let unix = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        Self { offset: unix.as_nanos() as i64 - Monotonic.now() as i64 }
    }

    /// Converts a monotonic time in seconds to nanoseconds since 1970.
    #[must_use]
    pub fn unix_ns(self, time: f64) -> u64 {
        (self.offset + (time * 1e9) as i64).max(0) as u64
    }
}

/// The attachments of a log. Together with the inputs they are all that a replay needs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attachments {
    /// The complete effective configuration, TOML.
    pub config: String,
    /// The trajectory file, TOML, if one was flown.
    pub trajectory: Option<String>,
    /// Whether the vehicle took off without an order.
    pub take_off: bool,
    /// Whether the vehicle flew by itself: the log holds what it told, and nothing from which the flight could be run again.
    pub on_board: bool,
}

/// Names of the attachments and of the metadata.
pub(super) const CONFIG: &str = "config.toml";
pub(super) const TRAJECTORY: &str = "trajectory.toml";
pub(super) const METADATA: &str = "tilthex";
pub(super) const TAKE_OFF: &str = "take_off";
pub(super) const ON_BOARD: &str = "on_board";
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
    of_a_tick: [Topic; REPLAYED.len()],
    timing: Topic,
    command: Topic,
    truth: Topic,
    lines: Topic,
    transforms: Topic,
}

/// A topic, and its message of a tick.
pub type TickMessage = (&'static str, Vec<u8>);

/// The messages of a tick that depend only on its inputs, in the order in which they are logged. `rotor_count` is the
/// vehicle's number of rotors.
#[must_use]
pub fn tick_messages(tick: &Tick, rotor_count: usize) -> [TickMessage; REPLAYED.len()] {
    std::array::from_fn(|i| {
        let mut message = Vec::new();
        REPLAYED[i].encode(tick, rotor_count, &mut message);
        (REPLAYED[i].topic, message)
    })
}

impl<W: Write> FlightLog<W> {
    /// Begins a log: writes channels, schemas and attachments.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn new(
        file: W,
        index: Index,
        epoch: Epoch,
        rotor_count: usize,
        attachments: &Attachments,
    ) -> Result<Self, McapError> {
        let mut log = LogWriter::new(file, index)?;
        let mut topic = |topic, message: &str| log.topic(topic, &full_name(message), &DESCRIPTORS);
        let timing = topic(TIMED.topic, TIMED.message())?;
        let mut of_a_tick = [timing; REPLAYED.len()];
        for (slot, channel) in of_a_tick.iter_mut().zip(&REPLAYED) {
            *slot = topic(channel.topic, channel.message())?;
        }
        let (command, truth) = (topic("/command", COMMAND.name)?, topic("/truth", TRUTH.name)?);
        let lines = log.topic("/log", &foxglove::Log::full_name(), FOXGLOVE)?;
        let transforms = log.topic("/tf", &foxglove::FrameTransform::full_name(), FOXGLOVE)?;
        let topics = Topics { of_a_tick, timing, command, truth, lines, transforms };
        let begun = epoch.unix_ns(0.0);
        log.attach(CONFIG, TOML, attachments.config.as_bytes(), begun)?;
        if let Some(trajectory) = &attachments.trajectory {
            log.attach(TRAJECTORY, TOML, trajectory.as_bytes(), begun)?;
        }
        let metadata = [
            (TAKE_OFF.to_string(), attachments.take_off.to_string()),
            (ON_BOARD.to_string(), attachments.on_board.to_string()),
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
    /// Errors of the file.
    pub fn tick(&mut self, tick: &Tick) -> Result<(), McapError> {
        let (t, record) = (self.topics, &tick.record);
        let time = self.epoch.unix_ns(record.input.time);
        let (log, rotor_count) = (&mut self.log, self.rotor_count);
        for (topic, channel) in t.of_a_tick.iter().zip(&REPLAYED) {
            log.put(*topic, time, |out| channel.encode(tick, rotor_count, out))?;
        }
        log.put(t.timing, time, |out| TIMED.encode(tick, rotor_count, out))?;
        if record.tick.is_multiple_of(TRANSFORM_EVERY) {
            let reference = &record.reference;
            let robot = viewers::robot_transform(time, &record.state);
            log.put(t.transforms, time, |out| robot.encode_raw(out))?;
            let reference =
                viewers::transform(time, "tool_reference", &reference.position_w, &reference.rotation_we);
            log.put(t.transforms, time, |out| reference.encode_raw(out))?;
        }
        self.changes(tick, time)
    }

    /// Logs a line for each text from the vehicle, new phase and new fault.
    fn changes(&mut self, tick: &Tick, time: u64) -> Result<(), McapError> {
        let record = &tick.record;
        if let Some((severity, text)) = tick.wire.text {
            self.line_at(time, viewers::level(severity), "vehicle", text.to_string())?;
        }
        let level = foxglove::log::Level::Warning;
        for row in FaultSet(record.faults.0 & !self.last_faults.0).rows() {
            self.line_at(time, level, "fault", format!("{}: {}", row.name, row.detection))?;
        }
        for row in FaultSet(self.last_faults.0 & !record.faults.0).rows() {
            self.line_at(time, level, "fault", format!("{} is over", row.name))?;
        }
        if record.phase != self.last_phase {
            let text = format!("{} -> {}", self.last_phase.name(), record.phase.name());
            self.line_at(time, foxglove::log::Level::Info, "phase", text)?;
        }
        (self.last_phase, self.last_faults) = (record.phase, record.faults);
        Ok(())
    }

    fn line_at(
        &mut self,
        time: u64,
        level: foxglove::log::Level,
        name: &str,
        text: String,
    ) -> Result<(), McapError> {
        let line = viewers::line(time, level, name, text);
        self.log.put(self.topics.lines, time, |out| line.encode_raw(out))
    }

    /// Logs an order as the client sent it, at a monotonic time in seconds. An urgent order is also a flag of the next input.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn command(&mut self, time: f64, json: &str, urgent: bool) -> Result<(), McapError> {
        let at = self.epoch.unix_ns(time);
        let order = Order { json: json.into(), urgent };
        self.log.put(self.topics.command, at, |out| COMMAND.encode(&order, 0, out))
    }

    /// Logs the true state of the simulated vehicle at a monotonic time in seconds.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn truth(&mut self, time: f64, truth: &Truth) -> Result<(), McapError> {
        let at = self.epoch.unix_ns(time);
        let (timed, rotor_count) = ((time, *truth), self.rotor_count);
        self.log.put(self.topics.truth, at, |out| TRUTH.encode(&timed, rotor_count, out))
    }

    /// Writes all data that are still in memory.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn flush(&mut self) -> Result<(), McapError> {
        self.log.flush()
    }

    /// Ends the log with its index.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn finish(self) -> Result<W, McapError> {
        self.log.finish()
    }
}

/// The names of faults, separated by commas.
#[must_use]
pub fn fault_names(faults: FaultSet) -> String {
    let names: Vec<_> = TABLE.iter().filter(|row| faults.contains(row.fault)).map(|row| row.name).collect();
    names.join(", ")
}
