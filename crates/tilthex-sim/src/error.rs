//! Why something is not simulated, or ends.

use std::fmt;

/// Why there is no simulation, in one sentence: what, found, expected, what mends it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SimError {
    /// The request cannot be simulated.
    Refused(String),
    /// The world behind the simulated vehicle ended, or answered something else.
    World(String),
    /// A flight did not go as a flight without faults goes.
    Flight(String),
}

impl SimError {
    /// The request cannot be simulated.
    pub fn refused(sentence: impl Into<String>) -> Self {
        Self::Refused(sentence.into())
    }

    /// The world behind the simulated vehicle ended, or answered something else.
    pub fn world(sentence: impl Into<String>) -> Self {
        Self::World(sentence.into())
    }

    /// A flight did not go as a flight without faults goes.
    pub fn flight(sentence: impl Into<String>) -> Self {
        Self::Flight(sentence.into())
    }
}

impl fmt::Display for SimError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Refused(sentence) | Self::World(sentence) | Self::Flight(sentence)) = self;
        f.write_str(sentence)
    }
}

impl std::error::Error for SimError {}
