//! The wrench observer: force from the accelerometer, torque from the angular
//! momentum; (18)-(25).
//!
//! Both are first-order lags of the external wrench, discretised in closed form: every gain and every period is
//! stable. The momentum balance is taken between consecutive samples with the rotation that was measured between
//! them. So the estimate for a freely tumbling body is zero to rounding; a sum of `omega x J omega dt` would drift
//! with the period.

use crate::{
    Error, Vehicle,
    error::check_range,
    filters::lag_fraction,
    so3,
    types::{Matrix3, RotorVector, Vector3, Wrench},
    vehicle,
};

/// Diagonal gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObserverGains {
    /// L, 1/s, world axes.
    pub force: Vector3,
    /// K_I, 1/s, robot axes.
    pub torque: Vector3,
}

/// The observer of the external wrench.
///
/// ```
/// use tilthex_core::{
///     Matrix3, Vector3, examples,
///     wrench_observer::{ObserverGains, ObserverInput, WrenchObserver, WrenchObserverState},
/// };
///
/// let vehicle = examples::tilt_hex()?;
/// let gains = ObserverGains { force: Vector3::repeat(30.0), torque: Vector3::repeat(30.0) };
/// let observer = WrenchObserver::new(&vehicle, gains)?;
/// let mut state = WrenchObserverState::default();
/// // It hovers, but the accelerometer feels 1 m/s^2 less than the rotors give: something pulls down by the mass times that.
/// let level = Matrix3::identity();
/// let input = ObserverInput {
///     rotation_wr: level,
///     angular_velocity_r: Vector3::zeros(),
///     specific_force_r: Vector3::new(0.0, 0.0, tilthex_core::GRAVITY - 1.0),
///     rotor_speeds: vehicle.hover_speeds(&level),
/// };
/// let mut wrench = observer.step(&mut state, &input, 0.002);
/// for _ in 0..1000 {
///     wrench = observer.step(&mut state, &input, 0.002);
/// }
/// assert!((wrench.force.z + vehicle.mass()).abs() < 1e-6);
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrenchObserver {
    gains: ObserverGains,
    /// The gain of all axes, 1/s, if they have the same.
    one_gain: Option<f64>,
    mass: f64,
    inertia: Matrix3,
    allocation: vehicle::Allocation,
    rotor_count: usize,
}

/// The state of the observer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WrenchObserverState {
    /// The estimate: force in W, torque in R about the centre of mass.
    pub wrench: Wrench,
    last: Option<Sample>,
}

impl WrenchObserverState {
    /// Keeps the estimate but not the last sample, for a state that was corrected by a jump, which is not a motion.
    pub fn forget_sample(&mut self) {
        self.last = None;
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Sample {
    rotation_wr: Matrix3,
    momentum_r: Vector3,
    torque_r: Vector3,
}

/// The measurements at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObserverInput {
    /// Orientation: maps R to W.
    pub rotation_wr: Matrix3,
    /// Angular velocity, rad/s, robot.
    pub angular_velocity_r: Vector3,
    /// Specific force at the centre of mass, m/s^2, robot.
    pub specific_force_r: Vector3,
    /// Measured rotor speeds, Hz.
    pub rotor_speeds: RotorVector,
}

impl WrenchObserver {
    /// An observer for one vehicle.
    ///
    /// # Errors
    /// Names the gain that is not positive or above 1e5.
    pub fn new(vehicle: &Vehicle, gains: ObserverGains) -> Result<Self, Error> {
        for (name, gain) in [("force_gain", gains.force), ("torque_gain", gains.torque)] {
            for x in gain.iter() {
                check_range(name, *x, 1e-6, 1e5)?;
            }
        }
        Ok(Self::with_gains(vehicle, gains))
    }

    fn with_gains(vehicle: &Vehicle, gains: ObserverGains) -> Self {
        let first = gains.force.x;
        let same = gains.force.iter().chain(&gains.torque).all(|gain| *gain == first);
        Self {
            gains,
            one_gain: same.then_some(first),
            mass: vehicle.mass(),
            inertia: *vehicle.inertia(),
            allocation: *vehicle.allocation(),
            rotor_count: vehicle.rotor_count(),
        }
    }

