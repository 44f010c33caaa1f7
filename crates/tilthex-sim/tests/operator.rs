//! What an operator does, and what a flight does without one, on virtual time.

use tilthex_config::{Config, VehicleSection};
use tilthex_core::{
    flight::{Command, HostFacts},
    supervisor::{Fault, Phase},
};
use tilthex_sim::{
    Simulation, SimulationParams,
    campaign::{self, World},
};

fn config() -> Config {
    Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset"))
}

fn hover() -> World {
    campaign::hover(&config()).expect("flies")
}

fn ticks(world: &mut World, seconds: f64) {
    for _ in 0..(seconds * 500.0) as usize {
        world.tick(None);
    }
}

/// Whether the bytes of the last tick stop all motors.
fn stops(world: &World) -> bool {
    world.sent().windows(3).any(|bytes| bytes == b"^x$")
}

#[test]
fn a_kill_is_on_the_wire_in_the_same_tick_in_every_phase() {
    let params = config().linked_params(true).expect("valid");
    let linked = tilthex_link::LinkedFlight::new(params, None).expect("valid");
    let mut world = World::new(Simulation::new(SimulationParams::new(params.flight.vehicle)), linked, 7);
    let mut seen = Vec::new();
    while world.now() < 30.0 {
        world.tick(None);
        let phase = world.record().phase;
        // In the middle of a phase, between two start commands as well.
        if phase != Phase::Disarmed && !world.linked.flight.supervisor().landed() {
            seen.push(phase);
            if seen.len().is_multiple_of(97) {
                let mut killed = world.clone();
                killed.host.kill = true;
                killed.tick(None);
                assert!(stops(&killed), "{phase:?}");
                assert_eq!(killed.record().phase, Phase::Disarmed);
                assert!(killed.linked.flight.supervisor().killed());
                ticks(&mut killed, 3.0);
                assert!(
                    killed.linked.flight.supervisor().killed() && !killed.simulation.firmware().all_spin()
                );
                // Nothing starts them again.
                killed.host = HostFacts::default();
                killed.tick(Some(&Command::TakeOff));
                ticks(&mut killed, 1.0);
                assert_eq!(killed.record().phase, Phase::Disarmed);
            }
        }
        world.host.land |= world.linked.flight.on_mission();
    }
    for phase in [Phase::Starting, Phase::Grounded, Phase::Flying, Phase::Landing] {
        assert!(seen.contains(&phase), "{phase:?}");
    }
}

#[test]
fn without_its_operator_a_flight_holds_then_lands() {
    let mut world = hover();
    world.host.operator_silent = true;
    ticks(&mut world, 1.0);
    assert_eq!(world.record().phase, Phase::Holding);
    world.host.operator_silent = false;
    ticks(&mut world, 1.0);
    assert_eq!(world.record().phase, Phase::Flying, "the operator is back");
    world.host.operator_silent = true;
    ticks(&mut world, 6.0);
    assert_eq!(world.record().phase, Phase::Landing);
    world.host.operator_silent = false;
    ticks(&mut world, 20.0);
    assert!(world.linked.finished() && world.simulation.stands());
    assert_eq!(world.linked.flight.supervisor().ended_by(), Some(Fault::OperatorGoneForGood));
}

#[test]
fn nobody_takes_off_without_the_operator_who_ordered_it() {
    let params = config().linked_params(false).expect("valid");
    let linked = tilthex_link::LinkedFlight::new(params, None).expect("valid");
    let mut world = World::new(Simulation::new(SimulationParams::new(params.flight.vehicle)), linked, 8);
    ticks(&mut world, 1.0);
    world.tick(Some(&Command::TakeOff));
    world.host.operator_silent = true;
    ticks(&mut world, 10.0);
    assert_eq!(world.record().phase, Phase::Disarmed);
    // The order does not wait for whoever speaks next.
    world.host.operator_silent = false;
    ticks(&mut world, 10.0);
    assert_eq!(world.record().phase, Phase::Disarmed);
}
