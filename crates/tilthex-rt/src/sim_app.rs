//! The program `tilthex-sim`: the simulated vehicle alone, for any controller.

use std::{
    fs,
    net::SocketAddr,
    os::unix::{
        fs::{FileTypeExt, symlink},
        net::{UnixListener, UnixStream},
    },
    path::{Path, PathBuf},
    sync::atomic::Ordering,
    time::Duration,
};

use clap::{CommandFactory, Parser, Subcommand};
use toml::{Table, Value};

use tilthex_config::{Config, TruthSection, VehicleSection};
use tilthex_link::{LinkKind, board::Board};
use tilthex_mocap::net::{LineParams, MocapUri};
use tilthex_sim::{
    Body, Pushes, STEP, Simulation, SimulationParams,
    onboard::{self, Onboard},
};

use crate::{
    Failure,
    completion::Completion,
    failure,
    output::say,
    signals,
    sim::{CAPTURE_EVERY, Capture, Server, World, board, world::WorldParams},
};

/// A simulated vehicle behind a pseudo-terminal, whose path it prints.
///
/// Exit status: 0 interrupted; 2 wrong arguments or configuration, or no Python with MuJoCo for --world;
/// 3 no pseudo-terminal, or the world ended or sent an unexpected answer.
#[derive(Clone, Debug, Parser)]
#[command(name = "tilthex-sim", version, max_term_width = 100, args_conflicts_with_subcommands = true)]
pub struct Args {
    #[command(subcommand)]
    action: Option<Action>,

    /// The configuration whose vehicle is simulated [default: that of the preset tilt-hex]
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,

    /// Also name the pseudo-terminal by this symbolic link
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,

    /// Listen at this Unix socket too: `tilthex-rt --port unix:PATH` connects there, without a terminal between the two
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,

    /// Protocol of the vehicle's link, as `protocol` in the section `[link]` [default: the configuration's]
    #[arg(long, value_name = "LINK")]
    pub protocol: Option<String>,

    /// The vehicle flies itself, with tilthex on board, and takes poses and orders from tilthex-rt console
    #[arg(long, conflicts_with_all = ["protocol", "world", "udp"])]
    pub on_board: bool,

    /// With px4: send datagrams to this address, at which tilthex-rt --port px4+udp://:PORT listens, instead of using
    /// the pseudo-terminal
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with = "socket")]
    pub udp: Option<SocketAddr>,

    /// Serve the vehicle's pose at this address, such as natnet://127.0.0.1/TILTHEX or vrpn://127.0.0.1/TILTHEX
    #[arg(long, value_name = "URI")]
    pub mocap: Option<MocapUri>,

    /// Time from the exposure of the cameras to the sending of a pose, s [default: the world's, or 0.008]
    #[arg(long, value_name = "S")]
    pub mocap_latency: Option<f64>,

    /// Largest random time that is added to --mocap-latency, s [default: the world's, or 0]
    #[arg(long, value_name = "S")]
    pub mocap_jitter: Option<f64>,

    /// Part of the poses that are lost, 0 to 1
    #[arg(long, value_name = "PART", default_value_t = 0.0)]
    pub mocap_loss: f64,

    /// A file of pushes on the tool, tables `[[push]]` with `at` (s since the first motor was ordered to start),
    /// `duration` (s), `force` (N) and `torque` (N m), world axes
    #[arg(long, value_name = "FILE.toml")]
    pub pushes: Option<PathBuf>,

    /// How the vehicle differs from the configuration's: exact, measured, cad, outdoors, or a TOML file with a
    /// `[truth]` table
    #[arg(long, value_name = "LEVEL", default_value = "exact")]
    pub truth: String,

    /// Seed of the sensors' noise and, with --truth, of the vehicle
    #[arg(long, default_value_t = 1)]
    pub seed: u64,

    /// Put the vehicle on a stand in this experiment's world, in MuJoCo, instead of flat ground: a name such as
    /// sliding, or a TOML file
    #[arg(long, value_name = "EXPERIMENT", conflicts_with = "pushes")]
    pub world: Option<String>,

    /// With --world: the name of the experiment's run [default: the first]
    #[arg(long, value_name = "NAME", requires = "world")]
    pub world_run: Option<String>,

    /// With --world: file for the true values of every cycle, written at the end
    #[arg(long, value_name = "FILE.npz", requires = "world")]
    pub world_truth: Option<PathBuf>,
}

/// An action instead of a simulation.
#[derive(Clone, Copy, Debug, Subcommand)]
enum Action {
    /// Print the script with which a shell completes this command
    Completion(Completion),
}

/// Runs the program until it is interrupted.
///
/// # Errors
/// One sentence.
pub fn run() -> Result<(), Failure> {
    let args: Args = failure::arguments()?;
    if let Some(Action::Completion(completion)) = args.action {
        return completion.print(Args::command());
    }
    let stop = signals::flag()?;
    let config = match &args.config {
        Some(path) => Config::from_file(path),
        None => VehicleSection::preset("tilt-hex").map(Config::default_for),
    }?;
    let config = match &args.protocol {
        Some(protocol) => config.overlaid(changed("link", "protocol", protocol))?,
        None => config,
    };
    if args.udp.is_some() && config.link().kind()? != LinkKind::Px4 {
        return Err(Failure::usage("--udp is for px4 only; expected --protocol px4 with it"));
    }
    let server = start(&args, &config)?;
    let _link = args.link.as_deref().map(|path| SymbolicLink::new(path, server.path())).transpose()?;
    match args.udp {
        Some(agent) => say!("udp:{agent}"),
        None => say!("{}", server.path().display()),
    }
    while server.is_running() && !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
    let report = server.stop();
    if let Some(socket) = &args.socket {
        // It may have been removed already.
        let _ = fs::remove_file(socket);
    }
    if report.imu_to_command.count > 0 {
        say!("IMU byte out of vehicle to command in  {}", report.imu_to_command);
    }
    say!("the simulated vehicle lags behind the clock by {}", report.lag);
    report.failure.map_or(Ok(()), Err)
}

