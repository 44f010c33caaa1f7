//! Wind: a constant velocity, and gusts with a Dryden spectrum.

use crate::{
    Error,
    error::check_range,
    random::Random,
    types::{Vector3, is_finite3},
};
use libm::{exp, fabs, sqrt};

/// Mean wind and the gusts about it.
///
/// Dryden's one-sided spectra over the angular spatial frequency `W` (rad/m), with the standard deviation `s` and the
/// length `L` (MIL-F-8785C, 3.7.2), are `s^2 (2 L/pi) / (1 + (L W)^2)` along the mean wind, and `s^2 (L/pi) (1 + 3 (L
/// W)^2) / (1 + (L W)^2)^2` across it and upwards. The gusts pass the vehicle with the airspeed (Taylor's frozen
/// turbulence), or with their standard deviation if that is larger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wind {
    /// Velocity of the air, m/s, world.
    pub mean_w: Vector3,
    /// Standard deviation of the gusts in each direction, m/s.
    pub gust_deviation: f64,
    /// Length scale of the gusts, m.
    pub gust_length: f64,
    /// Time from which the wind rises, s. It has its full speed [`RISES`] later.
    pub begin: f64,
}

/// A wind that begins during the simulation rises linearly over this time, s.
pub const RISES: f64 = 2.0;

/// The state of the gusts: filters of unit variance along, across and up, and their noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindState {
    along: f64,
    across: [f64; 2],
    up: [f64; 2],
    random: Random,
    /// Simulated time, s.
    time: f64,
}

impl WindState {
    /// Gusts in their steady statistics; each seed gives other gusts.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        // Sensors use `Random::new(seed)`; the gusts need other numbers for the same seed.
        let mut random = Random::new(seed ^ 0x57_49_4E_44);
        let mut pair = || {
            let (a, b) = (random.normal(), random.normal());
            // Unit variance; the covariance of the two lags and the variance of the second lag are 1/2.
            [a, 0.5 * a + 0.5 * b]
        };
        let (across, up) = (pair(), pair());
        Self { along: random.normal(), across, up, random, time: 0.0 }
    }
}

impl Default for WindState {
    fn default() -> Self {
        Self::new(0)
    }
}

impl Wind {
    /// Still air.
    pub const CALM: Self =
        Self { mean_w: Vector3::new(0.0, 0.0, 0.0), gust_deviation: 0.0, gust_length: 20.0, begin: 0.0 };

    /// Refuses impossible numbers.
    ///
    /// # Errors
    /// [`Error`], which names the first of them.
    pub fn check(&self) -> Result<(), Error> {
        if !is_finite3(&self.mean_w) {
            return Err(Error::NotFinite { name: "wind" });
        }
        check_range("wind_speed", self.mean_w.norm(), 0.0, 100.0)?;
        check_range("gust_deviation", self.gust_deviation, 0.0, 50.0)?;
        check_range("gust_length", self.gust_length, 0.1, 1e4)?;
        check_range("wind_begin", self.begin, 0.0, 1e6)
    }

    /// Whether there is neither wind nor gusts.
    #[must_use]
    pub fn is_calm(&self) -> bool {
        self.mean_w == Vector3::zeros() && self.gust_deviation == 0.0
    }

    /// Velocity of the air at the vehicle, m/s, world.
    #[must_use]
    pub fn velocity(&self, state: &WindState) -> Vector3 {
        let risen = if self.begin > 0.0 { ((state.time - self.begin) / RISES).clamp(0.0, 1.0) } else { 1.0 };
        if self.gust_deviation == 0.0 {
            return risen * self.mean_w;
        }
        let horizontal = Vector3::new(self.mean_w.x, self.mean_w.y, 0.0);
        let along = horizontal.try_normalize(1e-9).unwrap_or_else(Vector3::x);
        let across = Vector3::new(-along.y, along.x, 0.0);
        // (1 + sqrt(3) T s) / (1 + T s)^2 = sqrt(3) / (1 + T s) + (1 - sqrt(3)) / (1 + T s)^2.
        let second = |x: &[f64; 2]| {
            let root = sqrt(3.0);
            (root * x[0] + (1.0 - root) * x[1]) / sqrt(2.0)
        };
        let gust = state.along * along + second(&state.across) * across + second(&state.up) * Vector3::z();
        risen * (self.mean_w + self.gust_deviation * gust)
    }

    /// Moves the gusts by `dt` seconds past a vehicle with a velocity (m/s, world). Exact for any `dt` at a constant
    /// airspeed.
    pub fn step(&self, state: &mut WindState, velocity_w: &Vector3, dt: f64) {
        state.time += dt;
        if self.gust_deviation == 0.0 {
            return;
        }
        let airspeed = (self.mean_w - velocity_w).norm().max(self.gust_deviation);
        let e = airspeed * dt / self.gust_length;
        let keep = exp(-e);
        let square = keep * keep;
        let fresh = sqrt(fabs(1.0 - square));
        state.along = keep * state.along + fresh * state.random.normal();
        // Covariance of the noise of two first-order lags in series: P - A P A^T with P = [[1, 1/2], [1/2, 1/2]].
        let cross = 0.5 - square * (e + 0.5);
        let last = 0.5 - square * (e * e + e + 0.5);
        let slope = if fresh > 0.0 { cross / fresh } else { 0.0 };
        let rest = sqrt((last - slope * slope).max(0.0));
        for lags in [&mut state.across, &mut state.up] {
            let (a, b) = (state.random.normal(), state.random.normal());
            let [first, second] = *lags;
            *lags = [keep * first + fresh * a, keep * (e * first + second) + slope * a + rest * b];
        }
    }
}
