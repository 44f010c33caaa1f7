//! The outer loop: an admittance filter at the tool tip; (27)-(30).
//!
//! `M d(dv)/dt + D dv + K e = h_hat + h_user`, with the observed wrench `h_hat`, the commanded one
//! `h_user`, and the deviation of the reference from the set-point,
//! `e = [p_ref - p_set; 1/2 vee(R_ref R_set^T - R_set R_ref^T)]`: the reference yields in the direction of
//! the push. The paper prints set-point minus reference in (27)-(28), which would move against it.

mod diagonal;
mod forced;
mod motion;
mod params;
mod propagator;
mod spring;

use crate::{
    Error,
    error::check_range,
    force_axes::Forced,
    so3,
    types::{Matrix3, Matrix6, Reference, Setpoint, Vector3, Vector6, Wrench},
    vehicle::Mounting,
};
use motion::{Linear, Motion};
pub use params::{AdmittanceParams, Axes};
use propagator::Block;
use spring::{Spring, join};

/// The admittance filter.
///
/// ```
/// use tilthex_core::{
///     Matrix3, Matrix6, Setpoint, Vector3, Wrench,
///     admittance::{AdmittanceFilter, AdmittanceParams, AdmittanceState},
/// };
///
/// let filter = AdmittanceFilter::new(AdmittanceParams {
///     mass: Matrix6::identity() * 1.5,
///     damping: Matrix6::identity() * 10.0,
///     stiffness: Matrix6::identity() * 6.0,
///     ..AdmittanceParams::default()
/// })?;
/// let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
/// let push = Wrench { force: Vector3::new(1.2, 0.0, 0.0), torque: Vector3::zeros() };
/// let mut state = AdmittanceState::default();
/// let mut yielded = filter.step(&mut state, &setpoint, &push, 0.002);
/// for _ in 0..10_000 {
///     yielded = filter.step(&mut state, &setpoint, &push, 0.002);
/// }
/// // 1.2 N against a spring of 6 N/m: 0.2 m.
/// assert!((yielded.reference.position_w.x - 0.2).abs() < 1e-6);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdmittanceFilter {
    params: AdmittanceParams,
    spring: Spring,
    law: Law,
    /// Trace of the rotation whose angle is the limit.
    least_trace: f64,
}

/// The linear part; usually each axis acts only on itself.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "one a filter, and nothing is allocated")]
enum Law {
    Diagonal(Linear<Vector6>),
    Full(Linear<Matrix6>),
}

/// The deviation of the reference from the set-point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdmittanceState {
    /// p_r - p_d, m, world.
    pub translation_w: Vector3,
    /// R_r R_d^T.
    pub rotation: Matrix3,
    /// [v_r - v_d; omega_r - omega_d], m/s and rad/s, world.
    pub twist_w: Vector6,
}

impl Default for AdmittanceState {
    fn default() -> Self {
        Self { translation_w: Vector3::zeros(), rotation: Matrix3::identity(), twist_w: Vector6::zeros() }
    }
}

impl AdmittanceState {
    /// The state whose reference is a given tool pose and twist. With it, a filter that is switched on, or that gets
    /// a new set-point, does not jump.
    #[must_use]
    pub fn at(reference: &Setpoint, setpoint: &Setpoint) -> Self {
        let v = reference.velocity_w - setpoint.velocity_w;
        let w = reference.angular_velocity_w - setpoint.angular_velocity_w;
        Self {
            translation_w: reference.position_w - setpoint.position_w,
            rotation: reference.rotation_we * setpoint.rotation_we.transpose(),
            twist_w: Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z),
        }
    }

    /// The axes along which a set-point controls the force, if any: those of the reference's tool, or of the surface.
    #[inline(always)]
    pub(crate) fn forced(&self, setpoint: &Setpoint) -> Option<Forced> {
        setpoint.force_axes.any().then(|| setpoint.force_axes.at(&(self.rotation * setpoint.rotation_we)))
    }

    /// The same in axes whose coordinates are `turn` times these.
    fn turned(&self, turn: &Matrix3) -> Self {
        Self {
            translation_w: turn * self.translation_w,
            rotation: turn * self.rotation * turn.transpose(),
            twist_w: turned(&self.twist_w, turn),
        }
    }
}

