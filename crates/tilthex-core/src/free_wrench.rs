//! A commanded wrench while the tool touches nothing: how fast and how far that wrench may move the tool.
//!
//! Without this limit the filter moves at the speed force / damping, up to its excursion limit. Here the commanded wrench is
//! reduced until the reference keeps to the allowed speed. In contact it is not reduced: what the tool touches
//! balances the commanded wrench, and the reference does not move.

use crate::{
    Error,
    admittance::{AdmittanceFilter, AdmittanceState},
    error::check_range,
    force_axes::resists,
    types::{Matrix3, Matrix6, Setpoint, Vector3, Wrench},
};

/// Time constants of the approach to the largest speed and to the end of the way, s.
const REACHED: f64 = 0.1;
const APPROACH: f64 = 0.5;

/// The largest speeds and ways of a tool that is driven by a commanded wrench alone.
///
/// ```
/// use tilthex_core::{
///     Matrix3, Matrix6, Setpoint, Vector3, Wrench,
///     admittance::{AdmittanceFilter, AdmittanceParams, AdmittanceState},
///     free_wrench::{FreeWrenchParams, FreeWrenchState},
/// };
///
/// let filter = AdmittanceFilter::new(AdmittanceParams {
///     mass: Matrix6::identity() * 1.5,
///     damping: Matrix6::identity() * 10.0,
///     stiffness: Matrix6::zeros(),
///     ..AdmittanceParams::default()
/// })?;
/// let limits = FreeWrenchParams::default().checked()?;
/// let wrench_w = Wrench { force: Vector3::new(10.0, 0.0, 0.0), torque: Vector3::zeros() };
/// let setpoint = Setpoint { wrench_w, ..Setpoint::hold(Vector3::zeros(), Matrix3::identity()) };
/// let (mut state, mut moved) = (FreeWrenchState::default(), AdmittanceState::default());
/// for _ in 0..500 {
///     let drive_w = limits.step(&mut state, (&filter, &setpoint), &moved, &Wrench::ZERO, 0.002);
///     filter.step(&mut moved, &setpoint, &drive_w, 0.002);
///     // Without the limit the tool would reach 10 N / 10 N s/m = 1 m/s.
///     assert!(moved.twist_w[0] < 1.05 * limits.speed);
/// }
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeWrenchParams {
    /// Largest speed, m/s.
    pub speed: f64,
    /// Longest way without resistance, m.
    pub way: f64,
    /// Largest angular velocity, rad/s.
    pub spin: f64,
    /// Largest turn without resistance, rad.
    pub turn: f64,
}

impl Default for FreeWrenchParams {
    fn default() -> Self {
        let angle = 30f64.to_radians();
        Self { speed: 0.25, way: 0.3, spin: angle, turn: angle }
    }
}

impl FreeWrenchParams {
    /// The same parameters, after a check of their ranges.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for the first parameter that is out of its range.
    pub fn checked(self) -> Result<Self, Error> {
        check_range("max_wrench_speed", self.speed, 1e-3, 10.0)?;
        check_range("max_wrench_way", self.way, 0.0, 100.0)?;
        check_range("max_wrench_spin (rad/s)", self.spin, 1e-3, 100.0)?;
        check_range("max_wrench_turn (rad)", self.turn, 0.0, 3.1)?;
        Ok(self)
    }

    /// The part of a commanded wrench that drives the filter, world, in addition to the wrench that is felt; `dt` in s.
    #[inline]
    pub fn step(
        &self,
        state: &mut FreeWrenchState,
        (filter, setpoint): (&AdmittanceFilter, &Setpoint),
        moved: &AdmittanceState,
        felt_w: &Wrench,
        dt: f64,
    ) -> Wrench {
        let commanded_w = &setpoint.wrench_w;
        if *commanded_w == Wrench::ZERO {
            *state = FreeWrenchState::default();
            return Wrench::ZERO;
        }
        let spring_w = filter.acting_spring_w(moved, setpoint);
        let [mass, damping] = [&filter.params().mass, &filter.params().damping]
            .map(|m| filter.params().in_world(m, &setpoint.rotation_we));
        let half = |rows: usize, felt_w: Vector3, spring_w: Vector3, most: (f64, f64)| {
            let block = |m: &Matrix6| {
                Matrix3::from_fn(|i, k| m.get((rows + i, rows + k)).copied().unwrap_or_default())
            };
            Half { felt_w, spring_w, mass: block(&mass), damping: block(&damping), most }
        };
        let (force, torque) = (
            half(0, felt_w.force, spring_w.force, (self.speed, self.way)),
            half(3, felt_w.torque, spring_w.torque, (self.spin, self.turn)),
        );
        let twist_w = filter.own_twist_w(moved, setpoint);
        let (velocity_w, spin_w) = (twist_w.fixed_rows::<3>(0), twist_w.fixed_rows::<3>(3));
        Wrench {
            force: force.drive(&commanded_w.force, &velocity_w.into(), &mut state.way, dt),
            torque: torque.drive(&commanded_w.torque, &spin_w.into(), &mut state.turn, dt),
        }
    }
}

