//! Sets up a flight, watches it, and reports how it ended.

use std::{path::PathBuf, sync::mpsc, time::Duration};

use rtrb::{Consumer, RingBuffer};
use tilthex_config::{
    Config, TruthSection,
    orders::{self, Orders},
};
use tilthex_core::{PoseSample, Wrench, flight::Command};
use tilthex_link::{LinkedFlight, board::LinkBoard};
use tilthex_mocap::{
    ClientParams,
    net::{Client, LineParams, MocapUri},
};
use tilthex_sim::{Own, Pushes, Simulation, SimulationParams};

use super::{
    Args,
    args::Setup,
    report,
    status::{self, Says},
};
use crate::{
    Failure,
    control::{ControlSocket, Desk, Way},
    control_loop::{ControlLoop, End, LoopParams},
    flags::Flags,
    keys::{self, Keys},
    log::{Attachments, LogFile},
    output::{self, say},
    port::Port,
    realtime::{self, Demand},
    recorder::{Recorder, RecorderParams, TruthFeed},
    reference::Reference,
    signals,
    sim::{CAPTURE_EVERY, Capture, Hand, Server, board},
    vehicle_uri::VehicleUri,
};

/// Time from the exposure of a simulated camera to the sending of the pose, s.
const CAPTURE_LATENCY: f64 = 0.008;
/// Number of orders that can wait for the loop.
pub(super) const COMMAND_RING: usize = 8;
/// Longest time for which a start without orders waits until everything is ready, s.
pub(super) const PATIENCE: f64 = 30.0;

/// Flies.
pub(super) fn fly(args: &Args) -> Result<(), Failure> {
    let config = args.config()?;
    for warning in config.warnings() {
        output::error(format_args!("tilthex-rt: warning: {warning}"));
    }
    let params = config.linked_params(args.take_off)?;
    let trajectory = args.trajectory.as_deref().map(orders::read_file).transpose()?;
    let route = match (&trajectory, &args.trajectory) {
        (Some(text), Some(path)) => {
            let route = orders::parse_route(text, &config.mission().limits());
            Some(route.map_err(|e| Failure::usage(format!("{}: {e}", path.display())))?)
        }
        _ => None,
    };
    let kind = params.kind;
    let linked = LinkedFlight::new(params, route)?;
    let flags = Flags::default();
    signals::land_or_ignore(&flags.interrupted)?;
    let log = (!config.log().path.is_empty()).then(|| PathBuf::from(&config.log().path));
    if let Some(path) = &log {
        LogFile::check(path, args.log.overwrite)?;
    }
    let token = args.control.token()?;
    let client = config.mocap().client()?;
    args.check_start(&config)?;
    // The log is created, and an old one replaced, only after the vehicle and motion capture have been found.
    let rights = args.rights.realtime;
    let helper = rights.first(realtime::acquire_helper);
    let real = if args.sim { None } else { Some(Peers::connect(&args.setup, &config, client, helper)?) };
    let log = log.map(|path| LogFile::create(&path, args.log.overwrite)).transpose()?;
    let (recorder, feed, truths) = {
        let take_off = params.flight.take_off;
        let attached = Attachments { trajectory, take_off, ..Attachments::default() };
        Recorder::start(recorder_params(&config, log, attached, rights.first(realtime::acquire_recorder)))?
    };
    let (commands_in, commands) = RingBuffer::<Command>::new(COMMAND_RING);
    let orders = Orders::new(&config);
    let control = match &args.control.control {
        Some(address) => {
            let desk = Desk::new(orders, Way::Loop(commands_in), recorder.observer(), flags.clone());
            Some(ControlSocket::start(address, token, desk, rights.first(realtime::acquire_control))?)
        }
        None => None,
    };
    if let Some(control) = &control {
        say!("control socket at {}", control.address());
    }
    let (simulated, peers) = match real {
        Some(peers) => (None, peers),
        None => {
            let (capture, uri) = Capture::on_loopback(
                client.up_axis,
                LineParams { latency: CAPTURE_LATENCY, ..LineParams::default() },
            )?;
            let server = simulate(args, &config, capture, truths)?;
            let peers = Peers::open(server.path().display().to_string(), 0, Some(&uri), client, helper)?;
            (Some(server), peers)
        }
    };
    let Peers { name, port, client: _client, poses } = peers;
    let period = Duration::from_secs_f64(1.0 / config.link().imu_rate);
    let control_loop = ControlLoop {
        linked,
        port,
        poses,
        commands,
        feed,
        flags: flags.clone(),
        params: LoopParams {
            period,
            duration: args.duration,
            land_after_route: args.trajectory.is_some(),
            operator_timeout: config.supervisor().operator_timeout(),
            patience: args.take_off.then_some(PATIENCE),
        },
    };
    let running = start(control_loop, rights)?;
    let reference = (args.sim || args.reference).then(|| Reference::start(period, rights).ok()).flatten();
    let keys = Keys::watch(vec![keys::kill(&flags)], helper);
    if keys.is_some() {
        say!("Ctrl-C lands; the key K (capital letter) stops the motors at once");
    }
    let end = status::watch(&running, &recorder.observer(), Says::Last);
    drop(keys);
    let slept = reference.map(Reference::stop);
    let simulated = simulated.map(Server::stop);
    let recorded = recorder.finish();
    let refused_orders = control.map_or(0, |control| control.refused());
    report::print(&config, &recorded, slept, simulated.as_ref(), refused_orders);
    report::outcome(end, &name, (kind.vehicles(), kind.alone()), &flags, &recorded)
}

