//! The whole tick against the simulated vehicle, on virtual time, through the codecs.

#![allow(clippy::unwrap_used)]

use tilthex_core::{
    Matrix3, Matrix6, PoseSample, Vector3, Vector6, Vehicle,
    admittance::AdmittanceParams,
    allocation::AllocatorParams,
    controller::ControllerParams,
    estimator::EstimatorParams,
    flight::{
        Flight, FlightParams, GuidanceParams, HostFacts, Record, SessionParams, TickInput, TickOutput,
        WatchParams,
    },
    pose_control::PoseGains,
    supervisor::{Fault, Phase},
    trajectory::Limits,
    vehicle::{Mounting, TiltedHexarotor},
    wrench_observer::ObserverGains,
};
use tilthex_rt::sim::{Push, Pushes, Simulation, SimulationParams};

fn vehicle() -> Vehicle {
    let rotors = TiltedHexarotor {
        arm: 0.39,
        rotor_offset: Vector3::zeros(),
        alpha: 35_f64.to_radians(),
        beta: 10_f64.to_radians(),
        thrust_coefficient: 11.4e-4,
        drag_coefficient: 2.4e-5,
        min_speed: 16.0,
        max_speed: 110.0,
    };
    let inertia = Matrix3::from_diagonal(&Vector3::new(11.5e-3, 11.4e-3, 19.4e-3));
    let tool = Mounting { position_r: Vector3::new(0.12, 0.0, -0.4), ..Mounting::default() };
    Vehicle::new(2.4, inertia, &rotors.rotors(), 0.03, tool, Mounting::default()).unwrap()
}

fn params() -> FlightParams {
    let m = |t: f64, r: [f64; 3]| Matrix6::from_diagonal(&Vector6::new(t, t, t, r[0], r[1], r[2]));
    FlightParams {
        vehicle: vehicle(),
        controller: ControllerParams {
            pose: PoseGains {
                position: Vector3::repeat(36.0),
                velocity: Vector3::repeat(12.0),
                rotation: Vector3::repeat(150.0),
                angular_velocity: Vector3::repeat(22.0),
            },
            observer: ObserverGains { force: Vector3::repeat(20.0), torque: Vector3::repeat(20.0) },
            admittance: AdmittanceParams {
                mass: m(1.5, [0.01, 0.01, 0.02]),
                damping: m(10.0, [4.0; 3]),
                stiffness: m(6.0, [10.0, 10.0, 5.0]),
                max_translation: 1.0,
                max_rotation: 1.0,
            },
            force_dead_zone: 0.2,
            torque_dead_zone: 0.2,
            low_pass_hz: 10.0,
            allocation: AllocatorParams::default(),
        },
        estimator: EstimatorParams::default(),
        session: SessionParams {
            imu_period_us: 2000,
            motor_period_us: 4000,
            battery_period_us: 1_000_000,
            scales: None,
        },
        guidance: GuidanceParams {
            take_off_height: 0.6,
            bias_time: 2.0,
            limits: Limits {
                velocity: 0.4,
                acceleration: 0.8,
                angular_velocity: 0.5,
                angular_acceleration: 1.0,
            },
            landing_speed: 0.25,
            max_setpoint_jump: 0.05,
        },
        watch: WatchParams {
            battery_low: 0.0,
            battery_critical: 0.0,
            max_position_error: 0.4,
            max_rotation_error: 0.6,
            max_tilt: 1.0,
            max_speed: 3.0,
            max_force: 20.0,
            max_torque: 5.0,
            start_timeout: 30.0,
        },
        take_off: true,
    }
}

/// A host and a vehicle on virtual time.
struct World {
    simulation: Simulation,
    flight: Flight,
    out: TickOutput,
    to_host: Vec<u8>,
    poses: Vec<PoseSample>,
    capture: bool,
    host: HostFacts,
    ticks: u64,
    verbose: bool,
}

