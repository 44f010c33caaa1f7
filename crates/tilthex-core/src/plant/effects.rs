//! The effects on a vehicle in addition to the nominal wrench of its rotors and its weight.

use super::{
    battery::Battery,
    body_drag::BodyDrag,
    rod::Rod,
    rotor_drag::RotorDrag,
    rotor_inertia,
    surface::Surface,
    wind::{Wind, WindState},
};
use crate::{
    Error,
    error::check_range,
    types::{RobotState, RotorVector, Vector3, Wrench},
    vehicle::Vehicle,
};

/// Parameters of all effects; in [`Effects::OFF`] all effects are off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effects {
    /// Density of the air, kg/m^3.
    pub air_density: f64,
    /// Wind and gusts.
    pub wind: Wind,
    /// Drag and flapping of the rotors.
    pub rotor_drag: RotorDrag,
    /// Drag of the airframe.
    pub body_drag: BodyDrag,
    /// Radius of the rotors, m. If it is above 0, [`Self::surfaces`] act on the rotors.
    pub rotor_radius: f64,
    /// Ground and wall.
    pub surfaces: [Option<Surface>; 2],
    /// Moment of inertia of a rotor with the turning part of its motor, kg m^2.
    pub rotor_inertia: f64,
    /// Voltage, V, at which a throttle gives the speed of the same name; 0 if commands are speeds.
    pub throttle_voltage: f64,
    /// The battery at the start.
    pub battery: Battery,
    /// The tool's rod.
    pub rod: Rod,
}

/// The state of the effects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectsState {
    /// The gusts.
    pub wind: WindState,
    /// The battery.
    pub battery: Battery,
    /// Acceleration of the rotors at the end of the last step, Hz/s; zero while no effect needs it.
    pub rotor_accelerations: RotorVector,
}

/// The motion of the rotors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotors {
    /// Speeds, Hz.
    pub speeds: RotorVector,
    /// Accelerations, Hz/s.
    pub accelerations: RotorVector,
}

impl EffectsState {
    /// The initial state of the effects; each seed gives other gusts.
    #[must_use]
    pub fn new(effects: &Effects, seed: u64) -> Self {
        Self {
            wind: WindState::new(seed),
            battery: effects.battery,
            rotor_accelerations: RotorVector::zeros(),
        }
    }
}

impl Default for EffectsState {
    fn default() -> Self {
        Self::new(&Effects::OFF, 0)
    }
}

impl Effects {
    /// No effect. The air is that of the standard atmosphere at sea level (ISO 2533).
    pub const OFF: Self = Self {
        air_density: 1.225,
        wind: Wind::CALM,
        rotor_drag: RotorDrag { drag: 0.0, flapping: 0.0 },
        body_drag: BodyDrag { area_r: Vector3::new(0.0, 0.0, 0.0), centre_r: Vector3::new(0.0, 0.0, 0.0) },
        rotor_radius: 0.0,
        surfaces: [None; 2],
        rotor_inertia: 0.0,
        throttle_voltage: 0.0,
        battery: Battery::FULL,
        rod: Rod { stiffness: 0.0, length: 0.2 },
    };

    /// Refuses impossible numbers.
    ///
    /// # Errors
    /// [`Error`], which names the first of them.
    pub fn check(&self) -> Result<(), Error> {
        self.wind.check()?;
        check_range("air_density", self.air_density, 0.0, 10.0)?;
        check_range("rotor_drag", self.rotor_drag.drag, 0.0, 1.0)?;
        check_range("flapping", self.rotor_drag.flapping, -1.0, 1.0)?;
        check_range("rotor_radius", self.rotor_radius, 0.0, 10.0)?;
        check_range("rotor_inertia", self.rotor_inertia, 0.0, 1.0)?;
        check_range("throttle_voltage", self.throttle_voltage, 0.0, 1000.0)?;
        check_range("tool_stiffness", self.rod.stiffness, 0.0, 1e9)?;
        check_range("tool_length", self.rod.length, 1e-3, 10.0)?;
        for (name, smallest, v) in [
            ("drag_area", 0.0, &self.body_drag.area_r),
            ("centre_of_pressure", -10.0, &self.body_drag.centre_r),
        ] {
            for x in v.iter() {
                check_range(name, *x, smallest, 10.0)?;
            }
        }
        if self.rotor_radius > 0.0 && self.surfaces.iter().any(Option::is_some) {
            check_range("air_density", self.air_density, 1e-3, 10.0)?;
        }
        for surface in self.surfaces.iter().flatten() {
            check_range("length of the surface's normal", surface.normal_w.norm(), 1.0 - 1e-6, 1.0 + 1e-6)?;
            check_range("distance of the surface", surface.offset, -1e4, 1e4)?;
        }
        Ok(())
    }

    /// Whether no effect changes the wrench on the airframe.
    #[must_use]
    pub fn are_off(&self) -> bool {
        self.rotor_drag == RotorDrag::default()
            && self.body_drag.area_r == Vector3::zeros()
            && (self.rotor_radius == 0.0 || self.surfaces.iter().all(Option::is_none))
            && self.rotor_inertia == 0.0
    }

    /// The wrench on the airframe, force and torque about the centre of mass in robot coordinates, in addition to the
    /// nominal wrench of the rotors; `wind_w` is the velocity of the air, m/s, world.
    #[must_use]
    pub fn wrench(&self, vehicle: &Vehicle, robot: &RobotState, rotors: &Rotors, wind_w: &Vector3) -> Wrench {
        if self.are_off() {
            return Wrench::ZERO;
        }
        let omega = robot.angular_velocity_r;
        let airspeed_r = robot.rotation_wr.transpose() * (robot.velocity_w - wind_w);
        let mut sum = self.body_drag.wrench(self.air_density, &airspeed_r);
        if self.rotor_inertia > 0.0 {
            let (w, a) = (&rotors.speeds, &rotors.accelerations);
            sum.torque += rotor_inertia::torque(vehicle, self.rotor_inertia, w, a, &omega);
        }
        for (rotor, speed) in vehicle.rotors().iter().zip(rotors.speeds.iter()) {
            let mut through_r = airspeed_r + omega.cross(&rotor.position_r);
            let mut part = 0.0;
            if self.rotor_radius > 0.0 {
                for surface in self.surfaces.iter().flatten() {
                    let influence =
                        surface.influence(robot, rotor, self.rotor_radius, *speed, self.air_density);
                    part += influence.part;
                    through_r -= influence.wind_r;
                }
            }
            let (drag, torque) = self.rotor_drag.hub(rotor, *speed, &through_r);
            let thrust = rotor.thrust_coefficient * speed * libm::fabs(*speed);
            let force = drag + thrust * (1.0 / (1.0 - part) - 1.0) * rotor.axis_r;
            sum.force += force;
            sum.torque += torque + rotor.position_r.cross(&force);
        }
        sum
    }

    /// The speeds, Hz, to which the motors drive their rotors under a command.
    #[must_use]
    pub fn reached(&self, state: &EffectsState, command: &RotorVector) -> RotorVector {
        if self.throttle_voltage == 0.0 {
            return *command;
        }
        command * state.battery.speed_part(self.throttle_voltage)
    }

    /// Lets `dt` seconds pass, at the end of which robot and rotors have this state.
    pub fn step(&self, state: &mut EffectsState, robot: &RobotState, rotors: &Rotors, dt: f64) {
        self.wind.step(&mut state.wind, &robot.velocity_w, dt);
        if self.throttle_voltage > 0.0 {
            state.battery.advance(rotors.speeds.as_slice(), dt);
        }
        state.rotor_accelerations = rotors.accelerations;
    }
}
