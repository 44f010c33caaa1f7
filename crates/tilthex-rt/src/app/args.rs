//! The arguments of `tilthex-rt`.

use std::path::{Path, PathBuf};

use clap::{Parser, Subcommand};
use toml::{Table, Value};

use tilthex_config::{Config, ConfigError, VehicleSection};

use super::campaign::{Flights, Results};
use crate::{
    Failure,
    completion::Completion,
    control::{DEFAULT_ADDRESS, Token},
    realtime::Demand,
    vehicle_uri::VehicleUri,
};

/// Flies a fully actuated multirotor as an end-effector.
///
/// Exit status: 0 done; 2 wrong arguments or configuration, or a failed check of doctor; 3 the vehicle or motion capture
/// does not answer; 4 a fault or the order kill ended the flight, a replay differs from its log, or a flight of a campaign
/// failed; 5 a replayed log breaks off; 6 this computer denies what the program needs; 130 interrupted (the vehicle
/// landed).
#[derive(Clone, Debug, Parser)]
#[command(version, max_term_width = 100, args_conflicts_with_subcommands = true)]
pub struct Args {
    #[command(subcommand)]
    pub(super) action: Option<Action>,

    #[command(flatten)]
    pub(super) setup: Setup,

    #[command(flatten)]
    pub(super) rights: Rights,

    /// Way-points to fly after take-off [default: hover]
    #[arg(long, value_name = "FILE.toml")]
    pub trajectory: Option<PathBuf>,

    #[command(flatten)]
    pub(super) log: LogTo,

    /// Land this many seconds after take-off [default: when the trajectory ends, or on Ctrl-C]
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,

    /// Fly a simulated vehicle with simulated motion capture, in place of --port
    #[arg(long, conflicts_with_all = ["port", "mocap"])]
    pub sim: bool,

    /// With --sim: a file of pushes on the tool, tables `[[push]]` with `at` (s since the first motor was ordered to
    /// start), `duration` (s), `force` (N) and `torque` (N m), world axes
    #[arg(long, value_name = "FILE.toml", requires = "sim")]
    pub pushes: Option<PathBuf>,

    /// With --sim: push the tool with the wrench in UDP packets that arrive at this port of 127.0.0.1 (0 for any free
    /// port, which is printed): force and torque, six little-endian f64, N and N m, world axes. A push ends 0.3 s
    /// after its last packet
    #[arg(long, value_name = "PORT", requires = "sim")]
    pub push_port: Option<u16>,

    /// With --sim: how the simulated vehicle differs from the model: exact, measured, cad, outdoors, or a TOML file
    /// with a `[truth]` table
    #[arg(long, value_name = "LEVEL", requires = "sim")]
    pub truth: Option<String>,

    /// With --sim: seed of the simulated vehicle and its sensors' noise
    #[arg(long, requires = "sim", default_value_t = 1)]
    pub seed: u64,

    /// Start the motors and take off as soon as everything is ready. Without this option only the order take_off, which
    /// comes through --control, starts them
    #[arg(long)]
    pub take_off: bool,

    #[command(flatten)]
    pub(super) control: Control,

    /// Fly the vehicle at --port although the configuration has no battery voltage at which it must land
    #[arg(long)]
    pub no_battery_limits: bool,

    /// Also run a thread that only sleeps, and report its delays for comparison; always with --sim
    #[arg(long)]
    pub reference: bool,

    /// Print the complete configuration and end
    #[arg(long)]
    pub print_config: bool,
}

/// The vehicle, its configuration and how they are reached.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Setup {
    /// The vehicle's serial port: a path, or the USB serial number of its adapter; unix:PATH for tilthex-sim --socket;
    /// px4://PORT[?baud=N] or px4+udp://:PORT for a PX4
    #[arg(long, value_name = "DEV")]
    pub(super) port: Option<String>,

    /// Speed of the serial line, bits/s; 0 does not change it [default: the configuration's]
    #[arg(long, value_name = "N")]
    pub(super) baud: Option<u32>,

    /// The configuration to fly with [default: that of the preset tilt-hex]
    #[arg(long, value_name = "FILE.toml")]
    pub(super) config: Option<PathBuf>,

    /// Source of the poses, such as natnet://192.168.1.2/TILTHEX [default: the configuration's]
    #[arg(long, value_name = "URI")]
    pub(super) mocap: Option<String>,
}

/// What the loop demands of this computer.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Rights {
    /// What to do if this computer denies real-time rights
    #[arg(long, value_enum, default_value = "prefer")]
    pub(super) realtime: Demand,
}

/// The log of a flight.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct LogTo {
    /// The log to write [default: the configuration's]
    #[arg(long, value_name = "FILE.mcap")]
    pub(super) log: Option<PathBuf>,

    /// Replace the log's file if it exists
    #[arg(long)]
    pub(super) overwrite: bool,
}