impl World {
    fn new(pushes: Vec<Push>) -> Self {
        let mut params_sim = SimulationParams::new(vehicle());
        params_sim.pushes = Pushes::new(pushes);
        Self {
            simulation: Simulation::new(params_sim),
            flight: Flight::new(params(), None).unwrap(),
            out: TickOutput::default(),
            to_host: Vec::new(),
            poses: Vec::new(),
            capture: true,
            host: HostFacts::default(),
            ticks: 0,
            verbose: std::env::var_os("VERBOSE").is_some(),
        }
    }

    fn tick(&mut self) -> Record {
        for _ in 0..2 {
            self.simulation.advance(&mut self.to_host);
        }
        self.ticks += 1;
        let time = 100.0 + self.simulation.now() as f64 * 1e-6;
        if self.ticks.is_multiple_of(5) && self.capture {
            let (position_w, rotation_wr) = self.simulation.captured_pose();
            let sample = PoseSample { time, arrival: time, position_w, rotation_wr, tracking_valid: true };
            self.poses.push(sample);
        }
        let n = self.to_host.len().min(512);
        let input =
            TickInput { time, bytes: &self.to_host[..n], poses: &self.poses, command: None, host: self.host };
        let before = self.flight.supervisor().phase();
        self.flight.tick(&input, &mut self.out);
        self.to_host.drain(..n);
        self.poses.clear();
        let mut answer = Vec::new();
        self.simulation.receive(self.out.bytes(), &mut answer);
        self.to_host.extend(answer);
        let record = self.out.record;
        if self.verbose && (record.phase != before || self.ticks.is_multiple_of(500)) {
            let names: Vec<_> = record.faults.rows().map(|r| r.name).collect();
            let truth = self.simulation.truth();
            println!(
                "{:6.2} {:10} z {:.3} ref {:.3} e {:.4} f {:+.2?} tool {:+.2?} {:?} {}",
                time - 100.0,
                record.phase.name(),
                truth.robot.position_w.z,
                record.reference.position_w.z,
                record.position_error_w.norm(),
                record.wrench_robot.force.as_slice(),
                record.wrench_tool_w.force.as_slice(),
                names,
                self.flight.start_refused().map(|e| e.to_string()).unwrap_or_default()
            );
        }
        record
    }

    fn until(&mut self, seconds: f64, mut done: impl FnMut(&Flight) -> bool) -> bool {
        for _ in 0..(seconds * 500.0) as usize {
            self.tick();
            if done(&self.flight) {
                return true;
            }
        }
        false
    }

    fn fly(&mut self) {
        assert!(self.until(30.0, |f| f.on_mission()), "{:?}", self.flight.supervisor());
    }

    fn land(&mut self) {
        self.host.land = true;
        assert!(self.until(20.0, Flight::finished), "{:?}", self.flight.supervisor());
        assert!(self.simulation.stands());
    }
}

#[test]
fn it_takes_off_hovers_yields_and_lands() {
    let push = Push { at: 12.0, duration: 9.0, force: [1.4, 0.0, 0.0], torque: [0.0; 3] };
    let mut world = World::new(vec![push]);
    world.fly();
    let start = world.simulation.truth().tool_position_w;
    world.until(11.5, |_| false);
    let pushed = world.simulation.truth().tool_position_w;
    let deflection = pushed.x - start.x;
    assert!((deflection - 0.2).abs() < 0.01, "{deflection}");
    assert_eq!(world.flight.supervisor().phase(), Phase::Flying, "{:?}", world.flight.supervisor());
    world.land();
    assert_eq!(world.flight.supervisor().ended_by(), Some(Fault::Operator));
}

#[test]
fn it_holds_lands_and_descends_as_the_pose_stays_away() {
    let mut world = World::new(vec![]);
    world.fly();
    world.capture = false;
    assert!(world.until(0.2, |f| f.supervisor().phase() == Phase::Holding));
    world.capture = true;
    assert!(world.until(1.0, |f| f.supervisor().phase() == Phase::Flying));
    world.capture = false;
    assert!(world.until(1.0, |f| f.supervisor().phase() == Phase::Landing));
    assert!(world.until(3.0, |f| f.supervisor().phase() == Phase::Emergency));
    assert!(world.until(20.0, Flight::finished), "{:?}", world.flight.supervisor());
    assert!(world.simulation.stands());
}
