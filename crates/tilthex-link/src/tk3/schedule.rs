//! The samples of a stream whose rate the host chooses, at a vehicle's end.

/// One stream that the host may request.
#[derive(Clone, Copy, Debug, Default)]
pub struct Schedule {
    period: u32,
    next: u64,
    sequence: u8,
}

impl Schedule {
    /// Sets the period, us; 0 turns the stream off.
    pub fn set(&mut self, period: u32, now: u64) {
        self.period = period;
        self.next = now + u64::from(period);
    }

    /// The period, us.
    #[must_use]
    pub fn period(&self) -> u32 {
        self.period
    }

    /// Whether a sample is due. The times of the samples stay multiples of the period.
    #[must_use]
    pub fn due(&mut self, now: u64) -> bool {
        if self.period == 0 || now < self.next {
            return false;
        }
        let period = u64::from(self.period);
        self.next += period * ((now - self.next) / period + 1);
        self.sequence = self.sequence.wrapping_add(1);
        true
    }

    /// The number of the newest sample.
    #[must_use]
    pub fn sequence(&self) -> u8 {
        self.sequence
    }
}