/// The filter in translation, or in rotation, under a commanded force or torque.
struct Half {
    /// Force or torque that is felt, and that of the spring, N or N m, world.
    felt_w: Vector3,
    spring_w: Vector3,
    mass: Matrix3,
    damping: Matrix3,
    /// Largest speed and way, m/s and m, or rad/s and rad.
    most: (f64, f64),
}

impl Half {
    /// The part of a commanded force or torque that drives it; `way` is how far that has moved it without resistance.
    fn drive(&self, commanded_w: &Vector3, velocity_w: &Vector3, way: &mut f64, dt: f64) -> Vector3 {
        let size = commanded_w.norm();
        if size <= 0.0 {
            *way = 0.0;
            return *commanded_w;
        }
        let along = commanded_w / size;
        let speed = velocity_w.dot(&along);
        if resists(&self.felt_w, commanded_w) {
            *way = 0.0;
        } else {
            *way += speed.max(0.0) * dt;
        }
        let allowed = self.most.0.min((self.most.1 - *way).max(0.0) / APPROACH);
        let (mass, damping) = (along.dot(&(self.mass * along)), along.dot(&(self.damping * along)));
        let enough = damping * allowed + mass * (allowed - speed) / REACHED;
        let wanted = size + (self.felt_w - self.spring_w).dot(&along);
        // A filter with little damping does not slow down by itself: the drive may also brake, as strongly as it pushes.
        along * (size - (wanted - enough).max(0.0).min(2.0 * size))
    }
}

/// How far a commanded wrench has carried the tool without resistance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FreeWrenchState {
    /// Way without resistance, m.
    pub way: f64,
    /// Turn without resistance, rad.
    pub turn: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::admittance::AdmittanceParams;
    use proptest::prelude::*;

    const DT: f64 = 0.002;

    /// What a commanded force comes to in 12 s, with a spring of this stiffness, N/m, from a place on, m: the largest speed, the
    /// place, and the force on the spring.
    fn run(force: f64, damping: f64, stiffness: f64, wall: (f64, f64)) -> (f64, f64, f64) {
        let params = AdmittanceParams {
            mass: Matrix6::identity() * 1.5,
            damping: Matrix6::identity() * damping,
            stiffness: Matrix6::identity() * stiffness,
            max_translation: 100.0,
            ..AdmittanceParams::default()
        };
        let filter = AdmittanceFilter::new(params).expect("valid");
        let limits = FreeWrenchParams::default();
        let wrench_w = Wrench { force: Vector3::new(0.0, force, 0.0), torque: Vector3::zeros() };
        let setpoint = Setpoint { wrench_w, ..Setpoint::hold(Vector3::zeros(), Matrix3::identity()) };
        let (mut state, mut moved, mut fastest) =
            (FreeWrenchState::default(), AdmittanceState::default(), 0.0_f64);
        let mut pressed = 0.0;
        for _ in 0..6000 {
            pressed = ((moved.translation_w.y - wall.1) * wall.0).max(0.0);
            let felt = Wrench { force: Vector3::new(0.0, -pressed, 0.0), torque: Vector3::zeros() };
            let drive = limits.step(&mut state, (&filter, &setpoint), &moved, &felt, DT) + felt;
            filter.step(&mut moved, &setpoint, &drive, DT);
            fastest = fastest.max(moved.twist_w.norm());
        }
        (fastest, moved.translation_w.y, pressed)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn without_resistance_it_is_no_faster_and_goes_no_farther(force in 0.1..100.0_f64, damping in 0.0..40.0_f64, stiffness in 0.0..20.0_f64) {
            let (fastest, place, _) = run(force, damping, stiffness, (0.0, 0.0));
            let limits = FreeWrenchParams::default();
            prop_assert!(fastest < 1.05 * limits.speed, "{fastest} m/s");
            prop_assert!((-1e-3..limits.way + 0.01).contains(&place), "{place} m");
            // And a weak one goes as far as damping and spring let it, without mass, in 9 s of the 12 s.
            let rate = stiffness / damping;
            let crept = if rate > 0.0 { force / stiffness * (1.0 - (-9.0 * rate).exp()) } else { 9.0 * force / damping };
            let least = limits.way.min(crept);
            prop_assert!(damping == 0.0 || place > 0.9 * least, "{place} m of {least}");
        }

        /// Also without damping and spring, where nothing but the drive slows the filter down.
        #[test]
        fn the_way_ends_without_damping(force in 0.5..100.0_f64, damping in 0.0..2.0_f64) {
            let (fastest, place, _) = run(force, damping, 0.0, (0.0, 0.0));
            let limits = FreeWrenchParams::default();
            prop_assert!(fastest < 1.05 * limits.speed, "{fastest} m/s");
            prop_assert!((0.9 * limits.way..limits.way + 0.01).contains(&place), "{place} m");
        }

        #[test]
        fn what_resists_is_pushed_as_hard_as_asked(force in 0.5..20.0_f64, at in 0.0..0.25_f64, wall in 200.0..2000.0_f64) {
            let (fastest, _, pressed) = run(force, 20.0, 0.0, (wall, at));
            prop_assert!((pressed - force).abs() < 0.02 * force, "{pressed} N of {force}");
            prop_assert!(fastest < 0.5, "{fastest} m/s");
        }
    }
}
