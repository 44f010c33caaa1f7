//! The link to the vehicle: the codec of its serial protocol, and what stands
//! between a decoded frame and the estimator.

pub mod tk3;
