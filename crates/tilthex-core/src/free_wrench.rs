//! A wrench that the tool is asked to exert where nothing resists it: how fast, and how far, it may carry the tool.
//!
//! The filter would move at force by damping, up to its excursion limit. So as much of the asked wrench is left out
//! as would drive the reference faster than it may go. In contact nothing is left out: there the wrench of what is
//! touched takes the drive away.

use crate::{
    Error,
    admittance::{AdmittanceParams, AdmittanceState},
    error::check_range,
    so3,
    types::{Vector3, Vector6, Wrench},
};

/// Something resists where this part of the asked wrench is felt against it.
const RESISTS: f64 = 0.3;
/// The largest speed is reached within about so long, s, and the end of the way is approached within so long, s.
const REACHED: f64 = 0.1;
const APPROACH: f64 = 0.5;

/// The largest speeds and ways of a tool that is driven by an asked wrench alone.
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
        Self { speed: 0.25, way: 0.3, spin: 0.5, turn: 0.5 }
    }
}

impl FreeWrenchParams {
    /// The same, checked.
    ///
    /// # Errors
    /// Names what is out of range.
    pub fn checked(self) -> Result<Self, Error> {
        check_range("max_wrench_speed", self.speed, 1e-3, 10.0)?;
        check_range("max_wrench_way", self.way, 0.0, 100.0)?;
        check_range("max_wrench_spin (rad/s)", self.spin, 1e-3, 100.0)?;
        check_range("max_wrench_turn (rad)", self.turn, 0.0, 3.1)?;
        Ok(self)
    }

    /// What of an asked wrench drives the filter, world, beside the wrench that is felt; `dt` in s.
    pub fn step(
        &self,
        state: &mut FreeWrenchState,
        filter: &AdmittanceParams,
        moved: &AdmittanceState,
        felt_w: &Wrench,
        asked_w: &Wrench,
        dt: f64,
    ) -> Wrench {
        let turned = so3::vee(&moved.rotation);
        let mut strain = Vector6::zeros();
        strain.fixed_rows_mut::<3>(0).copy_from(&moved.translation_w);
        strain.fixed_rows_mut::<3>(3).copy_from(&turned);
        let beside = felt_w.to_vector() - filter.stiffness * strain;
        let left = |asked: &Vector3, felt: &Vector3, at: usize, most: (f64, f64), way: &mut f64| {
            let size = asked.norm();
            if size <= 0.0 {
                *way = 0.0;
                return *asked;
            }
            let along = asked / size;
            let mut axis = Vector6::zeros();
            let half = |v: &Vector6| {
                if at == 0 { v.fixed_rows::<3>(0).into_owned() } else { v.fixed_rows::<3>(3).into_owned() }
            };
            if at == 0 {
                axis.fixed_rows_mut::<3>(0).copy_from(&along);
            } else {
                axis.fixed_rows_mut::<3>(3).copy_from(&along);
            }
            let speed = half(&moved.twist_w).dot(&along);
            if felt.dot(&along) < -RESISTS * size {
                *way = 0.0;
            } else {
                *way += speed.max(0.0) * dt;
            }
            let allowed = most.0.min((most.1 - *way).max(0.0) / APPROACH);
            let drive = size + half(&beside).dot(&along);
            let (mass, damping) = (axis.dot(&(filter.mass * axis)), axis.dot(&(filter.damping * axis)));
            let enough = damping * allowed + mass * (allowed - speed) / REACHED;
            let too_much = (drive - enough).max(0.0).min(size);
            along * (size - too_much)
        };
        Wrench {
            force: left(&asked_w.force, &felt_w.force, 0, (self.speed, self.way), &mut state.way),
            torque: left(&asked_w.torque, &felt_w.torque, 3, (self.spin, self.turn), &mut state.turn),
        }
    }
}

/// How far an asked wrench has carried the tool without resistance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FreeWrenchState {
    /// m.
    pub way: f64,
    /// rad.
    pub turn: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        admittance::AdmittanceFilter,
        types::{Matrix3, Matrix6, Setpoint},
    };
    use proptest::prelude::*;

    const DT: f64 = 0.002;

    /// What an asked force comes to in 12 s, with a spring of so much, N/m, from a place on, m: the largest speed, the
    /// place, and the force on the spring.
    fn run(force: f64, damping: f64, stiffness: f64, wall: (f64, f64)) -> (f64, f64, f64) {
        let params = AdmittanceParams {
            mass: Matrix6::identity() * 1.5,
            damping: Matrix6::identity() * damping,
            stiffness: Matrix6::identity() * stiffness,
            max_translation: 100.0,
            max_rotation: 1.0,
        };
        let filter = AdmittanceFilter::new(params).expect("valid");
        let limits = FreeWrenchParams::default();
        let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        let (mut state, mut moved, mut fastest) =
            (FreeWrenchState::default(), AdmittanceState::default(), 0.0_f64);
        let asked = Wrench { force: Vector3::new(0.0, force, 0.0), torque: Vector3::zeros() };
        let mut pressed = 0.0;
        for _ in 0..6000 {
            pressed = ((moved.translation_w.y - wall.1) * wall.0).max(0.0);
            let felt = Wrench { force: Vector3::new(0.0, -pressed, 0.0), torque: Vector3::zeros() };
            let drive = limits.step(&mut state, filter.params(), &moved, &felt, &asked, DT) + felt;
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
            // And a weak one goes as far as it can.
            let least = if stiffness > 0.0 { (force / stiffness).min(limits.way) } else { limits.way };
            prop_assert!(damping == 0.0 || place > 0.9 * least.min(9.0 * force / damping), "{place} m of {least}");
        }

        #[test]
        fn what_resists_is_pushed_as_hard_as_asked(force in 0.5..20.0_f64, at in 0.0..0.25_f64, wall in 200.0..2000.0_f64) {
            let (fastest, _, pressed) = run(force, 20.0, 0.0, (wall, at));
            prop_assert!((pressed - force).abs() < 0.02 * force, "{pressed} N of {force}");
            prop_assert!(fastest < 0.5, "{fastest} m/s");
        }
    }
}
