//! Errors of parameters. Step functions never fail. Constructors fail once, with one sentence: what, found, expected.

use core::fmt;

/// A parameter that a constructor refuses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Error {
    /// A number is NaN or infinite.
    NotFinite {
        /// The parameter.
        name: &'static str,
    },
    /// A number lies outside its range.
    OutOfRange {
        /// The parameter.
        name: &'static str,
        /// What was given.
        found: f64,
        /// Smallest accepted.
        min: f64,
        /// Largest accepted.
        max: f64,
    },
    /// A matrix is not symmetric, or not positive (semi-)definite.
    NotPositiveDefinite {
        /// The parameter.
        name: &'static str,
        /// Smallest eigenvalue of its symmetric part.
        smallest_eigenvalue: f64,
    },
    /// A matrix differs from its transpose.
    NotSymmetric {
        /// The parameter.
        name: &'static str,
        /// Largest difference.
        defect: f64,
    },
    /// A matrix is not a rotation.
    NotRotation {
        /// The parameter.
        name: &'static str,
        /// Largest entry of `R^T R - I`, or the determinant's distance from one.
        defect: f64,
    },
    /// Too many or too few of something.
    Count {
        /// What is counted.
        name: &'static str,
        /// How many were given.
        found: usize,
        /// Fewest accepted.
        min: usize,
        /// Most accepted.
        max: usize,
    },
    /// One rotor's parameter lies outside its range.
    Rotor {
        /// The rotor, from 1.
        rotor: usize,
        /// The parameter.
        name: &'static str,
        /// What was given.
        found: f64,
        /// What is expected.
        expected: &'static str,
    },
    /// A choice that does not go with the vehicle.
    Unsupported {
        /// The parameter.
        name: &'static str,
        /// What was chosen.
        found: &'static str,
        /// What is expected, and why.
        expected: &'static str,
    },
    /// The rotors cannot turn the vehicle about every axis and carry it as well.
    NotControllable {
        /// Rank of the allocation matrix.
        rank: usize,
        /// Rank of its torque rows.
        torque_rank: usize,
        /// Ratio of its largest to its smallest singular value.
        condition: f64,
        /// A rotor (from 1) whose column the others already span.
        rotor: usize,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NotFinite { name } => {
                write!(f, "{name} holds a NaN or an infinity; expected finite numbers")
            }
            Self::OutOfRange { name, found, min, max } => {
                write!(f, "{name} is {found}; expected a number from {min} to {max}")
            }
            Self::NotPositiveDefinite { name, smallest_eigenvalue } => write!(
                f,
                "{name} has the eigenvalue {smallest_eigenvalue:.3e}; expected a positive definite matrix"
            ),
            Self::NotSymmetric { name, defect } => {
                write!(f, "{name} differs from its transpose by {defect:.3e}; expected a symmetric matrix")
            }
            Self::NotRotation { name, defect } => write!(
                f,
                "{name} is {defect:.3e} away from a rotation; expected an orthonormal matrix with determinant +1"
            ),
            Self::Count { name, found, min, max } => {
                write!(f, "{found} {name} were given; expected {min} to {max}")
            }
            Self::Rotor { rotor, name, found, expected } => {
                write!(f, "rotor {rotor} has {name} = {found}; expected {expected}")
            }
            Self::Unsupported { name, found, expected } => {
                write!(f, "{name} is \"{found}\"; expected {expected}")
            }
            Self::NotControllable { rank, torque_rank, condition, rotor } => write!(
                f,
                "the allocation matrix has rank {rank} (condition number {condition:.3e}) and its torques rank \
                 {torque_rank}; expected at least 4 with all 3 torques: rotor {rotor} adds no new direction, \
                 move, tilt or reverse it"
            ),
        }
    }
}

impl core::error::Error for Error {}

/// Refuses a number that is not finite or not within `min..=max`.
///
/// # Errors
/// [`Error::NotFinite`] or [`Error::OutOfRange`], which name the parameter.
pub fn check_range(name: &'static str, found: f64, min: f64, max: f64) -> Result<(), Error> {
    if !found.is_finite() {
        Err(Error::NotFinite { name })
    } else if found < min || found > max {
        Err(Error::OutOfRange { name, found, min, max })
    } else {
        Ok(())
    }
}
