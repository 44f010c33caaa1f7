//! Bayesian least squares over the errors of a vehicle's model.
//!
//! The unknowns are in units of their prior standard deviations, so that the prior covariance is the identity. For a
//! hover without contact, in robot coordinates about the true centre of mass,
//!
//! ```text
//! 0 = F1 u - m (s - b)        0 = F2 u - d/dt (J omega)
//! ```
//!
//! with the true F1, F2 and m and the accelerometer bias b that the estimator has not removed. The equations are
//! linear in all unknowns to first order; higher orders are included by linearising again about the last solution.
//!
//! Hovers at different headings also show a horizontal wrench that stays in the world, that of a steady wind: it does not turn
//! with the vehicle. It is an unknown of the calibration, and no error of the model.

use super::{Hover, ModelPrior};
use crate::{
    Vehicle,
    types::{MAX_ROTORS, RotorVector, Vector3, Wrench, is_finite3},
    vehicle::Correction,
};
use core::ops::Range;
use libm::sqrt;

/// Unknowns of the body: mass, common thrust, drag moment, centre of mass (3), accelerometer bias (3), and the horizontal force
/// and torque of the air (4).
const BODY: usize = 13;
/// The places of some of them.
pub(super) const MASS: usize = 0;
pub(super) const THRUST: usize = 1;
const DRAG_MOMENT: usize = 2;
pub(super) const CENTRE_OF_MASS: Range<usize> = 3..6;
pub(super) const ACCELEROMETER_BIAS: Range<usize> = 6..9;
const AIR: usize = 9;
/// Unknowns of a rotor: its thrust, and its axis in the two directions normal to it.
const EACH: usize = 3;
const UNKNOWNS: usize = BODY + EACH * MAX_ROTORS;

/// Standard deviations of a hover's mean force, N, and torque, N m, per axis.
const NOISE: (f64, f64) = (0.02, 0.005);
/// Standard deviations of a steady wind's force, N, and torque about the centre of mass, N m, per horizontal axis.
const OF_AIR: (f64, f64) = (0.5, 0.1);
/// Headings that differ by less than this show no wind, rad.
const TURNED: f64 = 0.3;
/// Number of linearisations.
const ROUNDS: usize = 3;

type Row = [f64; UNKNOWNS];
/// Derivative of a hover's balance by each unknown: force and torque.
type Columns = [Wrench; UNKNOWNS];

/// The unknowns, in prior deviations, and their covariance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Estimate {
    unknowns: Row,
    covariance: [Row; UNKNOWNS],
    /// Sum of the squared normalised innovations.
    pub(super) misfit: f64,
}

