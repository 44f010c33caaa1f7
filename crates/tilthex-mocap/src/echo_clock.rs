//! Two-way clock synchronisation: this side asks for the time of the remote clock. The remote clock was read between the
//! question and the arrival of the answer.

/// The offset of a remote clock that answers questions. It keeps the best answer, whose uncertainty grows with the drift of
/// the clocks, and needs constant memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EchoClock {
    drift: f64,
    best: Option<Answer>,
    resets: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Answer {
    /// Our clock minus the remote clock, s.
    offset: f64,
    /// Largest error of the offset, s.
    uncertainty: f64,
    /// Time at which it arrived, s, our clock.
    at: f64,
}

impl EchoClock {
    /// The state before the first answer. `drift` is the largest relative drift between the clocks.
    #[must_use]
    pub fn new(drift: f64) -> Self {
        Self { drift, best: None, resets: 0 }
    }

    /// Takes an answer with the remote time `remote` (s, remote clock). The question was sent at `asked`, and the answer
    /// arrived at `answered` (s, our clock). An answer that is older than its question or not finite is ignored.
    /// Returns whether the remote clock was set to another time since the last answer.
    pub fn step(&mut self, asked: f64, remote: f64, answered: f64) -> bool {
        let answer = Answer {
            offset: 0.5 * (asked + answered) - remote,
            uncertainty: 0.5 * (answered - asked),
            at: answered,
        };
        if !(answer.offset.is_finite() && answer.uncertainty >= 0.0) {
            return false;
        }
        let Some(best) = self.best.map(|best| self.aged(&best, answered)) else {
            self.best = Some(answer);
            return false;
        };
        let reset = (answer.offset - best.offset).abs() > answer.uncertainty + best.uncertainty;
        if reset {
            self.resets = self.resets.saturating_add(1);
        }
        if reset || answer.uncertainty <= best.uncertainty {
            self.best = Some(answer);
        }
        reset
    }

    /// Converts a remote time, s, to our clock. Also returns the largest error of the result, s, at the time `now` (our
    /// clock). `None` before the first answer.
    #[must_use]
    pub fn to_ours(&self, remote: f64, now: f64) -> Option<(f64, f64)> {
        self.best.map(|best| (remote + best.offset, self.aged(&best, now).uncertainty))
    }

    /// Number of times that the remote clock was set to another time.
    #[must_use]
    pub fn resets(&self) -> u32 {
        self.resets
    }

    fn aged(&self, answer: &Answer, now: f64) -> Answer {
        let age = (now - answer.at).max(0.0);
        Answer { uncertainty: answer.uncertainty + self.drift * age, ..*answer }
    }
}
