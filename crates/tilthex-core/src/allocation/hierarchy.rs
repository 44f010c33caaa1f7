//! Lexicographic least squares in a box, by a primal active-set search.
//!
//! For rows `A` in priority levels 1..k, targets `b` and bounds `l <= x <= h`: level 1 minimises `|A_1 x - b_1|`.
//! Each further level does the same without changing the results of the levels before it. Last, of all solutions that
//! are left, the `x` nearest to a preferred one is chosen.
//!
//! The search keeps `x` inside the box at all times, so that it may be stopped at any step. It moves in the null
//! space of the levels already settled, restricted to the variables that are free. An orthonormal basis of the
//! settled rows (modified Gram-Schmidt, inner products over the free variables only) is kept over all variables. Its
//! entries at the held variables are the reduced gradients, so that the multipliers of their bounds need no further
//! solve. A bound with a non-zero multiplier at the end of a level cannot be left without loss there, so it is fixed
//! for all later levels.
//!
//! Indices that the optimiser cannot bound are limited to their range, because the proof that no step can panic needs
//! it (`crates/tilthex-proof`).
#![allow(clippy::needless_range_loop)] // an index runs along several vectors

mod basis;
mod small;

use basis::{Basis, dot, largest};
use libm::{fabs, sqrt};
use small::{forward_substitution, least_squares};

/// Rows of a wrench.
pub(super) const ROWS: usize = 6;
/// Largest number of rows of one level.
const LEVEL_ROWS: usize = 3;
/// Projected rows and reduced gradients below this part of their scale count as zero.
const ZERO: f64 = 1e-10;
/// A level whose scaled residual is below this is met.
const MET: f64 = 1e-12;
/// Steps shorter than this part of the box are rounding errors.
const STALLED: f64 = 1e-12;
/// Largest number of steps; a search that reaches it ends with a feasible point; see [`super::MAX_ITERATIONS`].
pub(super) const MAX_ITERATIONS: u32 = 100;

/// Where a variable is held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Side {
    #[default]
    Free,
    Lower,
    Upper,
    /// Fixed: by equal bounds, or by a multiplier of a level already settled.
    Fixed,
}

/// Rows in the order of their priority, scaled to norms of at most one.
pub(super) struct Problem<'a, const N: usize> {
    pub rows: &'a [[f64; N]; ROWS],
    /// One past the last row of each level; a level has 1 to 3 rows.
    pub level_ends: &'a [usize],
    pub target: &'a [f64; ROWS],
    pub lower: &'a [f64; N],
    pub upper: &'a [f64; N],
    /// Of equally good points the nearest to this; `None` leaves the choice open.
    pub preferred: Option<&'a [f64; N]>,
}

pub(super) struct Solution<const N: usize> {
    pub x: [f64; N],
    pub side: [Side; N],
    /// Changes of the set of held variables, plus one per level. More than [`MAX_ITERATIONS`] if the search was
    /// stopped.
    pub iterations: u32,
}

/// Solves from a start that need not be feasible; the sides are a guess.
pub(super) fn solve<const N: usize>(
    problem: &Problem<N>,
    start: &[f64; N],
    guess: &[Side; N],
) -> Solution<N> {
    let mut search = Search::new(problem, start, guess);
    let mut first = 0;
    for &end in problem.level_ends {
        search.level(first, end);
        first = end;
    }
    if let Some(preferred) = problem.preferred {
        search.nearest(preferred, first);
    }
    Solution { x: search.x, side: search.side, iterations: search.iterations }
}

struct Search<'a, const N: usize> {
    problem: &'a Problem<'a, N>,
    x: [f64; N],
    side: [Side; N],
    basis: Basis<N>,
    iterations: u32,
    /// The last step had no length: choose by index, which cannot cycle (Bland).
    stalled: bool,
}

/// The step that a level's rows make in the null space of the basis.
struct LevelStep<const N: usize> {
    /// The rows, without their part in the basis of the levels before.
    reduced: [[f64; N]; LEVEL_ROWS],
    step: [f64; N],
    /// `b - A x` after the whole step.
    residual: [f64; LEVEL_ROWS],
    residual_norm: f64,
}

