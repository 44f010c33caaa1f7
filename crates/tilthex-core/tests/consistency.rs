//! Whether the estimator's errors are what its covariance says, over many closed-loop flights
//! of the simulated vehicle that steer by the estimate; and the table of errors in docs/estimator.md.
//!
//! 24 flights by default; `TILTHEX_FLIGHTS=200 cargo test --release -p tilthex-core
//! --test consistency -- --nocapture` prints the table of the documentation.
#![allow(clippy::unwrap_used, unreachable_pub, dead_code)]

mod common;
#[path = "common/flight.rs"]
mod flight;

use flight::Motion;
use nalgebra::SVector;
use tilthex_core::{
    Matrix3, Matrix6, PoseSample, RobotState, Setpoint, Vector3, Vector6, Vehicle, Wrench,
    admittance::{AdmittanceParams, Axes},
    allocation::AllocatorParams,
    attitude::AttitudeParams,
    controller::{Controller, ControllerInput, ControllerParams, ControllerState},
    estimator::{Estimator, EstimatorParams, Outcome},
    plant::{Plant, PlantState, SensorParams, Sensors},
    pose_control::PoseGains,
    random::Random,
    so3,
    ukf::{InitialDeviation, ProcessNoise},
    vehicle::Mounting,
    wrench_observer::ObserverGains,
};

const PERIOD: f64 = 0.002;
const DURATION: f64 = 8.0;
/// Errors count from here on, s.
const SETTLED: f64 = 2.0;

/// What happens to the poses on their way.
#[derive(Clone, Copy, Debug, Default)]
struct Trouble {
    latency: f64,
    loss: f64,
    /// Length of the gap that begins at 5 s.
    outage: f64,
    outliers: f64,
}

/// Sums over flights.
#[derive(Clone, Debug, Default)]
struct Tally {
    squares: Vector3,
    worst: Vector3,
    after_outage: Vector3,
    samples: f64,
    nees: Vec<f64>,
    nis: (f64, f64),
    rejected: u32,
}

fn vehicle() -> Vehicle {
    let v = common::tilt_hex();
    let imu = Mounting { position_r: Vector3::new(0.05, -0.02, 0.03), rotation_r: so3::rot_z(0.4) };
    Vehicle::new(v.mass(), *v.inertia(), v.rotors(), v.rotor_time_constant(), *v.tool(), imu).unwrap()
}

fn estimator_params(vehicle: &Vehicle, sensors: &SensorParams) -> EstimatorParams {
    EstimatorParams {
        process: ProcessNoise {
            gyro: sensors.gyro * PERIOD.sqrt(),
            accelerometer: sensors.accelerometer * PERIOD.sqrt(),
            gyro_bias: 1e-4,
            accelerometer_bias: 1e-3,
        },
        position_noise: sensors.position,
        rotation_noise: sensors.orientation,
        imu_position_r: vehicle.imu().position_r,
        imu_rotation_ri: vehicle.imu().rotation_r,
        initial: InitialDeviation {
            velocity: 0.05,
            gyro_bias: 0.01,
            accelerometer_bias: 0.05,
            ..InitialDeviation::default()
        },
        ..EstimatorParams::default()
    }
}

fn controller(vehicle: Vehicle) -> Controller {
    let stiff = |x: f64| Matrix6::from_diagonal(&Vector6::repeat(x));
    let params = ControllerParams {
        pose: PoseGains {
            position: Vector3::repeat(16.0),
            velocity: Vector3::repeat(8.0),
            rotation: Vector3::repeat(80.0),
            angular_velocity: Vector3::repeat(16.0),
        },
        observer: ObserverGains { force: Vector3::repeat(10.0), torque: Vector3::repeat(10.0) },
        admittance: AdmittanceParams {
            mass: stiff(1.0),
            damping: stiff(10.0),
            stiffness: stiff(10.0),
            max_translation: 1.0,
            max_rotation: 1.0,
            axes: Axes::World,
        },
        force_dead_zone: 5.0,
        torque_dead_zone: 5.0,
        low_pass_hz: 10.0,
        room_torque: 0.0,
        free_wrench: tilthex_core::free_wrench::FreeWrenchParams::default(),
        bounds: tilthex_core::reference_bounds::ReferenceBounds::default(),
        contact: tilthex_core::contact::ContactParams::default(),
        allocation: AllocatorParams::default(),
        attitude: AttitudeParams::default(),
    };
    Controller::new(vehicle, params).unwrap()
}

