//! Sets up a console for a vehicle that flies itself, watches the flight, and reports how it ended.

use std::{
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
};

use rtrb::RingBuffer;
use tilthex_config::orders::Orders;
use tilthex_link::onboard::{Base, BaseParams};

use super::{
    args::{Control, LogTo, Setup},
    fly::{COMMAND_RING, PATIENCE, Peers, Running, recorder_params},
    report,
    status::{self, Says},
};
use crate::{
    Failure,
    carrier::Carrier,
    console::{Console, ConsoleParams},
    control::{ControlSocket, Desk, Way},
    flags::Flags,
    keys::{self, Keys},
    log::{Attachments, LogFile},
    output::{self, say},
    realtime::{acquire_control, acquire_helper, acquire_recorder},
    recorder::Recorder,
    signals,
    waiting::Waiting,
};

/// The key that holds.
const HOLD: u8 = b'H';
/// The vehicles that a console expects, and what they do without messages, in words.
const VEHICLES: (&str, &str) = ("a vehicle with tilthex on board", "holds, then lands by itself");

/// The arguments of a console.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    setup: Setup,

    #[command(flatten)]
    log: LogTo,

    #[command(flatten)]
    control: Control,

    /// Order the take-off as soon as the vehicle is ready
    #[arg(long)]
    take_off: bool,

    /// Records of the flight that the vehicle sends in a second
    #[arg(long, value_name = "HZ", default_value_t = 50.0)]
    record_rate: f64,
}

/// Runs a console until the vehicle has landed.
pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if args.setup.uri()?.is_some_and(|uri| uri.link.is_some()) {
        return Err(Failure::usage(
            "a console needs the serial port of a vehicle with tilthex on board; expected --port DEVICE or --port unix:PATH",
        ));
    }
    let config = args.setup.config(args.log.log.as_deref())?;
    tilthex_core::error::check_range("--record-rate", args.record_rate, 1.0, 100.0)?;
    let flags = Flags::default();
    signals::land_or_ignore(&flags.interrupted)?;
    let path = (!config.log().path.is_empty()).then(|| PathBuf::from(&config.log().path));
    if let Some(path) = &path {
        LogFile::check(path, args.log.overwrite)?;
    }
    let token = args.control.token()?;
    let Peers { name, port, client: _client, poses } =
        Peers::connect(&args.setup, &config, config.mocap().client()?, acquire_helper)?;
    if config.mocap().uri.is_empty() {
        output::error(format_args!(
            "tilthex-rt: warning: no pose source is named with --mocap; the vehicle cannot take off"
        ));
    }
    let log = path.map(|path| LogFile::create(&path, args.log.overwrite)).transpose()?;
    let attached = Attachments { take_off: args.take_off, on_board: true, ..Attachments::default() };
    let (recorder, feed, _) = Recorder::start(recorder_params(&config, log, attached, acquire_recorder))?;
    let (commands_in, commands) = RingBuffer::new(COMMAND_RING);
    let control = match &args.control.control {
        Some(address) => {
            let carrier = Carrier { admittance: config.controller().admittance };
            let way = Way::Board(commands_in, Box::new(carrier));
            let desk = Desk::new(Orders::new(&config), way, recorder.observer(), flags.clone());
            Some(ControlSocket::start(address, token, desk, acquire_control)?)
        }
        None => None,
    };
    if let Some(control) = &control {
        say!("control socket at {}", control.address());
    }
    let vehicle = config.vehicle().vehicle();
    let hold = Arc::new(AtomicBool::new(false));
    let mut console = Console {
        base: Base::new(BaseParams {
            rotor_count: vehicle.rotor_count(),
            tool: *vehicle.tool(),
            record_period_us: (1e6 / args.record_rate) as u32,
            battery_period_us: (1e6 / config.link().battery_rate) as u32,
        })?,
        port,
        poses,
        waiting: Waiting::new(commands),
        feed,
        flags: flags.clone(),
        hold: Arc::clone(&hold),
        params: ConsoleParams { take_off: args.take_off, patience: args.take_off.then_some(PATIENCE) },
    };
    let (say_end, end) = mpsc::sync_channel(1);
    std::thread::Builder::new()
        .name("console".into())
        .spawn(move || say_end.send(console.run()))
        .map_err(|e| Failure::machine(format!("the console's thread cannot be started: {e}")))?;
    let hold = (HOLD, Box::new(move || hold.store(true, Ordering::Relaxed)) as Box<dyn Fn() + Send>);
    let keys = Keys::watch(vec![keys::kill(&flags), hold], acquire_helper);
    if keys.is_some() {
        say!("Ctrl-C lands; the key H holds, and the key K stops the motors at once (capital letters)");
    }
    let end = status::watch(&Running { end }, &recorder.observer(), Says::Nothing);
    drop(keys);
    let recorded = recorder.finish();
    say!("records             {} at {} Hz", recorded.latest.statistics.ticks, args.record_rate);
    if let Some(control) = control.filter(|control| control.refused() > 0) {
        say!("control socket      {} requests refused", control.refused());
    }
    report::print_log(&config, &recorded);
    report::outcome(end, &name, VEHICLES, &flags, &recorded)
}
