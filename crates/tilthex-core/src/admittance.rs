//! The outer loop: an admittance filter at the tool tip; (27)-(30).
//!
//! `M d(dv)/dt + D dv + K e = what_E + w_user`, with the deviation of the
//! reference from the set-point `e = [p_r - p_d; 1/2 vee(R_r R_d^T - R_d R_r^T)]`:
//! the reference yields in the direction of the push. The paper prints d - r
//! in (27)-(28), which would move against it.

use crate::{
    Error,
    error::check_range,
    so3,
    types::{Matrix3, Matrix6, Reference, Setpoint, Vector3, Vector6, Wrench},
    vehicle::Mounting,
};

/// Mass, damping and stiffness at the tool (world axes; translation first), and limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdmittanceParams {
    /// M, kg and kg m^2; positive definite.
    pub mass: Matrix6,
    /// D, N s/m and N m s/rad; positive semi-definite.
    pub damping: Matrix6,
    /// K, N/m and N m/rad; positive semi-definite.
    pub stiffness: Matrix6,
    /// Farthest the reference may yield, m.
    pub max_translation: f64,
    /// Farthest the reference may turn, rad; below pi.
    pub max_rotation: f64,
}

/// Rate of a reference that does not yield, critically damped, 1/s.
const FIRM: f64 = 2.0;
/// How far it may be from its set-point at the begin, at the least: m and rad.
const FIRM_EXCURSION: (f64, f64) = (1.0, 1.0);

impl AdmittanceParams {
    /// Those of a reference that does not yield and returns from wherever `yielding` let it go.
    #[must_use]
    pub(crate) fn firm(yielding: &Self) -> Self {
        let (far, wide) = FIRM_EXCURSION;
        Self {
            mass: Matrix6::identity(),
            damping: Matrix6::from_diagonal_element(2.0 * FIRM),
            stiffness: Matrix6::from_diagonal_element(FIRM * FIRM),
            max_translation: yielding.max_translation.max(far),
            max_rotation: yielding.max_rotation.max(wide),
        }
    }
}

/// The admittance filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdmittanceFilter {
    params: AdmittanceParams,
    mass_inverse: Matrix6,
    /// M^-1 D and M^-1 K.
    damping_rate: Matrix6,
    stiffness_rate: Matrix6,
    /// Bounds the fastest mode, 1/s: sets the number of sub-steps.
    fastest: f64,
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
    /// The state whose reference is a given tool pose and twist: a filter that
    /// is switched on, or given a new set-point, with it does not jump.
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
}

/// The reference of the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdmittanceOutput {
    /// Pose, twist and acceleration of the reference; its wrench is the set-point's.
    pub reference: Setpoint,
    /// e: how far it has yielded, m and rad (sine of the angle), world.
    pub deviation_w: Vector6,
    /// Whether the excursion limit holds it back.
    pub limited: bool,
}

/// Most sub-steps of one call; beyond them the period is too long for the parameters.
const MAX_SUB_STEPS: usize = 24;
/// Sub-step times fastest rate: one Runge-Kutta sub-step errs by at most 3e-6 of the fastest mode.
const SUB_STEP: f64 = 0.2;

impl AdmittanceFilter {
    /// Checks the parameters.
    ///
    /// # Errors
    /// Names the matrix that is not finite, symmetric or definite, or the
    /// limit out of range; a filter too fast for `MAX_SUB_STEPS` at 500 Hz is refused.
    pub fn new(params: AdmittanceParams) -> Result<Self, Error> {
        check_matrix("admittance mass", &params.mass, 1e-9)?;
        check_matrix("admittance damping", &params.damping, 0.0)?;
        check_matrix("admittance stiffness", &params.stiffness, 0.0)?;
        check_range("max_translation", params.max_translation, 0.0, 100.0)?;
        check_range("max_rotation", params.max_rotation, 0.0, 3.1)?;
        let singular = Error::NotPositiveDefinite { name: "admittance mass", smallest_eigenvalue: 0.0 };
        let mass_inverse = params.mass.try_inverse().ok_or(singular)?;
        let damping_rate = mass_inverse * params.damping;
        let stiffness_rate = mass_inverse * params.stiffness;
        let fastest = rate_bound(&damping_rate, &stiffness_rate);
        check_range("fastest rate of the admittance filter (1/s)", fastest, 0.0, 2400.0)?;
        Ok(Self { params, mass_inverse, damping_rate, stiffness_rate, fastest })
    }

    /// The parameters.
    #[must_use]
    pub fn params(&self) -> &AdmittanceParams {
        &self.params
    }

    /// Moves the reference on by `dt` seconds under the wrench `what_E + w_user`
    /// at the tool (world), held over the period; `setpoint` is that at its end.
    pub fn step(
        &self,
        state: &mut AdmittanceState,
        setpoint: &Setpoint,
        wrench_w: &Wrench,
        dt: f64,
    ) -> AdmittanceOutput {
        let push = self.mass_inverse * wrench_w.to_vector();
        let wanted = libm::ceil(dt * self.fastest / SUB_STEP);
        let steps = if wanted > 1.0 { wanted.min(MAX_SUB_STEPS as f64) } else { 1.0 };
        for _ in 0..steps as usize {
            self.runge_kutta(state, setpoint, &push, dt / steps);
        }
        let limits = self.hold_back(state);
        let limited = limits.iter().any(Option::is_some);
        let dv = self.acceleration(&deviation(state), &state.twist_w, &push);
        let (v, w) = halves(&state.twist_w);
        let (a, alpha) = halves(&dv);
        let [a, alpha] = [without_outward(a, limits[0]), without_outward(alpha, limits[1])];
        AdmittanceOutput {
            reference: Setpoint {
                position_w: setpoint.position_w + state.translation_w,
                rotation_we: state.rotation * setpoint.rotation_we,
                velocity_w: setpoint.velocity_w + v,
                angular_velocity_w: setpoint.angular_velocity_w + w,
                acceleration_w: setpoint.acceleration_w + a,
                angular_acceleration_w: setpoint.angular_acceleration_w + alpha,
                wrench_w: setpoint.wrench_w,
            },
            deviation_w: deviation(state),
            limited,
        }
    }

