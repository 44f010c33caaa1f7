//! The part of a campaign that one machine has flown, and how parts become one.

use serde::{Deserialize, Serialize};
use tilthex_config::{Config, TruthSection};

use super::{Kind, Summary};

/// Flights of a campaign with everything that determines them, and their figures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// Version of tilthex.
    version: String,
    /// The effective configuration, TOML.
    config: String,
    /// How the vehicles differ from their model, TOML.
    truth: String,
    /// The kinds of faults, from which each flight draws its own.
    faults: Vec<Kind>,
    /// First and last seed of each range, in their order.
    seeds: Vec<(u64, u64)>,
    summary: Summary,
}

impl Part {
    /// The part with the flights of `count` (at least 1) seeds from `first` on.
    #[must_use]
    pub fn new(
        config: &Config,
        truth: &TruthSection,
        kinds: &[Kind],
        count: u64,
        first: u64,
        summary: Summary,
    ) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            config: config.to_toml(),
            truth: truth.to_toml(),
            faults: kinds.to_vec(),
            seeds: vec![(first, first.saturating_add(count - 1))],
            summary,
        }
    }

    /// The same part, if its seeds are possible.
    ///
    /// # Errors
    /// Says which seeds are not.
    pub fn checked(self) -> Result<Self, String> {
        let mut next = 0;
        for &(first, last) in &self.seeds {
            if first < next || last < first || last == u64::MAX {
                return Err(format!("the seeds {first} to {last} are no range after the one before"));
            }
            next = last + 1;
        }
        Ok(self)
    }

    /// Number of its flights.
    #[must_use]
    pub fn flights(&self) -> u64 {
        self.seeds.iter().map(|(first, last)| last - first + 1).sum()
    }

    /// First and last seed of each range, in their order.
    #[must_use]
    pub fn seeds(&self) -> &[(u64, u64)] {
        &self.seeds
    }

    /// The figures of all its flights.
    #[must_use]
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// Adds another part. The result does not depend on the order of the parts.
    ///
    /// # Errors
    /// The other part is of another campaign, or has a flight of this one. The sentence begins after the name of the other.
    pub fn join(&mut self, other: Self) -> Result<(), String> {
        if other.version != self.version {
            return Err(format!("was flown by tilthex {}; expected {}", other.version, self.version));
        }
        for (what, ours, theirs) in
            [("configuration", &self.config, &other.config), ("truth", &self.truth, &other.truth)]
        {
            if let Some((ours, theirs)) = first_difference(ours, theirs) {
                return Err(format!("was flown with another {what}: \"{theirs}\"; expected \"{ours}\""));
            }
        }
        if other.faults != self.faults {
            return Err("was flown with other kinds of faults; expected the same --faults".into());
        }
        let mut seeds = [self.seeds.as_slice(), &other.seeds].concat();
        seeds.sort_unstable();
        let mut joined: Vec<(u64, u64)> = Vec::with_capacity(seeds.len());
        for (first, last) in seeds {
            match joined.last_mut() {
                Some(before) if first <= before.1 => {
                    let end = before.1.min(last);
                    return Err(format!(
                        "has the seeds {first} to {end}, which another file has, too; expected each seed once"
                    ));
                }
                Some(before) if first == before.1 + 1 => before.1 = last,
                _ => joined.push((first, last)),
            }
        }
        self.seeds = joined;
        self.summary.join(other.summary);
        Ok(())
    }
}

/// The first lines that differ; a line that a text does not have is empty.
fn first_difference<'a>(one: &'a str, other: &'a str) -> Option<(&'a str, &'a str)> {
    let longest = one.lines().count().max(other.lines().count());
    let padded = |text: &'a str| text.lines().chain(std::iter::repeat("")).take(longest);
    padded(one).zip(padded(other)).find(|(one, other)| one != other)
}
