//! The parameters of the admittance filter.

use crate::{
    Error,
    error::check_range,
    types::{Matrix3, Matrix6, Vector6},
};

/// The axes of mass, damping and stiffness.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// Those of the world.
    #[default]
    World,
    /// Those of the tool at its set-point.
    Tool,
}

impl Axes {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::World, Self::Tool];

    /// The name in a configuration.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::World => "world",
            Self::Tool => "tool",
        }
    }
}

/// Mass, damping and stiffness at the tool (translation first), and limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdmittanceParams {
    /// The axes of the matrices.
    pub axes: Axes,
    /// M, kg and kg m^2; positive definite.
    pub mass: Matrix6,
    /// D, N s/m and N m s/rad; positive semi-definite.
    pub damping: Matrix6,
    /// K, N/m and N m/rad; positive semi-definite.
    pub stiffness: Matrix6,
    /// Largest distance of the reference from the set-point, m.
    pub max_translation: f64,
    /// Largest rotation of the reference from the set-point, rad; below pi.
    pub max_rotation: f64,
}

/// The parameters of the paper's vehicle in free flight.
impl Default for AdmittanceParams {
    fn default() -> Self {
        let diagonal = |d: [f64; 6]| Matrix6::from_diagonal(&Vector6::from(d));
        Self {
            axes: Axes::World,
            mass: diagonal([1.5, 1.5, 1.5, 0.01, 0.01, 0.02]),
            damping: diagonal([10.0, 10.0, 10.0, 4.0, 4.0, 4.0]),
            stiffness: diagonal([6.0, 6.0, 6.0, 10.0, 10.0, 5.0]),
            max_translation: 1.0,
            max_rotation: core::f64::consts::FRAC_PI_3,
        }
    }
}

/// Rate of a reference that does not yield, critically damped, 1/s.
const FIRM: f64 = 2.0;
/// Smallest allowed excursion of such a reference at its start: m and rad.
const FIRM_EXCURSION: (f64, f64) = (1.0, 1.0);

impl AdmittanceParams {
    /// # Errors
    /// Names the matrix that is not finite, symmetric or definite, or the limit out of range.
    pub(super) fn check(&self) -> Result<(), Error> {
        check_matrix("admittance mass", &self.mass, 1e-9)?;
        check_matrix("admittance damping", &self.damping, 0.0)?;
        check_matrix("admittance stiffness", &self.stiffness, 0.0)?;
        check_range("max_translation", self.max_translation, 0.0, 100.0)?;
        check_range("max_rotation", self.max_rotation, 0.0, 3.1)
    }

    /// One of the matrices in world axes, for a tool at its set-point `rotation_we`.
    #[must_use]
    pub fn in_world(&self, matrix: &Matrix6, rotation_we: &Matrix3) -> Matrix6 {
        if self.axes == Axes::World {
            return *matrix;
        }
        let both = Matrix6::from_fn(|i, k| {
            if i / 3 == k / 3 { rotation_we.get((i % 3, k % 3)).copied().unwrap_or_default() } else { 0.0 }
        });
        both * matrix * both.transpose()
    }

    /// The parameters of a reference that does not yield, and that returns from any place to which `yielding` let it
    /// go.
    #[must_use]
    pub(crate) fn firm(yielding: &Self) -> Self {
        let (far, wide) = FIRM_EXCURSION;
        Self {
            mass: Matrix6::identity(),
            damping: Matrix6::from_diagonal_element(2.0 * FIRM),
            stiffness: Matrix6::from_diagonal_element(FIRM * FIRM),
            max_translation: yielding.max_translation.max(far),
            max_rotation: yielding.max_rotation.max(wide),
            ..Self::default()
        }
    }
}

fn check_matrix(name: &'static str, m: &Matrix6, least: f64) -> Result<(), Error> {
    if m.iter().any(|x| !x.is_finite()) {
        return Err(Error::NotFinite { name });
    }
    let defect = (m - m.transpose()).amax();
    if defect > 1e-9 * m.amax() {
        return Err(Error::NotSymmetric { name, defect });
    }
    let smallest_eigenvalue = m.symmetric_eigenvalues().min();
    if smallest_eigenvalue < least - 1e-12 * m.amax() {
        return Err(Error::NotPositiveDefinite { name, smallest_eigenvalue });
    }
    Ok(())
}
