//! Bounds of the reference's speed relative to its set-point, and of the energy that it gives to what the tool
//! touches.
//!
//! The admittance filter alone is passive. With the observer's lag, the delays of the loop and a commanded wrench it
//! is not: against a stiff wall the tool may bounce harder and harder. The tank counts the energy `-h_hat . dv dt`
//! that the reference, relative to its set-point, gives to the environment. A constant power, and the energy that the
//! environment gives back, fill it up to its capacity. If it is empty, the reference is pushed along `h_hat`, as an
//! impulse of the environment on the filter's mass would push it, until it gives no more than that power. So in any
//! time t it gives at most `capacity + power t` (Ferraguti et al. 2015 bound an admittance in a similar way).

use crate::{
    Error,
    admittance::AdmittanceState,
    error::check_range,
    types::{Setpoint, Vector3, Vector6, Wrench},
};

/// The bounds.
///
/// ```
/// use tilthex_core::{
///     Matrix3, Setpoint, Vector3, Vector6, Wrench, admittance::AdmittanceState, reference_bounds::ReferenceBounds,
/// };
///
/// let bounds = ReferenceBounds { capacity: 0.5, power: 0.0, ..ReferenceBounds::default() };
/// let wall_w = Wrench { force: Vector3::new(-10.0, 0.0, 0.0), torque: Vector3::zeros() };
/// let (mut level, mut given) = (bounds.capacity, 0.0);
/// for _ in 0..1000 {
///     // A reference that wants to press on at 0.9 m/s against 10 N.
///     let mut state = AdmittanceState { twist_w: Vector6::x() * 0.9, ..AdmittanceState::default() };
///     let mut reference = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
///     let felt_w = (&wall_w, &wall_w.to_vector());
///     let twist_w = state.twist_w;
///     bounds.step(&mut level, (&mut state, &mut reference), &twist_w, felt_w, 0.002);
///     given += 10.0 * state.twist_w[0] * 0.002;
/// }
/// assert!((given - 0.5).abs() < 1e-9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceBounds {
    /// Largest speed relative to the set-point, m/s.
    pub speed: f64,
    /// Largest angular velocity relative to the set-point, rad/s.
    pub spin: f64,
    /// Energy that the tank holds, J.
    pub capacity: f64,
    /// Power that fills it, W.
    pub power: f64,
}

impl Default for ReferenceBounds {
    fn default() -> Self {
        Self { speed: 1.0, spin: core::f64::consts::PI, capacity: 5.0, power: 5.0 }
    }
}

impl ReferenceBounds {
    /// # Errors
    /// [`Error::OutOfRange`] for the first bound that is out of its range.
    pub fn check(&self) -> Result<(), Error> {
        check_range("max_velocity", self.speed, 1e-3, 1e3)?;
        check_range("max_angular_velocity", self.spin, 1e-3, 1e3)?;
        check_range("tank_capacity", self.capacity, 0.0, 1e4)?;
        check_range("tank_power", self.power, 0.0, 1e4)
    }

    /// One tick of `dt` s, after the filter's. `level` is the tank's, J; `twist_w` the twist of the reference that counts,
    /// world; `felt_w` the wrench of the environment at the tool, world, and the change of the filter's twist by this
    /// wrench as an impulse of 1 s.
    #[inline]
    pub fn step(
        &self,
        level: &mut f64,
        (state, reference): (&mut AdmittanceState, &mut Setpoint),
        twist_w: &Vector6,
        felt_w: (&Wrench, &Vector6),
        dt: f64,
    ) {
        if dt <= 0.0 {
            return;
        }
        let halves = Wrench::from_vector(twist_w);
        let slower = |v: Vector3, most: f64| {
            let square = v.norm_squared();
            // No root and no division while it is slow enough, as it usually is.
            let part = if square > most * most { most / libm::sqrt(square) - 1.0 } else { 0.0 };
            v * part
        };
        let (v, w) = (slower(halves.force, self.speed), slower(halves.torque, self.spin));
        // The part of the velocity that is removed in this tick is removed from the acceleration too.
        reference.acceleration_w += v * (1.0 / dt);
        reference.angular_acceleration_w += w * (1.0 / dt);
        let slower = Wrench { force: v, torque: w }.to_vector();
        let change = slower + self.back(level, &(twist_w + slower), felt_w, dt);
        state.twist_w += change;
        let change = Wrench::from_vector(&change);
        reference.velocity_w += change.force;
        reference.angular_velocity_w += change.torque;
    }

    /// The change of the twist with which the tank's energy is not exceeded.
    #[inline]
    fn back(&self, level: &mut f64, twist_w: &Vector6, felt_w: (&Wrench, &Vector6), dt: f64) -> Vector6 {
        let (felt_w, impulse_w) = (felt_w.0.to_vector(), felt_w.1);
        let (given, weight) = (-felt_w.dot(twist_w), felt_w.dot(impulse_w));
        let most = self.power + *level / dt;
        let (spent, change) = if given > most && weight > 0.0 {
            (most, impulse_w * ((given - most) / weight))
        } else {
            (given, Vector6::zeros())
        };
        *level = (*level + (self.power - spent) * dt).max(0.0).min(self.capacity);
        change
    }
}