    /// An observer with the same gains for a vehicle whose model has been corrected.
    #[must_use]
    pub fn for_vehicle(&self, vehicle: &Vehicle) -> Self {
        Self::with_gains(vehicle, self.gains)
    }

    /// The gains.
    #[must_use]
    pub fn gains(&self) -> &ObserverGains {
        &self.gains
    }

    /// The body wrench of rotor speeds, Hz.
    fn actuation(&self, speeds: &RotorVector) -> Wrench {
        Wrench::from_vector(&vehicle::wrench_of(&self.allocation, &vehicle::inputs(speeds), self.rotor_count))
    }

    /// Takes the sample at the end of a period of `dt` seconds and returns the
    /// estimate: force in W, torque in R about the centre of mass, exerted by
    /// the environment on the robot.
    ///
    /// The first sample only marks t0. (19) has a plus before its bracket here; the paper's minus would estimate the
    /// negative of the force.
    #[inline(always)]
    pub fn step(&self, state: &mut WrenchObserverState, input: &ObserverInput, dt: f64) -> Wrench {
        let actuation = self.actuation(&input.rotor_speeds);
        let momentum_r = self.inertia * input.angular_velocity_r;
        let last = state.last.replace(Sample {
            rotation_wr: input.rotation_wr,
            momentum_r,
            torque_r: actuation.torque,
        });
        let Some(last) = last.filter(|_| dt > 0.0) else {
            return state.wrench;
        };
        let force_w = input.rotation_wr * (self.mass * input.specific_force_r - actuation.force);

        // The rotation over the period, seen from its start. A torque that is constant in the body rotates with it,
        // and its mean is given by the left Jacobian.
        let turn = so3::between(&last.rotation_wr, &input.rotation_wr);
        let gained = turn * momentum_r - last.momentum_r;
        let mean_torque_r = so3::left_jacobian_solve(&so3::log(&turn), &gained) / dt;
        let torque_r = mean_torque_r - 0.5 * (last.torque_r + actuation.torque);

        let (of_force, of_torque) = if let Some(rate) = self.one_gain {
            let fraction = Vector3::repeat(lag_fraction(rate, dt));
            (fraction, fraction)
        } else {
            let fraction = |gain: &Vector3| gain.map(|rate| lag_fraction(rate, dt));
            (fraction(&self.gains.force), fraction(&self.gains.torque))
        };
        let estimate = &mut state.wrench;
        estimate.force += of_force.component_mul(&(force_w - estimate.force));
        estimate.torque += of_torque.component_mul(&(torque_r - estimate.torque));
        *estimate
    }
}

/// Specific force at the centre of mass from that at an accelerometer away
/// from it: `s = s_I - omegad x p_I - omega x (omega x p_I)`, all in robot coordinates.
#[must_use]
pub fn remove_lever_arm(
    specific_force_i_r: &Vector3,
    angular_velocity_r: &Vector3,
    angular_acceleration_r: &Vector3,
    imu_position_r: &Vector3,
) -> Vector3 {
    specific_force_i_r
        - angular_acceleration_r.cross(imu_position_r)
        - angular_velocity_r.cross(&angular_velocity_r.cross(imu_position_r))
}

/// The wrench at the tool tip, W, of a wrench at the centre of mass (force W, torque R); (25).
#[must_use]
#[inline]
pub fn tool_wrench(robot: &Wrench, rotation_wr: &Matrix3, tool_position_r: &Vector3) -> Wrench {
    Wrench {
        force: robot.force,
        torque: rotation_wr * robot.torque - (rotation_wr * tool_position_r).cross(&robot.force),
    }
}

/// The wrench at the centre of mass (force W, torque R) of one at the tool tip, W; (18).
#[must_use]
pub fn robot_wrench(tool_w: &Wrench, rotation_wr: &Matrix3, tool_position_r: &Vector3) -> Wrench {
    let torque_w = tool_w.torque + (rotation_wr * tool_position_r).cross(&tool_w.force);
    Wrench { force: tool_w.force, torque: rotation_wr.transpose() * torque_w }
}
