//! The linear model: the transfer functions from a wanted acceleration to the acceleration, and from a wrench at the tool
//! to the tool's displacement.

use crate::{Config, TrueVehicle};
use nalgebra::{Complex, ComplexField, SMatrix, SVector};
use std::f64::consts::PI;
use tilthex_core::{
    GRAVITY, Matrix6, Vector3, Vehicle,
    admittance::{AdmittanceParams, Axes},
    controller::ControllerParams,
    so3,
    types::Vector6,
};

/// A complex number.
pub(crate) type Number = Complex<f64>;
/// A complex 6x6 matrix, translation before rotation.
pub(crate) type Matrix = SMatrix<Number, 6, 6>;
type Diagonal = SVector<Number, 6>;

/// If the rotors give less than this part of a wanted acceleration along an axis, the vehicle tilts to reach it.
const DIRECT: f64 = 0.5;
/// The lowest frequency, rad/s, and the number of frequencies from it to half the sampling frequency.
const LOWEST: f64 = 0.02;
const FREQUENCIES: usize = 500;
/// If the phase between two frequencies differs by more than this, rad, the interval is halved, up to [`HALVINGS`] times.
const MOST_PHASE: f64 = 0.7;
const HALVINGS: usize = 12;
/// A pole that only normalises determinants, 1/s.
const POLE: f64 = 10.0;

/// The delays of the loop, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopDelays {
    /// The control period, during which a command is held, s.
    pub period: f64,
    /// Delay from an inertial sample to the rotors' response to it, s, without the hold.
    pub line: f64,
    /// Age of the rotors' measured speeds, compared with the inertial sample, s.
    pub rotor_speeds: f64,
}

/// A linear model of the closed loop in level hover, with six axes: translation in world axes, then rotation in robot axes.
#[derive(Clone, Debug)]
pub struct LoopModel {
    /// The controller's parameters.
    pub params: ControllerParams,
    /// The delays.
    pub delays: LoopDelays,
    /// Generalised mass of the model, and the inverse of the true generalised mass.
    model_mass: Matrix6,
    true_inverse: Matrix6,
    /// From a wanted acceleration to the one that results, both [m/s^2; rad/s^2].
    effect: Matrix6,
    /// Axes along which the vehicle must tilt to accelerate.
    tilts: [bool; 6],
    /// From the robot's twist to the tool's twist: in the controller's model, and true.
    model_tool: Matrix6,
    true_tool: Matrix6,
    /// Time constant of the rotors, s: in the model, and true.
    model_lag: f64,
    true_lag: f64,
}

/// Every transfer function at one frequency.
pub(crate) struct Point {
    /// j omega, 1/s.
    pub s: Number,
    /// Pose control, `K_v s + K_p`.
    pose: Diagonal,
    /// From the rotors' command to the acceleration that they give, and to that which the observer computes from measured
    /// speeds.
    rotors: Diagonal,
    seen: Diagonal,
    /// The observer's response to accelerations, and to what it computes that the rotors give.
    observer: Matrix,
    observer_rotors: Matrix,
    /// From the observed wrench, as accelerations, to the acceleration that the yielding reference asks for.
    yields: Matrix,
    /// From the wanted lateral acceleration to the turn of the vehicle, rad.
    turn: Matrix,
}

/// Delay, hold and lag at one frequency.
struct Rotor {
    s: Number,
    /// Delay of one period.
    last: Number,
    hold: Number,
    answer: Number,
}

/// A first-order lag in the discrete form of the controller. `rate` is the lag's rate times the period.
fn discrete_lag(rate: f64, last: Number) -> Number {
    let share = -(-rate).exp_m1();
    Number::new(share, 0.0) / (Number::new(1.0, 0.0) - last * (1.0 - share))
}

/// `count` frequencies in equal ratios, from `from` on; `to` itself is left out.
pub(crate) fn rising(from: f64, to: f64, count: usize) -> impl Iterator<Item = f64> + use<> {
    let step = (to / from).ln() / count as f64;
    (0..count).map(move |k| from * (step * k as f64).exp())
}

pub(crate) fn real(m: &Matrix6) -> Matrix {
    m.map(|x| Number::new(x, 0.0))
}

fn unit(angle: f64) -> Number {
    Number::new(angle.cos(), angle.sin())
}

