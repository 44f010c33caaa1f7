//! Measurements of rotors that are wrong, and rotors that stand still.

use tilthex_core::supervisor::{Fault, Phase};

use crate::world::World;

/// Five in a row pass every gate, and turned the vehicle over.
#[test]
fn wrong_speeds_in_a_row_do_not_move_the_vehicle() {
    for wrong in [1000.0, 110.0, 0.0, -110.0] {
        let mut world = World::hover();
        let before = world.simulation.truth().tool_position_w;
        for rotor in 0..6 {
            world.simulation.firmware_mut().misread(rotor, Some(wrong));
            world.run(0.01);
            world.simulation.firmware_mut().misread(rotor, None);
            for _ in 0..150 {
                world.tick();
                let moved = (world.simulation.truth().tool_position_w - before).norm();
                assert!(moved < 0.05, "{wrong} of rotor {rotor} moves the tool by {moved}");
            }
        }
        assert_eq!(world.phase(), Phase::Flying, "{wrong} {:?}", world.texts);
    }
}

#[test]
fn a_rotor_whose_speed_stays_wrong_makes_it_land() {
    let reachable = [110.0, 90.0, 35.0, -60.0].map(|wrong| (wrong, Fault::MotorWrongSpeed));
    let others = [(1000.0, Fault::MotorWrongSpeed), (0.0, Fault::MotorDataWrong)];
    for (wrong, fault) in others.into_iter().chain(reachable) {
        let mut world = World::hover();
        world.simulation.firmware_mut().misread(2, Some(wrong));
        world.until(3.0, |world| world.phase() == Phase::Landing);
        assert!(world.record().faults.contains(fault), "{wrong} {:?}", world.texts);
        world.landed();
    }
}

#[test]
fn a_rotor_that_stands_still_is_found() {
    let mut world = World::hover();
    world.simulation.weaken_rotor(2, 0.0);
    world.until(0.3, |world| world.record().faults.contains(Fault::MotorNotSpinning));
    assert!(!world.record().faults.contains(Fault::MotorDataWrong));
}