impl<'a, const N: usize> Search<'a, N> {
    fn new(problem: &'a Problem<'a, N>, start: &[f64; N], guess: &[Side; N]) -> Self {
        let (mut x, mut side, mut free) = ([0.0; N], *guess, [0.0; N]);
        for i in 0..N {
            let (lower, upper) = (problem.lower[i], problem.upper[i]);
            side[i] = if upper <= lower {
                Side::Fixed
            } else if side[i] == Side::Fixed {
                // Fixed by a level's multiplier in the search before: still a guess.
                if start[i] <= lower {
                    Side::Lower
                } else if start[i] >= upper {
                    Side::Upper
                } else {
                    Side::Free
                }
            } else {
                side[i]
            };
            x[i] = match side[i] {
                Side::Lower | Side::Fixed => lower,
                Side::Upper => upper,
                Side::Free => start[i].max(lower).min(upper),
            };
            free[i] = f64::from(side[i] == Side::Free);
        }
        Self { problem, x, side, basis: Basis::new(free), iterations: 0, stalled: false }
    }

    /// Settles rows `first..end`.
    fn level(&mut self, first: usize, end: usize) {
        let settled = self.basis.count;
        let mut rank_before = settled;
        self.stalled = false;
        while self.counted() {
            self.basis.count = rank_before;
            let reach = self.level_step(first, end);
            if !self.advance(&reach.step) {
                rank_before = self.rebuild(first);
                continue;
            }
            if reach.residual_norm > MET {
                let gradient = reach.gradient();
                let noise = ZERO * reach.residual_norm;
                if self.release(&gradient, noise) {
                    rank_before = self.rebuild(first);
                    continue;
                }
                for i in 0..N {
                    if self.side[i] != Side::Free && fabs(gradient[i]) > noise {
                        self.side[i] = Side::Fixed;
                    }
                }
            }
            // Rows that only held variables can move would make the multipliers of
            // the next level ambiguous: free one for each.
            if self.basis.count < rank_before + (end - first) && self.has_tied_row(first, end) {
                self.rebuild(end);
            }
            return;
        }
    }

    /// Counts an iteration, while there are any left.
    fn counted(&mut self) -> bool {
        self.iterations += 1;
        self.iterations <= MAX_ITERATIONS
    }

    /// Moves to the point nearest to `preferred` that keeps rows `..settled`.
    fn nearest(&mut self, preferred: &[f64; N], settled: usize) {
        self.stalled = false;
        while self.counted() {
            let mut away = [0.0; N];
            for i in 0..N {
                away[i] = preferred[i] - self.x[i];
            }
            let scale = 1.0 + largest(&away);
            self.basis.reduce(&mut away);
            let mut step = away;
            let mut gradient = [0.0; N];
            for i in 0..N {
                step[i] *= self.basis.free[i];
                gradient[i] = -away[i] * (1.0 - self.basis.free[i]);
            }
            if self.advance(&step) && !self.release(&gradient, ZERO * scale) {
                return;
            }
            self.rebuild(settled);
        }
    }

    /// The least-squares step of rows `first..end`, shortest of all; extends the basis by them.
    fn level_step(&mut self, first: usize, end: usize) -> LevelStep<N> {
        let rows = (end - first).min(LEVEL_ROWS);
        let before = self.basis.count;
        let mut reduced = [[0.0; N]; LEVEL_ROWS];
        let mut residual = [0.0; LEVEL_ROWS];
        for r in 0..rows {
            let row = (first + r).min(ROWS - 1);
            reduced[r] = self.problem.rows[row];
            residual[r] = self.problem.target[row] - dot(&reduced[r], &self.x);
            self.basis.reduce(&mut reduced[r]);
        }
        // reduced = L Q over the free variables, rows taken by their size.
        let mut left = reduced;
        let mut taken = [false; LEVEL_ROWS];
        let mut pick = [0; LEVEL_ROWS];
        let mut l = [[0.0; LEVEL_ROWS]; LEVEL_ROWS];
        let mut rank = 0;
        while rank < rows {
            let mut best = ZERO * ZERO;
            let mut chosen = None;
            for r in 0..rows {
                let size = if taken[r] { 0.0 } else { self.basis.norm_squared(&left[r]) };
                if size > best {
                    best = size;
                    chosen = Some(r);
                }
            }
            let Some(r) = chosen else { break };
            taken[r] = true;
            pick[rank] = r;
            self.basis.push(&left[r], sqrt(best));
            let j = self.basis.count - 1;
            for s in 0..rows {
                l[s][rank] = self.basis.coefficient(j, &left[s]);
                if !taken[s] {
                    self.basis.subtract(j, l[s][rank], &mut left[s]);
                }
            }
            rank += 1;
        }
        let y = if rank == rows {
            forward_substitution(&l, &pick, &residual, rank)
        } else {
            least_squares(&l, &residual, rows, rank)
        };
        let mut step = [0.0; N];
        for (j, y) in y.iter().enumerate().take(rank) {
            for i in 0..N {
                step[i] += y * self.basis.masked[(before + j).min(ROWS - 1)][i];
            }
        }
        let mut norm = 0.0;
        for r in 0..rows {
            for j in 0..rank {
                residual[r] -= l[r][j] * y[j];
            }
            norm += residual[r] * residual[r];
        }
        LevelStep { reduced, step, residual, residual_norm: sqrt(norm) }
    }

