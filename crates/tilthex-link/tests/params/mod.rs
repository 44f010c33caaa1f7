//! The link that the tests open.

use tilthex_link::{LinkParams, px4::ThrottleMap};

/// Samples at 500 Hz, motor data at 250 Hz, the battery once a second; the board tells its units itself.
pub(crate) fn params() -> LinkParams {
    LinkParams {
        imu_period_us: 2000,
        motor_period_us: 4000,
        battery_period_us: 1_000_000,
        scales: None,
        throttle: ThrottleMap::default(),
    }
}