/// Orders of other programs.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Control {
    /// Take orders at this address, for example from `tilthex.connect()`: ADDRESS:PORT, or unix:PATH for a socket
    /// that only this user may use
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = DEFAULT_ADDRESS)]
    pub(super) control: Option<String>,

    /// Take orders only from clients that first send the token in this file; needed if other computers can reach
    /// ADDRESS
    #[arg(long, value_name = "FILE", requires = "control")]
    pub(super) control_token_file: Option<PathBuf>,
}

/// An action instead of a flight.
#[derive(Clone, Debug, Subcommand)]
pub(super) enum Action {
    /// Check this computer before a flight, and say what to correct
    Doctor {
        #[command(flatten)]
        setup: Setup,
        #[command(flatten)]
        rights: Rights,
        /// Print the result as one JSON object, for scripts
        #[arg(long)]
        json: bool,
    },
    /// Print the script with which a shell completes this command
    Completion(Completion),
    /// Forward poses and orders to a vehicle that flies itself with tilthex on board, show what it tells, and log it
    Console(super::console::Args),
    /// Run a logged flight again from its raw inputs and compare every output, bit for bit
    Replay {
        /// The log
        log: PathBuf,
        /// Print the result as one JSON object, for scripts
        #[arg(long)]
        json: bool,
    },
    /// Fly many flights with random faults, in simulation on virtual time
    #[command(args_conflicts_with_subcommands = true)]
    Campaign {
        #[command(flatten)]
        flights: Flights,
        #[command(subcommand)]
        results: Option<Results>,
    },
}

impl Args {
    /// Refuses a flight that no order could start, and one whose battery has no limits.
    ///
    /// # Errors
    /// One sentence.
    pub fn check_start(&self, config: &Config) -> Result<(), Failure> {
        let limited = config.supervisor().battery_low > 0.0 && config.supervisor().battery_critical > 0.0;
        if self.setup.port.is_some() && !limited && !self.no_battery_limits {
            return Err(Failure::usage(
                "the battery has no limits: give battery_low and battery_critical (V) in [supervisor] of the configuration, or \
                 fly without them with --no-battery-limits",
            ));
        }
        if self.take_off || self.control.control.is_some() || !(self.sim || self.setup.port.is_some()) {
            return Ok(());
        }
        Err(Failure::usage(
            "nothing can start the motors; give --take-off, or --control for the order take_off",
        ))
    }

    /// The configuration that the arguments name.
    ///
    /// # Errors
    /// One sentence: the file, the section, the key.
    pub fn config(&self) -> Result<Config, Failure> {
        let config = self.setup.config(self.log.log.as_deref())?;
        if self.duration.is_some_and(|s| !s.is_finite() || s < 0.0) {
            return Err(Failure::usage("--duration is not a time; expected seconds, 0 or more"));
        }
        Ok(config)
    }
}

impl Control {
    /// The token that every client must send first, if the arguments name one.
    ///
    /// # Errors
    /// One sentence: the file cannot be read, or holds no token.
    pub(super) fn token(&self) -> Result<Option<Token>, Failure> {
        self.control_token_file.as_deref().map(Token::read).transpose()
    }
}

impl Setup {
    /// The vehicle's port.
    ///
    /// # Errors
    /// One sentence: it is no port.
    pub(super) fn uri(&self) -> Result<Option<VehicleUri>, Failure> {
        self.port.as_deref().map(VehicleUri::parse).transpose()
    }

    /// The configuration that the arguments name, which writes to another log if one is given.
    ///
    /// # Errors
    /// One sentence: the file, the section, the key.
    pub(super) fn config(&self, log: Option<&Path>) -> Result<Config, Failure> {
        let mut changes = Table::new();
        let mut change = |section: &str, key: &str, value: Option<Value>| {
            let section = changes.entry(section).or_insert_with(|| Value::Table(Table::new()));
            if let (Some(value), Some(section)) = (value, section.as_table_mut()) {
                section.insert(key.into(), value);
            }
        };
        let uri = self.uri()?;
        let named = uri.as_ref().and_then(|uri| uri.baud);
        if let (Some(one), Some(other)) = (self.baud, named)
            && one != other
        {
            let port = self.port.as_deref().unwrap_or_default();
            return Err(Failure::usage(if other == 0 {
                format!("--baud {one} cannot be set: --port {port} is not a serial line; leave --baud out")
            } else {
                format!("--baud is {one}, but --port {port} says {other}; expected one of the two")
            }));
        }
        let link = uri.and_then(|uri| uri.link);
        change("link", "protocol", link.map(|link| link.name().into()));
        change("link", "baud", self.baud.or(named).map(|baud| i64::from(baud).into()));
        change("mocap", "uri", self.mocap.clone().map(Value::String));
        change("log", "path", log.map(|path| path.display().to_string().into()));
        Ok(read(self.config.as_deref())?.overlaid(changes)?)
    }
}

/// The configuration in a file; without one that of the preset.
///
/// # Errors
/// One sentence: the file, the section, the key.
pub(super) fn read(path: Option<&Path>) -> Result<Config, ConfigError> {
    match path {
        Some(path) => Config::from_file(path),
        None => VehicleSection::preset("tilt-hex").map(Config::default_for),
    }
}
