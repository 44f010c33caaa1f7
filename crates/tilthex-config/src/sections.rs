//! The sections of what surrounds the controller.

// The comments stand in TOML files too, where brackets are no links.
#![allow(rustdoc::broken_intra_doc_links)]

use super::{section::section, values::Axes};
use tilthex_core::model_learning::ModelPrior;

section! {
    /// The link to the vehicle.
    pub LinkSection as "link" {
        /// Protocol of the vehicle: "tk3" (mikrokopter ESCs, chimera boards) or "px4" (uXRCE-DDS).
        protocol: String = "tk3".into(),
        /// 57600, 115200, 500000, 2000000, or 0 to leave the speed alone (native USB, pseudo-terminals).
        baud: u32 = 500_000 => "bits/s",
        /// Rate of the inertial samples.
        imu_rate: f64 = 500.0 => "Hz" from 0.5 to 2000.0,
        /// Rate of each motor's measurements.
        motor_rate: f64 = 250.0 => "Hz" from 0.5 to 2000.0,
        /// Rate of the battery's measurements.
        battery_rate: f64 = 1.0 => "Hz" from 0.5 to 2000.0,
        /// Delay from an inertial sample to the rotors' answer, in addition to half a control period: line, computer
        /// and motor controllers. Stability margins and derived gains use it.
        loop_delay: f64 = 0.004 => "s" from 0.0 to 0.1,
        /// How much older a measured rotor speed is than an inertial sample that arrives with it. Above 0 the model of the
        /// rotors brings the speeds to the sample's time; 0 takes the speeds as measured.
        rotor_speed_age: f64 = 0.0 => "s" from 0.0 to 0.05,
        /// One count of the accelerometer; 0 for the known value of the board.
        accelerometer_scale: f64 = 0.0 => "m/s^2" from 0.0 to 1.0,
        /// One count of the gyroscope; 0 for the known value of the board.
        gyro_scale: f64 = 0.0 => "rad/s" from 0.0 to 1.0,
        /// With "px4": c0, c1 and c2 of throttle = c0 + c1 x + c2 x^2. The throttle is from 0 to 1; x is the rotor's speed (Hz)
        /// times (throttle_voltage / battery voltage)^throttle_exponent. All 0: not known, and the vehicle cannot fly.
        throttle: Axes<3> = Axes([0.0; 3]) => "1, 1/Hz, 1/Hz^2",
        /// Battery voltage at which throttle was measured; 0 if the battery does not change the speed at a throttle (motor
        /// controllers that regulate the speed). Then x is the speed.
        throttle_voltage: f64 = 0.0 => "V" from 0.0 to 1000.0,
        /// Power of the battery's voltage with which the speed at a throttle grows; `tilthex fit` finds it in a log. 1: the speed is
        /// proportional to the voltage.
        throttle_exponent: f64 = 1.0 => "1" from 0.0 to 3.0,
        /// Rate at which the measured speeds correct the throttles; 0 for no correction.
        throttle_correction: f64 = 2.0 => "1/s" from 0.0 to 20.0,
    }
}

section! {
    /// Motion capture.
    pub MocapSection as "mocap" {
        /// Source of the poses: "natnet://HOST[:PORT]/BODY", "natnet+multicast://HOST/BODY", "vrpn://HOST/TRACKER[/SENSOR]" or "udp://SENDER/BODY"; empty for none.
        uri: String = String::new(),
        /// The capture system's upward axis, "y" or "z".
        up_axis: String = "z".into(),
        /// Age of a pose when it leaves a capture system that does not send this age (VRPN, or cameras without
        /// exposure times). At most 0.08: a pose that is older than 0.1 s counts as lost.
        latency: f64 = 0.0 => "s" from 0.0 to 1.0,
    }
}