/// Mass and inertia as one matrix.
fn generalised(vehicle: &Vehicle) -> Matrix6 {
    let mut m = Matrix6::from_diagonal(&Vector6::repeat(vehicle.mass()));
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(vehicle.inertia());
    m
}

/// `[I, -hat(p); 0, I]`: from the robot's twist to the twist of a point.
fn twist_at(position: &Vector3) -> Matrix6 {
    let mut m = Matrix6::identity();
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(&-so3::hat(position));
    m
}

impl LoopModel {
    /// The model of a configuration whose vehicle equals its model.
    #[must_use]
    pub fn of(config: &Config) -> Self {
        let vehicle = config.vehicle().vehicle();
        Self::new(*config.controller(), vehicle, vehicle, config.loop_delays())
    }

    /// The model of a configuration that flies a drawn vehicle.
    #[must_use]
    pub fn of_true(config: &Config, drawn: &TrueVehicle) -> Self {
        let mut delays = config.loop_delays();
        delays.rotor_speeds += drawn.delays.rotor_speeds;
        Self::new(*config.controller(), config.vehicle().vehicle(), drawn.vehicle.vehicle(), delays)
    }

    /// The model of a controller that uses the vehicle `model` and flies the vehicle `truth`.
    pub(crate) fn new(
        mut params: ControllerParams,
        model: &Vehicle,
        truth: &Vehicle,
        delays: LoopDelays,
    ) -> Self {
        // The vehicle hovers level.
        let (a, rotation_we) = (params.admittance, &model.tool().rotation_r);
        let in_world = |m: &Matrix6| a.in_world(m, rotation_we);
        params.admittance = AdmittanceParams {
            axes: Axes::World,
            mass: in_world(&a.mass),
            damping: in_world(&a.damping),
            stiffness: in_world(&a.stiffness),
            ..a
        };
        let (model_mass, true_mass) = (generalised(model), generalised(truth));
        let true_inverse = true_mass.try_inverse().unwrap_or_else(Matrix6::identity);
        let model_inverse = model_mass.try_inverse().unwrap_or_else(Matrix6::identity);
        let given = |vehicle: &Vehicle| vehicle.allocation() * model.allocation_inverse();
        let nominal = model_inverse * given(model) * model_mass;
        let tilts = std::array::from_fn(|i| i < 2 && nominal[(i, i)] < DIRECT);
        let mut effect = true_inverse * given(truth) * model_mass;
        for i in (0..6).filter(|i| tilts[*i]) {
            // The thrust carries the weight. If it is tilted, the acceleration depends on the turn alone, not on the model.
            effect.row_mut(i).fill(0.0);
            effect.column_mut(i).fill(0.0);
            effect[(i, i)] = 1.0;
        }
        Self {
            params,
            delays,
            model_mass,
            true_inverse,
            effect,
            tilts,
            model_tool: twist_at(&model.tool().position_r),
            true_tool: twist_at(&truth.tool().position_r),
            model_lag: model.rotor_time_constant(),
            true_lag: truth.rotor_time_constant(),
        }
    }

    /// The frequencies at which the transfer functions are computed, rad/s.
    pub(crate) fn frequencies(&self) -> impl Iterator<Item = f64> + use<> {
        rising(LOWEST, PI / self.delays.period, FREQUENCIES)
    }

