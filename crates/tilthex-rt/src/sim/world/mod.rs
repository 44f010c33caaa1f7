//! The world of an experiment in another process. MuJoCo steps it in Python, one cycle of the board at a time; requests and
//! answers go through the standard input and output of the process.

pub mod record;

use std::{
    env,
    io::{BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use rustix::{
    event::{PollFd, PollFlags, poll},
    time::Timespec,
};
use tilthex_core::{
    RotorVector, Vector3, Vehicle, Wrench,
    plant::{ImuSample, PlantState},
};

use crate::sleeper::Nanos;
use record::{GREETING, Greeting, STATE, State};
use tilthex_sim::{Body, SimError, body::Cycle};

/// The module that Python runs.
const MODULE: &str = "tilthex.experiments.world_process";
/// Longest wait for the process to begin: the first import of MuJoCo is slow.
const BEGIN: Duration = Duration::from_secs(60);
/// Longest wait for the answer of one cycle.
const ANSWER: Duration = Duration::from_secs(5);
/// Longest wait for the process to write its truth and end.
const END: Duration = Duration::from_secs(30);

/// The choice of a world.
#[derive(Clone, Debug, Default)]
pub struct WorldParams {
    /// The experiment: its name, or its TOML file.
    pub experiment: String,
    /// The run of the experiment; `None` for the first.
    pub run: Option<String>,
    /// File for the truth, a NumPy archive that is written at the end.
    pub truth: Option<PathBuf>,
    /// How the vehicle differs from that of the experiment: a level, or a TOML file with a `[truth]` table.
    pub level: String,
    /// Seed from which the vehicle is drawn.
    pub seed: u64,
}

/// A running world. Its process ends when this is dropped.
#[derive(Debug)]
pub struct World {
    process: Process,
    greeting: Greeting,
    vehicle: Vehicle,
    start: Vector3,
    state: State,
    failure: Option<SimError>,
}

impl World {
    /// Starts the process and waits for its greeting.
    ///
    /// # Errors
    /// One sentence: Python or MuJoCo is missing, the experiment is unknown, or it has another vehicle.
    pub fn start(params: &WorldParams, vehicle: Vehicle) -> Result<Self, SimError> {
        let python = python();
        let mut command = Command::new(&python);
        command.args(["-m", MODULE, &params.experiment]);
        if let Some(run) = &params.run {
            command.args(["--run", run]);
        }
        if let Some(truth) = &params.truth {
            command.arg("--truth").arg(truth);
        }
        if !params.level.is_empty() && params.level != "exact" {
            command.args(["--level", &params.level, "--seed", &params.seed.to_string()]);
        }
        // The threads of a linear algebra library wait actively, and would take the loop's processor.
        command.env("OPENBLAS_NUM_THREADS", "1").env("OMP_NUM_THREADS", "1");
        Self::from_command(command, vehicle)
    }

    /// Starts a world with a given command.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn from_command(command: Command, vehicle: Vehicle) -> Result<Self, SimError> {
        let mut process = Process::start(command)?;
        let bytes = process.read::<GREETING>(BEGIN)?;
        let greeting = record::greeting(&bytes).map_err(|what| process.rubbish(&what))?;
        let bytes = process.read::<STATE>(BEGIN)?;
        let state = record::state(&bytes, 0).map_err(|what| process.rubbish(&what))?;
        let (rotors, mass) = (vehicle.rotor_count(), vehicle.mass());
        if greeting.rotor_count != rotors || (greeting.mass - mass).abs() > 1e-9 {
            return Err(SimError::refused(format!(
                "the world's vehicle has {} rotors and {} kg, the configuration's {rotors} rotors and {mass} kg; name \
                 the experiment's own vehicle with --config",
                greeting.rotor_count, greeting.mass
            )));
        }
        process.begun = true;
        let start = state.plant.robot.position_w;
        Ok(Self { process, greeting, vehicle, start, state, failure: None })
    }

    /// Its greeting.
    #[must_use]
    pub fn greeting(&self) -> &Greeting {
        &self.greeting
    }

    fn ask(&mut self, at: Nanos, commands: &RotorVector) -> Result<State, SimError> {
        self.process.write(&record::request(at, commands))?;
        let bytes = self.process.read::<STATE>(ANSWER)?;
        record::state(&bytes, at).map_err(|what| self.process.rubbish(&what))
    }
}

impl Body for World {
    fn advance(&mut self, cycle: &Cycle, commands: &RotorVector) {
        if self.failure.is_some() {
            return;
        }
        match self.ask(cycle.at, commands) {
            Ok(state) => self.state = state,
            Err(failure) => self.failure = Some(failure),
        }
    }

    fn state(&self) -> &PlantState {
        &self.state.plant
    }

    fn imu(&self) -> ImuSample {
        let to_imu = self.vehicle.imu().rotation_r.transpose();
        ImuSample {
            gyro_i: to_imu * self.state.plant.robot.angular_velocity_r,
            specific_force_i: self.state.specific_force_i,
        }
    }

    fn tool_wrench_w(&self) -> Wrench {
        self.state.tool_wrench_w
    }

    fn external(&self) -> Wrench {
        self.state.external
    }

    fn rests(&self) -> bool {
        let robot = &self.state.plant.robot;
        robot.position_w.z < self.start.z + 0.01 && robot.velocity_w.norm() < 0.1
    }

    fn failed(&self) -> bool {
        self.failure.is_some()
    }

    fn finish(&mut self) -> Result<(), SimError> {
        match self.failure.take() {
            Some(failure) => Err(failure),
            None => self.process.end(),
        }
    }
}

/// Python in the folder of this program (an installed package has it there), or the Python on the path.
fn python() -> PathBuf {
    let beside = env::current_exe().ok().and_then(|program| Some(program.parent()?.join("python3")));
    beside.filter(|path| path.exists()).unwrap_or_else(|| Path::new("python3").into())
}

/// The process, its pipes, and the last line that it wrote to standard error.
#[derive(Debug)]
struct Process {
    name: String,
    child: Child,
    input: Option<ChildStdin>,
    output: ChildStdout,
    said: Option<JoinHandle<String>>,
    /// Whether it has sent its greeting and its first state.
    begun: bool,
}

impl Process {
    fn start(mut command: Command) -> Result<Self, SimError> {
        let name = command.get_program().to_string_lossy().into_owned();
        let pipes = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = pipes.spawn().map_err(|e| {
            SimError::refused(format!(
                "the world needs {name}, which cannot be started: {e}; install Python, then \
                 pip install 'tilthex[experiments]'"
            ))
        })?;
        let (Some(output), Some(errors)) = (child.stdout.take(), child.stderr.take()) else {
            return Err(SimError::refused(format!("the world's process {name} has no pipes")));
        };
        let said = thread::spawn(move || {
            let lines = BufReader::new(errors).lines().map_while(Result::ok);
            lines.filter(|line| !line.trim().is_empty()).last().unwrap_or_default()
        });
        Ok(Self { name, input: child.stdin.take(), child, output, said: Some(said), begun: false })
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), SimError> {
        let written = self.input.as_mut().map(|input| input.write_all(bytes));
        if let Some(Ok(())) = written { Ok(()) } else { Err(self.died()) }
    }

    fn read<const N: usize>(&mut self, patience: Duration) -> Result<[u8; N], SimError> {
        let (mut bytes, mut read) = ([0; N], 0);
        let until = Instant::now() + patience;
        while read < N {
            let left = until.saturating_duration_since(Instant::now());
            let timeout = Timespec { tv_sec: left.as_secs() as _, tv_nsec: left.subsec_nanos().into() };
            let ready = poll(&mut [PollFd::new(&self.output, PollFlags::IN)], Some(&timeout));
            if left.is_zero() {
                return Err(SimError::world(format!(
                    "the world did not answer for {} s ({}); check the load of this computer",
                    patience.as_secs(),
                    self.name
                )));
            }
            if ready != Ok(1) {
                continue;
            }
            match self.output.read(&mut bytes[read..]) {
                Ok(0) | Err(_) => return Err(self.died()),
                Ok(count) => read += count,
            }
        }
        Ok(bytes)
    }

    /// The error of a record that is wrong.
    fn rubbish(&self, what: &str) -> SimError {
        SimError::world(format!(
            "the world's answer is wrong: {what}; expected a record of {MODULE} of this version: install tilthex again \
             for {}",
            self.name
        ))
    }

    /// The error of a process that has ended. Its last line says why.
    fn died(&mut self) -> SimError {
        match self.closed() {
            Some((status, said)) if status.code() == Some(2) => SimError::refused(said),
            Some((status, said)) if self.begun => SimError::world(format!(
                "the world's process {} ended by itself ({status}): {said}; start it again",
                self.name
            )),
            Some((status, said)) => SimError::refused(format!(
                "the world's process {} did not begin ({status}): {said}; install what it needs with \
                 pip install 'tilthex[experiments]'",
                self.name
            )),
            None => SimError::world(format!("the world ({}) closed its pipes and does not end", self.name)),
        }
    }

    /// Ends the process by closing its input.
    fn end(&mut self) -> Result<(), SimError> {
        match self.closed() {
            Some((status, _)) if status.success() => Ok(()),
            Some((status, said)) => {
                Err(SimError::world(format!("the world's process ended with an error ({status}): {said}")))
            }
            None => Err(SimError::world(format!(
                "the world did not end within {} s and was killed; its truth is lost",
                END.as_secs()
            ))),
        }
    }

    /// Closes the process's input. Returns its exit status and its last line, or `None` if it had to be killed.
    fn closed(&mut self) -> Option<(std::process::ExitStatus, String)> {
        self.input = None;
        let until = Instant::now() + END;
        loop {
            if let Ok(Some(status)) = self.child.try_wait() {
                let said = self.said.take().and_then(|said| said.join().ok()).unwrap_or_default();
                return Some((status, said));
            }
            if Instant::now() > until {
                // If it has just ended, this does nothing.
                let _ = self.child.kill();
                let _ = self.child.wait();
                return None;
            }
            thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // If the process has already ended, this does nothing.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests;