/// A slow tool motion: a fifth of the pace and a third of the angles of [`Motion`].
fn setpoint(motion: &Motion, vehicle: &Vehicle, t: f64) -> Setpoint {
    let state = motion.state(0.25 * t);
    let angle = so3::log(&state.rotation_wr) / 3.0;
    let rotation = so3::exp(&angle);
    let tool = vehicle.tool();
    Setpoint {
        velocity_w: 0.25 * state.velocity_w,
        ..Setpoint::hold(state.position_w + rotation * tool.position_r, rotation * tool.rotation_r)
    }
}

fn error(
    estimator: &Estimator,
    truth: &RobotState,
    gyro_bias: &Vector3,
    force_bias: &Vector3,
) -> SVector<f64, 15> {
    let state = estimator.robot_state();
    let mut e = SVector::<f64, 15>::zeros();
    e.fixed_rows_mut::<3>(0).copy_from(&(truth.position_w - state.position_w));
    e.fixed_rows_mut::<3>(3).copy_from(&(truth.velocity_w - state.velocity_w));
    e.fixed_rows_mut::<3>(6).copy_from(&so3::log(&(truth.rotation_wr * state.rotation_wr.transpose())));
    e.fixed_rows_mut::<3>(9).copy_from(&(gyro_bias - estimator.gyro_bias()));
    e.fixed_rows_mut::<3>(12).copy_from(&(force_bias - estimator.accelerometer_bias()));
    e
}

#[allow(clippy::too_many_lines)]
fn fly(seed: u64, trouble: &Trouble, tally: &mut Tally) {
    let mut random = Random::new(0x5EED_0000 + seed);
    let motion = Motion::new(&mut random);
    let vehicle = vehicle();
    let sensors = SensorParams::EXPERIMENTS;
    let params = estimator_params(&vehicle, &sensors);
    let (mut gyro_bias, mut force_bias) = (random.normal3(0.01), random.normal3(0.05));
    let plant = Plant::new(vehicle);
    let mut sensing = Sensors::new(sensors, random.bits());
    let controller = controller(vehicle);
    let mut memory = ControllerState::default();
    let begin = setpoint(&motion, &vehicle, 0.0);
    let rotation = begin.rotation_we * vehicle.tool().rotation_r.transpose();
    let mut state = PlantState::new(
        RobotState {
            position_w: begin.position_w - rotation * vehicle.tool().position_r,
            rotation_wr: rotation,
            velocity_w: random.normal3(0.05),
            angular_velocity_r: Vector3::zeros(),
        },
        vehicle.hover_speeds(&rotation),
    );
    let mut estimator = Estimator::new(params).unwrap();
    // The first pose errs as its covariance says, about the IMU's own position.
    let turn = so3::exp(&random.normal3(params.initial.rotation)) * rotation;
    let arm = vehicle.imu().position_r;
    let place =
        state.robot.position_w + rotation * arm + random.normal3(params.initial.position) - turn * arm;
    estimator.initialize(0.0, &place, &turn).unwrap();

    let mut waiting: Vec<PoseSample> = Vec::new();
    let steps = (DURATION / PERIOD) as usize;
    let (mut sum, mut count) = (0.0, 0.0);
    for k in 0..=steps {
        let t = k as f64 * PERIOD;
        gyro_bias += random.normal3(params.process.gyro_bias * PERIOD.sqrt());
        force_bias += random.normal3(params.process.accelerometer_bias * PERIOD.sqrt());
        let imu = sensing.imu(&plant.imu(&state, &Wrench::ZERO));
        estimator.predict(t, &(imu.gyro_i + gyro_bias), &(imu.specific_force_i + force_bias));
        if k % 5 == 0 && k > 0 {
            let (position, rotation) = sensing.pose(&state);
            let outlier = random.uniform() < trouble.outliers;
            let off = if outlier { random.normal3(0.3) } else { Vector3::zeros() };
            let turn = if outlier { so3::exp(&random.normal3(0.5)) } else { Matrix3::identity() };
            let lost = random.uniform() < trouble.loss || (5.0..5.0 + trouble.outage).contains(&t);
            if !lost {
                waiting.push(PoseSample {
                    time: t,
                    arrival: t + trouble.latency,
                    position_w: position + off,
                    rotation_wr: rotation * turn,
                    tracking_valid: true,
                });
            }
        }
        while waiting.first().is_some_and(|p| p.arrival <= t + 1e-9) {
            estimator.update_pose_observed(&waiting.remove(0), &mut |report| {
                if report.time > SETTLED && report.outcome == Outcome::Accepted {
                    (sum, count) = (sum + report.nis, count + 1.0);
                }
            });
        }
        let estimate = estimator.robot_state();
        let e = error(&estimator, &state.robot, &gyro_bias, &force_bias);
        if t > SETTLED {
            let norms = Vector3::from_fn(|i, _| e.fixed_rows::<3>(3 * i).norm());
            tally.squares += norms.component_mul(&norms);
            tally.worst = tally.worst.sup(&norms);
            tally.samples += 1.0;
            if (5.0 + trouble.outage - PERIOD - t).abs() < 0.5 * PERIOD {
                tally.after_outage += norms.component_mul(&norms);
            }
        }
        if k == steps {
            let covariance = estimator.covariance();
            tally.nees.push((e.transpose() * covariance.cholesky().unwrap().solve(&e))[0]);
        }
        let input = ControllerInput {
            state: estimate,
            specific_force_r: estimator.specific_force_r(),
            rotor_speeds: sensing.rotor_speeds(&plant, &state),
            setpoint: setpoint(&motion, &vehicle, t),
            compliant: false,
            unyielding: None,
            learn_bias: false,
            lost_rotors: 0,
            fixed_attitude: false,
        };
        let out = controller.step(&mut memory, &input, PERIOD);
        plant.step(&mut state, &out.rotor_speeds, &Wrench::ZERO, PERIOD);
    }
    tally.nis.0 += sum;
    tally.nis.1 += count;
    let counts = estimator.health().counts;
    tally.rejected += counts.rejected + counts.position_only;
}

