//! `tilthex-rt campaign`: flies a range of seeds, and merges the ranges of several machines.

use std::{
    fs::{self, OpenOptions},
    io::Write as _,
    path::{Path, PathBuf},
};

use clap::Subcommand;
use tilthex_config::{Config, TruthSection, orders};
use tilthex_sim::campaign::{self, Kind, Part, Summary};

use super::{args, status};
use crate::{Failure, output};

/// Largest number of failures of a campaign that are shown one by one.
const SHOWN_FAILURES: usize = 400;

/// The flights of a campaign.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Flights {
    /// The configuration to fly with [default: that of the preset tilt-hex]
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Number of flights
    #[arg(long, short, default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..))]
    number: u64,
    /// Seed of the first flight; each later flight has the next seed
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only faults of these kinds, such as reboot,bit-flips; the error for an unknown kind lists them [default: all]
    #[arg(long, value_enum, value_delimiter = ',', value_name = "KINDS", hide_possible_values = true)]
    faults: Vec<Kind>,
    /// How the vehicles differ from their model, drawn for each seed: exact, measured, cad, outdoors, or a TOML
    /// file with a `[truth]` table
    #[arg(long, value_name = "LEVEL", default_value = "exact")]
    truth: String,
    /// Also write the result to this new file, for `campaign merge`
    #[arg(long, value_name = "FILE.json")]
    save: Option<PathBuf>,
    /// Print the result as one JSON object, for scripts: what --save writes
    #[arg(long)]
    json: bool,
}

/// An action on the results of campaigns.
#[derive(Clone, Debug, Subcommand)]
pub(super) enum Results {
    /// Print one table from the files of several machines, each of which flew other seeds of the same campaign
    Merge {
        /// Files that `campaign --save` wrote
        #[arg(required = true, value_name = "FILE.json")]
        files: Vec<PathBuf>,
        /// Also write the merged result to this new file
        #[arg(long, value_name = "FILE.json")]
        save: Option<PathBuf>,
        /// Print the merged result as one JSON object, for scripts
        #[arg(long)]
        json: bool,
    },
}

/// Flies the flights and prints their table. Of a single flight, whose result is not written, it prints every event.
pub(super) fn fly(flights: &Flights) -> Result<(), Failure> {
    let &Flights { number, seed, .. } = flights;
    if seed.checked_add(number).is_none() {
        return Err(Failure::usage(format!(
            "--seed {seed} has no {number} seeds after it; expected a smaller one"
        )));
    }
    check_new(flights.save.as_deref())?;
    let kinds = if flights.faults.is_empty() { Kind::ALL } else { &flights.faults };
    let truth = TruthSection::named(&flights.truth)?;
    let config = args::read(flights.config.as_deref())?;
    if number == 1 && flights.save.is_none() && !flights.json {
        return tell(&config, &truth, kinds, seed);
    }
    let tell_progress = |ended| {
        if output::is_terminal() {
            output::text(format!("\r{ended} of {number} flights"));
        }
    };
    let summary = campaign::run(&config, &truth, kinds, number, seed, &tell_progress);
    output::text(status::clear().into());
    // The table is printed past the queue.
    output::settle();
    let summary = summary?;
    let part = Part::new(&config, &truth, kinds, number, seed, summary);
    finish(flights.save.as_deref(), &part, flights.json)
}

/// Merges the results of several machines and prints their table.
pub(super) fn merge(Results::Merge { files, save: merged, json }: &Results) -> Result<(), Failure> {
    check_new(merged.as_deref())?;
    let mut whole: Option<Part> = None;
    for file in files {
        let part = read(file)?;
        match &mut whole {
            None => whole = Some(part),
            Some(whole) => {
                whole.join(part).map_err(|why| Failure::usage(format!("{}: {why}", file.display())))?;
            }
        }
    }
    let whole = whole.ok_or_else(|| Failure::usage("no file to merge; expected at least one"))?;
    let ranges: Vec<_> = whole.seeds().iter().map(|(first, last)| format!("{first} to {last}")).collect();
    output::error(format_args!("{} files with the seeds {}", files.len(), ranges.join(", ")));
    finish(merged.as_deref(), &whole, *json)
}

/// Prints the story of one flight.
fn tell(config: &Config, truth: &TruthSection, kinds: &[Kind], seed: u64) -> Result<(), Failure> {
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
    text += &format!("worst error {:.3} m, touch-down {:.2} m/s, {end}\n", outcome.deviation, outcome.impact);
    output::print(&text)?;
    outcome.failure.map_or(Ok(()), |f| Err(Failure::fault(format!("flight {seed} failed: {f}"))))
}

/// Saves a result and prints it, also if it cannot be saved.
fn finish(path: Option<&Path>, part: &Part, as_json: bool) -> Result<(), Failure> {
    let saved = path.map_or(Ok(()), |path| save(path, part));
    let text = if as_json { json(part)? + "\n" } else { table(part.summary()) };
    output::print(&text)?;
    saved.and(verdict(part.summary(), part.flights()))
}

fn json(part: &Part) -> Result<String, Failure> {
    serde_json::to_string_pretty(part).map_err(|e| Failure::machine(format!("the result is no JSON: {e}")))
}

/// The table of a campaign, and its failures.
fn table(summary: &Summary) -> String {
    let mut text = summary.table();
    for (seed, failure) in summary.failures().iter().take(SHOWN_FAILURES) {
        text += &format!("failed: seed {seed}: {failure}\n");
    }
    text
}

/// Whether no flight failed.
fn verdict(summary: &Summary, number: u64) -> Result<(), Failure> {
    let failures = summary.failures();
    match failures.first_key_value() {
        None => Ok(()),
        Some((seed, first)) => Err(Failure::fault(format!(
            "{} of {number} flights with faults failed; the first has the seed {seed} (--number 1 --seed {seed} shows its events): {first}",
            failures.len()
        ))),
    }
}

fn read(path: &Path) -> Result<Part, Failure> {
    let text = orders::read_file(path)?;
    serde_json::from_str::<Part>(&text).map_err(|e| e.to_string()).and_then(Part::checked).map_err(|e| {
        Failure::usage(format!("{}: {e}; expected a file that `campaign --save` wrote", path.display()))
    })
}

/// Refuses a file that exists, before hours of flights and not after them.
fn check_new(path: Option<&Path>) -> Result<(), Failure> {
    let Some(path) = path else { return Ok(()) };
    if fs::symlink_metadata(path).is_ok() {
        return Err(Failure::usage(format!("{} exists; name a new file with --save", path.display())));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if folder.is_dir() {
        return Ok(());
    }
    Err(Failure::usage(format!("{}: there is no folder {}; make it", path.display(), folder.display())))
}

fn save(path: &Path, part: &Part) -> Result<(), Failure> {
    let failed = |e: std::io::Error| Failure::machine(format!("{}: cannot be written: {e}", path.display()));
    let text = json(part)?;
    let mut file = OpenOptions::new().write(true).create_new(true).open(path).map_err(failed)?;
    file.write_all(text.as_bytes()).and_then(|()| file.sync_all()).map_err(failed)
}
