//! The program `tilthex-rt`: from its arguments to its exit status.

mod args;
mod campaign;
mod console;
mod fly;
mod report;
pub(crate) mod status;

pub use args::Args;

use clap::CommandFactory;

use crate::{
    Failure,
    doctor::{self, Verdict},
    failure, output, replay,
};
use args::Action;

/// Runs the program.
///
/// # Errors
/// The failure, if the program did not end with success.
pub fn run() -> Result<(), Failure> {
    let args: Args = failure::arguments()?;
    match &args.action {
        None if args.print_config => output::print(&args.config()?.to_toml()),
        None => fly::fly(&args),
        Some(Action::Doctor { setup, rights, json }) => {
            let port = setup.uri()?.map(|uri| uri.name);
            let checks = doctor::examine(&setup.config(None)?, port.as_deref(), rights.realtime);
            if *json {
                output::print(&format!("{:#}\n", doctor::json(&checks)))?;
            } else {
                let text: Vec<_> = checks.iter().map(|check| format!("{check}\n")).collect();
                output::print(&text.concat())?;
            }
            let bad = checks.iter().filter(|check| check.verdict == Verdict::Bad).count();
            match bad {
                0 => Ok(()),
                _ => Err(Failure::usage(format!(
                    "{bad} of {} checks failed; correct them before a flight",
                    checks.len()
                ))),
            }
        }
        Some(Action::Completion(completion)) => completion.print(Args::command()),
        Some(Action::Console(args)) => console::run(args),
        Some(Action::Replay { log, json }) => {
            let found = replay::file(log)?;
            let text = if *json { format!("{:#}\n", found.json()) } else { found.to_string() };
            output::print(&text)?;
            match (found.first_difference, found.missing) {
                (None, None) => Ok(()),
                (None, Some(missing)) => {
                    let message = format!("{}: {missing}", log.display());
                    Err(Failure { kind: failure::Kind::Incomplete, message })
                }
                (Some((tick, topic)), _) => {
                    Err(Failure::fault(format!("{}: {topic} of tick {tick} differs", log.display())))
                }
            }
        }
        Some(Action::Campaign { results: Some(results), .. }) => campaign::merge(results),
        Some(Action::Campaign { flights, results: None }) => campaign::fly(flights),
    }
}
