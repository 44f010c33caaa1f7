//! The program `tilthex-rt`: from its arguments to its exit status.

mod args;
mod fly;
mod report;
mod status;

pub use args::Args;

use clap::Parser;

use crate::Failure;
use args::Action;

/// Runs the program.
///
/// # Errors
/// How it ended, where that is not success.
pub fn run() -> Result<(), Failure> {
    let args = Args::parse();
    match &args.action {
        None if args.print_config => {
            print!("{}", args.config()?.to_toml());
            Ok(())
        }
        None => fly::fly(&args),
        Some(Action::Doctor) => Ok(()),
    }
}
