//! The sections of what surrounds the controller. Their owners read the fields.

use super::section::section;

section! {
    /// The state estimator, an unscented Kalman filter on SO(3) x R^12.
    pub EstimatorSection as "estimator" {
        /// Standard deviation of a captured position, m an axis.
        position_noise: f64 = 0.3e-3,
        /// Standard deviation of a captured orientation, degrees an axis.
        rotation_noise_deg: f64 = 0.12,
    }
}

section! {
    /// The serial link to the vehicle.
    pub LinkSection as "link" {
        /// 57600, 115200, 500000, 2000000, or 0 to leave the speed alone (native USB, pseudo-terminals).
        baud: u32 = 500_000,
    }
}

section! {
    /// Motion capture.
    pub MocapSection as "mocap" {
        /// Where poses come from: "natnet://HOST" or "vrpn://BODY@HOST"; empty for none.
        uri: String = String::new(),
    }
}

section! {
    /// What ends a flight.
    pub SupervisorSection as "supervisor" {
        /// Lowest battery voltage to start and to fly with, V; 0 for no limit.
        min_battery: f64 = 0.0,
    }
}

section! {
    /// The log.
    pub LogSection as "log" {
        /// The MCAP file to write; empty for none.
        path: String = String::new(),
    }
}
