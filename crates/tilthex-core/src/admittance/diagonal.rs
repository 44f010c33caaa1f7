//! The same filter with other diagonal matrices. It needs no eigenvalues, and is cheap enough for a tick of a microcontroller.

use super::{AdmittanceFilter, AdmittanceParams, FASTEST, Law, largest_root, motion::Linear, spring::Spring};
use crate::{
    Error,
    error::check_range,
    types::{Matrix6, Vector6},
};

impl AdmittanceFilter {
    /// This filter with the diagonals of other matrices for mass, damping and stiffness, prepared for periods near 2 ms:
    /// what [`AdmittanceFilter::new`] makes of them, bit for bit.
    ///
    /// # Errors
    /// As [`AdmittanceFilter::new`].
    pub fn with_diagonals(
        &self,
        mass: &Vector6,
        damping: &Vector6,
        stiffness: &Vector6,
    ) -> Result<Self, Error> {
        check_diagonal("admittance mass", mass, 1e-9)?;
        check_diagonal("admittance damping", damping, 0.0)?;
        check_diagonal("admittance stiffness", stiffness, 0.0)?;
        let inverse = mass.map(|x| 1.0 / x);
        let (damping_rate, stiffness_rate) =
            (inverse.component_mul(damping), inverse.component_mul(stiffness));
        let largest = |rates: &Vector6| rates.iter().copied().fold(0.0, f64::max);
        let fastest = largest_root(largest(&damping_rate), largest(&stiffness_rate));
        check_range("fastest rate of the admittance filter (1/s)", fastest, 0.0, FASTEST)?;
        let full = |diagonal: &Vector6| Matrix6::from_diagonal(diagonal);
        Ok(Self {
            params: AdmittanceParams {
                mass: full(mass),
                damping: full(damping),
                stiffness: full(stiffness),
                ..self.params
            },
            spring: Spring::diagonal(stiffness),
            law: Law::Diagonal(Linear::new(*mass, inverse, damping_rate, stiffness_rate, fastest)),
            least_trace: self.least_trace,
        })
    }
}

/// # Errors
/// Names the matrix that is not finite, or not definite enough.
fn check_diagonal(name: &'static str, diagonal: &Vector6, least: f64) -> Result<(), Error> {
    if diagonal.iter().any(|x| !x.is_finite()) {
        return Err(Error::NotFinite { name });
    }
    let smallest_eigenvalue = diagonal.iter().copied().fold(f64::INFINITY, f64::min);
    if smallest_eigenvalue
        < least - 1e-12 * diagonal.iter().copied().fold(0.0, |most, x| f64::max(most, libm::fabs(x)))
    {
        return Err(Error::NotPositiveDefinite { name, smallest_eigenvalue });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{array::uniform6, prelude::*};

    /// The filter of matrices.
    fn of(m: Vector6, d: Vector6, k: Vector6) -> Result<AdmittanceFilter, Error> {
        let [mass, damping, stiffness] = [m, d, k].map(|diagonal| Matrix6::from_diagonal(&diagonal));
        AdmittanceFilter::new(AdmittanceParams { mass, damping, stiffness, ..AdmittanceParams::default() })
    }

    proptest! {
        #[test]
        fn it_is_the_filter_of_the_matrices(
            m in uniform6(1e-3..10.0), d in uniform6(0.0..50.0), k in uniform6(0.0..300.0)
        ) {
            let (m, d, k) = (Vector6::from(m), Vector6::from(d), Vector6::from(k));
            let changed = AdmittanceFilter::new(AdmittanceParams::default()).unwrap().with_diagonals(&m, &d, &k);
            prop_assert_eq!(changed.unwrap(), of(m, d, k).unwrap());
        }

        #[test]
        fn it_refuses_what_the_matrices_are_refused_for(
            axis in 0usize..6, which in 0usize..3, wrong in prop::sample::select(&[-1.0, f64::NAN, f64::INFINITY][..])
        ) {
            let mut parts = [Vector6::repeat(1.0); 3];
            parts[which][axis] = wrong;
            let [m, d, k] = parts;
            let filter = AdmittanceFilter::new(AdmittanceParams::default()).unwrap();
            prop_assert!(filter.with_diagonals(&m, &d, &k).is_err() && of(m, d, k).is_err());
        }
    }
}
