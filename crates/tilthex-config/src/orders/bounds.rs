//! The bounds of orders: what the vehicle can do, and what is safe for people beside it.

use tilthex_core::{
    Matrix3, Matrix6, Setpoint, Vector3, Wrench, admittance::AdmittanceParams, flight::Route,
    trajectory::Limits,
};

use crate::{Config, reach::Reach};

/// Least apparent mass and inertia at the tool, as a part of the vehicle's mass and inertia. The smaller the apparent mass,
/// the softer an environment must be for stable contact (Keemink, van der Kooij, Stienen, IJRR 2018).
const LEAST_MASS: f64 = 0.2;
/// Least damping divided by the apparent mass, 1/s: after a push the tool must come to rest by itself.
const LEAST_DAMPING: f64 = 0.5;

/// The limits of all values in orders.
#[derive(Clone, Debug)]
pub(super) struct Bounds {
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

impl Bounds {
    /// The bounds of a configuration.
    pub(super) fn of(config: &Config) -> Self {
        let vehicle = config.vehicle().vehicle();
        let admittance = &config.controller().admittance;
        Self {
            rates: config.orders().limits(),
            reach: Reach::of(vehicle, config.controller().attitude.max_turn),
            force: config.supervisor().max_force,
            torque: config.supervisor().max_torque,
            mass: LEAST_MASS * vehicle.mass(),
            inertia: LEAST_MASS * vehicle.inertia().symmetric_eigenvalues().min(),
            max_translation: admittance.max_translation,
            max_rotation: admittance.max_rotation,
        }
    }

    pub(super) fn check_route(&self, route: &Route) -> Result<(), String> {
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

    pub(super) fn check_setpoint(&self, setpoint: &Setpoint) -> Result<(), String> {
        let most = &self.rates;
        for (what, found, most) in [
            ("velocity (m/s)", &setpoint.velocity_w, most.velocity),
            ("acceleration (m/s^2)", &setpoint.acceleration_w, most.acceleration),
            ("angular velocity (rad/s)", &setpoint.angular_velocity_w, most.angular_velocity),
            ("angular acceleration (rad/s^2)", &setpoint.angular_acceleration_w, most.angular_acceleration),
        ] {
            check(what, length(found), most, "[orders]")?;
        }
        self.check_wrench(&setpoint.rotation_we, &setpoint.wrench_w)
    }

    /// Refuses a wrench (world) that the tool must not or cannot exert in an attitude of the tool.
    pub(super) fn check_wrench(&self, rotation_we: &Matrix3, wrench_w: &Wrench) -> Result<(), String> {
        check("force (N)", length(&wrench_w.force), self.force, "[supervisor] max_force")?;
        check("torque (N m)", length(&wrench_w.torque), self.torque, "[supervisor] max_torque")?;
        if !self.reach.exerts(rotation_we, &Wrench::ZERO) {
            return Err("the vehicle cannot hover in this attitude of the tool; tilt it less".into());
        }
        if !self.reach.exerts(rotation_we, wrench_w) {
            return Err(format!(
                "the vehicle cannot exert this wrench at its tool and hover: force {} N, torque {} N m, world; ask for less",
                numbers(&wrench_w.force),
                numbers(&wrench_w.torque)
            ));
        }
        Ok(())
    }

    /// Refuses admittance parameters that are not safe. Matrices that the order does not name are not checked.
    pub(super) fn check_admittance(
        &self,
        params: &AdmittanceParams,
        names_mass: bool,
        names_damping: bool,
    ) -> Result<(), String> {
        if names_mass {
            let least = |m: &Matrix6, at: usize| m.fixed_view::<3, 3>(at, at).symmetric_eigenvalues().min();
            let (mass, inertia) = (least(&params.mass, 0), least(&params.mass, 3));
            if mass < self.mass || inertia < self.inertia {
                return Err(format!(
                    "mass is {mass:.3e} kg and {inertia:.3e} kg m^2 in its lightest directions; expected {:.3e} kg and {:.3e} kg \
                     m^2 or more, which is {LEAST_MASS} of the vehicle's",
                    self.mass, self.inertia
                ));
            }
        }
        if (names_mass || names_damping)
            && (params.damping - params.mass * LEAST_DAMPING).symmetric_eigenvalues().min() < 0.0
        {
            return Err(format!(
                "damping is too weak for this mass; expected {LEAST_DAMPING} 1/s times the mass or more, so that the tool \
                 comes to rest after a push"
            ));
        }
        check("max_translation (m)", params.max_translation, self.max_translation, "[admittance]")?;
        let (found, most) = (params.max_rotation.to_degrees(), self.max_rotation.to_degrees());
        check("max_rotation_deg", found, most, "[admittance]")
    }
}

fn length(vector: &Vector3) -> f64 {
    vector.norm()
}

pub(super) fn numbers(vector: &Vector3) -> String {
    format!("[{:.2}, {:.2}, {:.2}]", vector.x, vector.y, vector.z)
}

/// Refuses a value that is too large, or not finite.
fn check(what: &str, found: f64, most: f64, key: &str) -> Result<(), String> {
    if found <= most {
        return Ok(());
    }
    Err(format!("{what} is {found:.4}; expected {most:.4} at most, the limit of {key} in the configuration"))
}