impl Estimate {
    /// The estimate before any hover.
    pub(super) fn prior() -> Self {
        let mut covariance = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (i, row) in covariance.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = f64::from(u8::from(i == j));
            }
        }
        Self { unknowns: [0.0; UNKNOWNS], covariance, misfit: 0.0 }
    }

    /// The estimate from some hovers of a vehicle.
    pub(super) fn of(vehicle: &Vehicle, prior: &ModelPrior, hovers: &[Hover]) -> Self {
        let mut estimate = Self::prior();
        let windy = hovers.iter().zip(hovers.iter().skip(1)).any(|(a, b)| a.turned_from(b) > TURNED);
        for _ in 0..ROUNDS {
            let about = estimate.unknowns;
            estimate = Self::prior();
            for hover in hovers {
                estimate.absorb(vehicle, prior, &about, hover, windy);
            }
        }
        estimate
    }

    /// The unknowns, to linearise about them.
    pub(super) fn about(&self) -> Row {
        self.unknowns
    }

    /// Adds a hover, linearised about some unknowns; `windy` says whether the air can push. Returns the largest innovation of
    /// its wrench, in standard deviations.
    pub(super) fn absorb(
        &mut self,
        vehicle: &Vehicle,
        prior: &ModelPrior,
        about: &Row,
        hover: &Hover,
        windy: bool,
    ) -> f64 {
        let (mut balance, mut columns) = linearised(vehicle, prior, about, hover);
        if windy {
            let slots = columns.iter_mut().skip(AIR).zip(about.iter().skip(AIR));
            for ((column, unknown), push) in slots.zip(hover.pushes_of_air(OF_AIR)) {
                *column = push;
                balance = balance + times(&push, *unknown);
            }
        }
        let mut largest: f64 = 0.0;
        for (axis, found) in balance.to_vector().iter().enumerate() {
            let row = columns.map(|c| c.to_vector().as_slice().get(axis).copied().unwrap_or(0.0));
            let noise = if axis < 3 { NOISE.0 } else { NOISE.1 };
            let squared = self.update(&row, dot(&row, about) - found, noise * noise);
            largest = largest.max(sqrt(squared));
        }
        largest
    }

    /// Some unknowns change at random with this variance, in prior variances; none becomes less certain than its prior.
    pub(super) fn stray(&mut self, unknowns: Range<usize>, variance: f64) {
        for i in unknowns {
            if let Some(entry) = self.covariance.get_mut(i).and_then(|row| row.get_mut(i)) {
                *entry += variance.min((1.0 - *entry).max(0.0));
            }
        }
    }

    /// Adds a scalar measurement `row . unknowns`. Returns its squared normalised innovation.
    fn update(&mut self, row: &Row, measured: f64, variance: f64) -> f64 {
        let mut gain = [0.0; UNKNOWNS];
        for (g, covariance) in gain.iter_mut().zip(&self.covariance) {
            *g = dot(covariance, row);
        }
        let expected = dot(row, &gain) + variance;
        let innovation = measured - dot(row, &self.unknowns);
        let squared = innovation * innovation / expected;
        self.misfit += squared;
        for (x, g) in self.unknowns.iter_mut().zip(&gain) {
            *x += g * innovation / expected;
        }
        for (covariance, g) in self.covariance.iter_mut().zip(&gain) {
            for (entry, other) in covariance.iter_mut().zip(&gain) {
                *entry -= g * other / expected;
            }
        }
        squared
    }

    /// Whether no unknown is farther from its prior than `times` its deviation.
    pub(super) fn is_within(&self, times: f64) -> bool {
        self.unknowns.iter().all(|x| x.abs() <= times)
    }

    /// The correction of the vehicle that follows from the estimate.
    pub(super) fn correction(&self, vehicle: &Vehicle, prior: &ModelPrior) -> Correction {
        correction(vehicle, prior, &self.unknowns)
    }

    /// Standard deviation of a combination of the unknowns.
    fn deviation(&self, row: &Row) -> f64 {
        sqrt(
            row.iter()
                .zip(&self.covariance)
                .map(|(x, covariance)| x * dot(covariance, row))
                .sum::<f64>()
                .max(0.0),
        )
    }

    /// Standard deviations of each.
    pub(super) fn deviations(&self, vehicle: &Vehicle, prior: &ModelPrior) -> super::ModelDeviation {
        let one = |index: usize, scale: f64| self.deviation(&unit(&[(index, scale)]));
        let three = |first: usize, scale: f64| {
            Vector3::new(one(first, scale), one(first + 1, scale), one(first + 2, scale))
        };
        let each = |of: &dyn Fn(usize) -> f64| {
            let mut found = RotorVector::zeros();
            for (i, slot) in found.iter_mut().take(vehicle.rotor_count()).enumerate() {
                *slot = of(BODY + EACH * i);
            }
            found
        };
        let (force, torque) = self.false_wrench(vehicle, prior);
        super::ModelDeviation {
            mass: one(MASS, prior.mass),
            drag_moment: one(DRAG_MOMENT, prior.drag_moment),
            centre_of_mass_r: three(CENTRE_OF_MASS.start, prior.centre_of_mass),
            accelerometer_bias_r: three(ACCELEROMETER_BIAS.start, prior.accelerometer_bias),
            thrust: each(&|i| self.deviation(&unit(&[(THRUST, prior.thrust), (i, prior.thrust_each)]))),
            rotor_axis: each(&|i| {
                let (a, b) = (one(i + 1, prior.rotor_axis), one(i + 2, prior.rotor_axis));
                sqrt(a * a + b * b)
            }),
            false_force: force,
            false_torque: torque,
        }
    }

    /// Expected false contact in hovers tilted by [`super::TILT`] in all directions: root of the mean square of the
    /// force, N, and of the torque about the centre of mass, N m.
    fn false_wrench(&self, vehicle: &Vehicle, prior: &ModelPrior) -> (f64, f64) {
        const DIRECTIONS: u8 = 6;
        let (mut force, mut torque) = (0.0, 0.0);
        for k in 0..DIRECTIONS {
            let angle = f64::from(k) * core::f64::consts::TAU / f64::from(DIRECTIONS);
            let (sine, cosine) = (libm::sin(super::TILT), libm::cos(super::TILT));
            let up_r = Vector3::new(sine * libm::cos(angle), sine * libm::sin(angle), cosine);
            let hover = Hover {
                specific_force_r: up_r * crate::GRAVITY,
                inputs: vehicle.hover_inputs(&up_r),
                ..Hover::default()
            };
            let (_, mut columns) = linearised(vehicle, prior, &[0.0; UNKNOWNS], &hover);
            // The estimator removes the accelerometer's bias later.
            columns
                .iter_mut()
                .take(ACCELEROMETER_BIAS.end)
                .skip(ACCELEROMETER_BIAS.start)
                .for_each(|c| *c = Wrench::ZERO);
            for axis in 0..6 {
                let row = columns.map(|c| c.to_vector().as_slice().get(axis).copied().unwrap_or(0.0));
                let deviation = self.deviation(&row);
                let part = deviation * deviation / f64::from(DIRECTIONS);
                if axis < 3 { force += part } else { torque += part }
            }
        }
        (sqrt(force), sqrt(torque))
    }
}

