//! A whole flight over the toy link.

#![allow(clippy::unwrap_used)]

use std::path::Path;
use tilthex_config::Config;
use tilthex_core::{
    PoseSample,
    flight::{HostFacts, Record},
    supervisor::{Fault, Phase},
};
use tilthex_link::{
    LinkedFlight, LinkedOutput, MAX_BYTES_IN, WireInput,
    ascii::board::{Plain, STOP},
    board::BoardParams,
};
use tilthex_sim::{Own, Push, Pushes, Simulation, SimulationParams};

struct World {
    simulation: Simulation<Own, Plain>,
    linked: LinkedFlight,
    out: LinkedOutput,
    to_host: Vec<u8>,
    host: HostFacts,
    ticks: u64,
    cut: bool,
}

impl World {
    fn new(pushes: Vec<Push>) -> Self {
        let text = "vehicle.preset = \"tilt-hex\"\n[link]\nprotocol = \"ascii\"\nbaud = 0\n";
        let params = Config::from_text(text, Path::new("")).unwrap().linked_params(true).unwrap();
        let mut simulated = SimulationParams::new(params.flight.vehicle);
        simulated.pushes = Pushes::new(pushes);
        let board = BoardParams { battery: simulated.firmware.battery, link: params.link };
        let board = Plain::new(&params.flight.vehicle, board);
        Self {
            simulation: Simulation::with_board(simulated, board),
            linked: LinkedFlight::new(params, None).unwrap(),
            out: LinkedOutput::default(),
            to_host: Vec::new(),
            host: HostFacts::default(),
            ticks: 0,
            cut: false,
        }
    }

    fn tick(&mut self) -> Record {
        for _ in 0..2 {
            self.simulation.advance(&mut self.to_host);
        }
        if self.cut {
            self.to_host.clear();
        }
        self.ticks += 1;
        let time = 100.0 + self.simulation.now() as f64 * 1e-6;
        let (position_w, rotation_wr) = self.simulation.captured_pose();
        let pose = PoseSample { time, arrival: time, position_w, rotation_wr, tracking_valid: true };
        let poses = if self.ticks.is_multiple_of(5) { &[pose][..] } else { &[] };
        let count = self.to_host.len().min(MAX_BYTES_IN);
        let bytes = &self.to_host[..count];
        self.linked.tick(&WireInput { time, bytes, poses, command: None, host: self.host }, &mut self.out);
        self.to_host.drain(..count);
        if !self.cut {
            self.simulation.receive(self.out.wire.sent.bytes(), &mut self.to_host);
        }
        self.out.commanded.record
    }

    fn run(&mut self, seconds: f64, mut each: impl FnMut(&Self) -> bool) -> bool {
        (0..(500.0 * seconds) as u64).any(|_| {
            self.tick();
            each(self)
        })
    }

    fn flies(&mut self) {
        let flies = self.run(40.0, |world| world.linked.flight.on_mission());
        assert!(flies, "{:?}", self.linked.flight.supervisor());
    }
}

#[test]
fn it_takes_off_yields_and_lands() {
    // A push of 1.2 N against a stiffness of 6 N/m.
    let push = Push { at: 12.0, duration: 9.0, force: [1.2, 0.0, 0.0], torque: [0.0; 3] };
    let mut world = World::new(vec![push]);
    world.flies();
    let start = world.simulation.truth().tool_position_w;
    world.run(11.5, |_| false);
    let deflection = world.simulation.truth().tool_position_w.x - start.x;
    assert!((deflection - 0.17).abs() < 0.02, "{deflection}");
    assert_eq!(world.linked.flight.supervisor().phase(), Phase::Flying);
    world.host.land = true;
    assert!(world.run(30.0, |world| world.linked.finished()), "{:?}", world.linked.flight.supervisor());
    assert_eq!(world.linked.flight.supervisor().ended_by(), Some(Fault::Operator));
    assert!(world.simulation.stands());
}

#[test]
fn a_line_that_is_gone_stops_the_motors() {
    let mut world = World::new(vec![]);
    world.flies();
    world.cut = true;
    let stands =
        |world: &World| tilthex_link::board::Board::commands(world.simulation.firmware()).amax() == 0.0;
    assert!(!world.run(0.9e-6 * STOP as f64, stands));
    assert!(world.run(0.2, stands));
    assert!(world.linked.flight.supervisor().active().contains(Fault::LinkLost));
}
