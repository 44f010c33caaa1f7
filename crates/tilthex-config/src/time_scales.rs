//! Compares the dominant poles of the observer and of the admittance filter: the observer must be faster (docs/laws.md). The
//! stability margins cover the observer and the pose controller.

use nalgebra::SMatrix;
use tilthex_core::{Matrix6, controller::ControllerParams};

/// Least ratio of the observer's pole to the dominant pole of the admittance filter.
const OBSERVER_TO_ADMITTANCE: f64 = 1.5;

/// One sentence for each pair of blocks that are too close.
pub(super) fn warnings(params: &ControllerParams) -> Vec<String> {
    let a = &params.admittance;
    let block = |m: &Matrix6, at: usize| m.fixed_view::<3, 3>(at, at).into_owned();
    let mut found = Vec::new();
    for (what, observer, at) in
        [("translation", params.observer.force.min(), 0), ("rotation", params.observer.torque.min(), 3)]
    {
        let yields = dominant(block(&a.mass, at), block(&a.damping, at), block(&a.stiffness, at));
        if observer < OBSERVER_TO_ADMITTANCE * yields {
            found.push(format!(
                "{what}: the wrench observer ({observer:.2} 1/s) is too slow for the admittance filter \
                 (dominant pole {yields:.2} 1/s); expected at least {OBSERVER_TO_ADMITTANCE} times it: raise its \
                 gain, or soften the filter's stiffness or add damping"
            ));
        }
    }
    found
}

/// The fastest of the three slowest poles of `M s^2 + D s + K` with three axes, 1/s.
fn dominant(mass: SMatrix<f64, 3, 3>, damping: SMatrix<f64, 3, 3>, stiffness: SMatrix<f64, 3, 3>) -> f64 {
    let inverse = mass.try_inverse().unwrap_or_else(SMatrix::zeros);
    let mut companion = Matrix6::zeros();
    companion.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
    companion.fixed_view_mut::<3, 3>(3, 0).copy_from(&(-inverse * stiffness));
    companion.fixed_view_mut::<3, 3>(3, 3).copy_from(&(-inverse * damping));
    let poles = companion.complex_eigenvalues();
    let mut sizes: Vec<f64> = poles.iter().map(|s| s.re.hypot(s.im)).collect();
    sizes.sort_by(f64::total_cmp);
    sizes[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Config, VehicleSection};

    fn of(overlay: &str) -> Vec<String> {
        let config = Config::default_for(VehicleSection::preset("tilt-hex").unwrap());
        config.overlaid(overlay.parse().unwrap()).unwrap().warnings()
    }

    #[test]
    fn a_double_pole_and_a_slow_one() {
        let d = |x: f64| SMatrix::<f64, 3, 3>::from_diagonal_element(x);
        assert!((dominant(d(2.0), d(6.0), d(4.0)) - 1.0).abs() < 1e-12);
        assert_eq!(dominant(d(2.0), d(6.0), d(0.0)), 0.0);
    }

    #[test]
    fn the_default_and_the_experiments_are_accepted() {
        for overlay in [
            "",
            "[admittance]\nstiffness = [8, 8, 8, 10, 10, 5]",
            "[admittance]\ndamping = [5, 5, 5, 4, 4, 4]",
            "[admittance]\nmass = [0.75, 0.75, 0.75, 0.01, 0.01, 0.02]",
            "[admittance]\ndamping = [10, 3.5, 10, 4, 4, 4]\nstiffness = [10, 2.5, 6, 10, 10, 5]",
        ] {
            assert_eq!(of(overlay), Vec::<String>::new(), "{overlay}");
        }
        // Peg in hole, with a soft wrist that holds its heading: a spring without a potential, and nothing else.
        let found = of("[wrench_observer]\nforce_gain = 30\ntorque_gain = 30\n[admittance]\n\
             damping = [10, 10, 10, 1.5, 1.5, 1.5]\nstiffness = [6, 6, 30, 0.05, 0.05, 5]");
        assert!(
            found.len() == 1 && found[0].contains("0.05, 0.05 and 5 N m/rad, has no potential"),
            "{found:?}"
        );
    }

    #[test]
    fn the_pair_that_is_too_close_is_named() {
        let slow_observer = of("[wrench_observer]\ntorque_gain = 2");
        assert!(slow_observer.len() == 1 && slow_observer[0].starts_with("rotation: the wrench observer"));
    }
}
