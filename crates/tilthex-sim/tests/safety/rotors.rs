//! Rotors count as lost by evidence: a touch on an arm is a push, and telemetry that fails is telemetry.

use crate::world::World;
use tilthex_core::{
    Vector3,
    random::Random,
    supervisor::{Fault, Phase},
};

#[test]
fn a_touch_on_an_arm_is_no_lost_rotor() {
    for (preset, seed) in [("hexarotor", 90), ("tilt-hex", 91)] {
        let mut world = World::preset(preset, "exact", seed);
        world.fly();
        let mut random = Random::new(seed);
        let arms: Vec<Vector3> = world.simulation.vehicle().rotors().iter().map(|r| r.position_r).collect();
        for (k, arm) in arms.iter().cycle().take(24).enumerate() {
            // Without lateral force of its own, what pushes aside at an arm's end turns the vehicle.
            let aside = if preset == "tilt-hex" { random.normal3(1.0) } else { Vector3::zeros() };
            let size = if preset == "tilt-hex" {
                1.2 + 4.8 * random.uniform()
            } else {
                2.5 + 2.5 * random.uniform()
            };
            let force = (Vector3::new(0.0, 0.0, -1.0) + aside).normalize() * size;
            if world.phase() != Phase::Flying {
                // Another limit of the last push made it land.
                world = World::preset(preset, "exact", seed);
                world.fly();
            }
            world.push(force, arm * (0.95 + 0.1 * random.uniform()));
            world.run(1.0);
            world.push(Vector3::zeros(), *arm);
            world.run(1.5);
            assert!(!world.saw(Fault::ThrustLost) && !world.saw(Fault::RotorLost), "{preset} {k}: {force:?}");
            if preset == "hexarotor" {
                let seen = world.linked.flight.supervisor().seen();
                assert!(matches!(world.phase(), Phase::Flying | Phase::Holding), "{k} {seen:?}");
            }
        }
    }
}

#[test]
fn telemetry_that_drops_to_zero_is_no_lost_rotor() {
    for motor in 0..6 {
        let mut world = World::preset("tilt-hex", "measured", 95);
        world.fly();
        world.cruelty.borrow_mut().silent = Some(motor);
        assert!(world.ends(30.0));
        assert_eq!(world.ended_by(), Some(Fault::MotorDataWrong), "{motor}");
        assert!(!world.saw(Fault::MotorNotSpinning) && !world.saw(Fault::RotorLost));
        assert!(world.simulation.stands() && world.farthest < 0.2);
    }
}
