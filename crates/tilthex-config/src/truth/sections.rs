//! What may differ between a vehicle and its model.

use super::spread::Spread;
use crate::{section::section, values::Axes};

section! {
    /// Errors of the controller's model of the vehicle. Each is a number, { mean, std } (normal, cut at
    /// three deviations; mean 0 without) or { min, max } (uniform), drawn for each seed.
    pub ErrorSection as "truth.error" {
        /// Mass, fraction of the model's.
        mass: Spread = Spread::default() => "1",
        /// Thrust coefficient of all rotors together, fraction of the model's.
        thrust: Spread = Spread::default() => "1",
        /// Thrust coefficient of each rotor in addition, fraction of the model's; drawn for each rotor.
        thrust_each: Spread = Spread::default() => "1",
        /// Drag-moment coefficient of all rotors together, fraction of the model's.
        drag_moment: Spread = Spread::default() => "1",
        /// Rotation of the thrust axis about each of two axes normal to it; drawn for each rotor.
        rotor_axis_deg: Spread = Spread::default() => "degrees",
        /// Centre of mass; drawn for each robot axis. Rotors, tool, IMU and the captured body stay where they are.
        centre_of_mass: Spread = Spread::default() => "m",
        /// Principal moments of inertia, fraction of the model's; drawn for each. Moments that no rigid body can have
        /// are drawn again.
        inertia: Spread = Spread::default() => "1",
        /// Time constant of the rotors' lag, fraction of the model's.
        rotor_lag: Spread = Spread::default() => "1",
        /// Tool tip; drawn for each robot axis.
        tool_tip: Spread = Spread::default() => "m",
    }
}

section! {
    /// Effects of the air, which the controller's model does not contain. Numbers, or distributions as above.
    pub AerodynamicsSection as "truth.aerodynamics" {
        /// Density of the air (ISO 2533 at sea level: 1.225).
        air_density: f64 = 1.225 => "kg/m^3" from 0.0 to 10.0,
        /// Rotor drag: force against the airspeed in the rotor's disc, per Hz of rotor speed (Faessler, Franchi, Scaramuzza 2018).
        /// If it is not set, that of `[vehicle]`.
        rotor_drag: Option<f64> = None => "N s/m per Hz" from 0.0 to 1.0,
        /// Flapping: torque that lifts the leading edge of a rotor's disc, per Hz of rotor speed (Mahony, Kumar, Corke 2012).
        /// If it is not set, that of `[vehicle]`.
        flapping: Option<f64> = None => "N m s/m per Hz" from -1.0 to 1.0,
        /// Drag coefficient times area of the airframe along robot x, y, z: force 1/2 rho C A |v| v.
        drag_area: Axes<3> = Axes([0.0; 3]) => "m^2",
        /// Point at which that force acts, from the centre of mass, robot frame.
        centre_of_pressure: Axes<3> = Axes([0.0; 3]) => "m",
        /// Horizontal speed of the mean wind.
        wind_speed: f64 = 0.0 => "m/s" from 0.0 to 100.0,
        /// Direction to which the wind blows, from world x towards y.
        wind_direction_deg: f64 = 0.0 => "degrees",
        /// Upward speed of the mean wind.
        wind_up: f64 = 0.0 => "m/s",
        /// Standard deviation of the gusts in each direction; Dryden spectra (MIL-F-8785C, 3.7.2).
        gust_deviation: f64 = 0.0 => "m/s" from 0.0 to 50.0,
        /// Length scale of the gusts.
        gust_length: f64 = 20.0 => "m",
        /// Time in the simulation at which wind and gusts rise, within 2 s; 0 for a wind from the start.
        wind_begin: f64 = 0.0 => "s" from 0.0 to 1e6,
        /// Radius of the rotors, for `ground` and `wall`; 0 for no such effect.
        rotor_radius: f64 = 0.0 => "m" from 0.0 to 10.0,
        /// Height of the ground in the world: thrust grows near it (Cheeseman and Bennett 1955).
        ground: Option<f64> = None => "m",
        /// Distance of a wall from the world's origin, in the direction of `wall_direction_deg`: air crosses the rotors near it (the same source and image).
        wall: Option<f64> = None => "m",
        /// Direction of the wall, from world x towards y.
        wall_direction_deg: f64 = 0.0 => "degrees",
    }
}

section! {
    /// Effects of the vehicle's own parts, which the controller's model does not contain.
    pub StructureSection as "truth.structure" {
        /// Moment of inertia of a rotor with the turning part of its motor: reaction to acceleration, and gyroscopic torque.
        rotor_inertia: f64 = 0.0 => "kg m^2" from 0.0 to 1.0,
        /// Voltage at which a throttle gives the speed of the same name: thrust falls with the square of the voltage.
        /// 0 if commands are speeds.
        throttle_voltage: f64 = 0.0 => "V" from 0.0 to 1000.0,
        /// The same for a vehicle with PX4: power of the voltage with which the speed at a throttle grows. If it is not set, that
        /// of `[link]`.
        throttle_exponent: Option<f64> = None => "1" from 0.0 to 3.0,
        /// Capacity of the battery (4 cells of lithium polymer).
        battery_capacity: f64 = 5.0 => "A h",
        /// Charge at the start, 0 to 1.
        battery_charge: f64 = 0.9 => "1" from 0.0 to 1.0,
        /// Lateral stiffness of the tool's rod at its tip (a cantilever: 3 E I / L^3); 0 for a rigid rod.
        tool_stiffness: f64 = 0.0 => "N/m" from 0.0 to 1e9,
        /// Length of the rod from its clamp to its tip.
        tool_length: f64 = 0.4 => "m" from 1e-3 to 10.0,
    }
}

section! {
    /// The sensors. Noise that is not set is that of the program that simulates.
    pub SensorsSection as "truth.sensors" {
        /// Noise of captured positions.
        position: Option<f64> = None => "m",
        /// Noise of captured orientations.
        orientation: Option<f64> = None => "rad",
        /// Noise of a gyroscope sample.
        gyro: Option<f64> = None => "rad/s",
        /// Noise of an accelerometer sample.
        accelerometer: Option<f64> = None => "m/s^2",
        /// Noise of the rotor speeds.
        rotor_speed: Option<f64> = None => "Hz",
        /// Constant bias of the gyroscope, IMU axes.
        gyro_bias: Axes<3> = Axes([0.0; 3]) => "rad/s",
        /// Constant bias of the accelerometer, IMU axes.
        accelerometer_bias: Axes<3> = Axes([0.0; 3]) => "m/s^2",
        /// Relative error of the gyroscope's scale, IMU axes.
        gyro_scale: Axes<3> = Axes([0.0; 3]) => "1",
        /// Small rotation of the gyroscope's axes relative to the IMU's.
        gyro_misalignment: Axes<3> = Axes([0.0; 3]) => "rad",
        /// Vibration of the IMU by one rotor at 100 Hz; it grows with the square of the speed.
        vibration: f64 = 0.0 => "m/s^2" from 0.0 to 1000.0,
    }
}

section! {
    /// Delays. Those that are not set are those of the program that simulates.
    pub DelaysSection as "truth.delays" {
        /// Mean age of a captured pose when it arrives.
        pose: Option<f64> = None => "s",
        /// Half the width of that age's uniform distribution.
        pose_jitter: Option<f64> = None => "s",
        /// Age of the measured rotor speeds.
        rotor_speeds: f64 = 0.0 => "s" from 0.0 to 0.05,
    }
}
