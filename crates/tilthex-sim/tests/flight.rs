//! The whole tick against the simulated vehicle, on virtual time, through the codecs.

#![allow(clippy::unwrap_used)]

use std::path::Path;
use tilthex_config::Config;
use tilthex_core::{
    PoseSample,
    flight::{HostFacts, Record},
    supervisor::{Fault, Phase},
};
use tilthex_link::{LinkedFlight, LinkedOutput, MAX_BYTES_IN, WireInput};
use tilthex_sim::{Push, Pushes, Simulation, SimulationParams};

/// A host and a vehicle on virtual time.
struct World {
    simulation: Simulation,
    linked: LinkedFlight,
    out: LinkedOutput,
    to_host: Vec<u8>,
    poses: Vec<PoseSample>,
    capture: bool,
    host: HostFacts,
    ticks: u64,
    verbose: bool,
}

impl World {
    fn new(pushes: Vec<Push>) -> Self {
        let config = Config::from_text("vehicle.preset = \"tilt-hex\"", Path::new("")).unwrap();
        let params = config.linked_params(true).unwrap();
        let mut simulated = SimulationParams::new(params.flight.vehicle);
        simulated.pushes = Pushes::new(pushes);
        Self {
            simulation: Simulation::new(simulated),
            linked: LinkedFlight::new(params, None).unwrap(),
            out: LinkedOutput::default(),
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
        let n = self.to_host.len().min(MAX_BYTES_IN);
        let input =
            WireInput { time, bytes: &self.to_host[..n], poses: &self.poses, command: None, host: self.host };
        let before = self.linked.flight.supervisor().phase();
        self.linked.tick(&input, &mut self.out);
        self.to_host.drain(..n);
        self.poses.clear();
        let mut answer = Vec::new();
        self.simulation.receive(self.out.wire.sent.bytes(), &mut answer);
        self.to_host.extend(answer);
        let record = self.out.commanded.record;
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
                self.linked.flight.start_refused().map(|e| e.to_string()).unwrap_or_default()
            );
        }
        record
    }

    fn until(&mut self, seconds: f64, mut done: impl FnMut(&LinkedFlight) -> bool) -> bool {
        for _ in 0..(seconds * 500.0) as usize {
            self.tick();
            if done(&self.linked) {
                return true;
            }
        }
        false
    }

    fn fly(&mut self) {
        assert!(self.until(30.0, |f| f.flight.on_mission()), "{:?}", self.linked.flight.supervisor());
    }

    fn land(&mut self) {
        self.host.land = true;
        assert!(self.until(20.0, LinkedFlight::finished), "{:?}", self.linked.flight.supervisor());
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
    assert_eq!(
        world.linked.flight.supervisor().phase(),
        Phase::Flying,
        "{:?}",
        world.linked.flight.supervisor()
    );
    world.land();
    assert_eq!(world.linked.flight.supervisor().ended_by(), Some(Fault::Operator));
}

#[test]
fn it_holds_lands_and_descends_as_the_pose_stays_away() {
    let mut world = World::new(vec![]);
    world.fly();
    world.capture = false;
    assert!(world.until(0.2, |f| f.flight.supervisor().phase() == Phase::Holding));
    world.capture = true;
    assert!(world.until(1.0, |f| f.flight.supervisor().phase() == Phase::Flying));
    world.capture = false;
    assert!(world.until(1.0, |f| f.flight.supervisor().phase() == Phase::Landing));
    assert!(world.until(3.0, |f| f.flight.supervisor().phase() == Phase::Emergency));
    assert!(world.until(20.0, LinkedFlight::finished), "{:?}", world.linked.flight.supervisor());
    assert!(world.simulation.stands());
}

/// While the host hangs the line keeps the bytes; of the samples in them none is lost afterwards.
#[test]
fn samples_that_wait_for_a_host_that_hangs_are_all_used() {
    let mut world = World::new(Vec::new());
    world.fly();
    let before = world.linked.flight.estimator().health().counts;
    for _ in 0..70 {
        world.simulation.advance(&mut world.to_host);
    }
    assert!(world.to_host.len() < MAX_BYTES_IN, "one tick takes all, {} bytes", world.to_host.len());
    for _ in 0..100 {
        world.tick();
        let counts = world.linked.flight.estimator().health().counts;
        assert_eq!((counts.imu_gaps, counts.imu_rejected), (before.imu_gaps, before.imu_rejected));
    }
    world.land();
}
