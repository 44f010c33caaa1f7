//! The linear part of the filter over a period, in closed form.
//!
//! `d/dt [x; y] = L [x; y] + ...` with `L = [0 I; -M^-1 K  -M^-1 D]`. An exponential
//! integrator weights what drives it by `phi_k(hL) = int_0^1 exp((1-s) hL) s^(k-1)/(k-1)! ds`
//! (Hochbruck, Ostermann, "Exponential integrators", Acta Numerica 2010). They are summed
//! as series for a fraction of the period and doubled up to the whole (Skaflestad, Wright,
//! "The scaling and modified squaring method for matrix functions related to the
//! exponential", Appl. Numer. Math. 2009).

use crate::types::{Matrix6, Vector6};
use core::ops::{Add, Mul};

/// A 6x6 matrix; one that is diagonal is kept as its diagonal, and costs a sixth.
pub(super) trait Block: Copy + Add<Output = Self> + Mul<f64, Output = Self> {
    /// Whether an axis may act on another; if not, all matrices are diagonal.
    const COUPLED: bool;
    fn zero() -> Self;
    fn one() -> Self;
    fn times(&self, other: &Self) -> Self;
    fn apply(&self, v: &Vector6) -> Vector6;
    /// Largest entry of the rows of rotation.
    fn most_rotation(&self) -> f64;
    /// Largest sum of the absolute entries of a row: a bound of the eigenvalues.
    fn largest_row_sum(&self) -> f64;
}

impl Block for Vector6 {
    const COUPLED: bool = false;
    fn zero() -> Self {
        Self::zeros()
    }
    fn one() -> Self {
        Self::repeat(1.0)
    }
    fn times(&self, other: &Self) -> Self {
        self.component_mul(other)
    }
    fn apply(&self, v: &Vector6) -> Vector6 {
        self.component_mul(v)
    }
    fn most_rotation(&self) -> f64 {
        self.fixed_rows::<3>(3).amax()
    }
    fn largest_row_sum(&self) -> f64 {
        self.amax()
    }
}

impl Block for Matrix6 {
    const COUPLED: bool = true;
    fn zero() -> Self {
        Self::zeros()
    }
    fn one() -> Self {
        Self::identity()
    }
    fn times(&self, other: &Self) -> Self {
        self * other
    }
    fn apply(&self, v: &Vector6) -> Vector6 {
        self * v
    }
    fn most_rotation(&self) -> f64 {
        self.fixed_rows::<3>(3).amax()
    }
    fn largest_row_sum(&self) -> f64 {
        self.row_iter().map(|row| row.iter().map(|x| libm::fabs(*x)).sum()).fold(0.0, f64::max)
    }
}

/// `[xx xy; yx yy]`, 12x12: acts on deviations x and rates y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pair<B> {
    xx: B,
    xy: B,
    yx: B,
    yy: B,
}

impl<B: Block> Pair<B> {
    fn diagonal(value: f64) -> Self {
        let (d, zero) = (B::one() * value, B::zero());
        Self { xx: d, xy: zero, yx: zero, yy: d }
    }

    fn scaled(&self, by: f64) -> Self {
        Self { xx: self.xx * by, xy: self.xy * by, yx: self.yx * by, yy: self.yy * by }
    }

    fn plus(&self, other: &Self) -> Self {
        Self {
            xx: self.xx + other.xx,
            xy: self.xy + other.xy,
            yx: self.yx + other.yx,
            yy: self.yy + other.yy,
        }
    }

    fn times(&self, other: &Self) -> Self {
        Self {
            xx: self.xx.times(&other.xx) + self.xy.times(&other.yx),
            xy: self.xx.times(&other.xy) + self.xy.times(&other.yy),
            yx: self.yx.times(&other.xx) + self.yy.times(&other.yx),
            yy: self.yx.times(&other.xy) + self.yy.times(&other.yy),
        }
    }

    /// The product with `[x; y]`.
    pub(super) fn apply(&self, (x, y): &(Vector6, Vector6)) -> (Vector6, Vector6) {
        (self.xx.apply(x) + self.xy.apply(y), self.yx.apply(x) + self.yy.apply(y))
    }
}

/// What a period h makes of the rates at its start and of what they leave out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Propagator<B> {
    /// h, s.
    pub period: f64,
    /// `h phi_1`, for an input that is constant over the period.
    pub constant: Pair<B>,
    /// `h phi_2`, for an input that grows linearly from zero to its value at the end of the period.
    pub linear: Pair<B>,
    /// `2 h phi_3`, for an input that grows with the square of the time from zero to its value at the end.
    pub squared: Pair<B>,
    /// Whether the period shows how the rotational spring bends: within it, the spring undoes at
    /// most [`SHOWN`] of a turn.
    pub shows_bend: bool,
}

/// A swing of 0.3 rad of its phase a period.
const SHOWN: f64 = 0.045;

/// The series are summed for at most this many times the fastest mode's time constant ...
const SUMMED: f64 = 0.25;
/// ... and doubled as often as that needs; more than any filter's.
const MOST_DOUBLINGS: u32 = 64;
/// Terms of the series: the first left out is below 1e-14 of the sum.
const TERMS: i32 = 9;

