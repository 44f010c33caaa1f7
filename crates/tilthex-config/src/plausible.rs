//! Refuses numbers that are valid one by one but impossible together: a line that is too slow for its streams, poses that
//! are too old to fly with, a vehicle that cannot hover, numbers in another unit.

use super::{Config, ConfigError};
use tilthex_core::{Matrix3, Rotor, Vector3, Vehicle, allocation::Allocator, types::Vector6};
use tilthex_link::{Link, LinkKind, LinkParams, VehicleLink};

/// Largest age of a pose when it leaves the capture system, s. Poses older than 0.1 s count as lost (docs/faults.md); the
/// rest is for the time between two poses and for the network.
const MAX_LATENCY: f64 = 0.08;
/// Largest part of a line's capacity that its streams may use.
const MAX_LOAD: f64 = 0.9;
/// Number of bits that the line needs for one byte.
const BITS: f64 = 10.0;
/// Largest distance of a rotor, tool or sensor from the centre of mass, m.
const MAX_REACH: f64 = 5.0;
/// Fastest rotor, Hz.
const MAX_SPEED: f64 = 1000.0;
/// Factor by which principal moments may break the triangle inequality, because numbers are rounded.
const INERTIA_SLACK: f64 = 1.02;
/// The rotors carry the weight if the error of their wrench (N and N m) is below this part of the weight (N).
const CARRIED: f64 = 0.01;
/// Largest mass of a vehicle, kg.
const MAX_MASS: f64 = 1000.0;
/// Above this mass, kg, the message asks whether the unit is right.
const HEAVY: f64 = 100.0;
/// Smallest and largest radius of gyration, divided by the farthest rotor's distance. Outside of them the message asks
/// whether the unit is right.
const GYRATION: (f64, f64) = (0.02, 2.0);

impl Config {
    /// Refuses poses that are too old when they leave the capture system.
    pub(super) fn check_latency(&self) -> Result<(), ConfigError> {
        let (mocap, constant) = (self.mocap.latency, self.estimator.latency);
        let most = MAX_LATENCY.min(0.5 * self.estimator.history);
        if mocap <= 0.0 || mocap + constant.max(0.0) <= most {
            return Ok(());
        }
        let beside =
            if constant > 0.0 { format!(", and {constant} s of [estimator]") } else { String::new() };
        Err(ConfigError::new(format!(
            "[mocap]: latency is {mocap} s{beside}; expected {most} s at most together: poses older than 0.1 s count as lost"
        )))
    }

    /// Refuses a line that cannot carry the configured streams.
    pub(super) fn check_line(&self, params: LinkParams) -> Result<(), ConfigError> {
        let link = &self.link;
        if link.baud == 0 {
            return Ok(());
        }
        let rotors = self.vehicle.vehicle().rotor_count();
        let frames = Link::new(link.kind()?, params, rotors)?.frames();
        let (imu, motors) = (link.imu_rate, rotors as f64 * link.motor_rate);
        let received = imu * f64::from(frames.inertial)
            + motors * f64::from(frames.motor)
            + link.battery_rate * f64::from(frames.battery);
        let sent = imu * f64::from(frames.command);
        let carried = f64::from(link.baud) / BITS;
        if received.max(sent) <= MAX_LOAD * carried {
            return Ok(());
        }
        Err(ConfigError::new(format!(
            "[link]: baud is {}, which carries {carried} bytes/s each way; the streams need {received:.0} from the vehicle \
             ({} Hz x {} bytes of the IMU + {rotors} x {} Hz x {} bytes of the motors + {} Hz x {} bytes of the battery) and \
             {sent:.0} to it: use a faster line, or lower imu_rate and motor_rate",
            link.baud,
            link.imu_rate,
            frames.inertial,
            link.motor_rate,
            frames.motor,
            link.battery_rate,
            frames.battery,
        )))
    }

    /// Refuses a vehicle that needs throttles (PX4) if its throttle map is not known or a rotor turns in both directions.
    pub(super) fn check_throttle(&self) -> Result<(), ConfigError> {
        if self.link.kind()? != LinkKind::Px4 {
            return Ok(());
        }
        let reversible = self.vehicle.vehicle().rotors().iter().position(|rotor| rotor.min_speed < 0.0);
        if let Some(rotor) = reversible {
            return Err(ConfigError::new(format!(
                "[link]: protocol is \"px4\", and min_speed of rotor {} is negative; expected 0 or more: this link turns rotors \
                 in one direction only",
                rotor + 1
            )));
        }
        let throttle = self.link.params()?.throttle;
        let fastest = self.vehicle.vehicle().rotors().iter().map(|rotor| rotor.max_speed).fold(0.0, f64::max);
        let (half, whole) = (throttle.throttle(0.5 * fastest, None).0, throttle.throttle(fastest, None).0);
        if throttle.coefficients != [0.0; 3] && half < whole {
            return Ok(());
        }
        Err(ConfigError::new(format!(
            "[link]: throttle is {:?}, which gives {whole:.2} at {fastest} Hz, the largest speed, and {half:.2} at half of it; \
             expected a throttle from 0 to 1 that grows with the speed: fit the map as docs/howto/px4.md says",
            throttle.coefficients
        )))
    }

