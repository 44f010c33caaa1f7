//! The sections of what surrounds the controller.

// The comments stand in TOML files too, where brackets are no links.
#![allow(rustdoc::broken_intra_doc_links)]

use super::section::section;

section! {
    /// The link to the vehicle.
    pub LinkSection as "link" {
        /// What the vehicle speaks: "tk3" (mikrokopter ESCs, chimera boards).
        protocol: String = "tk3".into(),
        /// 57600, 115200, 500000, 2000000, or 0 to leave the speed alone (native USB, pseudo-terminals).
        baud: u32 = 500_000,
        /// Rate of the inertial samples, Hz.
        imu_rate: f64 = 500.0,
        /// Rate of each motor's measurements, Hz.
        motor_rate: f64 = 250.0,
        /// Rate of the battery's measurements, Hz.
        battery_rate: f64 = 1.0,
        /// One count of the accelerometer, m/s^2; 0 for what is known of the board.
        accelerometer_scale: f64 = 0.0,
        /// One count of the gyroscope, rad/s; 0 for what is known of the board.
        gyro_scale: f64 = 0.0,
    }
}

section! {
    /// Motion capture.
    pub MocapSection as "mocap" {
        /// Where poses come from: "natnet://HOST[:PORT]/BODY", "natnet+multicast://HOST/BODY" or "vrpn://HOST/TRACKER"; empty for none.
        uri: String = String::new(),
        /// The capture system's upward axis, "y" or "z".
        up_axis: String = "z".into(),
        /// Age of a pose when it leaves a system that does not tell it (VRPN, or cameras without exposure times), s;
        /// at most 0.08, since older poses count as lost.
        latency: f64 = 0.0,
    }
}

section! {
    /// Take-off, hover and landing.
    pub MissionSection as "mission" {
        /// Height of the first hover above the start, m.
        take_off_height: f64 = 0.6,
        /// Time of the first hover in which the observer's bias is learnt, s; 0 for none.
        bias_time: f64 = 2.0,
        /// Largest velocity on the way to a way-point, m/s.
        max_velocity: f64 = 0.4,
        /// Largest acceleration on the way to a way-point, m/s^2.
        max_acceleration: f64 = 0.8,
        /// Largest angular velocity on the way to a way-point, degrees/s.
        max_angular_velocity_deg: f64 = 30.0,
        /// Largest angular acceleration on the way to a way-point, degrees/s^2.
        max_angular_acceleration_deg: f64 = 60.0,
        /// Speed of the descent to the ground, m/s.
        landing_speed: f64 = 0.25,
        /// Farthest a streamed set-point may be from the one before, m.
        max_setpoint_jump: f64 = 0.05,
    }
}

section! {
    /// Limits whose crossing is a fault; docs/faults.md says what follows.
    pub SupervisorSection as "supervisor" {
        /// The vehicle does not start, and lands, below this battery voltage, V; 0 for no limit.
        battery_low: f64 = 0.0,
        /// Critical battery voltage, V; 0 for no limit.
        battery_critical: f64 = 0.0,
        /// Largest distance from the reference, m.
        max_position_error: f64 = 0.3,
        /// Largest rotation from the reference, degrees.
        max_rotation_error_deg: f64 = 35.0,
        /// Largest tilt, degrees.
        max_tilt_deg: f64 = 60.0,
        /// Largest speed, m/s.
        max_speed: f64 = 3.0,
        /// Largest estimated force on the tool, N.
        max_force: f64 = 40.0,
        /// Largest estimated torque on the tool, N m.
        max_torque: f64 = 5.0,
        /// Longest time from the first start command until all motors spin, s.
        start_timeout: f64 = 30.0,
        /// The vehicle lands where it is farther than this from its start along x or y, m.
        geofence: f64 = 3.0,
        /// The vehicle lands where it is higher than this above its start, m.
        geofence_height: f64 = 3.0,
    }
}

section! {
    /// The log.
    pub LogSection as "log" {
        /// The MCAP file to write; empty for none. One that exists is replaced only with --overwrite.
        path: String = String::new(),
    }
}
