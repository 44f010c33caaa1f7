//! Why a simulation cannot begin, or why it ends.

use std::fmt;

/// Why there is no simulation. One sentence: what is wrong, what was found, what was expected, how to correct it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SimError {
    /// The request cannot be simulated.
    Refused(String),
    /// The world behind the simulated vehicle ended, or sent an unexpected answer.
    World(String),
    /// A flight without faults did not reach its mission.
    Flight(String),
}

impl SimError {
    /// The request cannot be simulated.
    pub fn refused(sentence: impl Into<String>) -> Self {
        Self::Refused(sentence.into())
    }

    /// The world behind the simulated vehicle ended, or sent an unexpected answer.
    pub fn world(sentence: impl Into<String>) -> Self {
        Self::World(sentence.into())
    }

    /// A flight without faults did not reach its mission.
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