    /// Refuses a vehicle whose rotors cannot carry its weight within their limits, in any attitude.
    ///
    /// # Errors
    /// Says at which speed a rotor would turn in level hover, and its limits.
    pub fn check_hover(&self) -> Result<(), ConfigError> {
        let vehicle = self.vehicle.vehicle();
        let weight = vehicle.weight();
        let allocator = Allocator::new(vehicle);
        let carried = |up: &Vector3| {
            let mut wrench = Vector6::zeros();
            wrench.fixed_rows_mut::<3>(0).copy_from(&(up.normalize() * weight));
            (allocator.allocate(&wrench).wrench - wrench).norm() < CARRIED * weight
        };
        let step = [0.0, -1.0, 1.0];
        let ups = step.iter().flat_map(|&x| step.map(|y| step.map(|z| Vector3::new(x, y, z))).concat());
        if carried(&Vector3::z()) || ups.filter(|up| up.norm() > 0.0).any(|up| carried(&up)) {
            return Ok(());
        }
        let level = vehicle.hover_speeds(&Matrix3::identity());
        // The factor by which a rotor's speed would be outside of its limits.
        let outside = |(rotor, &speed): (&Rotor, &f64)| {
            (speed.abs() / rotor.max_speed.abs()).max(rotor.min_speed.abs() / speed.abs())
        };
        let worst = vehicle
            .rotors()
            .iter()
            .zip(&level)
            .enumerate()
            .max_by(|a, b| outside(a.1).total_cmp(&outside(b.1)));
        let (number, found, rotor) = match worst {
            Some((k, (rotor, speed))) => (k + 1, *speed, *rotor),
            None => return Ok(()),
        };
        Err(ConfigError::new(format!(
            "[vehicle]: it cannot hover: to carry its weight of {weight:.1} N in level hover, rotor {number} would turn at \
             {found:.1} Hz; expected {} to {} Hz: check mass (kg), thrust_coefficient (N/Hz^2), min_speed and max_speed (Hz, \
             which is rpm / 60)",
            rotor.min_speed, rotor.max_speed
        )))
    }
}

/// Refuses a place that is too far from the centre of mass.
pub(super) fn check_place(what: &str, place_r: &Vector3) -> Result<(), ConfigError> {
    if place_r.norm() > MAX_REACH {
        return Err(ConfigError::new(format!(
            "{what} is {:.4} m from the centre of mass; expected {MAX_REACH} m at most: is it in mm?",
            place_r.norm()
        )));
    }
    Ok(())
}

/// Refuses a mass that is probably in grams.
pub(super) fn check_mass(mass: f64) -> Result<(), ConfigError> {
    if mass > MAX_MASS {
        return Err(ConfigError::new(format!(
            "mass is {mass} kg; expected {MAX_MASS} kg at most: is it in grams?"
        )));
    }
    Ok(())
}

/// Refuses a body that cannot exist, and numbers that are probably in another unit.
pub(super) fn check_body(vehicle: &Vehicle) -> Result<(), ConfigError> {
    let refuse = |sentence: String| Err(ConfigError::new(sentence));
    let moments = vehicle.inertia().symmetric_eigenvalues();
    let (largest, sum) = (moments.max(), moments.sum());
    if largest > INERTIA_SLACK * (sum - largest) {
        return refuse(format!(
            "inertia has the principal moments {:.4e}, {:.4e} and {:.4e} kg m^2; expected none above the sum of the other \
             two, because no body has such an inertia",
            moments[0], moments[1], moments[2]
        ));
    }
    for (k, rotor) in vehicle.rotors().iter().enumerate() {
        check_place(&format!("rotor {}", k + 1), &rotor.position_r)?;
        let fastest = rotor.max_speed.abs().max(rotor.min_speed.abs());
        if fastest > MAX_SPEED {
            return refuse(format!(
                "rotor {} turns at up to {fastest} Hz; expected {MAX_SPEED} Hz at most: is it in rpm? 60 rpm are 1 Hz",
                k + 1
            ));
        }
    }
    Ok(())
}

/// Questions about numbers that are possible but unusual.
pub(super) fn questions(vehicle: &Vehicle) -> Vec<String> {
    let mut found = Vec::new();
    if vehicle.mass() > HEAVY {
        found.push(format!("[vehicle]: mass is {} kg: is it in grams?", vehicle.mass()));
    }
    let reach = vehicle.rotors().iter().map(|rotor| rotor.position_r.norm()).fold(0.0, f64::max);
    let gyration = (vehicle.inertia().symmetric_eigenvalues().max() / vehicle.mass()).sqrt();
    if !(GYRATION.0 * reach..=GYRATION.1 * reach).contains(&gyration) {
        found.push(format!(
            "[vehicle]: inertia is that of a ring with a radius of {gyration:.3} m, and the farthest rotor is {reach:.3} m from \
             the centre: is it in kg m^2?"
        ));
    }
    found
}