    fn acceleration(&self, e: &Vector6, twist: &Vector6, push: &Vector6) -> Vector6 {
        push - self.damping_rate * twist - self.stiffness_rate * e
    }

    /// One fourth-order Runge-Kutta-Munthe-Kaas step.
    fn runge_kutta(&self, state: &mut AdmittanceState, setpoint: &Setpoint, push: &Vector6, h: f64) {
        let start = *state;
        // (translation, rotation vector from the start) and twist, and their rates.
        let rates = |move_by: &Vector6, twist: &Vector6| -> (Vector6, Vector6, AdmittanceState) {
            let (translation, turn) = halves(move_by);
            let moved = AdmittanceState {
                translation_w: start.translation_w + translation,
                rotation: so3::exp(&turn) * start.rotation,
                twist_w: *twist,
            };
            let (v, w) = halves(twist);
            // d(R_r R_d^T)/dt = hat(omega_r - Q omega_d) Q, Q the deviation itself.
            let turning = w + setpoint.angular_velocity_w - moved.rotation * setpoint.angular_velocity_w;
            // Inverse of the exponential's derivative; the rest is of fourth order in `turn`.
            let c = turn.cross(&turning);
            let rate = turning - 0.5 * c + turn.cross(&c) / 12.0;
            let move_rate = Vector6::new(v.x, v.y, v.z, rate.x, rate.y, rate.z);
            (move_rate, self.acceleration(&deviation(&moved), twist, push), moved)
        };
        let t0 = start.twist_w;
        let (m1, a1, _) = rates(&Vector6::zeros(), &t0);
        let (m2, a2, _) = rates(&(0.5 * h * m1), &(t0 + 0.5 * h * a1));
        let (m3, a3, _) = rates(&(0.5 * h * m2), &(t0 + 0.5 * h * a2));
        let (m4, a4, _) = rates(&(h * m3), &(t0 + h * a3));
        let moved = h / 6.0 * (m1 + 2.0 * m2 + 2.0 * m3 + m4);
        let (translation, turn) = halves(&moved);
        state.translation_w += translation;
        // exp of a product drifts from SO(3) by rounding only: one Newton step removes it.
        let rotation = so3::exp(&turn) * start.rotation;
        state.rotation = rotation * (1.5 * Matrix3::identity() - 0.5 * rotation.transpose() * rotation);
        state.twist_w += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
    }

    /// Keeps the excursion within its limits: back onto the sphere, without outward velocity.
    /// Returns the outward directions of translation and turn that are at their limits.
    fn hold_back(&self, state: &mut AdmittanceState) -> [Option<Vector3>; 2] {
        let (mut v, mut w) = halves(&state.twist_w);
        let translation = clamp(&mut state.translation_w, &mut v, self.params.max_translation);
        let mut turn = so3::log(&state.rotation);
        let rotation = clamp(&mut turn, &mut w, self.params.max_rotation);
        if translation.is_some() || rotation.is_some() {
            state.rotation = so3::exp(&turn);
            state.twist_w = Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z);
        }
        [translation, rotation]
    }
}

/// Brings a vector longer than `limit` back to it; returns its direction if it was.
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

/// What is left of a rate where the way `outward` is barred.
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
pub fn centre_of_mass_reference(tool_reference: &Setpoint, tool: &Mounting) -> Reference {
    let t = tool_reference;
    let rotation_wr = t.rotation_we * tool.rotation_r.transpose();
    let lever_w = rotation_wr * tool.position_r;
    let (omega, alpha) = (t.angular_velocity_w, t.angular_acceleration_w);
    let to_body = rotation_wr.transpose();
    Reference {
        position_w: t.position_w - lever_w,
        rotation_wr,
        velocity_w: t.velocity_w - omega.cross(&lever_w),
        angular_velocity_r: to_body * omega,
        acceleration_w: t.acceleration_w - alpha.cross(&lever_w) - omega.cross(&omega.cross(&lever_w)),
        angular_acceleration_r: to_body * alpha,
    }
}

fn deviation(state: &AdmittanceState) -> Vector6 {
    let (p, r) = (state.translation_w, so3::vee(&state.rotation));
    Vector6::new(p.x, p.y, p.z, r.x, r.y, r.z)
}

fn halves(v: &Vector6) -> (Vector3, Vector3) {
    (v.fixed_rows::<3>(0).into_owned(), v.fixed_rows::<3>(3).into_owned())
}

/// Upper bound of |s| over the roots of det(s^2 + s D' + K'): with row sums,
/// |s| <= d + k/|s| at the largest root.
fn rate_bound(damping: &Matrix6, stiffness: &Matrix6) -> f64 {
    let norm =
        |m: &Matrix6| m.row_iter().map(|r| r.iter().map(|x| libm::fabs(*x)).sum::<f64>()).fold(0.0, f64::max);
    let (d, k) = (norm(damping), norm(stiffness));
    0.5 * (d + libm::sqrt(d * d + 4.0 * k))
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
