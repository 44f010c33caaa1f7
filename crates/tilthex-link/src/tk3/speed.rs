//! Rotor speeds as the protocol sends them: the time of half a revolution in microseconds.

/// Microseconds in half a second: a rotor at `w` Hz takes this over `w` for half a turn.
const HALF_SECOND: f64 = 500_000.0;

/// The lowest speed that the protocol can send, Hz: `500000 / 32767`. Zero cannot be sent.
pub const LOWEST_SPEED: f64 = HALF_SECOND / 32_767.0;

/// The half period, us, that asks for a speed in Hz: `trunc(500000 / speed)`,
/// within +-32767 and never 0. Speeds below about 15.259 Hz in magnitude, zero
/// among them, give +-32767, the lowest speed; so does NaN.
#[must_use]
pub fn half_period(speed: f64) -> i16 {
    // A NaN fails both comparisons. The cast truncates towards zero and saturates.
    let magnitude = if speed > 0.0 {
        HALF_SECOND / speed
    } else if speed < 0.0 {
        HALF_SECOND / -speed
    } else {
        f64::INFINITY
    };
    let magnitude = (magnitude as i16).max(1);
    if speed < 0.0 { -magnitude } else { magnitude }
}

/// The speed, Hz, that a half period in us stands for; 0 for a half period of 0.
#[must_use]
pub fn speed(half_period: i16) -> f64 {
    if half_period == 0 { 0.0 } else { HALF_SECOND / f64::from(half_period) }
}

/// The half period, us, of a measured speed in Hz: rounded to the nearest count. That of a commanded one is truncated.
#[must_use]
pub fn nearest_half_period(speed: f64) -> i16 {
    if speed.abs() < LOWEST_SPEED {
        return if speed < 0.0 { -i16::MAX } else { i16::MAX };
    }
    libm::round(HALF_SECOND / speed) as i16
}
