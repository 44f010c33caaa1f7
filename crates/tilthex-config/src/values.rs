//! Numbers in the shapes that a configuration can have.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// One number, several, or rows of them, as TOML can hold them.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number, a list of numbers or a list of rows")]
pub(crate) enum Raw {
    Number(f64),
    Numbers(Vec<f64>),
    Rows(Vec<Vec<f64>>),
}

impl Raw {
    fn describe(&self) -> String {
        match self {
            Self::Number(_) => "one number".into(),
            Self::Numbers(all) => format!("{} numbers", all.len()),
            Self::Rows(rows) => format!("{} rows", rows.len()),
        }
    }
}

/// One number for each axis. A single number holds for all axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Raw", into = "Raw")]
pub struct Axes<const N: usize>(pub [f64; N]);

impl<const N: usize> Axes<N> {
    /// The numbers as a vector.
    #[must_use]
    pub fn vector(&self) -> SVector<f64, N> {
        SVector::from(self.0)
    }
}

impl<const N: usize> TryFrom<Raw> for Axes<N> {
    type Error = String;

    fn try_from(raw: Raw) -> Result<Self, String> {
        match raw {
            Raw::Number(x) => Ok(Self([x; N])),
            Raw::Numbers(ref all) => match <[f64; N]>::try_from(all.as_slice()) {
                Ok(each) => Ok(Self(each)),
                Err(_) => Err(format!("found {}, expected one number or {N}", raw.describe())),
            },
            Raw::Rows(_) => Err(format!("found {}, expected one number or {N}", raw.describe())),
        }
    }
}

impl<const N: usize> From<Axes<N>> for Raw {
    fn from(axes: Axes<N>) -> Self {
        Self::Numbers(axes.0.to_vec())
    }
}

/// A square matrix, given as its diagonal or in full.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Raw", into = "Raw")]
pub struct Square<const N: usize>(pub SMatrix<f64, N, N>);

impl<const N: usize> Square<N> {
    /// A diagonal matrix.
    #[must_use]
    pub fn diagonal(diagonal: [f64; N]) -> Self {
        Self(SMatrix::from_diagonal(&SVector::from(diagonal)))
    }
}

impl<const N: usize> TryFrom<Raw> for Square<N> {
    type Error = String;

    fn try_from(raw: Raw) -> Result<Self, String> {
        let refused = || format!("found {}, expected {N} numbers (the diagonal) or {N}x{N}", raw.describe());
        match &raw {
            Raw::Numbers(all) => {
                <[f64; N]>::try_from(all.as_slice()).map(Self::diagonal).map_err(|_| refused())
            }
            Raw::Rows(rows) if rows.len() == N && rows.iter().all(|r| r.len() == N) => {
                Ok(Self(SMatrix::from_fn(|i, j| rows[i][j])))
            }
            _ => Err(refused()),
        }
    }
}

impl<const N: usize> From<Square<N>> for Raw {
    fn from(square: Square<N>) -> Self {
        let m = square.0;
        if m == SMatrix::from_diagonal(&m.diagonal()) {
            Self::Numbers(m.diagonal().as_slice().to_vec())
        } else {
            Self::Rows(m.row_iter().map(|row| row.iter().copied().collect()).collect())
        }
    }
}