    /// Steps until the first bound, where that variable is held; true if there was none.
    fn advance(&mut self, step: &[f64; N]) -> bool {
        let size = largest(step);
        if size < STALLED {
            return true;
        }
        let noise = 1e-13 * size;
        let mut length = 1.0;
        let mut blocked = None;
        for i in 0..N {
            let room = if step[i] > noise {
                self.problem.upper[i] - self.x[i]
            } else if step[i] < -noise {
                self.problem.lower[i] - self.x[i]
            } else {
                continue;
            };
            // room / step < length, without the division in the common case.
            if fabs(room) < length * fabs(step[i]) {
                length = fabs(room / step[i]);
                blocked = Some(i);
            }
        }
        for i in 0..N {
            self.x[i] = (self.x[i] + length * step[i]).max(self.problem.lower[i]).min(self.problem.upper[i]);
        }
        if length * size > STALLED {
            self.stalled = false;
        } else if blocked.is_some() {
            self.stalled = true;
        }
        let Some(i) = blocked else { return true };
        if step[i] > 0.0 {
            self.hold(i, Side::Upper, self.problem.upper[i]);
        } else {
            self.hold(i, Side::Lower, self.problem.lower[i]);
        }
        false
    }

    fn hold(&mut self, i: usize, side: Side, at: f64) {
        self.x[i] = at;
        self.side[i] = side;
        self.basis.free[i] = 0.0;
    }

    fn free(&mut self, i: usize) {
        self.side[i] = Side::Free;
        self.basis.free[i] = 1.0;
    }

    /// Frees the held variable whose bound hinders the descent most; false if none does.
    fn release(&mut self, gradient: &[f64; N], noise: f64) -> bool {
        let mut worst = noise;
        let mut chosen = None;
        for i in 0..N {
            let hindrance = match self.side[i] {
                Side::Lower => -gradient[i],
                Side::Upper => gradient[i],
                Side::Free | Side::Fixed => 0.0,
            };
            if hindrance > worst {
                chosen = Some(i);
                if self.stalled {
                    break;
                }
                worst = hindrance;
            }
        }
        if let Some(i) = chosen {
            self.free(i);
        }
        chosen.is_some()
    }

    /// Orthonormalises rows `..end` over the variables that are free now; returns their rank.
    fn rebuild(&mut self, end: usize) -> usize {
        self.basis.count = 0;
        let mut r = 0;
        while r < end {
            let mut row = self.problem.rows[r.min(ROWS - 1)];
            self.basis.reduce(&mut row);
            let size = sqrt(self.basis.norm_squared(&row));
            r += 1;
            if size > ZERO {
                self.basis.push(&row, size);
            } else if let Some(i) = self.tied(&row) {
                // At most once a variable: it stays free until a step holds it.
                self.free(i);
                self.basis.count = 0;
                r = 0;
            }
        }
        self.basis.count
    }

    /// Of the held variables that are not fixed, the one that moves most a row which no free variable moves.
    fn tied(&self, row: &[f64; N]) -> Option<usize> {
        let mut best = ZERO;
        let mut chosen = None;
        for i in 0..N {
            if matches!(self.side[i], Side::Lower | Side::Upper) && fabs(row[i]) > best {
                best = fabs(row[i]);
                chosen = Some(i);
            }
        }
        chosen
    }

    fn has_tied_row(&self, first: usize, end: usize) -> bool {
        (first..end).any(|r| {
            let mut row = self.problem.rows[r.min(ROWS - 1)];
            self.basis.reduce(&mut row);
            self.basis.norm_squared(&row) <= ZERO * ZERO && self.tied(&row).is_some()
        })
    }
}

impl<const N: usize> LevelStep<N> {
    /// Reduced gradient of half the squared error.
    fn gradient(&self) -> [f64; N] {
        let mut gradient = [0.0; N];
        for (row, residual) in self.reduced.iter().zip(&self.residual) {
            for i in 0..N {
                gradient[i] -= residual * row[i];
            }
        }
        gradient
    }
}