    /// The control laws and the vehicle at a frequency, rad/s. `drives` says whether the observed force and the observed
    /// torque at the tool move the reference: inside a dead zone they do not.
    pub(crate) fn at(&self, frequency: f64, drives: [bool; 2]) -> Point {
        let one = Number::new(1.0, 0.0);
        let period = self.delays.period;
        let Rotor { s, last, hold, answer: rotor } = self.rotor(frequency);
        let late = |delay: f64| unit(-frequency * delay);
        let lag = |rate: f64| discrete_lag(rate * period, last);
        let pose = self.pose(s);
        let (mut rotors, mut seen) = (Diagonal::repeat(rotor), Diagonal::repeat(rotor));
        let mut turn = Matrix::zeros();
        let vertical = self.effect[(2, 2)];
        for i in 0..6 {
            if self.tilts[i] {
                // A turn about y accelerates the vehicle forwards, a turn about -x to the left.
                let (about, sign) = if i == 0 { (4, 1.0) } else { (3, -1.0) };
                let tilt = self.turned(s) * self.attitude(s, rotor, about);
                rotors[i] = tilt;
                seen[i] = tilt / vertical;
                turn[(about, i)] = tilt * (sign / GRAVITY);
            } else {
                seen[i] *= late(self.delays.rotor_speeds);
            }
        }
        // The torque observer uses means over the last period.
        let mean = one + last;
        let gains = self.params.observer;
        let of = |i: usize| lag(if i < 3 { gains.force[i] } else { gains.torque[i - 3] });
        let accelerations = Diagonal::from_fn(|i, _| if i < 3 { of(i) } else { of(i) * hold });
        let of_rotors = Diagonal::from_fn(|i, _| if i < 3 { of(i) } else { of(i) * mean * 0.5 });
        let mass = real(&self.model_mass);
        let mass_inverse = real(&self.model_mass.try_inverse().unwrap_or_else(Matrix6::identity));
        let in_newtons = |h: &Diagonal| mass_inverse * Matrix::from_diagonal(h) * mass;
        let low = if self.params.low_pass_hz > 0.0 { lag(2.0 * PI * self.params.low_pass_hz) } else { one };
        let yields = self.yields(s, &pose, hold * late(-period)) * low;
        let through = Matrix6::from_diagonal(&Vector6::from_fn(|i, _| f64::from(u8::from(drives[i / 3]))));
        let to_tool =
            self.model_tool.transpose().try_inverse().unwrap_or_else(Matrix6::identity) * self.model_mass;
        Point {
            s,
            pose,
            rotors,
            seen,
            observer: in_newtons(&accelerations),
            observer_rotors: in_newtons(&of_rotors),
            yields: yields * real(&(through * to_tool)),
            turn,
        }
    }

    /// The loop gain of one axis at a frequency, rad/s, for a vehicle that equals its model: an element of the diagonal of
    /// [`Self::loop_gain`].
    pub(crate) fn axis_gain(&self, axis: usize, frequency: f64) -> Number {
        let Rotor { s, last, answer, .. } = self.rotor(frequency);
        let pose = self.pose(s)[axis] / (s * s);
        if self.tilts[axis] {
            return pose * self.turned(s) * self.attitude(s, answer, if axis == 0 { 4 } else { 3 });
        }
        let gains = self.params.observer;
        let gain = if axis < 3 { gains.force[axis] } else { gains.torque[axis - 3] };
        let seen_late = Number::new(1.0, 0.0) - unit(-frequency * self.delays.rotor_speeds);
        let observed = discrete_lag(gain * self.delays.period, last) * answer * seen_late;
        pose * answer / (observed + 1.0)
    }

    /// Whether the vehicle must tilt to accelerate along an axis.
    pub(crate) fn tilts(&self, axis: usize) -> bool {
        self.tilts[axis]
    }

    /// The part of the commanded wrench that the rotors give.
    fn rotor(&self, frequency: f64) -> Rotor {
        let one = Number::new(1.0, 0.0);
        let s = Number::new(0.0, frequency);
        let last = unit(-frequency * self.delays.period);
        let hold = (one - last) / (s * self.delays.period);
        let answer = unit(-frequency * self.delays.line) * hold / (one + s * self.true_lag);
        Rotor { s, last, hold, answer }
    }

    fn pose(&self, s: Number) -> Diagonal {
        let g = &self.params.pose;
        let of = |proportional: &Vector3, rate: &Vector3, i: usize| s * rate[i] + proportional[i];
        Diagonal::from_fn(|i, _| {
            if i < 3 { of(&g.position, &g.velocity, i) } else { of(&g.rotation, &g.angular_velocity, i - 3) }
        })
    }

    /// The filter from the wanted tilt to the reference's tilt.
    fn turned(&self, s: Number) -> Number {
        let bandwidth = self.params.attitude.bandwidth;
        let following = (3.0 * bandwidth).max(if self.model_lag > 0.0 { 1.0 / self.model_lag } else { 0.0 });
        let damped = s * (2.0 * bandwidth) + bandwidth * bandwidth;
        Number::new(bandwidth * bandwidth * following, 0.0) / (s * s * (s + following) + damped * following)
    }

    /// From the reference's attitude to the attitude, with the lead that compensates the rotor lag of the model.
    fn attitude(&self, s: Number, rotor: Number, about: usize) -> Number {
        let g = &self.params.pose;
        let feedback = s * g.angular_velocity[about - 3] + g.rotation[about - 3];
        let lead = s * s * (s * self.model_lag + 1.0);
        rotor * (lead + feedback) / (s * s + rotor * feedback)
    }

