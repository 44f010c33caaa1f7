//! The control system of a flying end-effector: a fully actuated multirotor
//! that commands its full 6-D pose and the full 6-D wrench of its tool.
//!
//! `no_std`, no allocation, no unsafe. Each block has one module, with the name of Ryll et al., "6D interaction
//! control with aerial robots: the flying end-effector paradigm", IJRR 38(9), 2019 ("the paper"; its equation numbers
//! are cited as "(n)"), in the order of its figure 5.
//!
//! # Conventions
//! SI units; rotor speeds in Hz, rotor inputs `u = w |w|` in Hz^2. Frames are
//! suffixes: `_w` world (z up), `_r` robot (origin in the centre of mass),
//! `_e` tool, `_i` IMU. `rotation_wr` maps robot coordinates to world
//! coordinates. External wrenches are exerted by the environment on the robot.
//!
//! A block is `Params` (validated once) + `State` (what changes in flight) + `step(&self, &mut State, input, dt) ->
//! Output`.
#![no_std]
#![forbid(unsafe_code)]

pub mod admittance;
pub mod allocation;
pub mod attitude;
pub mod bias;
pub mod clock_sync;
pub mod contact;
pub mod controller;
pub mod error;
pub mod estimator;
pub mod examples;
pub mod filters;
pub mod flight;
pub mod force_axes;
pub mod free_wrench;
pub mod model_learning;
pub mod order_bounds;
pub mod plant;
pub mod pose_control;
pub mod random;
pub mod reach;
pub mod reference_bounds;
mod ring;
pub mod rotor_room;
pub mod so3;
pub mod supervisor;
pub mod trajectory;
pub mod types;
pub mod ukf;
pub mod vehicle;
pub mod wrench_observer;

#[cfg(test)]
extern crate std;

pub use error::Error;
pub use types::{
    MAX_ROTORS, Matrix3, Matrix6, PoseSample, Reference, RobotState, RotorVector, Setpoint, Vector3, Vector6,
    Wrench,
};
pub use vehicle::{Rotor, Vehicle};

/// Gravitational acceleration, m/s^2 (the paper's table 1).
pub const GRAVITY: f64 = 9.81;
