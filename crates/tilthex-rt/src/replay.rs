//! Runs a logged flight again from its raw inputs and compares every recorded output, bit for bit.

use std::{collections::VecDeque, path::Path};

use prost::Message;
use tilthex_config::{
    Config,
    orders::{self, Orders},
};
use tilthex_core::{PoseSample, flight::HostFacts};
use tilthex_link::{LinkedFlight, LinkedOutput, WireInput};

use crate::{
    Failure,
    log::{LogReader, TickMessages, convert::pose_from, messages as m},
};

/// What a replay found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Replay {
    /// Ticks that were run again.
    pub ticks: u64,
    /// Messages that were compared.
    pub messages: u64,
    /// The first that came out otherwise: tick and topic.
    pub first_difference: Option<(u64, String)>,
}

/// Replays a log file.
///
/// # Errors
/// One sentence, where it is no log of a flight, or not a complete one.
pub fn file(path: &Path) -> Result<Replay, Failure> {
    let log = LogReader::open(path)
        .map_err(|e| Failure::usage(format!("{}: can not be read: {e}", path.display())))?;
    replay(&log).map_err(|e| Failure::usage(format!("{}: {e}", path.display())))
}

/// Replays a log.
///
/// # Errors
/// One sentence, where it is no log of a flight, or not a complete one.
pub fn replay(log: &LogReader) -> Result<Replay, String> {
    let attachments = log.attachments().map_err(|e| format!("is no MCAP file: {e}"))?;
    if attachments.config.is_empty() {
        return Err("is no MCAP log of a flight: no set-up is attached".into());
    }
    let config = Config::from_text(&attachments.config, Path::new("")).map_err(|e| e.to_string())?;
    let params = config.linked_params(attachments.take_off).map_err(|e| e.to_string())?;
    let limits = config.mission.limits();
    let route = attachments.trajectory.map(|text| orders::parse_route(&text, &limits)).transpose()?;
    let mut lines = VecDeque::new();
    log.each(|topic, data| {
        if topic == "/command" {
            lines.extend(m::Command::decode(data).map(|command| command.json));
        }
    })
    .map_err(|e| format!("is no MCAP file: {e}"))?;
    let mut replayer = Replayer {
        linked: LinkedFlight::new(params, route).map_err(|e| e.to_string())?,
        orders: Orders::new(limits, params.flight.controller.admittance),
        lines,
        rotor_count: params.flight.vehicle.rotor_count(),
        out: Box::default(),
        recorded: Vec::new(),
        found: Replay::default(),
        broken: None,
    };
    log.each(|topic, data| replayer.take(topic, data)).map_err(|e| format!("is no MCAP file: {e}"))?;
    match replayer.broken {
        Some(reason) => Err(reason),
        None if replayer.found.ticks == 0 => Err("holds no tick of a flight".into()),
        None => Ok(replayer.found),
    }
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
        // The output is logged last.
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
        let poses: Option<Vec<PoseSample>> = input.poses.iter().map(pose_from).collect();
        let poses = poses.ok_or_else(|| format!("a pose of tick {} is damaged", input.tick))?;
        let host = HostFacts { land: input.land, link_lost: input.link_lost, log_lost: input.log_lost };
        let tick = WireInput {
            time: input.time,
            bytes: &input.link,
            poses: &poses,
            command: command.as_ref(),
            host,
        };
        self.linked.tick(&tick, &mut self.out);
        self.found.ticks += 1;
        let again = TickMessages::new(&self.out.commanded.record, &self.out.wire, self.rotor_count).encoded();
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
