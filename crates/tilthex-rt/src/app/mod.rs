//! The program `tilthex-rt`: from its arguments to its exit status.

mod args;
mod fly;
mod report;
mod status;

pub use args::Args;

use tilthex_config::{Config, TruthSection};
use tilthex_sim::campaign::{self, Kind};

use crate::{
    Failure,
    doctor::{self, Verdict},
    failure, output, replay,
};
use args::Action;

/// Largest number of failures of a campaign that are shown one by one.
const SHOWN_FAILURES: usize = 400;

/// Runs the program.
///
/// # Errors
/// The failure, if the program did not end with success.
pub fn run() -> Result<(), Failure> {
    let args: Args = failure::arguments()?;
    match &args.action {
        None if args.print_config => output::print(&args.config()?.to_toml()),
        None => fly::fly(&args),
        Some(Action::Doctor(setup)) => {
            let port = setup.uri()?.map(|uri| uri.name);
            let checks = doctor::examine(&setup.config(None)?, port.as_deref(), setup.realtime);
            let text: Vec<_> = checks.iter().map(|check| format!("{check}\n")).collect();
            output::print(&text.concat())?;
            let bad = checks.iter().filter(|check| check.verdict == Verdict::Bad).count();
            match bad {
                0 => Ok(()),
                _ => Err(Failure::usage(format!(
                    "{bad} of {} checks failed; correct them before a flight",
                    checks.len()
                ))),
            }
        }
        Some(Action::Replay { log }) => {
            let found = replay::file(log)?;
            output::print(&format!("{} ticks, {} messages run again\n", found.ticks, found.messages))?;
            match (found.first_difference, found.missing) {
                (None, None) => output::print("every recorded output is reproduced bit for bit\n"),
                (None, Some(missing)) => {
                    output::print("every output in the log is reproduced bit for bit, but the log is cut\n")?;
                    let message = format!("{}: {missing}", log.display());
                    Err(Failure { kind: failure::Kind::Incomplete, message })
                }
                (Some((tick, topic)), _) => {
                    Err(Failure::fault(format!("{}: {topic} of tick {tick} differs", log.display())))
                }
            }
        }
        Some(Action::Campaign { config, number, seed, faults, truth }) => {
            let kinds = if faults.is_empty() { Kind::ALL } else { faults };
            let truth = TruthSection::named(truth)?;
            fly_campaign(&args::read(config.as_deref())?, &truth, kinds, *number, *seed)
        }
    }
}

/// Flies many flights with faults and prints their table. Of a single flight it prints every event.
fn fly_campaign(
    config: &Config,
    truth: &TruthSection,
    kinds: &[Kind],
    number: u64,
    seed: u64,
) -> Result<(), Failure> {
    if number == 1 {
        let (outcome, story) = campaign::again(config, truth, kinds, seed)?;
        let mut text = String::new();
        for injection in &outcome.injections {
            text += &format!("{}: {injection:?}\n", injection.kind.text());
        }
        text += &story;
        let end = match (outcome.ended, outcome.toppled) {
            (true, false) => "stands, motors off",
            (true, true) => "has toppled, motors off",
            (false, _) => "does not rest with its motors off",
        };
        text +=
            &format!("worst error {:.3} m, touch-down {:.2} m/s, {end}\n", outcome.deviation, outcome.impact);
        output::print(&text)?;
        return outcome.failure.map_or(Ok(()), |f| Err(Failure::fault(format!("flight {seed} failed: {f}"))));
    }
    let summary = campaign::run(config, truth, kinds, number, seed)?;
    let mut text = summary.table();
    let failures = summary.failures();
    for (seed, failure) in failures.iter().take(SHOWN_FAILURES) {
        text += &format!("failed: seed {seed}: {failure}\n");
    }
    output::print(&text)?;
    match failures.first_key_value() {
        None => Ok(()),
        Some((seed, first)) => Err(Failure::fault(format!(
            "{} of {number} flights with faults failed; the first has the seed {seed} (--number 1 --seed {seed} shows its events): {first}",
            failures.len()
        ))),
    }
}
