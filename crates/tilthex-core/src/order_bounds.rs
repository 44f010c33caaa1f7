//! The bounds of orders: what the vehicle can do, and what is safe for people beside it. Whoever takes orders uses them: a
//! program beside the vehicle, and a vehicle that flies itself.

use core::fmt;

use crate::{
    Vehicle,
    admittance::AdmittanceParams,
    controller::ControllerParams,
    flight::{Route, WatchParams},
    reach::Reach,
    trajectory::Limits,
    types::{Matrix3, Matrix6, Setpoint, Vector3, Vector6, Wrench},
};

/// Least apparent mass and inertia at the tool, as a part of the vehicle's mass and inertia. The smaller the apparent mass,
/// the softer an environment must be for stable contact (Keemink, van der Kooij, Stienen, IJRR 2018).
const LEAST_MASS: f64 = 0.2;
/// Least damping divided by the apparent mass, 1/s: after a push the tool must come to rest by itself.
const LEAST_DAMPING: f64 = 0.5;
/// A value may be beyond its limit by this part of it: messages carry rounded values.
const ROUNDED: f64 = 1e-6;

/// The limits of all values in orders.
#[derive(Clone, Copy, Debug)]
pub struct OrderBounds {
    rates: Limits,
    reach: Reach,
    force: f64,
    torque: f64,
    /// Least apparent mass, kg, and inertia, kg m^2.
    mass: f64,
    inertia: f64,
    max_translation: f64,
    max_rotation: f64,
}

/// Why an order is beyond the bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Beyond {
    /// A value is larger than its limit, or not finite.
    TooLarge {
        /// The value and its unit.
        what: &'static str,
        /// What was ordered.
        found: f64,
        /// Its limit.
        most: f64,
        /// The keys of the configuration with the limit.
        key: &'static str,
    },
    /// The vehicle cannot hover in the attitude.
    Attitude,
    /// The vehicle cannot exert the wrench at its tool and hover.
    Wrench(Wrench),
    /// The apparent mass is too small.
    Light {
        /// Mass (kg) and inertia (kg m^2) in their lightest directions.
        found: (f64, f64),
        /// The least ones.
        least: (f64, f64),
    },
    /// The damping is too weak for the mass.
    Weak,
}

impl Beyond {
    /// The reason in a few words.
    #[must_use]
    pub fn short(&self) -> &'static str {
        match self {
            Self::TooLarge { key: "[orders]", .. } => "a rate is above the limit of [orders]",
            Self::TooLarge { .. } => "a value is above its limit",
            Self::Attitude => "the vehicle cannot hover in this attitude",
            Self::Wrench(_) => "the vehicle cannot exert this wrench",
            Self::Light { .. } => "the mass is too small",
            Self::Weak => "the damping is too weak for this mass",
        }
    }
}

impl fmt::Display for Beyond {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers = |v: &Vector3| [v.x, v.y, v.z];
        match self {
            Self::TooLarge { what, found, most, key } => write!(
                f,
                "{what} is {found:.4}; expected {most:.4} at most, the limit of {key} in the configuration"
            ),
            Self::Attitude => {
                f.write_str("the vehicle cannot hover in this attitude of the tool; tilt it less")
            }
            Self::Wrench(wrench_w) => write!(
                f,
                "the vehicle cannot exert this wrench at its tool and hover: force {:.2?} N, torque {:.2?} N m, world; ask for less",
                numbers(&wrench_w.force),
                numbers(&wrench_w.torque)
            ),
            Self::Light { found, least } => write!(
                f,
                "mass is {:.3e} kg and {:.3e} kg m^2 in its lightest directions; expected {:.3e} kg and {:.3e} kg m^2 or more, \
                 which is {LEAST_MASS} of the vehicle's",
                found.0, found.1, least.0, least.1
            ),
            Self::Weak => write!(
                f,
                "damping is too weak for this mass; expected {LEAST_DAMPING} 1/s times the mass or more, so that the tool comes \
                 to rest after a push"
            ),
        }
    }
}

impl OrderBounds {
    /// The bounds of a vehicle, its controller, the largest rates of orders, and the limits of the tool's wrench.
    #[must_use]
    pub fn new(
        vehicle: &Vehicle,
        controller: &ControllerParams,
        rates: &Limits,
        watch: &WatchParams,
    ) -> Self {
        let admittance = &controller.admittance;
        Self {
            rates: *rates,
            reach: Reach::of(vehicle, controller.attitude.max_turn),
            force: watch.max_force,
            torque: watch.max_torque,
            mass: LEAST_MASS * vehicle.mass(),
            inertia: LEAST_MASS * vehicle.inertia().symmetric_eigenvalues().min(),
            max_translation: admittance.max_translation,
            max_rotation: admittance.max_rotation,
        }
    }

