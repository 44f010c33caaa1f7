//! Triangles of 15x15 matrices, in a layout for factorisation and update.
//!
//! A column holds 16 lanes, so that a compiler turns each loop over lanes into whole vector instructions. Columns are
//! processed in groups of four, from the first lane of the group. Entries above the diagonal are never read.
#![allow(clippy::needless_range_loop)] // Indices are the mathematics here.

/// Dimension of the error state.
pub(super) const N: usize = 15;
/// Its dimension padded to whole vectors; the last lane is zero.
pub(super) const LANES: usize = 16;

/// One column.
pub(super) type Column = [f64; LANES];

/// The lower triangle of a symmetric matrix, or a lower triangular one, by columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triangle(pub(super) [Column; N]);

impl Triangle {
    pub(super) const ZERO: Self = Self([[0.0; LANES]; N]);

    /// Entry of the symmetric matrix of which this is the lower triangle.
    pub(super) fn get(&self, i: usize, j: usize) -> f64 {
        if i >= j { self.0[j][i] } else { self.0[i][j] }
    }

    /// Column of the symmetric matrix.
    #[inline]
    pub(super) fn whole_column(&self, j: usize) -> Column {
        let j = j.min(N - 1); // always true; the optimiser needs it
        let mut column = self.0[j];
        for i in 0..j {
            column[i] = self.0[i][j];
        }
        column
    }

    /// Diagonal entry.
    #[inline(always)]
    pub(super) fn diagonal(&self, i: usize) -> f64 {
        self.0[i][i]
    }

    /// Sets the first columns of the lower triangular factor `L` with `L L^T` equal to this matrix, zero above the diagonal,
    /// where `l` must be zero. False if one of their pivots is not above `1e-15` of its
    /// diagonal entry.
    pub(super) fn cholesky<const COLUMNS: usize>(&self, l: &mut [Column; COLUMNS]) -> bool {
        self.factor_panel::<0, COLUMNS>(l)
            && self.factor_panel::<4, COLUMNS>(l)
            && self.factor_panel::<8, COLUMNS>(l)
            && self.factor_panel::<12, COLUMNS>(l)
    }

    /// Whether this matrix has a factor.
    pub(super) fn is_definite(&self) -> bool {
        self.cholesky::<N>(&mut [[0.0; LANES]; N])
    }

    /// Columns `FIRST..FIRST + 4` of the factor (left-looking).
    #[inline]
    fn factor_panel<const FIRST: usize, const COLUMNS: usize>(&self, l: &mut [Column; COLUMNS]) -> bool {
        for j in FIRST..COLUMNS.min(FIRST + 4) {
            let mut column = self.0[j];
            let entry = column[j];
            for k in 0..j {
                let factor = l[k][j];
                for i in FIRST..LANES {
                    column[i] -= factor * l[k][i];
                }
            }
            let pivot = column[j];
            if !(pivot > 1e-15 * entry && pivot.is_finite()) {
                return false;
            }
            let scale = 1.0 / libm::sqrt(pivot);
            for i in FIRST..LANES {
                l[j][i] = if i >= j { column[i] * scale } else { 0.0 };
            }
        }
        true
    }

    /// Subtracts the sum of `w w^T`.
    pub(super) fn downdate<const M: usize>(&mut self, w: &[Column; M]) {
        self.downdate_panel::<0, M>(w);
        self.downdate_panel::<4, M>(w);
        self.downdate_panel::<8, M>(w);
        self.downdate_panel::<12, M>(w);
    }

    #[inline]
    fn downdate_panel<const FIRST: usize, const M: usize>(&mut self, w: &[Column; M]) {
        for j in FIRST..N.min(FIRST + 4) {
            let mut column = self.0[j];
            for w in w {
                let factor = w[j];
                for i in FIRST..LANES {
                    column[i] -= factor * w[i];
                }
            }
            self.0[j] = column;
        }
    }

    /// Multiplies row and column `i` by `scale` (the diagonal entry twice).
    pub(super) fn scale(&mut self, i: usize, scale: f64) {
        let i = i.min(N - 1); // always true; the optimiser needs it
        for j in 0..i {
            self.0[j][i] *= scale;
        }
        for x in &mut self.0[i] {
            *x *= scale;
        }
        self.0[i][i] *= scale;
    }

    /// Whether all entries below the diagonal are finite and all entries on it positive.
    pub(super) fn is_sound(&self) -> bool {
        (0..N).all(|j| self.0[j][j] > 0.0 && self.0[j][j..N].iter().all(|x| x.is_finite()))
    }
}
