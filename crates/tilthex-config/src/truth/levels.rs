//! The built-in levels of a `[truth]` table, and the tables that name one.

use super::spread;
use crate::section::{self, ConfigError};
use toml::{Table, Value};

/// The built-in levels: name and file.
pub const LEVELS: &[(&str, &str)] = &[
    ("exact", "[truth]\n"),
    ("measured", include_str!("../../../../truths/measured.toml")),
    ("cad", include_str!("../../../../truths/cad.toml")),
    ("outdoors", include_str!("../../../../truths/outdoors.toml")),
];

/// The table of a level.
///
/// # Errors
/// If there is no level with this name.
pub(super) fn level(name: &str) -> Result<Table, ConfigError> {
    if name.contains('\n') {
        let sentence =
            "found a text of several lines; expected a level, or the name of a file, which ends in .toml";
        return Err(ConfigError::new(sentence).within("[truth]"));
    }
    let known = LEVELS.iter().map(|l| l.0);
    section::check_known("level", name, known)
        .map_err(|e| ConfigError::new(format!("{e}; a file's name ends in .toml")).within("[truth]"))?;
    if name == "exact" {
        return Ok(Table::new());
    }
    let text = LEVELS.iter().find(|l| l.0 == name).map_or("", |l| l.1);
    let mut table = truth_of_text(text)?;
    table.insert("name".into(), Value::String(name.into()));
    Ok(table)
}

/// The `[truth]` of a text of TOML.
///
/// # Errors
/// If the text is not TOML, or has no such table.
pub(super) fn truth_of_text(text: &str) -> Result<Table, ConfigError> {
    match crate::parse(text)?.remove("truth") {
        Some(Value::Table(table)) => Ok(table),
        _ => Err(ConfigError::new("no [truth] table; expected one, for example with level = \"measured\"")),
    }
}

/// Adds the keys of the `level`. Keys in the table itself override them.
///
/// # Errors
/// If the level is unknown, or levels name each other.
pub(super) fn resolve(mut table: Table, depth: usize) -> Result<Table, ConfigError> {
    let mut base = match table.remove("level") {
        None => return Ok(table),
        Some(Value::String(name)) if depth < 8 => {
            let mut base = level(&name)?;
            base.remove("name");
            base
        }
        _ => return Err(ConfigError::new("[truth]: level is not a text; expected the name of one")),
    };
    base = resolve(base, depth + 1)?;
    overlay(&mut base, table);
    Ok(base)
}

/// Replaces the keys of `base` by those of `upper`, table by table. A distribution is one value.
fn overlay(base: &mut Table, upper: Table) {
    for (key, value) in upper {
        match (base.get_mut(&key), value) {
            (Some(below), above) if spread::is_distribution(below) || spread::is_distribution(&above) => {
                *below = above;
            }
            (Some(Value::Table(below)), Value::Table(above)) => overlay(below, above),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}