/// The reference of the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdmittanceOutput {
    /// Pose, twist and acceleration of the reference; its wrench is the set-point's.
    pub reference: Setpoint,
    /// e: deviation of the reference from the set-point, m and rad (sine of the angle), world.
    pub deviation_w: Vector6,
    /// Whether the excursion limit limits the reference.
    pub limited: bool,
}

/// Faster filters, 1/s, are refused: no vehicle can follow them.
const FASTEST: f64 = 1e9;
impl AdmittanceFilter {
    /// Checks the parameters, and prepares for periods near 2 ms.
    ///
    /// # Errors
    /// Names the matrix that is not finite, symmetric or definite, or the limit out of range.
    pub fn new(params: AdmittanceParams) -> Result<Self, Error> {
        params.check()?;
        let singular = Error::NotPositiveDefinite { name: "admittance mass", smallest_eigenvalue: 0.0 };
        let mass_inverse = params.mass.try_inverse().ok_or(singular)?;
        let (damping_rate, stiffness_rate) = (mass_inverse * params.damping, mass_inverse * params.stiffness);
        let fastest = rate_bound(&damping_rate, &stiffness_rate);
        check_range("fastest rate of the admittance filter (1/s)", fastest, 0.0, FASTEST)?;
        let diagonal = [&params.mass, &params.damping, &params.stiffness].iter().all(|m| is_diagonal(m));
        let law = if diagonal {
            let [m, i, d, k] =
                [&params.mass, &mass_inverse, &damping_rate, &stiffness_rate].map(Matrix6::diagonal);
            Law::Diagonal(Linear::new(m, i, d, k, fastest))
        } else {
            Law::Full(Linear::new(params.mass, mass_inverse, damping_rate, stiffness_rate, fastest))
        };
        let spring = Spring::new(&params.stiffness);
        Ok(Self { params, spring, law, least_trace: so3::trace(params.max_rotation) })
    }

    /// The filter of [`AdmittanceParams::firm`] with the excursion limits of a filter that may yield farther. It
    /// cannot fail.
    #[must_use]
    pub(crate) fn reaching(mut self, yielding: &AdmittanceParams) -> Self {
        let AdmittanceParams { max_translation, max_rotation, .. } = AdmittanceParams::firm(yielding);
        (self.params.max_translation, self.params.max_rotation) = (max_translation, max_rotation);
        self.least_trace = so3::trace(max_rotation);
        self
    }

    /// The parameters.
    #[must_use]
    pub fn params(&self) -> &AdmittanceParams {
        &self.params
    }

    /// Prepares for steps of about `period` seconds, if it is not prepared for them. A step with another period takes
    /// several times as long.
    pub fn prepare(&mut self, period: f64) {
        match &mut self.law {
            Law::Diagonal(law) => law.prepare(period),
            Law::Full(law) => law.prepare(period),
        }
    }

    /// Whether the rotational spring has a potential. It has none if one rotational stiffness is larger than the sum
    /// of the two others: then a rotation that ends where it began may gain energy.
    #[must_use]
    pub fn has_potential(&self) -> bool {
        self.spring.has_potential()
    }

    /// Energy of the deviation, J: kinetic energy and, if the spring [has a potential](Self::has_potential), the
    /// energy in the spring. Without a push, at a set-point that does not rotate, it never grows.
    #[must_use]
    pub fn energy(&self, state: &AdmittanceState) -> f64 {
        let moving = 0.5 * state.twist_w.dot(&(self.params.mass * state.twist_w));
        moving + self.spring.energy(&state.translation_w, &state.rotation, true)
    }