/// The vehicle and the motion capture.
pub(super) struct Peers {
    pub(super) name: String,
    pub(super) port: Port,
    pub(super) client: Option<Client>,
    pub(super) poses: Consumer<PoseSample>,
}

impl Peers {
    /// Connects to those that the arguments and the configuration name. The capture's thread does `first` first.
    pub(super) fn connect(
        setup: &Setup,
        config: &Config,
        client: ClientParams,
        first: fn(),
    ) -> Result<Self, Failure> {
        let Some(port) = &setup.port else {
            return Err(Failure::usage(
                "no vehicle is named; name its port with --port, or fly a simulated one with --sim",
            ));
        };
        let uri = &config.mocap().uri;
        let uri = (!uri.is_empty()).then(|| uri.parse::<MocapUri>()).transpose()?;
        Self::open(VehicleUri::parse(port)?.name, config.link().baud, uri.as_ref(), client, first)
    }

    fn open(
        name: String,
        baud: u32,
        uri: Option<&MocapUri>,
        client: ClientParams,
        first: fn(),
    ) -> Result<Self, Failure> {
        let port = Port::open(&name, baud)?;
        let (client, poses) = match uri {
            Some(uri) => {
                let (client, poses) =
                    Client::start_with(uri, client, first).map_err(|e| Failure::link(e.to_string()))?;
                (Some(client), poses)
            }
            None => (None, RingBuffer::new(1).1),
        };
        Ok(Self { name, port, client, poses })
    }
}

/// The running loop. It sends its end.
pub(super) struct Running {
    pub(super) end: mpsc::Receiver<End>,
}

/// Starts the loop's thread, and waits until it has asked for its rights.
fn start(mut control_loop: ControlLoop, demand: Demand) -> Result<Running, Failure> {
    let (say_rights, rights) = mpsc::sync_channel(1);
    let (say_end, end) = mpsc::sync_channel(1);
    std::thread::Builder::new()
        .name("loop".into())
        .stack_size(realtime::LOOP_STACK)
        .spawn(move || {
            let rights = realtime::acquire(demand);
            let refused = rights.is_err();
            // Kept open: if it is closed, the processor sleeps deeply again.
            let (held, said) = match rights {
                Ok(rights) => (Some(rights.held), Ok(rights.warnings)),
                Err(failure) => (None, Err(failure)),
            };
            let _ = say_rights.send(said);
            if !refused {
                let _ = say_end.send(control_loop.run());
            }
            drop(held);
        })
        .map_err(|e| Failure::machine(format!("the loop's thread cannot be started: {e}")))?;
    let warnings =
        rights.recv().map_err(|_| Failure::machine("the loop's thread ended before it began"))??;
    for warning in warnings {
        output::error(format_args!("tilthex-rt: warning: {warning}"));
    }
    Ok(Running { end })
}

/// The recorder's parameters: its log, and what is attached to it.
pub(super) fn recorder_params(
    config: &Config,
    log: Option<LogFile>,
    attached: Attachments,
    first: fn(),
) -> RecorderParams {
    let black_box = log.as_ref().map_or_else(
        || {
            let unix = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
            PathBuf::from(format!("tilthex-fault-{}.mcap", unix.as_secs()))
        },
        |log| log.path().with_extension("fault.mcap"),
    );
    RecorderParams {
        log,
        black_box,
        attachments: Attachments { config: config.to_toml(), ..attached },
        rotor_count: config.vehicle().vehicle().rotor_count(),
        first,
    }
}

/// Starts the simulated vehicle and its motion capture.
fn simulate(
    args: &Args,
    config: &Config,
    mut capture: Capture,
    mut truths: TruthFeed,
) -> Result<Server, Failure> {
    let truth = TruthSection::named(args.truth.as_deref().unwrap_or("exact"));
    let drawn = truth.and_then(|truth| truth.draw(config.vehicle(), args.seed));
    let mut params = SimulationParams::of(&drawn?)?;
    if let Some(path) = &args.pushes {
        params.pushes = Pushes::read(path)?;
    }
    let mut hand = args.push_port.map(hand).transpose()?;
    let board = board(config, &params)?;
    let simulation = Simulation::with_board(params, board);
    let mut cycle = 0_u64;
    let observer = move |at, simulation: &mut Simulation<Own, LinkBoard>| {
        cycle += 1;
        if cycle.is_multiple_of(CAPTURE_EVERY) {
            if let Some(hand) = &mut hand {
                simulation.disturb(hand.wrench(at), Wrench::ZERO);
            }
            capture.show(at, simulation);
            let _ = truths.push((at as f64 * 1e-9, simulation.truth()));
        }
    };
    Server::start(simulation, Box::new(observer), None, None)
        .map_err(|e| Failure::link(format!("the simulated vehicle has no pseudo-terminal: {e}")))
}

/// Listens for pushes of the tool, and prints the port.
fn hand(port: u16) -> Result<Hand, Failure> {
    let listening = Hand::new(port).and_then(|hand| Ok((hand.port()?, hand)));
    let (found, hand) = listening
        .map_err(|e| Failure::usage(format!("--push-port {port}: no packets can be received there: {e}")))?;
    say!("pushes of the tool at 127.0.0.1:{found}");
    Ok(hand)
}
