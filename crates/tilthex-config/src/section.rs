//! The common part of all sections of a configuration: declaration, reading with
//! errors that name the key, and printing with comments.

use serde::{Serialize, de::DeserializeOwned};
use std::fmt;
use tilthex_core::error::check_range;
use toml::{Table, Value};

/// An error of a configuration, in one sentence.
#[derive(Clone, Debug, PartialEq)]
pub struct ConfigError(String);

impl ConfigError {
    pub(crate) fn new(sentence: impl Into<String>) -> Self {
        Self(sentence.into())
    }

    /// The error with its place (a file or a section) before the sentence.
    pub(crate) fn within(self, place: impl fmt::Display) -> Self {
        Self(format!("{place}: {}", self.0))
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for ConfigError {}

impl From<tilthex_core::Error> for ConfigError {
    fn from(error: tilthex_core::Error) -> Self {
        Self(error.to_string())
    }
}

/// One documented key.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Its name.
    pub name: &'static str,
    /// Lines of documentation: its meaning.
    pub doc: &'static [&'static str],
    /// Unit of its numbers; "1" for a number without a unit, empty if it is not a number.
    pub unit: &'static str,
    /// Smallest and largest number that is accepted, in that unit.
    pub range: Option<(f64, f64)>,
    /// The order that changes it in flight.
    pub order: Option<&'static str>,
}

impl Key {
    /// Unit and range in words; empty if neither is declared.
    #[must_use]
    pub fn numbers(&self) -> String {
        let unit = match self.unit {
            "" => String::new(),
            "1" => "a number".into(),
            unit => format!("unit {unit}"),
        };
        match self.range {
            None => unit,
            Some((min, max)) if unit.is_empty() => format!("from {min} to {max}"),
            Some((min, max)) => format!("{unit}, from {min} to {max}"),
        }
    }

    /// Refuses a number outside the key's range, alone or in a list.
    fn check(&self, value: &Value) -> Result<(), ConfigError> {
        let number = match value {
            Value::Array(all) => return all.iter().try_for_each(|each| self.check(each)),
            Value::Float(x) => *x,
            Value::Integer(n) => *n as f64,
            _ => return Ok(()),
        };
        let Some((min, max)) = self.range else { return Ok(()) };
        Ok(check_range(self.name, number, min, max)?)
    }
}

/// A section: a struct whose fields are the keys.
pub trait Section: Serialize + DeserializeOwned {
    /// Its name in the file.
    const NAME: &'static str;
    /// What it is about.
    const DOC: &'static [&'static str];
    /// Its keys, in the order in which they are printed.
    const KEYS: &'static [Key];
}

/// A section, for the documentation.
#[derive(Clone, Debug)]
pub struct Described {
    /// Its name in the file.
    pub name: &'static str,
    /// What it is about.
    pub doc: &'static [&'static str],
    /// Its keys.
    pub keys: &'static [Key],
    /// The values of keys that are not given.
    pub defaults: Table,
}

impl Described {
    pub(crate) fn of<S: Section + Default>() -> Self {
        let defaults = Table::try_from(S::default()).expect("numbers, texts and lists of them are TOML");
        Self { name: S::NAME, doc: S::DOC, keys: S::KEYS, defaults }
    }
}

