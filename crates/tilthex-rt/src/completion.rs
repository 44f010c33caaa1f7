//! The script with which a shell completes a program.

use clap::{Args, Command};
use clap_complete::Shell;

use crate::{Failure, output};

/// The arguments of `completion`, which each program has.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct Completion {
    /// The shell
    shell: Shell,
}

impl Completion {
    /// Prints the script for a program.
    ///
    /// # Errors
    /// The script could not be printed.
    pub(crate) fn print(self, mut command: Command) -> Result<(), Failure> {
        let name = command.get_name().to_owned();
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut command, &name, &mut script);
        // The generator of bash has two names for a command with a hyphen, of which it finds only the second.
        let script = String::from_utf8_lossy(&script)
            .replace(&name.replace('-', "__subcmd__"), &name.replace('-', "__"));
        output::print(&script)
    }
}
