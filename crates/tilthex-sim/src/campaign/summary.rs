//! The table of a campaign: reactions and largest errors for each kind of fault.

use std::{collections::BTreeMap, fmt::Write as _};

use serde::{Deserialize, Serialize};
use tilthex_core::supervisor::Reaction;

use super::{
    Kind,
    judge::{HARD, Outcome},
};

/// The figures of one kind of fault.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tally {
    flights: u64,
    reactions: [u64; 4],
    seen: BTreeMap<String, u64>,
    deviation: f64,
    hard: u64,
    toppled: u64,
    not_ended: u64,
    failed: u64,
}

/// The figures of a campaign.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Summary {
    tallies: BTreeMap<Kind, Tally>,
    failures: BTreeMap<u64, String>,
}

impl Summary {
    /// Adds the flight of a seed.
    pub(super) fn add(&mut self, seed: u64, outcome: &Outcome) {
        if let Some(failure) = &outcome.failure {
            let kinds: Vec<_> = outcome.injections.iter().map(|i| format!("{:?}", i.kind)).collect();
            self.failures.insert(seed, format!("{}: {failure}", kinds.join(" and ")));
        }
        for injection in &outcome.injections {
            let tally = self.tallies.entry(injection.kind).or_default();
            tally.flights += 1;
            let reaction = match outcome.reaction {
                Reaction::Note | Reaction::Refuse => 0,
                Reaction::Hold => 1,
                Reaction::Land => 2,
                Reaction::Descend => 3,
            };
            tally.reactions[reaction] += 1;
            for row in outcome.seen.rows() {
                *tally.seen.entry(row.name.to_owned()).or_default() += 1;
            }
            tally.deviation = tally.deviation.max(outcome.deviation);
            tally.hard += u64::from(outcome.impact > HARD);
            tally.toppled += u64::from(outcome.toppled);
            tally.not_ended += u64::from(!outcome.ended);
            tally.failed += u64::from(outcome.failure.is_some());
        }
    }

    /// Adds the flights of another campaign. The order does not matter.
    pub(super) fn join(&mut self, other: Self) {
        for (kind, theirs) in other.tallies {
            let ours = self.tallies.entry(kind).or_default();
            ours.flights += theirs.flights;
            for (sum, count) in ours.reactions.iter_mut().zip(theirs.reactions) {
                *sum += count;
            }
            for (fault, count) in theirs.seen {
                *ours.seen.entry(fault).or_default() += count;
            }
            ours.deviation = ours.deviation.max(theirs.deviation);
            ours.hard += theirs.hard;
            ours.toppled += theirs.toppled;
            ours.not_ended += theirs.not_ended;
            ours.failed += theirs.failed;
        }
        self.failures.extend(other.failures);
    }

    /// What went wrong in the flights that failed, by seed.
    #[must_use]
    pub fn failures(&self) -> &BTreeMap<u64, String> {
        &self.failures
    }

    /// The table.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = String::from(
            "fault              flights  went on    held  landed  descended  worst error  hard  toppled  not ended  failed\n",
        );
        for (kind, t) in &self.tallies {
            let [on, held, landed, descended] = t.reactions;
            let _ = writeln!(
                text,
                "{:18} {:7}  {on:7} {held:7} {landed:7}  {descended:9}  {:9.3} m {:5}  {:7}  {:9}  {:6}",
                format!("{kind:?}"),
                t.flights,
                t.deviation,
                t.hard,
                t.toppled,
                t.not_ended,
                t.failed
            );
        }
        for (kind, t) in &self.tallies {
            let mut seen: Vec<_> = t.seen.iter().collect();
            seen.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
            let seen: Vec<_> = seen.iter().take(5).map(|(name, count)| format!("{name} {count}")).collect();
            let _ = writeln!(text, "{kind:?}, {}: seen as {}", kind.text(), seen.join(", "));
        }
        text
    }
}