    /// Moves the reference by `dt` seconds under the wrench `h_hat + h_user` at the tool (world), which is constant
    /// over the period; `setpoint` is the set-point at its end. Along the force axes of the set-point, neither its place nor
    /// its motion acts on the reference.
    #[inline]
    pub fn step(
        &self,
        state: &mut AdmittanceState,
        setpoint: &Setpoint,
        wrench_w: &Wrench,
        dt: f64,
    ) -> AdmittanceOutput {
        let mut push_w = *wrench_w;
        if let Some(forced) = state.forced(setpoint) {
            push_w = push_w + self.spring_w(state, setpoint) - self.relieved_w(state, setpoint, &forced);
            push_w = push_w - forced.along(&self.carried_w(setpoint));
        }
        let push = push_w.to_vector();
        let (acceleration_w, limited) = match self.params.axes {
            Axes::World => self.step_own(state, &push, setpoint.angular_velocity_w, dt),
            Axes::Tool => {
                // The axes do not turn within the period.
                let (to_world, to_axes) = (setpoint.rotation_we, setpoint.rotation_we.transpose());
                let mut own = state.turned(&to_axes);
                let turning = to_axes * setpoint.angular_velocity_w;
                let (acceleration, limited) = self.step_own(&mut own, &turned(&push, &to_axes), turning, dt);
                *state = own.turned(&to_world);
                (turned(&acceleration, &to_world), limited)
            }
        };
        let (a, alpha) = halves(&acceleration_w);
        let (v, w) = halves(&state.twist_w);
        AdmittanceOutput {
            reference: Setpoint {
                position_w: setpoint.position_w + state.translation_w,
                rotation_we: state.rotation * setpoint.rotation_we,
                velocity_w: setpoint.velocity_w + v,
                angular_velocity_w: setpoint.angular_velocity_w + w,
                acceleration_w: setpoint.acceleration_w + a,
                angular_acceleration_w: setpoint.angular_acceleration_w + alpha,
                ..*setpoint
            },
            deviation_w: join(&state.translation_w, &so3::vee(&state.rotation)),
            limited,
        }
    }

    /// One step in the axes of the matrices: the acceleration at its end, and whether an excursion limit is active.
    #[inline]
    fn step_own(
        &self,
        state: &mut AdmittanceState,
        push: &Vector6,
        turning: Vector3,
        dt: f64,
    ) -> (Vector6, bool) {
        match &self.law {
            Law::Diagonal(law) => self.step_by(law, state, push, turning, dt),
            Law::Full(law) => self.step_by(law, state, push, turning, dt),
        }
    }

    #[inline(always)]
    fn step_by<B: Block>(
        &self,
        law: &Linear<B>,
        state: &mut AdmittanceState,
        push: &Vector6,
        setpoint_velocity: Vector3,
        dt: f64,
    ) -> (Vector6, bool) {
        let moved = state.translation_w.norm_squared() + state.twist_w.norm_squared() + push.norm_squared();
        if moved == 0.0 && state.rotation == Matrix3::identity() {
            // Nothing pushes it away from the set-point.
            return (Vector6::zeros(), false);
        }
        let push = law.mass_inverse.apply(push);
        let motion = Motion { law, spring: &self.spring, push, setpoint_velocity };
        if dt > 0.0 {
            motion.advance(state, dt);
        }
        let limits = self.hold_back(state);
        let (a, alpha) = halves(&motion.acceleration(state, &motion.strained(state)));
        let acceleration = join(&without_outward(a, limits[0]), &without_outward(alpha, limits[1]));
        (acceleration, limits.iter().any(Option::is_some))
    }

    /// Limits the excursion: moves the deviation back onto the limit, and removes the outward velocity. Returns the
    /// outward directions of translation and rotation that are at their limits.
    #[inline(always)]
    fn hold_back(&self, state: &mut AdmittanceState) -> [Option<Vector3>; 2] {
        let (mut v, mut w) = halves(&state.twist_w);
        let translation = clamp(&mut state.translation_w, &mut v, self.params.max_translation);
        let mut rotation = None;
        if state.rotation.trace() < self.least_trace {
            let mut turn = so3::log(&state.rotation);
            rotation = clamp(&mut turn, &mut w, self.params.max_rotation);
            if rotation.is_some() {
                state.rotation = so3::exp(&turn);
            }
        }
        if translation.is_some() || rotation.is_some() {
            state.twist_w = join(&v, &w);
        }
        [translation, rotation]
    }
}

