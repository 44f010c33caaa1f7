//! Two-way clock synchronisation: the remote clock is asked, and its answer
//! lies between the question and its arrival.

/// The offset of a remote clock that answers, in constant memory: the best
/// answer so far, whose uncertainty grows with the drift of the clocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EchoClock {
    drift: f64,
    best: Option<Answer>,
    resets: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Answer {
    /// Ours minus the remote clock, s.
    offset: f64,
    /// Largest error of the offset, s.
    uncertainty: f64,
    /// When it came, s on our clock.
    at: f64,
}

impl EchoClock {
    /// A clock that was not asked yet, with the largest relative drift between the clocks.
    #[must_use]
    pub fn new(drift: f64) -> Self {
        Self { drift, best: None, resets: 0 }
    }

    /// Takes an answer: `remote` (s, its clock) to a question of `asked`, which came at `answered` (s, ours).
    /// One that comes before its question or is not finite changes nothing.
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

    /// A remote time, s, on our clock, and its largest error, s, at a time (ours); `None` before the first answer.
    #[must_use]
    pub fn to_ours(&self, remote: f64, now: f64) -> Option<(f64, f64)> {
        self.best.map(|best| (remote + best.offset, self.aged(&best, now).uncertainty))
    }

    /// How often the remote clock was set to another time.
    #[must_use]
    pub fn resets(&self) -> u32 {
        self.resets
    }

    fn aged(&self, answer: &Answer, now: f64) -> Answer {
        let age = (now - answer.at).max(0.0);
        Answer { uncertainty: answer.uncertainty + self.drift * age, ..*answer }
    }
}