impl<B: Block> Propagator<B> {
    /// For `M^-1 K`, `M^-1 D`, a bound of their fastest mode, 1/s, and a period, s.
    pub(super) fn new(stiffness_rate: &B, damping_rate: &B, fastest: f64, period: f64) -> Self {
        let mut doublings = 0;
        let mut h = period;
        while h * fastest > SUMMED && doublings < MOST_DOUBLINGS {
            h *= 0.5;
            doublings += 1;
        }
        // h L times a matrix.
        let part = h;
        let times_hl = |m: &Pair<B>| Pair {
            xx: m.yx * part,
            xy: m.yy * part,
            yx: (stiffness_rate.times(&m.xx) + damping_rate.times(&m.yx)) * -part,
            yy: (stiffness_rate.times(&m.xy) + damping_rate.times(&m.yy)) * -part,
        };
        // phi_3 = sum of (hL)^j / (j+3)!, and phi_(k-1) = 1/(k-1)! + hL phi_k.
        let mut phi3 = Pair::diagonal(1.0);
        for j in (1..=TERMS).rev() {
            phi3 = times_hl(&phi3).scaled(1.0 / f64::from(j + 3)).plus(&Pair::diagonal(1.0));
        }
        phi3 = phi3.scaled(1.0 / 6.0);
        let mut phi2 = times_hl(&phi3).plus(&Pair::diagonal(0.5));
        let mut phi1 = times_hl(&phi2).plus(&Pair::diagonal(1.0));
        let mut phi0 = times_hl(&phi1).plus(&Pair::diagonal(1.0));
        // What the spring undoes of a turn, at its most: of a fast swing the period may be a whole.
        let undone = |phi1: &Pair<B>, h: f64| (phi1.xy.times(stiffness_rate) * h).most_rotation();
        let mut most_undone = undone(&phi1, h);
        for _ in 0..doublings {
            phi3 = phi0.times(&phi3).plus(&phi1.scaled(0.5)).plus(&phi2).plus(&phi3).scaled(0.125);
            phi2 = phi0.times(&phi2).plus(&phi1).plus(&phi2).scaled(0.25);
            phi1 = phi0.times(&phi1).plus(&phi1).scaled(0.5);
            phi0 = phi0.times(&phi0);
            h *= 2.0;
            most_undone = most_undone.max(undone(&phi1, h));
        }
        Self {
            period,
            constant: phi1.scaled(period),
            linear: phi2.scaled(period),
            squared: phi3.scaled(2.0 * period),
            shows_bend: most_undone <= SHOWN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Diagonal or not, it is the same propagator; its columns are those of the scalar
        /// `x'' + d x' + k x = 1, t/h, (t/h)^2`, summed here as power series in time.
        #[test]
        fn it_moves_a_spring_as_its_power_series_does(
            k in prop::array::uniform6(0.0..4000.0f64), d in prop::array::uniform6(0.0..90.0f64), h in 1e-4..5e-3f64,
        ) {
            let (k, d) = (Vector6::from(k), Vector6::from(d));
            let fastest = 200.0;
            let thin = Propagator::new(&k, &d, fastest, h);
            let full = Propagator::new(&Matrix6::from_diagonal(&k), &Matrix6::from_diagonal(&d), fastest, h);
            let input = (Vector6::zeros(), Vector6::repeat(1.0));
            let found = [&thin.constant, &thin.linear, &thin.squared].map(|p| p.apply(&input));
            let same = [&full.constant, &full.linear, &full.squared].map(|p| p.apply(&input));
            for (power, ((x, y), (u, v))) in found.into_iter().zip(same).enumerate() {
                prop_assert!((x - u).amax() < 1e-15 && (y - v).amax() < 1e-12);
                for i in 0..6 {
                    // x = sum of c_n t^n from rest, with x'' + d x' + k x = (t/h)^power.
                    let mut c = [0.0; 40];
                    for n in 0..38 {
                        let drive = if n == power { h.powi(-(power as i32)) } else { 0.0 };
                        let at = |m: usize| m as f64;
                        c[n + 2] = (drive - d[i] * at(n + 1) * c[n + 1] - k[i] * c[n]) / (at(n + 1) * at(n + 2));
                    }
                    let (mut place, mut rate) = (0.0, 0.0);
                    for n in (1..40).rev() {
                        place += c[n] * h.powi(n as i32);
                        rate += n as f64 * c[n] * h.powi(n as i32 - 1);
                    }
                    prop_assert!((x[i] - place).abs() < 1e-12 * h, "{power} {} {place}", x[i]);
                    prop_assert!((y[i] - rate).abs() < 1e-12, "{power} {} {rate}", y[i]);
                }
            }
        }
    }

    /// A mode of a millionth of the period has gone; a slow one beside it has moved as it should.
    #[test]
    fn stiff_and_slow_modes_stand_side_by_side() {
        let h = 2e-3;
        let damping = Vector6::new(4e8, 4e2, 1.0, 0.0, 4e8, 4e8);
        let stiffness = Vector6::new(1e9, 1e3, 0.0, 0.0, 0.0, 4e8);
        let p = Propagator::new(&stiffness, &damping, 4e8, h);
        let (x, y) = p.constant.apply(&(Vector6::zeros(), Vector6::repeat(1.0)));
        for i in 0..6 {
            let (k, d) = (stiffness[i], damping[i]);
            // By the roots s of s^2 + d s + k, slow one without cancellation.
            let root = (d * d - 4.0 * k).sqrt();
            let fast = -0.5 * (d + root);
            let slow = if fast == 0.0 { 0.0 } else { k / fast };
            let grown = |s: f64| if s == 0.0 { h } else { (s * h).exp_m1() / s };
            let rate =
                if slow == fast { h } else { (grown(slow) * slow - grown(fast) * fast) / (slow - fast) };
            let place = if slow == fast { 0.5 * h * h } else { (grown(slow) - grown(fast)) / (slow - fast) };
            assert!((y[i] - rate).abs() < 1e-7 * rate.abs() + 1e-16, "{i} {} {rate}", y[i]);
            assert!((x[i] - place).abs() < 1e-7 * place, "{i} {} {place}", x[i]);
        }
    }
}
