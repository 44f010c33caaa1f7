//! Runs a logged flight again from its raw inputs and compares every recorded output, bit for bit.

use std::{collections::VecDeque, fmt, path::Path};

use prost::Message;
use tilthex_config::{
    Config,
    orders::{self, Orders},
};
use tilthex_link::{LinkedFlight, LinkedOutput, WireInput};
use tilthex_sim::feed::{Tick, Timing};

use crate::{
    Failure,
    log::{Channel, LogReader, messages as m, schema, tick_messages},
};

/// The result of a replay.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Replay {
    /// Number of ticks that were run again.
    pub ticks: u64,
    /// Number of messages that were compared.
    pub messages: u64,
    /// The first message that differs: its tick and its topic.
    pub first_difference: Option<(u64, String)>,
    /// A sentence that says what is missing, if the log breaks off.
    pub missing: Option<String>,
}

impl Replay {
    /// The same for scripts.
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        let difference = self.first_difference.as_ref();
        let difference = difference.map(|(tick, topic)| serde_json::json!({ "tick": tick, "topic": topic }));
        serde_json::json!({
            "ticks": self.ticks,
            "messages": self.messages,
            "first_difference": difference,
            "missing": self.missing,
        })
    }
}

impl fmt::Display for Replay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} ticks, {} messages run again", self.ticks, self.messages)?;
        match (&self.first_difference, &self.missing) {
            (None, None) => writeln!(f, "every recorded output is reproduced bit for bit"),
            (None, Some(_)) => {
                writeln!(f, "every output in the log is reproduced bit for bit, but the log is cut")
            }
            (Some(_), _) => Ok(()),
        }
    }
}

/// Replays a log file.
///
/// # Errors
/// One sentence, if it is not a log of a flight, or ticks are missing.
pub fn file(path: &Path) -> Result<Replay, Failure> {
    let replayed = LogReader::open(path).and_then(|log| replay(&log));
    replayed.map_err(|e| Failure::usage(format!("{} {e}", path.display())))
}

/// Replays a log.
///
/// # Errors
/// If it is not a log of a flight, or ticks are missing: the part of a sentence that follows the log's name.
pub fn replay(log: &LogReader) -> Result<Replay, String> {
    let attachments = log.attachments();
    if attachments.on_board {
        return Err(
            "is the log of a console: the vehicle flew by itself, and the flight cannot be run again here"
                .into(),
        );
    }
    let set_up = |e: &dyn fmt::Display| format!("has a configuration that this version cannot read: {e}");
    let config = Config::from_text(&attachments.config, Path::new("")).map_err(|e| set_up(&e))?;
    let params = config.linked_params(attachments.take_off).map_err(|e| set_up(&e))?;
    let limits = config.mission().limits();
    let route = attachments.trajectory.as_deref().map(|text| orders::parse_route(text, &limits));
    let route = route.transpose().map_err(|e| set_up(&e))?;
    for channel in log.channels().values() {
        check(channel)?;
    }
    let mut lines = VecDeque::new();
    log.each(|channel, data| {
        if channel.topic == "/command" {
            let order = m::Command::decode(data).ok().filter(|order| !order.urgent);
            lines.extend(order.map(|order| order.json));
        }
    });
    let mut replayer = Replayer {
        linked: LinkedFlight::new(params, route).map_err(|e| set_up(&e))?,
        orders: Orders::new(&config),
        lines,
        rotor_count: params.flight.vehicle.rotor_count(),
        out: Box::default(),
        recorded: Vec::new(),
        found: Replay { missing: log.missing(), ..Replay::default() },
        broken: None,
    };
    log.each(|channel, data| replayer.take(&channel.topic, data));
    match (replayer.broken, log.missing()) {
        (Some(reason), _) => Err(format!("cannot be run again: {reason}")),
        (None, Some(missing)) if replayer.found.ticks == 0 => Err(format!("holds no whole tick: {missing}")),
        (None, None) if replayer.found.ticks == 0 => Err("holds no tick of a flight".into()),
        (None, _) => Ok(replayer.found),
    }
}

/// Refuses a channel that has a name of tilthex-rt but another schema.
fn check(channel: &Channel) -> Result<(), String> {
    let message = match channel.topic.as_str() {
        "/input" => "Input",
        "/output" => "Output",
        "/command" => "Command",
        _ => return Ok(()),
    };
    let expected = schema::full_name(message);
    if channel.schema == expected && channel.encoding == "protobuf" {
        return Ok(());
    }
    Err(format!(
        "is not a log of tilthex-rt: {} holds messages of \"{}\" ({}); expected {expected} (protobuf)",
        channel.topic,
        channel.schema.escape_debug(),
        channel.encoding.escape_debug()
    ))
}

struct Replayer {
    linked: LinkedFlight,
    orders: Orders,
    lines: VecDeque<String>,
    rotor_count: usize,
    out: Box<LinkedOutput>,
    /// The messages of the tick that is being read.
    recorded: Vec<(String, Vec<u8>)>,
    found: Replay,
    broken: Option<String>,
}

impl Replayer {
    fn take(&mut self, topic: &str, data: &[u8]) {
        let of_a_tick = !matches!(topic, "/command" | "/timing" | "/truth" | "/log" | "/tf");
        if self.broken.is_some() || !of_a_tick {
            return;
        }
        self.recorded.push((topic.into(), data.into()));
        // The output is the last message of a tick.
        if topic == "/output"
            && let Err(reason) = self.tick()
        {
            self.broken = Some(reason);
        }
    }

    fn tick(&mut self) -> Result<(), String> {
        let recorded = std::mem::take(&mut self.recorded);
        let input = recorded.iter().find(|(topic, _)| topic == "/input").ok_or("a tick without its input")?;
        let input = m::Input::decode(&*input.1).map_err(|e| format!("an input is damaged: {e}"))?;
        if input.tick != self.found.ticks {
            return Err(format!(
                "tick {} is missing: a replay needs a log from the first tick on, without gaps",
                self.found.ticks
            ));
        }
        let command = if input.command {
            let line = self
                .lines
                .pop_front()
                .ok_or_else(|| format!("the order of tick {} is missing", input.tick))?;
            Some(self.orders.parse(&line)?)
        } else {
            None
        };
        let poses = input.poses().ok_or_else(|| format!("a pose of tick {} is damaged", input.tick))?;
        let tick = WireInput {
            time: input.time,
            bytes: &input.link,
            poses: &poses,
            command: command.as_ref(),
            host: input.host(),
        };
        self.linked.tick(&tick, &mut self.out);
        self.found.ticks += 1;
        let again = tick_messages(&Tick::new(&self.out, Timing::default()), self.rotor_count);
        if again.len() != recorded.len() {
            return Err(format!(
                "tick {} has {} messages; expected {}",
                input.tick,
                recorded.len(),
                again.len()
            ));
        }
        for ((topic, data), (recorded_topic, recorded_data)) in again.iter().zip(&recorded) {
            self.found.messages += 1;
            if topic != recorded_topic || data != recorded_data {
                self.found.first_difference.get_or_insert_with(|| (input.tick, (*topic).into()));
            }
        }
        Ok(())
    }
}