/// Declares a section: struct, defaults, keys and their documentation at once. A key is
///
/// ```text
/// /// What it means.
/// name: type = default => "unit" from smallest to largest by "order",
/// ```
///
/// The parts after the default may be left out. `order` is the order that changes the key in flight.
macro_rules! section {
    (
        $(#[doc = $doc:literal])*
        $vis:vis $name:ident as $toml:literal {
            $(
                $(#[doc = $key_doc:literal])*
                $key:ident: $kind:ty = $default:expr
                    $(=> $unit:literal $(from $min:literal to $max:literal)? $(by $order:literal)?)?,
            )*
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        $vis struct $name {
            $( $(#[doc = $key_doc])* $(#[doc = concat!("\n\nUnit: ", $unit, ".")])? pub $key: $kind, )*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $( $key: $default, )* }
            }
        }

        impl $crate::section::Section for $name {
            const NAME: &'static str = $toml;
            const DOC: &'static [&'static str] = &[$($doc),*];
            const KEYS: &'static [$crate::section::Key] = &[
                $( $crate::section::Key {
                    name: stringify!($key),
                    doc: &[$($key_doc),*],
                    unit: concat!($($unit)?),
                    range: $crate::section::optional!($($( ($min, $max) )?)?),
                    order: $crate::section::optional!($($( $order )?)?),
                }, )*
            ];
        }
    };
}
pub(crate) use section;

/// `Some` of a declared value, `None` without one.
macro_rules! optional {
    () => {
        None
    };
    ($value:expr) => {
        Some($value)
    };
}
pub(crate) use optional;

/// Refuses a name that is not one of `known`. The error names the nearest one.
pub(crate) fn check_known<'a>(
    what: &str,
    found: &str,
    known: impl IntoIterator<Item = &'a str>,
) -> Result<(), ConfigError> {
    let mut nearest = None;
    for name in known {
        if name == found {
            return Ok(());
        }
        let likeness = strsim::jaro_winkler(name, found);
        if nearest.is_none_or(|(best, _)| likeness > best) {
            nearest = Some((likeness, name));
        }
    }
    let hint = nearest.map_or_else(String::new, |(_, name)| format!("; the nearest known one is `{name}`"));
    Err(ConfigError::new(format!("unknown {what} `{found}`{hint}")))
}

/// Reads a section from its table, key by key, so that an error names its key.
pub(crate) fn read<S: Section>(table: &Table) -> Result<S, ConfigError> {
    read_at(&format!("[{}]", S::NAME), table)
}

/// The same for one of several sections of a kind. Errors name its place.
pub(crate) fn read_at<S: Section>(place: &str, table: &Table) -> Result<S, ConfigError> {
    for key in table.keys() {
        check_known("key", key, S::KEYS.iter().map(|k| k.name)).map_err(|e| e.within(place))?;
    }
    for key in S::KEYS {
        table.get(key.name).map_or(Ok(()), |value| key.check(value)).map_err(|e| e.within(place))?;
    }
    table
        .clone()
        .try_into()
        .map_err(|error: toml::de::Error| ConfigError::new(one_line(&error.to_string())).within(place))
}

/// The section with some keys changed by an order. Refuses keys that the order may not change.
pub(crate) fn changed<S: Section>(section: &S, order: &str, changes: Table) -> Result<S, ConfigError> {
    let changeable = S::KEYS.iter().filter(|k| k.order == Some(order)).map(|k| k.name);
    for key in changes.keys() {
        check_known("key", key, changeable.clone())?;
    }
    let mut table = Table::try_from(section).expect("numbers, texts and lists of them are TOML");
    table.extend(changes);
    read(&table)
}

/// An error text of the TOML library in one line, without the names of Rust's types.
pub fn one_line(message: &str) -> String {
    let line = message.split_whitespace().collect::<Vec<_>>().join(" ");
    macro_rules! whole_numbers {
        ($($kind:ident)*) => { [$( (stringify!($kind), $kind::MAX.to_string()) ),*] };
    }
    let line = whole_numbers!(u8 u16 u32 u64 usize).iter().fold(line, |line, (kind, largest)| {
        line.replace(&format!("expected {kind}"), &format!("expected a whole number from 0 to {largest}"))
    });
    line.replace("expected f64", "expected a number")
}

/// Takes a section out of the file's table. A missing section has the defaults.
pub(crate) fn take<S: Section + Default>(file: &mut Table) -> Result<S, ConfigError> {
    match file.remove(S::NAME) {
        None => Ok(S::default()),
        Some(Value::Table(table)) => read(&table),
        Some(other) => {
            let sentence = format!("[{}]: found an {}; expected a table", S::NAME, other.type_str());
            Err(ConfigError::new(sentence))
        }
    }
}

/// Writes a section with a comment above each key.
pub(crate) fn print<S: Section>(section: &S, out: &mut String) {
    print_under(&format!("[{}]", S::NAME), section, out);
}

/// The same under another header.
pub(crate) fn print_under<S: Section>(header: &str, section: &S, out: &mut String) {
    let values = Table::try_from(section).expect("numbers, texts and lists of them are TOML");
    for line in S::DOC {
        *out += &format!("#{line}\n");
    }
    *out += &format!("{header}\n");
    for key in S::KEYS {
        for line in key.doc {
            *out += &format!("#{line}\n");
        }
        let (numbers, order) = (key.numbers(), key.order.map(|o| format!("changed in flight by {o}")));
        let facts: Vec<_> = Some(numbers).filter(|n| !n.is_empty()).into_iter().chain(order).collect();
        if !facts.is_empty() {
            *out += &format!("# [{}]\n", facts.join("; "));
        }
        match values.get(key.name) {
            Some(value) => *out += &format!("{} = {value}\n", key.name),
            None => *out += &format!("# {} is not set\n", key.name),
        }
    }
    out.push('\n');
}
