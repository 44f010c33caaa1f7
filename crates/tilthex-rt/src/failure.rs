//! How a program ends without success: one sentence and an exit status.

use std::{fmt, process::ExitCode};

use tilthex_config::ConfigError;
use tilthex_mocap::net::SourceError;
use tilthex_sim::SimError;

use crate::output;

/// The kind of reason for which a program ends. It decides the exit status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Wrong usage or configuration, or a failed check of `doctor`: 2.
    Usage,
    /// The vehicle's link, motion capture, or the world of a simulated vehicle failed: 3.
    Link,
    /// A fault or the order `kill` ended the flight, a replay differs from its log, or a flight of a campaign failed: 4.
    Fault,
    /// A log breaks off; everything before its end is good: 5.
    Incomplete,
    /// This computer denies what the program needs (a thread, a signal handler, real-time rights, its output): 6.
    Machine,
    /// The user interrupted the program, and the vehicle landed: 130.
    Interrupted,
}

/// An end without success. One sentence: what is wrong, what was found, what was expected, how to correct it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The kind of reason, which decides the exit status.
    pub kind: Kind,
    /// The sentence.
    pub message: String,
}

impl Failure {
    /// A usage or configuration error.
    pub fn usage(message: impl Into<String>) -> Self {
        Self { kind: Kind::Usage, message: message.into() }
    }

    /// An error of the vehicle's link, of motion capture or of a world.
    pub fn link(message: impl Into<String>) -> Self {
        Self { kind: Kind::Link, message: message.into() }
    }

    /// A fault that ended the flight.
    pub fn fault(message: impl Into<String>) -> Self {
        Self { kind: Kind::Fault, message: message.into() }
    }

    /// A right or a resource that this computer denies.
    pub fn machine(message: impl Into<String>) -> Self {
        Self { kind: Kind::Machine, message: message.into() }
    }

    /// The documented exit status.
    #[must_use]
    pub fn exit_status(&self) -> u8 {
        match self.kind {
            Kind::Usage => 2,
            Kind::Link => 3,
            Kind::Fault => 4,
            Kind::Incomplete => 5,
            Kind::Machine => 6,
            Kind::Interrupted => 130,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Self {
        Self::usage(error.to_string())
    }
}

impl From<tilthex_core::Error> for Failure {
    fn from(error: tilthex_core::Error) -> Self {
        Self::usage(error.to_string())
    }
}

/// For an address that is wrong. If a source does not answer, use [`Failure::link`].
impl From<SourceError> for Failure {
    fn from(error: SourceError) -> Self {
        Self::usage(error.to_string())
    }
}

impl From<SimError> for Failure {
    fn from(error: SimError) -> Self {
        match error {
            SimError::Refused(sentence) => Self::usage(sentence),
            SimError::World(sentence) => Self::link(sentence),
            SimError::Flight(sentence) => Self::fault(sentence),
        }
    }
}

/// Ends a program: prints a failure to standard error and gives its status.
#[must_use]
pub fn exit(program: &str, result: Result<(), Failure>) -> ExitCode {
    let status = match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            output::error(format_args!("{program}: {failure}"));
            ExitCode::from(failure.exit_status())
        }
    };
    output::settle();
    status
}

/// Reads a program's arguments. For help and version it prints the text and ends the program.
///
/// # Errors
/// What is wrong with them, in one line.
pub fn arguments<T: clap::Parser>() -> Result<T, Failure> {
    T::try_parse().map_err(|e| {
        if !e.use_stderr() {
            e.exit();
        }
        let text = e.to_string();
        // The first paragraph says what is wrong, and names the arguments.
        let paragraph: Vec<_> = text.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
        let line = paragraph.join(" ");
        let line = line.trim_start_matches("error: ");
        Failure::usage(format!("{line}; --help lists all arguments"))
    })
}