/// A table that changes one key of the configuration.
fn changed(section: &str, key: &str, value: &str) -> Table {
    Table::from_iter([(section.into(), Value::Table(Table::from_iter([(key.into(), value.into())])))])
}

/// Starts the vehicle on flat ground, or in a world.
fn start(args: &Args, config: &Config) -> Result<Server, Failure> {
    let Some(experiment) = &args.world else {
        let truth = TruthSection::named(&args.truth);
        let drawn = truth.and_then(|truth| truth.draw(config.vehicle(), args.seed));
        let drawn = drawn?;
        // `[truth.delays]` has the mean and half the width of a uniform latency; a line has its smallest value and its width.
        let half = drawn.delays.pose_jitter.unwrap_or(0.0);
        let line = ((drawn.delays.pose.unwrap_or(0.008 + half) - half).max(0.0), 2.0 * half);
        let mut params = SimulationParams::of(&drawn)?;
        if let Some(path) = &args.pushes {
            params.pushes = Pushes::read(path)?;
        }
        if args.on_board {
            let board = Onboard::new(onboard::firmware_params(config)?, params.firmware.battery)?;
            return serve(args, config, Simulation::with_board(params, board), CAPTURE_EVERY, line);
        }
        let board = board(config, &params)?;
        return serve(args, config, Simulation::with_board(params, board), CAPTURE_EVERY, line);
    };
    let params = WorldParams {
        experiment: experiment.clone(),
        run: args.world_run.clone(),
        truth: args.world_truth.clone(),
        level: args.truth.clone(),
        seed: args.seed,
    };
    let world = World::start(&params, *config.vehicle().vehicle())?;
    let greeting = *world.greeting();
    let every = (greeting.pose_period / (STEP as f64 * 1e-6)).round().max(1.0) as u64;
    let line = (greeting.pose_latency, greeting.pose_jitter);
    let params = SimulationParams::new(*config.vehicle().vehicle());
    let board = board(config, &params)?;
    let simulation = Simulation::with_body(world, params.plant, greeting.sensors, board, args.seed);
    serve(args, config, simulation, every, line)
}

/// Connects the simulation with a pseudo-terminal and with motion capture. The cameras take a pose every `every` cycles;
/// their line has the given default latency and jitter (s).
fn serve<B: Body + Send + 'static, F: Board + Send + 'static>(
    args: &Args,
    config: &Config,
    simulation: Simulation<B, F>,
    every: u64,
    line: (f64, f64),
) -> Result<Server, Failure> {
    let line = LineParams {
        latency: args.mocap_latency.unwrap_or(line.0),
        jitter: args.mocap_jitter.unwrap_or(line.1),
        loss: args.mocap_loss,
        seed: args.seed,
    };
    for (name, value, most) in [
        ("--mocap-latency", line.latency, 10.0),
        ("--mocap-jitter", line.jitter, 10.0),
        ("--mocap-loss", line.loss, 1.0),
    ] {
        tilthex_core::error::check_range(name, value, 0.0, most)?;
    }
    let up_axis = config.mocap().up_axis()?;
    let mut capture = args.mocap.as_ref().map(|uri| Capture::start(uri, up_axis, line)).transpose()?;
    let mut cycle = 0_u64;
    let observer = move |at, simulation: &mut Simulation<B, F>| {
        cycle += 1;
        if let Some(capture) = capture.as_mut().filter(|_| cycle.is_multiple_of(every)) {
            capture.show(at, simulation);
        }
    };
    let socket = args.socket.as_deref().map(listen).transpose()?;
    Server::start(simulation, Box::new(observer), socket, args.udp)
        .map_err(|e| Failure::link(format!("the simulated vehicle has no pseudo-terminal: {e}")))
}

/// Listens at a socket. Replaces a socket that a killed program left, but never a file.
fn listen(path: &Path) -> Result<UnixListener, Failure> {
    if fs::symlink_metadata(path).is_ok_and(|found| found.file_type().is_socket())
        && UnixStream::connect(path).is_err()
    {
        // If this fails, the next call fails.
        let _ = fs::remove_file(path);
    }
    UnixListener::bind(path).map_err(|e| {
        Failure::usage(format!(
            "{} cannot be a socket: {e}; name a path that does not exist with --socket",
            path.display()
        ))
    })
}

/// A symbolic link that is removed when the program ends.
struct SymbolicLink(PathBuf);

impl SymbolicLink {
    /// Links `path` to `target`. Replaces a link that a killed program left, but never a file.
    fn new(path: &Path, target: &Path) -> Result<Self, Failure> {
        if fs::symlink_metadata(path).is_ok_and(|found| found.is_symlink()) {
            // If this fails, the next call fails.
            let _ = fs::remove_file(path);
        }
        symlink(target, path).map_err(|e| {
            Failure::usage(format!(
                "{} cannot be linked to the pseudo-terminal: {e}; name a path that does not exist with --link",
                path.display()
            ))
        })?;
        Ok(Self(path.into()))
    }
}

impl Drop for SymbolicLink {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}