fn dot(a: &Row, b: &Row) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// A combination of a few unknowns.
fn unit(parts: &[(usize, f64)]) -> Row {
    let mut row = [0.0; UNKNOWNS];
    for (index, factor) in parts {
        if let Some(slot) = row.get_mut(*index) {
            *slot = *factor;
        }
    }
    row
}

/// Two unit vectors normal to a rotor's axis; zero if the axis is not estimated.
fn across(vehicle: &Vehicle, axis_r: &Vector3) -> [Vector3; 2] {
    // Axes that are all parallel are parallel by design: rotated axes would look like lateral force.
    if vehicle.rank() < 6 {
        return [Vector3::zeros(); 2];
    }
    let a = axis_r.abs();
    let least = if a.x <= a.y && a.x <= a.z {
        Vector3::x()
    } else if a.y <= a.z {
        Vector3::y()
    } else {
        Vector3::z()
    };
    let first = axis_r.cross(&least);
    let first = first / first.norm().max(1e-9);
    [first, axis_r.cross(&first)]
}

/// Splits the unknowns: of the body, and of each rotor.
fn parts(unknowns: &Row) -> ([f64; BODY], impl Iterator<Item = [f64; EACH]> + '_) {
    let (body, rotors) = unknowns.split_first_chunk::<BODY>().unwrap_or((&[0.0; BODY], &[]));
    (*body, rotors.chunks_exact(EACH).map(|c| c.try_into().unwrap_or([0.0; EACH])))
}

