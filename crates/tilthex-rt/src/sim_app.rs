//! The program `tilthex-sim`: the simulated vehicle alone, for anyone's controller.

use std::{
    fs,
    io::{Write, stdout},
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    sync::atomic::Ordering,
    time::Duration,
};

use clap::Parser;

use crate::{
    Failure,
    config::{Config, VehicleSection},
    failure,
    mocap::{LineParams, MocapUri},
    signals,
    sim::{CAPTURE_EVERY, Capture, Pushes, Server, Simulation, SimulationParams},
};

/// A simulated vehicle behind a pseudo-terminal, whose path it prints.
#[derive(Clone, Debug, Parser)]
#[command(version, max_term_width = 100)]
pub struct Args {
    /// The set-up; its vehicle is simulated [default: the preset tilt-hex]
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,

    /// Also name the pseudo-terminal by this symbolic link
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,

    /// Show the vehicle's pose, such as natnet://127.0.0.1/TILTHEX or vrpn://127.0.0.1/TILTHEX
    #[arg(long, value_name = "URI")]
    pub mocap: Option<MocapUri>,

    /// From the exposure of the cameras to the sending of its frame
    #[arg(long, value_name = "S", default_value_t = 0.008)]
    pub mocap_latency: f64,

    /// Added to it at random, up to this
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub mocap_jitter: f64,

    /// Share of the frames that are lost, 0 to 1
    #[arg(long, value_name = "PART", default_value_t = 0.0)]
    pub mocap_loss: f64,

    /// What pushes the tool, and when
    #[arg(long, value_name = "FILE.toml")]
    pub pushes: Option<PathBuf>,

    /// Chooses the sensors' noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// Runs the program until it is interrupted.
///
/// # Errors
/// One sentence.
pub fn run() -> Result<(), Failure> {
    let args: Args = failure::arguments()?;
    let stop = signals::flag()?;
    let config = match &args.config {
        Some(path) => Config::from_file(path),
        None => VehicleSection::preset("tilt-hex").map(Config::default_for),
    }
    .map_err(|e| Failure::usage(e.to_string()))?;
    let server = start(&args, &config)?;
    let _link = args.link.as_deref().map(|path| Link::new(path, server.path())).transpose()?;
    let mut out = stdout().lock();
    let _ = writeln!(out, "{}", server.path().display()).and_then(|()| out.flush());
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

fn start(args: &Args, config: &Config) -> Result<Server, Failure> {
    for (name, value, most) in [
        ("--mocap-latency", args.mocap_latency, 10.0),
        ("--mocap-jitter", args.mocap_jitter, 10.0),
        ("--mocap-loss", args.mocap_loss, 1.0),
    ] {
        tilthex_core::error::check_range(name, value, 0.0, most)
            .map_err(|e| Failure::usage(e.to_string()))?;
    }
    let line = LineParams {
        latency: args.mocap_latency,
        jitter: args.mocap_jitter,
        loss: args.mocap_loss,
        seed: args.seed,
    };
    let up_axis = config.mocap.up_axis().map_err(|e| Failure::usage(e.to_string()))?;
    let mut capture = args.mocap.as_ref().map(|uri| Capture::start(uri, up_axis, line)).transpose()?;
    let mut params = SimulationParams::new(*config.vehicle.vehicle());
    params.seed = args.seed;
    if let Some(path) = &args.pushes {
        params.pushes = Pushes::read(path)?;
    }
    let mut cycle = 0_u64;
    let observer = move |at, simulation: &mut Simulation| {
        cycle += 1;
        if let Some(capture) = capture.as_mut().filter(|_| cycle.is_multiple_of(CAPTURE_EVERY)) {
            capture.show(at, simulation);
        }
    };
    Server::start(Simulation::new(params), Box::new(observer))
        .map_err(|e| Failure::link(format!("the simulated vehicle has no pseudo-terminal: {e}")))
}

/// A symbolic link that goes when the program does.
struct Link(PathBuf);

impl Link {
    /// Links `path` to `target`; a link that a killed program left is replaced, a file is not.
    fn new(path: &Path, target: &Path) -> Result<Self, Failure> {
        if fs::symlink_metadata(path).is_ok_and(|found| found.is_symlink()) {
            // Whether it went shows in the next call.
            let _ = fs::remove_file(path);
        }
        symlink(target, path).map_err(|e| {
            Failure::usage(format!(
                "{} can not be linked to the pseudo-terminal: {e}; name a place that is free with --link",
                path.display()
            ))
        })?;
        Ok(Self(path.into()))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}