section! {
    /// Take-off, hover and landing.
    pub MissionSection as "mission" {
        /// Height of the first hover above the start.
        take_off_height: f64 = 0.6 => "m" from 0.05 to 100.0,
        /// Time of the first hover in which the observer's bias is learnt; 0 for none.
        bias_time: f64 = 2.0 => "s" from 0.0 to 60.0,
        /// The contact-free flight after the first hover from which the model is learnt: "none", "hover" (level) or
        /// "tilts" (level, and three hovers tilted by 10 to 15 degrees and turned by 90 degrees, 35 s in all). The learnt model replaces
        /// the bias.
        calibration: String = "none".into(),
        /// Standard deviation of the configured mass, as a fraction of it; 0.001 for a vehicle that was weighed as it flies. The
        /// calibration flight shows only the ratio of thrust and mass, and corrects mostly the less certain of the two. A mass
        /// that stays wrong scales every observed force.
        mass_deviation: f64 = ModelPrior::CAD.mass => "" from 1e-4 to 0.3,
        /// Whether hovers of the mission go on correcting mass, thrust and centre of mass after a calibration: payload and battery
        /// change. A hover that differs by more than these change is contact, and corrects nothing.
        slow_learning: bool = true,
        /// Largest velocity between way-points.
        max_velocity: f64 = 0.4 => "m/s" from 1e-3 to 10.0,
        /// Largest acceleration between way-points.
        max_acceleration: f64 = 0.8 => "m/s^2" from 1e-3 to 20.0,
        /// Largest angular velocity between way-points.
        max_angular_velocity_deg: f64 = 30.0 => "degrees/s" from 0.1 to 1e3,
        /// Largest angular acceleration between way-points.
        max_angular_acceleration_deg: f64 = 60.0 => "degrees/s^2" from 0.1 to 1e4,
        /// Speed of the descent to the ground.
        landing_speed: f64 = 0.25 => "m/s" from 0.05 to 1.0,
        /// Largest distance of a streamed set-point from the one before.
        max_setpoint_jump: f64 = 0.05 => "m" from 0.0 to 1.0,
    }
}

section! {
    /// Limits whose crossing is a fault; docs/faults.md says what follows.
    pub SupervisorSection as "supervisor" {
        /// The vehicle does not start, and lands, below this battery voltage; 0 for no limit, which
        /// `tilthex-rt --port` accepts only with --no-battery-limits.
        battery_low: f64 = 0.0 => "V" from 0.0 to 100.0,
        /// Critical battery voltage; 0 for no limit, as for `battery_low`.
        battery_critical: f64 = 0.0 => "V" from 0.0 to 100.0,
        /// Largest distance of the centre of mass from its reference, and in the mission of the tool from its own.
        max_position_error: f64 = 0.3 => "m" from 0.01 to 10.0,
        /// Largest rotation from the reference.
        max_rotation_error_deg: f64 = 35.0 => "degrees" from 1.0 to 90.0,
        /// Largest tilt.
        max_tilt_deg: f64 = 60.0 => "degrees" from 1.0 to 180.0,
        /// Largest speed.
        max_speed: f64 = 3.0 => "m/s" from 0.1 to 100.0,
        /// Largest estimated force on the tool; unless given, what the level vehicle can push.
        max_force: f64 = 40.0 => "N" from 0.1 to 1e3,
        /// Largest estimated torque on the tool; unless given, what the level vehicle can exert.
        max_torque: f64 = 5.0 => "N m" from 0.01 to 1e3,
        /// Longest time from the first start command until all motors spin.
        start_timeout: f64 = 30.0 => "s" from 1.0 to 300.0,
        /// Whether each motor is spun alone, for about half a second, before all of them start. The right motor must
        /// turn at its speed, and no other motor may turn; otherwise no motor starts.
        motor_check: bool = true,
        /// The vehicle lands if it is farther than this from its start along x or y.
        geofence: f64 = 3.0 => "m" from 0.1 to 1e4,
        /// The vehicle lands if it is higher than this above its start.
        geofence_height: f64 = 3.0 => "m" from 0.1 to 1e4,
        /// Longest silence of the operator on the control socket while the vehicle flies the operator's orders. After
        /// it the vehicle holds, and lands later. 0 for no limit.
        operator_timeout: f64 = 2.0 => "s" from 0.0 to 3600.0,
    }
}

section! {
    /// Limits of orders on the control socket, in addition to what the vehicle can push and hold.
    pub OrdersSection as "orders" {
        /// Largest velocity of a streamed set-point and of a route's limits.
        max_velocity: f64 = 1.5 => "m/s" from 1e-3 to 10.0,
        /// Largest acceleration of either.
        max_acceleration: f64 = 4.0 => "m/s^2" from 1e-3 to 20.0,
        /// Largest angular velocity of either.
        max_angular_velocity_deg: f64 = 90.0 => "degrees/s" from 0.1 to 1e3,
        /// Largest angular acceleration of either.
        max_angular_acceleration_deg: f64 = 360.0 => "degrees/s^2" from 0.1 to 1e4,
    }
}

section! {
    /// The log.
    pub LogSection as "log" {
        /// The MCAP file to write; empty for none. One that exists is replaced only with --overwrite.
        path: String = String::new(),
    }
}
