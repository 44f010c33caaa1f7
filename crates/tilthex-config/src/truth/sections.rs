//! What may differ between a vehicle and its model.

use super::spread::Spread;
use crate::{section::section, values::Axes};

section! {
    /// Errors of the controller's model of the vehicle. Each is a number, { mean, std } (normal, cut at
    /// three deviations; mean 0 without) or { min, max } (uniform), drawn for each seed.
    pub ErrorSection as "truth.error" {
        /// Mass, part of the model's.
        mass: Spread = Spread::default(),
        /// Thrust coefficient of all rotors together, part of the model's.
        thrust: Spread = Spread::default(),
        /// Thrust coefficient of each rotor in addition, part; drawn for each rotor.
        thrust_each: Spread = Spread::default(),
        /// Drag-moment coefficient of all rotors together, part.
        drag_moment: Spread = Spread::default(),
        /// Turn of the thrust axis about each of two axes normal to it, degrees; drawn for each rotor.
        rotor_axis_deg: Spread = Spread::default(),
        /// Centre of mass, m; drawn for each robot axis. Rotors, tool, IMU and the captured body stay where they are.
        centre_of_mass: Spread = Spread::default(),
        /// Principal moments of inertia, part; drawn for each. Moments that no body has are drawn again.
        inertia: Spread = Spread::default(),
        /// Time constant of the rotors' lag, part.
        rotor_lag: Spread = Spread::default(),
        /// Tool tip, m; drawn for each robot axis.
        tool_tip: Spread = Spread::default(),
    }
}

section! {
    /// What the air does, of which the controller's model has nothing. Numbers, or distributions as above.
    pub AerodynamicsSection as "truth.aerodynamics" {
        /// Density of the air, kg/m^3 (ISO 2533 at sea level: 1.225).
        air_density: f64 = 1.225,
        /// Rotor drag: force against the airspeed in the rotor's disc, N s/m per Hz of rotor speed (Faessler, Franchi, Scaramuzza 2018).
        rotor_drag: f64 = 0.0,
        /// Flapping: torque that lifts the leading edge of a rotor's disc, N m s/m per Hz of rotor speed (Mahony, Kumar, Corke 2012).
        flapping: f64 = 0.0,
        /// Drag coefficient times area of the airframe along robot x, y, z, m^2: force 1/2 rho C A |v| v.
        drag_area: Axes<3> = Axes([0.0; 3]),
        /// Where that force acts, from the centre of mass, robot frame, m.
        centre_of_pressure: Axes<3> = Axes([0.0; 3]),
        /// Horizontal speed of the mean wind, m/s.
        wind_speed: f64 = 0.0,
        /// Where it blows to, degrees from world x towards y.
        wind_direction_deg: f64 = 0.0,
        /// Upward speed of the mean wind, m/s.
        wind_up: f64 = 0.0,
        /// Standard deviation of the gusts in each direction, m/s; Dryden spectra (MIL-F-8785C, 3.7.2).
        gust_deviation: f64 = 0.0,
        /// Their length, m.
        gust_length: f64 = 20.0,
        /// Radius of the rotors, m, for `ground` and `wall`; 0 for no such effect.
        rotor_radius: f64 = 0.0,
        /// Height of the ground in the world, m: thrust grows near it (Cheeseman and Bennett 1955).
        ground: Option<f64> = None,
        /// Distance of a wall from the world's origin, m, in the direction of `wall_direction_deg`: air crosses the rotors near it (the same source and image).
        wall: Option<f64> = None,
        /// Where the wall is, degrees from world x towards y.
        wall_direction_deg: f64 = 0.0,
    }
}

section! {
    /// What the vehicle's own parts do, of which the controller's model has nothing.
    pub StructureSection as "truth.structure" {
        /// Moment of inertia of a rotor with the turning part of its motor, kg m^2: reaction to acceleration, and gyroscopic torque.
        rotor_inertia: f64 = 0.0,
        /// Voltage at which a throttle gives the speed it names, V: thrust falls with the square of the voltage; 0 where commands are speeds.
        throttle_voltage: f64 = 0.0,
        /// Capacity of the battery (4 cells of lithium polymer), A h.
        battery_capacity: f64 = 5.0,
        /// Charge at the start, 0 to 1.
        battery_charge: f64 = 0.9,
        /// Lateral stiffness of the tool's rod at its tip, N/m (a cantilever: 3 E I / L^3); 0 for a rigid rod.
        tool_stiffness: f64 = 0.0,
        /// Length of the rod from its clamp to its tip, m.
        tool_length: f64 = 0.4,
    }
}

section! {
    /// The sensors. Noise that is not set is that of the program that simulates.
    pub SensorsSection as "truth.sensors" {
        /// Noise of captured positions, m.
        position: Option<f64> = None,
        /// Noise of captured orientations, rad.
        orientation: Option<f64> = None,
        /// Noise of the gyroscope, rad/s a sample.
        gyro: Option<f64> = None,
        /// Noise of the accelerometer, m/s^2 a sample.
        accelerometer: Option<f64> = None,
        /// Noise of the rotor speeds, Hz.
        rotor_speed: Option<f64> = None,
        /// Constant bias of the gyroscope, IMU axes, rad/s.
        gyro_bias: Axes<3> = Axes([0.0; 3]),
        /// Constant bias of the accelerometer, IMU axes, m/s^2.
        accelerometer_bias: Axes<3> = Axes([0.0; 3]),
        /// Relative error of the gyroscope's scale, IMU axes.
        gyro_scale: Axes<3> = Axes([0.0; 3]),
        /// Turn of the gyroscope's axes against the IMU's, rad.
        gyro_misalignment: Axes<3> = Axes([0.0; 3]),
        /// Vibration of the IMU by one rotor at 100 Hz, m/s^2; it grows with the square of the speed.
        vibration: f64 = 0.0,
    }
}

section! {
    /// Delays. Those that are not set are those of the program that simulates.
    pub DelaysSection as "truth.delays" {
        /// Mean age of a captured pose when it arrives, s.
        pose: Option<f64> = None,
        /// Half the width of that age's uniform distribution, s.
        pose_jitter: Option<f64> = None,
        /// Age of the measured rotor speeds, s, up to 0.05.
        rotor_speeds: f64 = 0.0,
    }
}
