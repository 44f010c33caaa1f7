//! Faults of the vehicle, its wiring and its sensors, and pushes on it.

use tilthex_core::{
    Vector3, Wrench,
    plant::{SensorParams, Sensors},
};

use super::{
    Injection,
    acts::{Act, OnVehicle},
};

/// Nothing: the damage stays until the flight is over.
fn nothing(_: &Injection, _: &mut OnVehicle<'_>) {}

/// A change that is made once and stays.
const fn lasting(begin: fn(&Injection, &mut OnVehicle<'_>)) -> Act {
    Act::Vehicle { begin, during: nothing, end: nothing }
}

/// Sensors that are different while the fault is active.
const fn sensors(begin: fn(&Injection, &mut OnVehicle<'_>)) -> Act {
    Act::Vehicle { begin, during: nothing, end: own_sensors }
}

/// A wrench on the vehicle while the fault is active.
const fn pressing(during: fn(&Injection, &mut OnVehicle<'_>)) -> Act {
    Act::Vehicle { begin: nothing, during, end: released }
}

pub(super) const CAPTURE_NOISE: Act = sensors(|fault, on| {
    let k = fault.between(5.0, 100.0);
    sense(fault, on, |noise| SensorParams {
        position: k * noise.position,
        orientation: k.min(30.0) * noise.orientation,
        ..noise
    });
});

pub(super) const IMU_NOISE: Act = sensors(|fault, on| {
    let k = fault.between(3.0, 30.0);
    sense(fault, on, |noise| SensorParams {
        gyro: k * noise.gyro,
        accelerometer: k * noise.accelerometer,
        ..noise
    });
});

pub(super) const GYRO_BIAS: Act = sensors(|fault, on| {
    let step = 0.2 * fault.strength * fault.direction();
    sense(fault, on, |noise| SensorParams { gyro_bias_i: noise.gyro_bias_i + step, ..noise });
});

pub(super) const ACCELEROMETER_BIAS: Act = sensors(|fault, on| {
    let step = fault.strength * fault.direction();
    sense(fault, on, |noise| SensorParams {
        accelerometer_bias_i: noise.accelerometer_bias_i + step,
        ..noise
    });
});

pub(super) const IMU_SATURATED: Act = sensors(|fault, on| {
    let beyond = 40.0 * fault.direction();
    sense(fault, on, |noise| SensorParams { gyro_bias_i: beyond, ..noise });
});

pub(super) const ROTOR_THRUST: Act = lasting(|fault, on| {
    let rotor = rotor(fault, on);
    on.simulation.damage_rotor(rotor, 0.8 * fault.strength);
});

pub(super) const ROTOR_SLOW: Act = lasting(|fault, on| {
    let rotor = rotor(fault, on);
    on.simulation.weaken_rotor(rotor, 0.4 + 0.5 * fault.strength);
});

pub(super) const ROTOR_STUCK: Act = lasting(|fault, on| {
    let rotor = rotor(fault, on);
    on.simulation.weaken_rotor(rotor, 0.0);
});

pub(super) const MOTOR_EMERGENCY: Act = lasting(|fault, on| {
    let rotor = rotor(fault, on);
    on.simulation.firmware_mut().fail_motor(rotor as u8 + 1, on.out);
});

pub(super) const MOTORS_EXCHANGED: Act = lasting(|fault, on| {
    let (rotor, rotors) = (rotor(fault, on), on.simulation.vehicle().rotor_count());
    let other = (rotor + 1 + (fault.strength * (rotors - 1) as f64) as usize) % rotors;
    on.simulation.exchange_motors(rotor, other);
});

pub(super) const SPIN_REVERSED: Act = lasting(|fault, on| {
    let rotor = rotor(fault, on);
    on.simulation.reverse_spin(rotor);
});

pub(super) const BATTERY_EMPTY: Act = lasting(|fault, on| {
    let battery = on.simulation.firmware_mut().battery_mut();
    battery.charge = 0.05 * battery.capacity * fault.strength;
});

pub(super) const REBOOT: Act = lasting(|_, on| {
    let now = on.simulation.now();
    on.simulation.firmware_mut().reboot(now);
});

pub(super) const PUSH: Act = pressing(|fault, on| {
    let tool_w = Wrench { force: towards(fault) * fault.between(0.5, 15.0), torque: Vector3::zeros() };
    on.simulation.disturb(tool_w, Wrench::ZERO);
});

pub(super) const PUSH_ON_ARM: Act = pressing(|fault, on| {
    let arm_r = on.simulation.vehicle().rotors()[rotor(fault, on)].position_r;
    let force_w = towards(fault) * fault.between(0.5, 6.0);
    let rotation_wr = on.simulation.truth().robot.rotation_wr;
    let body = Wrench { force: force_w, torque: arm_r.cross(&(rotation_wr.transpose() * force_w)) };
    on.simulation.disturb(Wrench::ZERO, body);
});

pub(super) const GUSTS: Act = pressing(|fault, on| {
    // A random force about a mean, with a time constant of 1 s.
    let mean = fault.direction() * 0.7 * fault.between(0.5, 5.0);
    let now = on.simulation.disturbance().force;
    let force = now + (mean - now) * 0.002 + on.random.normal3(0.03 * mean.norm());
    on.simulation.disturb(Wrench::ZERO, Wrench { force, torque: Vector3::zeros() });
});

/// The rotor that a fault changes, from 0.
fn rotor(fault: &Injection, on: &OnVehicle<'_>) -> usize {
    fault.rotor(on.simulation.vehicle().rotor_count())
}

/// A unit vector in a direction that the fault chooses.
fn towards(fault: &Injection) -> Vector3 {
    let (turn, rise) = (2.4 * fault.index as f64, 2.0 * (7.3 * fault.strength).fract() - 1.0);
    let level = (1.0 - rise * rise).sqrt();
    Vector3::new(level * turn.cos(), level * turn.sin(), rise)
}

fn sense(fault: &Injection, on: &mut OnVehicle<'_>, change: impl Fn(SensorParams) -> SensorParams) {
    let own = *on.simulation.own_sensors();
    *on.simulation.sensors_mut() = Sensors::new(change(own), fault.index as u64);
}

fn own_sensors(_: &Injection, on: &mut OnVehicle<'_>) {
    let own = *on.simulation.own_sensors();
    *on.simulation.sensors_mut() = Sensors::new(own, 99);
}

fn released(_: &Injection, on: &mut OnVehicle<'_>) {
    on.simulation.disturb(Wrench::ZERO, Wrench::ZERO);
}