    /// From a wrench at the tool to the commanded acceleration at the centre of mass: the acceleration of the admittance
    /// filter, and that with which pose control follows the filter's displacement and speed. `hold` is the hold of a wrench
    /// over the period before.
    fn yields(&self, s: Number, pose: &Diagonal, hold: Number) -> Matrix {
        let a = &self.params.admittance;
        let law = real(&a.mass) * (s * s) + real(&a.damping) * s + real(&a.stiffness);
        let way = law.try_inverse().unwrap_or_else(Matrix::zeros) * hold;
        let mass_inverse = real(&a.mass.try_inverse().unwrap_or_else(Matrix6::identity));
        let resists = real(&a.damping) * s + real(&a.stiffness);
        let acceleration = mass_inverse * (Matrix::identity() - resists * way);
        let to_robot = real(&self.model_tool.try_inverse().unwrap_or_else(Matrix6::identity));
        to_robot * acceleration + Matrix::from_diagonal(pose) * to_robot * way
    }

    /// From the rotors' command to what pose control and the observer subtract from it: 6x6, accelerations. `yielding` says
    /// whether the admittance filter takes part.
    fn feedback(&self, at: &Point, yielding: bool) -> (Matrix, Matrix) {
        let rest = if yielding { Matrix::identity() - at.yields } else { Matrix::identity() };
        let moved = real(&self.effect) * Matrix::from_diagonal(&at.rotors);
        let pose = Matrix::from_diagonal(&(at.pose / (at.s * at.s))) * moved;
        (pose, rest * (at.observer * moved - at.observer_rotors * Matrix::from_diagonal(&at.seen)))
    }

    /// The loop gain, 6x6, with the admittance filter at rest. The loop is opened at the accelerations that pose control
    /// asks for.
    pub(crate) fn loop_gain(&self, at: &Point) -> Option<Matrix> {
        let (pose, observer) = self.feedback(at, false);
        Some(pose * (Matrix::identity() + observer).try_inverse()?)
    }

    /// `det(I + feedback)` without its double integrators. The number of its turns around zero gives the unstable poles.
    pub(crate) fn characteristic(&self, at: &Point, yielding: bool) -> Number {
        let (pose, observer) = self.feedback(at, yielding);
        let integrator = at.s * at.s / ((at.s + POLE) * (at.s + POLE));
        (Matrix::identity() + pose + observer).determinant() * integrator.powu(6)
    }

    /// From a wrench at the tool, N and N m, to the tool's displacement, m and rad.
    pub(crate) fn compliance(&self, at: &Point) -> Option<Matrix> {
        let one = Matrix::identity();
        let rest = at.yields - one;
        let seen = Matrix::from_diagonal(&at.seen);
        let square = at.s * at.s;
        let pose = Matrix::from_diagonal(&(at.pose / square));
        let commanded = (one + rest * at.observer_rotors * seen).try_inverse()? * (rest * at.observer - pose);
        let moved = real(&self.effect) * Matrix::from_diagonal(&at.rotors);
        let accelerations = (one - moved * commanded).try_inverse()?;
        let tool = real(&self.true_tool);
        let pushed = real(&(self.true_inverse * self.true_tool.transpose()));
        let turned = at.turn * commanded;
        Some(tool * ((one / square + turned) * accelerations) * pushed)
    }
}

/// The number of zeros in the right half-plane of a function that is real at frequency zero and 1 at infinity. `known` are
/// its values at rising frequencies. Where the phase changes by more than [`MOST_PHASE`], more values are computed.
pub(crate) fn unstable(known: &[(f64, Number)], value: impl Fn(f64) -> Number) -> usize {
    fn turned(
        from: (f64, Number),
        to: (f64, Number),
        value: &impl Fn(f64) -> Number,
        halvings: usize,
    ) -> f64 {
        let step = (to.1 / from.1).argument();
        if halvings == 0 || step.abs() < MOST_PHASE {
            return step;
        }
        let frequency = (from.0 * to.0).sqrt();
        let middle = (frequency, value(frequency));
        turned(from, middle, value, halvings - 1) + turned(middle, to, value, halvings - 1)
    }
    let all: f64 = known.windows(2).map(|w| turned(w[0], w[1], &value, HALVINGS)).sum();
    let first = known.first().map_or(0.0, |v| v.1.argument());
    (-(all + first) / PI).round().max(0.0) as usize
}
