//! Numbers that are drawn: a value, or a distribution instead of it.

use super::super::section::ConfigError;
use serde::{Deserialize, Serialize};
use tilthex_core::random::Random;
use toml::{Table, Value};

/// Number of standard deviations at which a normal distribution is cut: a draw outside of them is drawn again.
const CUT: f64 = 3.0;
/// The keys that make a table a distribution.
const KEYS: [&str; 4] = ["mean", "std", "min", "max"];

/// A number, or the distribution from which it is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number, { mean, std } or { min, max }")]
pub enum Spread {
    /// A fixed number.
    Fixed(f64),
    /// Normal distribution with a mean (0 if it is not given) and a standard deviation, cut at three deviations.
    Normal {
        /// Mean.
        #[serde(default)]
        mean: f64,
        /// Standard deviation before the cut.
        std: f64,
    },
    /// Uniform distribution.
    Uniform {
        /// Smallest.
        min: f64,
        /// Largest.
        max: f64,
    },
}

impl Default for Spread {
    fn default() -> Self {
        Self::Fixed(0.0)
    }
}

impl Spread {
    /// One draw.
    pub fn draw(&self, random: &mut Random) -> f64 {
        match *self {
            Self::Fixed(x) => x,
            Self::Normal { mean, std } => {
                let part = loop {
                    let part = random.normal();
                    if part.abs() <= CUT {
                        break part;
                    }
                };
                mean + std * part
            }
            Self::Uniform { min, max } => min + (max - min) * random.uniform(),
        }
    }

    /// Refuses a value that is not a distribution.
    ///
    /// # Errors
    /// What is wrong.
    pub fn check(&self) -> Result<(), ConfigError> {
        let refuse = |what: String| Err(ConfigError::new(what));
        match *self {
            Self::Fixed(x) if !x.is_finite() => refuse(format!("is {x}; expected a finite number")),
            Self::Normal { mean, std } if !(mean.is_finite() && std.is_finite() && std >= 0.0) => {
                refuse(format!("has mean = {mean} and std = {std}; expected finite numbers, std 0 or above"))
            }
            Self::Uniform { min, max } if !(min.is_finite() && max.is_finite() && min <= max) => {
                refuse(format!("has min = {min} and max = {max}; expected finite numbers, min first"))
            }
            _ => Ok(()),
        }
    }
}

/// A separate stream of random numbers for every seed and key, so that an additional key does not change the draws of the
/// others.
pub(super) fn stream(seed: u64, key: &str) -> Random {
    // FNV-1a over the key's name.
    let hash = key.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    let mut random = Random::new(hash);
    Random::new(random.bits() ^ Random::new(seed).bits())
}

/// Whether a value is a distribution.
pub(super) fn is_distribution(value: &Value) -> bool {
    value.as_table().is_some_and(|t| !t.is_empty() && t.keys().all(|key| KEYS.contains(&key.as_str())))
}

/// Replaces every distribution in a table by a draw from it.
///
/// # Errors
/// Names the key.
pub(super) fn drawn(table: &Table, place: &str, seed: u64) -> Result<Table, ConfigError> {
    table
        .iter()
        .map(|(key, value)| {
            let place = format!("{place}.{key}");
            Ok((key.clone(), drawn_value(value, &place, seed)?))
        })
        .collect()
}

fn drawn_value(value: &Value, place: &str, seed: u64) -> Result<Value, ConfigError> {
    match value {
        Value::Table(table) if is_distribution(value) => {
            let mut random = stream(seed, place);
            let each = components(table).map_err(|e| e.within(place))?;
            let numbers: Vec<Value> = each.iter().map(|one| Value::Float(one.draw(&mut random))).collect();
            let is_list = table.values().any(Value::is_array);
            Ok(if is_list {
                Value::Array(numbers)
            } else {
                numbers.into_iter().next().unwrap_or(Value::Float(0.0))
            })
        }
        Value::Table(table) => Ok(Value::Table(drawn(table, place, seed)?)),
        Value::Array(all) => all
            .iter()
            .enumerate()
            .map(|(i, one)| drawn_value(one, &format!("{place}.{i}"), seed))
            .collect::<Result<_, _>>()
            .map(Value::Array),
        other => Ok(other.clone()),
    }
}

/// The distribution of each number of a list. A single number holds for all of them.
fn components(table: &Table) -> Result<Vec<Spread>, ConfigError> {
    let lengths: Vec<usize> = table.values().filter_map(|v| v.as_array().map(Vec::len)).collect();
    let count = lengths.first().copied().unwrap_or(1);
    if lengths.iter().any(|n| *n != count) {
        return Err(ConfigError::new(format!("found lists of {lengths:?} numbers; expected equal lengths")));
    }
    (0..count)
        .map(|i| {
            let one: Table = table
                .iter()
                .map(|(key, v)| (key.clone(), v.as_array().map_or_else(|| v.clone(), |all| all[i].clone())))
                .collect();
            let spread = Value::Table(one).try_into::<Spread>().map_err(|_| {
                ConfigError::new(
                    "expected a number, { mean, std } or { min, max }, each a number or a list of numbers",
                )
            })?;
            spread.check()?;
            Ok(spread)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_have_their_mean_and_their_deviation_and_are_cut() {
        let spread = Spread::Normal { mean: 2.0, std: 0.5 };
        let mut random = stream(4, "a");
        let all: Vec<f64> = (0..20_000).map(|_| spread.draw(&mut random)).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let deviation = (all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt();
        // A normal distribution cut at three deviations has 0.9866 of its deviation.
        assert!((mean - 2.0).abs() < 0.02 && (deviation - 0.4933).abs() < 0.01, "{mean} {deviation}");
        assert!(all.iter().all(|x| (x - 2.0).abs() <= 1.5));
        let uniform = Spread::Uniform { min: -1.0, max: 3.0 };
        assert!((0..1000).map(|_| uniform.draw(&mut random)).all(|x| (-1.0..=3.0).contains(&x)));
    }

    #[test]
    fn a_key_more_leaves_the_others_as_they_are() {
        let of = |text: &str| drawn(&text.parse().unwrap(), "t", 7).unwrap();
        let one = of("a = { std = 1.0 }");
        let two = of("a = { std = 1.0 }\nb = { mean = [0.0, 0.0], std = 1.0 }");
        assert_eq!(one["a"], two["a"]);
        let b = two["b"].as_array().unwrap();
        assert!(b.len() == 2 && b[0] != b[1]);
        assert_ne!(drawn(&"a = { std = 1.0 }".parse().unwrap(), "t", 8).unwrap()["a"], one["a"]);
    }

    #[test]
    fn what_is_no_distribution_is_said() {
        let refused = |text: &str| drawn(&text.parse().unwrap(), "t", 7).unwrap_err().to_string();
        assert_eq!(
            refused("a = { mean = 1.0, std = -1.0 }"),
            "t.a: has mean = 1 and std = -1; expected finite numbers, std 0 or above"
        );
        assert!(refused("a = { mean = 1.0 }").starts_with("t.a: expected a number"));
        assert!(refused("a = { mean = [1.0, 2.0], std = [1.0] }").contains("expected equal lengths"));
    }
}