    /// # Errors
    /// If a rate of the route is too large, or a way-point needs an attitude or a wrench that the vehicle cannot have.
    pub fn check_route(&self, route: &Route) -> Result<(), Beyond> {
        let (found, most) = (route.limits(), &self.rates);
        for (what, found, most) in [
            ("velocity limit (m/s)", found.velocity, most.velocity),
            ("acceleration limit (m/s^2)", found.acceleration, most.acceleration),
            ("angular velocity limit (rad/s)", found.angular_velocity, most.angular_velocity),
            ("angular acceleration limit (rad/s^2)", found.angular_acceleration, most.angular_acceleration),
        ] {
            check(what, found, most, "[orders]")?;
        }
        route.waypoints().iter().try_for_each(|point| self.check_wrench(&point.rotation_we, &point.wrench_w))
    }

    /// # Errors
    /// If a rate of the set-point is too large, or it needs an attitude or a wrench that the vehicle cannot have.
    pub fn check_setpoint(&self, setpoint: &Setpoint) -> Result<(), Beyond> {
        let most = &self.rates;
        for (what, found, most) in [
            ("velocity (m/s)", &setpoint.velocity_w, most.velocity),
            ("acceleration (m/s^2)", &setpoint.acceleration_w, most.acceleration),
            ("angular velocity (rad/s)", &setpoint.angular_velocity_w, most.angular_velocity),
            ("angular acceleration (rad/s^2)", &setpoint.angular_acceleration_w, most.angular_acceleration),
        ] {
            check(what, found.norm(), most, "[orders]")?;
        }
        self.check_wrench(&setpoint.rotation_we, &setpoint.wrench_w)
    }

    /// # Errors
    /// If the tool must not or cannot exert a wrench (world) in an attitude of the tool.
    pub fn check_wrench(&self, rotation_we: &Matrix3, wrench_w: &Wrench) -> Result<(), Beyond> {
        check("force (N)", wrench_w.force.norm(), self.force, "[supervisor] max_force")?;
        check("torque (N m)", wrench_w.torque.norm(), self.torque, "[supervisor] max_torque")?;
        if !self.reach.exerts(rotation_we, &Wrench::ZERO) {
            return Err(Beyond::Attitude);
        }
        if *wrench_w != Wrench::ZERO && !self.reach.exerts(rotation_we, wrench_w) {
            return Err(Beyond::Wrench(*wrench_w));
        }
        Ok(())
    }

    /// Checks admittance parameters. Matrices that an order does not name are not checked.
    ///
    /// # Errors
    /// If they are not safe.
    pub fn check_admittance(
        &self,
        params: &AdmittanceParams,
        names_mass: bool,
        names_damping: bool,
    ) -> Result<(), Beyond> {
        if names_mass {
            let least = |m: &Matrix6, at: usize| m.fixed_view::<3, 3>(at, at).symmetric_eigenvalues().min();
            self.check_lightest(least(&params.mass, 0), least(&params.mass, 3))?;
        }
        if names_mass || names_damping {
            check_slowest((params.damping - params.mass * LEAST_DAMPING).symmetric_eigenvalues().min())?;
        }
        check("max_translation (m)", params.max_translation, self.max_translation, "[admittance]")?;
        let (found, most) = (params.max_rotation.to_degrees(), self.max_rotation.to_degrees());
        check("max_rotation_deg", found, most, "[admittance]")
    }

    /// Checks a diagonal mass, translation first.
    ///
    /// # Errors
    /// If it is too small.
    pub fn check_mass(&self, mass: &Vector6) -> Result<(), Beyond> {
        let least = |from: usize| least(mass.iter().skip(from).take(3));
        self.check_lightest(least(0), least(3))
    }

    /// Checks a diagonal damping for a diagonal mass.
    ///
    /// # Errors
    /// If it is too weak.
    pub fn check_damping(&self, mass: &Vector6, damping: &Vector6) -> Result<(), Beyond> {
        check_slowest(least((damping - mass * LEAST_DAMPING).iter()))
    }

    fn check_lightest(&self, mass: f64, inertia: f64) -> Result<(), Beyond> {
        let enough = |found: f64, least: f64| found >= least * (1.0 - ROUNDED);
        if enough(mass, self.mass) && enough(inertia, self.inertia) {
            return Ok(());
        }
        Err(Beyond::Light { found: (mass, inertia), least: (self.mass, self.inertia) })
    }
}

/// The least number; NaN if one is NaN.
fn least<'a>(numbers: impl Iterator<Item = &'a f64>) -> f64 {
    numbers.fold(f64::INFINITY, |least, x| if least.is_nan() || *x >= least { least } else { *x })
}

/// Refuses a damping by how much it exceeds what its mass needs.
fn check_slowest(excess: f64) -> Result<(), Beyond> {
    if excess >= -ROUNDED { Ok(()) } else { Err(Beyond::Weak) }
}

/// Refuses a value that is too large, or not finite.
fn check(what: &'static str, found: f64, most: f64, key: &'static str) -> Result<(), Beyond> {
    if found <= most * (1.0 + ROUNDED) { Ok(()) } else { Err(Beyond::TooLarge { what, found, most, key }) }
}