fn flights() -> u64 {
    std::env::var("TILTHEX_FLIGHTS").ok().and_then(|n| n.parse().ok()).unwrap_or(24)
}

fn tally(trouble: &Trouble, flights: u64) -> Tally {
    let mut tally = Tally::default();
    for seed in 0..flights {
        fly(seed, trouble, &mut tally);
    }
    tally
}

impl Tally {
    fn rms(&self) -> Vector3 {
        (self.squares / self.samples).map(f64::sqrt)
    }

    fn mean_nees(&self) -> f64 {
        self.nees.iter().sum::<f64>() / self.nees.len() as f64
    }
}

/// Half width of the 95 % band of the mean of `count` chi-square numbers of `freedom` degrees.
fn band(freedom: f64, count: f64) -> f64 {
    1.96 * (2.0 * freedom / count).sqrt()
}

#[test]
fn errors_are_what_the_covariance_says() {
    let flights = flights();
    let late = Trouble { latency: 0.03, ..Trouble::default() };
    let outage = Trouble { outage: DURATION - 5.0, ..Trouble::default() };
    println!("flights: {flights}");
    for (name, trouble) in [("nominal", Trouble::default()), ("30 ms late", late), ("3 s outage", outage)] {
        let tally = tally(&trouble, flights);
        let (nees, nis) = (tally.mean_nees(), tally.nis.0 / tally.nis.1);
        let (nees_band, nis_band) = (band(15.0, flights as f64), band(6.0, tally.nis.1));
        println!(
            "{name}: NEES {nees:.2} (15 +- {nees_band:.2}), NIS {nis:.3} (6 +- {nis_band:.3}), rejected {}",
            tally.rejected
        );
        assert!((nees - 15.0).abs() < nees_band, "{name}: mean NEES {nees}, 15 +- {nees_band}");
        assert!((nis - 6.0).abs() < nis_band, "{name}: mean NIS {nis}, 6 +- {nis_band}");
    }
}

#[test]
fn errors_by_trouble() {
    // A quarter of the flights: five scenarios.
    let flights = flights().div_ceil(4);
    println!("flights a row: {flights}");
    println!(
        "| trouble | position rms (mm) | velocity rms (mm/s) | rotation rms (mrad) | worst position (mm) | worst rotation (mrad) |"
    );
    println!("|---|---|---|---|---|---|");
    let nominal = Trouble::default();
    let mut first = None;
    for (name, trouble, limit) in [
        ("none", nominal, 1.0),
        ("30 ms latency", Trouble { latency: 0.03, ..nominal }, 1.5),
        ("10 % loss", Trouble { loss: 0.1, ..nominal }, 1.2),
        ("0.5 s outage", Trouble { outage: 0.5, ..nominal }, 10.0),
        ("1 % outliers", Trouble { outliers: 0.01, ..nominal }, 1.1),
    ] {
        let tally = tally(&trouble, flights);
        let (rms, worst) = (1e3 * tally.rms(), 1e3 * tally.worst);
        println!("| {name} | {:.3} | {:.2} | {:.3} | {:.2} | {:.2} |", rms.x, rms.y, rms.z, worst.x, worst.z);
        let end = 1e3 * (tally.after_outage / flights as f64).map(f64::sqrt);
        if trouble.outage > 0.0 {
            println!("| at its end | {:.3} | {:.2} | {:.3} | | |", end.x, end.y, end.z);
        }
        let nominal = *first.get_or_insert(rms);
        assert!((rms.component_div(&nominal)).max() < limit + 1e-9, "{name}: {rms} against {nominal}");
    }
}
