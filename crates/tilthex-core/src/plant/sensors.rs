//! The sensors of the simulated vehicle: noise, biases, errors of scale and axes, vibration, age.

use super::{
    Plant, PlantState,
    age::{self, Past},
    vibration::Angles,
};
use crate::{
    Error,
    error::check_range,
    random::Random,
    so3,
    types::{Matrix3, RotorVector, Vector3},
};

/// Standard deviations of the sensors' noise, and the sensors' constant errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorParams {
    /// Noise of the captured position, m.
    pub position: f64,
    /// Noise of the captured orientation, rad.
    pub orientation: f64,
    /// Noise of a gyroscope sample, rad/s.
    pub gyro: f64,
    /// Noise of an accelerometer sample, m/s^2.
    pub accelerometer: f64,
    /// Noise of a rotor speed, Hz.
    pub rotor_speed: f64,
    /// Constant gyroscope bias, rad/s, IMU axes.
    pub gyro_bias_i: Vector3,
    /// Constant accelerometer bias, m/s^2, IMU axes.
    pub accelerometer_bias_i: Vector3,
    /// Relative error of the gyroscope's scale for each IMU axis.
    pub gyro_scale_i: Vector3,
    /// Small rotation of the gyroscope's axes relative to the IMU's, rad.
    pub gyro_misalignment_i: Vector3,
    /// Acceleration of the IMU by the imbalance of one rotor at 100 Hz, m/s^2. It grows with the square of the speed.
    pub vibration: f64,
    /// The point whose pose motion capture gives, from the centre of mass, m, robot coordinates.
    pub captured_r: Vector3,
    /// Age of the measured rotor speeds, s.
    pub rotor_speed_age: f64,
}

impl SensorParams {
    /// No noise and no bias.
    pub const IDEAL: Self = Self {
        position: 0.0,
        orientation: 0.0,
        gyro: 0.0,
        accelerometer: 0.0,
        rotor_speed: 0.0,
        gyro_bias_i: Vector3::new(0.0, 0.0, 0.0),
        accelerometer_bias_i: Vector3::new(0.0, 0.0, 0.0),
        gyro_scale_i: Vector3::new(0.0, 0.0, 0.0),
        gyro_misalignment_i: Vector3::new(0.0, 0.0, 0.0),
        vibration: 0.0,
        captured_r: Vector3::new(0.0, 0.0, 0.0),
        rotor_speed_age: 0.0,
    };

    /// The noise of the experiments.
    pub const EXPERIMENTS: Self = Self {
        position: 0.3e-3,
        orientation: 2e-3,
        gyro: 5e-3,
        accelerometer: 0.15,
        rotor_speed: 0.1,
        ..Self::IDEAL
    };

    /// Refuses impossible numbers.
    ///
    /// # Errors
    /// [`Error`], which names the first of them.
    pub fn check(&self) -> Result<(), Error> {
        check_range("position noise", self.position, 0.0, 1.0)?;
        check_range("orientation noise", self.orientation, 0.0, 1.0)?;
        check_range("gyro noise", self.gyro, 0.0, 10.0)?;
        check_range("accelerometer noise", self.accelerometer, 0.0, 100.0)?;
        check_range("rotor_speed noise", self.rotor_speed, 0.0, 100.0)?;
        check_range("vibration", self.vibration, 0.0, 1000.0)?;
        check_range("rotor_speed_age", self.rotor_speed_age, 0.0, age::LARGEST)?;
        for (name, largest, v) in [
            ("gyro_bias", 10.0, &self.gyro_bias_i),
            ("accelerometer_bias", 100.0, &self.accelerometer_bias_i),
            ("gyro_scale", 0.5, &self.gyro_scale_i),
            ("gyro_misalignment", 0.5, &self.gyro_misalignment_i),
            ("captured", 10.0, &self.captured_r),
        ] {
            for x in v.iter() {
                check_range(name, *x, -largest, largest)?;
            }
        }
        Ok(())
    }
}

/// An inertial sample, IMU axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Angular velocity, rad/s.
    pub gyro_i: Vector3,
    /// Specific force, m/s^2.
    pub specific_force_i: Vector3,
}

/// The sensors; each seed gives other noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensors {
    params: SensorParams,
    random: Random,
    angles: Angles,
    past: Past,
    vibration_i: Vector3,
}

impl Sensors {
    /// Sensors; the same seed gives the same noise, if the same deviations are 0.
    #[must_use]
    pub fn new(params: SensorParams, seed: u64) -> Self {
        Self {
            params,
            random: Random::new(seed),
            angles: Angles::default(),
            past: Past::default(),
            vibration_i: Vector3::zeros(),
        }
    }

    /// Lets `dt` seconds pass, at the end of which the plant has this state: rotors turn, and past speeds are kept.
    /// Needed only for vibration and for an age of the rotor speeds.
    pub fn pass(&mut self, plant: &Plant, state: &PlantState, dt: f64) {
        if self.params.vibration != 0.0 {
            self.angles.step(&state.rotor_speeds, dt);
            let (vehicle, at_100_hz) = (plant.vehicle(), self.params.vibration);
            self.vibration_i = vehicle.imu().rotation_r.transpose()
                * self.angles.acceleration(vehicle, &state.rotor_speeds, at_100_hz);
        }
        if self.params.rotor_speed_age != 0.0 {
            self.past.push(&state.rotor_speeds, dt);
        }
    }

    /// The values of the IMU if a perfect IMU has the values `truth`. The gyroscope gives `(1 + scale) (w -
    /// misalignment x w) + bias + noise` in each axis.
    pub fn imu(&mut self, truth: &ImuSample) -> ImuSample {
        let p = &self.params;
        let turned = truth.gyro_i - p.gyro_misalignment_i.cross(&truth.gyro_i);
        let scaled = turned + p.gyro_scale_i.component_mul(&turned);
        ImuSample {
            gyro_i: scaled + p.gyro_bias_i + self.random.normal3(p.gyro),
            specific_force_i: truth.specific_force_i
                + self.vibration_i
                + p.accelerometer_bias_i
                + self.random.normal3(p.accelerometer),
        }
    }

    /// The captured pose: position (m, W) of the captured point, rotation (R to W).
    pub fn pose(&mut self, state: &PlantState) -> (Vector3, Matrix3) {
        let turn = self.random.normal3(self.params.orientation);
        (
            state.robot.position_w
                + state.robot.rotation_wr * self.params.captured_r
                + self.random.normal3(self.params.position),
            state.robot.rotation_wr * so3::exp(&turn),
        )
    }

    /// Measured rotor speeds, Hz.
    pub fn rotor_speeds(&mut self, plant: &Plant, state: &PlantState) -> RotorVector {
        let age = self.params.rotor_speed_age;
        let past = if age == 0.0 { None } else { self.past.at(age) };
        let mut measured = past.unwrap_or(state.rotor_speeds);
        for i in 0..plant.vehicle().rotor_count() {
            measured[i] += self.random.noise(self.params.rotor_speed);
        }
        measured
    }
}