fn correction(vehicle: &Vehicle, prior: &ModelPrior, unknowns: &Row) -> Correction {
    let ([mass, thrust, drag, cx, cy, cz, ..], rotors) = parts(unknowns);
    let mut correction = Correction {
        mass: 1.0 + prior.mass * mass,
        centre_r: Vector3::new(cx, cy, cz) * prior.centre_of_mass,
        drag: (1.0 + prior.drag_moment * drag).max(0.0),
        ..Correction::NONE
    };
    let slots = correction.thrust.iter_mut().zip(correction.axis_r.iter_mut());
    for ((slot, axis_r), ([each, a, b], rotor)) in slots.zip(rotors.zip(vehicle.rotors())) {
        *slot = 1.0 + prior.thrust * thrust + prior.thrust_each * each;
        let [first, second] = across(vehicle, &rotor.axis_r);
        *axis_r = (first * a + second * b) * prior.rotor_axis;
    }
    correction
}

/// The balance of a hover about some unknowns, which is zero for the true ones, and its derivative by each unknown.
fn linearised(vehicle: &Vehicle, prior: &ModelPrior, about: &Row, hover: &Hover) -> (Wrench, Columns) {
    let correction = correction(vehicle, prior, about);
    let ([_, _, _, _, _, _, bx, by, bz, ..], _) = parts(about);
    let unbiased_r = hover.specific_force_r - Vector3::new(bx, by, bz) * prior.accelerometer_bias;
    let mass = vehicle.mass() * correction.mass;
    let mut balance = Wrench { force: -unbiased_r * mass, torque: -hover.momentum_rate_r };
    let mut columns = [Wrench::ZERO; UNKNOWNS];
    let (mut common, mut drag) = (Wrench::ZERO, Wrench::ZERO);
    let slots = columns.get_mut(BODY..).unwrap_or(&mut []).chunks_exact_mut(EACH);
    let rotors = correction.rotors(vehicle).zip(vehicle.rotors()).zip(hover.inputs.iter());
    for (slot, ((rotor, model), input)) in slots.zip(rotors) {
        // The wrench of a thrust along an axis, and of the drag moment.
        let thrust = |axis_r: Vector3| Wrench { force: axis_r, torque: rotor.position_r.cross(&axis_r) };
        let moment = |axis_r: Vector3| Wrench { force: Vector3::zeros(), torque: axis_r };
        let (c_f, c_tau) = (rotor.thrust_coefficient * input, rotor.spin * rotor.drag_coefficient * input);
        balance = balance + thrust(rotor.axis_r * c_f) + moment(rotor.axis_r * c_tau);
        let by_thrust = thrust(rotor.axis_r * (model.thrust_coefficient * input));
        common = common + by_thrust;
        drag = drag + moment(rotor.axis_r * (rotor.spin * model.drag_coefficient * input));
        let [a, b] = across(vehicle, &model.axis_r)
            .map(|v| thrust(v * (c_f * prior.rotor_axis)) + moment(v * (c_tau * prior.rotor_axis)));
        if let [each, first, second] = slot {
            (*each, *first, *second) = (times(&by_thrust, prior.thrust_each), a, b);
        }
    }
    let given_r = balance.force + unbiased_r * mass;
    let of_body = [
        Wrench { force: -unbiased_r * (vehicle.mass() * prior.mass), torque: Vector3::zeros() },
        times(&common, prior.thrust),
        times(&drag, prior.drag_moment),
    ];
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let centre =
        axes.map(|e| Wrench { force: Vector3::zeros(), torque: given_r.cross(&(e * prior.centre_of_mass)) });
    let bias =
        axes.map(|e| Wrench { force: e * (mass * prior.accelerometer_bias), torque: Vector3::zeros() });
    let all = of_body.into_iter().chain(centre).chain(bias);
    for (slot, column) in columns.iter_mut().zip(all) {
        *slot = column;
    }
    (balance, columns)
}

fn times(wrench: &Wrench, by: f64) -> Wrench {
    Wrench { force: wrench.force * by, torque: wrench.torque * by }
}

impl Hover {
    /// Whether every number is finite.
    pub(super) fn is_finite(&self) -> bool {
        is_finite3(&self.specific_force_r)
            && is_finite3(&self.momentum_rate_r)
            && self.inputs.iter().all(|u| u.is_finite())
    }
}