/// Limits a vector to the length `limit`; returns its direction if it was longer.
#[inline]
fn clamp(value: &mut Vector3, rate: &mut Vector3, limit: f64) -> Option<Vector3> {
    let norm = value.norm();
    if norm > limit {
        let outward = *value / norm;
        *value = outward * limit;
        *rate = without_outward(*rate, Some(outward));
        Some(outward)
    } else {
        None
    }
}

/// A rate without its part in the direction `outward`, which is at its limit.
fn without_outward(rate: Vector3, outward: Option<Vector3>) -> Vector3 {
    match outward {
        Some(n) if rate.dot(&n) > 0.0 => rate - n * rate.dot(&n),
        _ => rate,
    }
}

/// The reference of the centre of mass that puts the tool at its reference; (29)-(30).
///
/// (30) prints R_R where the reference's R_R,r is meant.
#[must_use]
#[inline(always)]
pub fn centre_of_mass_reference(tool_reference: &Setpoint, tool: &Mounting) -> Reference {
    let t = tool_reference;
    let rotation_wr = t.rotation_we * tool.rotation_r.transpose();
    let attitude = Reference {
        angular_velocity_r: rotation_wr.tr_mul(&t.angular_velocity_w),
        angular_acceleration_r: rotation_wr.tr_mul(&t.angular_acceleration_w),
        ..Reference::hold(t.position_w, rotation_wr)
    };
    let turning_w = (&t.angular_velocity_w, &t.angular_acceleration_w);
    with_tool_at(t, attitude, turning_w, &tool.position_r)
}

/// The reference of the centre of mass for a given attitude, with the position and the motion at which the tool is at
/// its reference.
pub(crate) fn about_tool(
    tool_reference: &Setpoint,
    attitude: &Reference,
    tool_position_r: &Vector3,
) -> Reference {
    let r = &attitude.rotation_wr;
    let (omega_w, alpha_w) = (r * attitude.angular_velocity_r, r * attitude.angular_acceleration_r);
    with_tool_at(tool_reference, *attitude, (&omega_w, &alpha_w), tool_position_r)
}

/// The same with the attitude's angular velocity and acceleration in W.
#[inline(always)]
fn with_tool_at(
    tool: &Setpoint,
    attitude: Reference,
    (omega_w, alpha_w): (&Vector3, &Vector3),
    tool_position_r: &Vector3,
) -> Reference {
    let lever_w = attitude.rotation_wr * tool_position_r;
    let whirl_w = omega_w.cross(&lever_w);
    Reference {
        position_w: tool.position_w - lever_w,
        velocity_w: tool.velocity_w - whirl_w,
        acceleration_w: tool.acceleration_w - alpha_w.cross(&lever_w) - omega_w.cross(&whirl_w),
        ..attitude
    }
}

fn halves(v: &Vector6) -> (Vector3, Vector3) {
    (v.fixed_rows::<3>(0).into_owned(), v.fixed_rows::<3>(3).into_owned())
}

/// Both halves in axes whose coordinates are `turn` times these.
fn turned(v: &Vector6, turn: &Matrix3) -> Vector6 {
    let (linear, angular) = halves(v);
    join(&(turn * linear), &(turn * angular))
}

/// Upper bound of |s| over the roots of det(s^2 + s D' + K'): with row sums,
/// |s| <= d + k/|s| at the largest root.
fn rate_bound(damping: &Matrix6, stiffness: &Matrix6) -> f64 {
    largest_root(damping.largest_row_sum(), stiffness.largest_row_sum())
}

/// The positive root of s^2 = d s + k.
fn largest_root(d: f64, k: f64) -> f64 {
    0.5 * (d + libm::sqrt(d * d + 4.0 * k))
}

fn is_diagonal(m: &Matrix6) -> bool {
    (m - Matrix6::from_diagonal(&m.diagonal())).iter().all(|x| *x == 0.0)
}
