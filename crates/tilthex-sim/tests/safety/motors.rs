//! Each motor alone, before all of them start.

use crate::world::World;
use tilthex_core::{
    flight::{Command, MotorFault},
    supervisor::{Fault, Phase},
};

/// Exchanges two starts on the line, or takes one away: motors as their controllers number them, from 1.
fn wired(world: &mut World, one: u8, other: Option<u8>) {
    let start = |motor: u8| [0x5e, b'g', motor, 0x24];
    world.wires = Box::new(move |bytes| {
        let mut bytes = bytes.to_vec();
        for at in 0..bytes.len().saturating_sub(3) {
            let frame = &mut bytes[at..at + 4];
            if *frame == start(one) {
                frame.copy_from_slice(&other.map_or([0; 4], start));
            } else if other.is_some_and(|other| *frame == start(other)) {
                frame.copy_from_slice(&start(one));
            }
        }
        bytes
    });
}

fn refused(world: &mut World) -> MotorFault {
    assert!(world.until(20.0, |w| w.saw(Fault::MotorCheck)));
    world.run(1.0);
    assert_eq!(world.phase(), Phase::Disarmed);
    assert!(world.simulation.truth().rotor_speeds.iter().all(|w| w.abs() < 1.0), "motors turn");
    assert_eq!(world.ended_by(), Some(Fault::MotorCheck));
    world.linked.flight.motor_fault().unwrap()
}

#[test]
fn a_motor_at_a_wrong_number_is_named_and_no_motor_starts() {
    for (one, other) in [(1, 4), (2, 3), (6, 1)] {
        let mut world = World::preset("tilt-hex", "measured", 801);
        wired(&mut world, one, Some(other));
        let first = usize::from(one.min(other)) - 1;
        let fault = refused(&mut world);
        assert_eq!(fault, MotorFault::Another { motor: first, found: usize::from(one.max(other)) - 1 });
        let said = fault.to_string();
        assert!(said.contains(&format!("motor {} was", first + 1)) && said.contains("numbers"), "{said}");
    }
}

#[test]
fn a_motor_that_does_not_turn_is_named_until_another_start_is_asked_for() {
    let mut world = World::preset("tilt-hex", "measured", 802);
    wired(&mut world, 3, None);
    assert_eq!(refused(&mut world), MotorFault::Still { motor: 2 });
    // Mended, and ordered again.
    world.run(5.0);
    assert_eq!(world.phase(), Phase::Disarmed);
    world.wires = Box::new(<[u8]>::to_vec);
    world.tick(Some(&Command::TakeOff));
    world.fly();
}

#[test]
fn telemetry_of_another_motor_is_a_wrong_number_or_a_wrong_speed() {
    let mut world = World::preset("tilt-hex", "measured", 803);
    world.cruelty.borrow_mut().silent = Some(4);
    let fault = refused(&mut world);
    assert!(
        matches!(fault, MotorFault::Still { motor: 4 } | MotorFault::WrongSpeed { motor: 4, .. }),
        "{fault}"
    );
}

#[test]
fn the_check_takes_no_longer_than_it_may_and_can_be_left_out() {
    let time = |check: bool| {
        let text = format!("vehicle.preset = \"tilt-hex\"\nsupervisor.motor_check = {check}\n");
        let mut world = World::new(&text, "measured", 804);
        assert!(world.until(30.0, |w| w.phase() == Phase::Flying));
        world.now()
    };
    let (with, without) = (time(true), time(false));
    assert!((1.0..3.3).contains(&(with - without)), "{with} {without}");
}

/// One motor turns alone, and no two do before the check is over.
#[test]
fn each_motor_turns_alone() {
    let mut world = World::preset("tilt-hex", "exact", 805);
    let (mut seen, mut together) = (Vec::new(), false);
    world.until(10.0, |w| {
        let turning: Vec<_> = w
            .simulation
            .truth()
            .rotor_speeds
            .iter()
            .enumerate()
            .filter(|(_, s)| **s > 9.0)
            .map(|(i, _)| i)
            .collect();
        if let ([one], false) = (&turning[..], together)
            && seen.last() != Some(one)
        {
            seen.push(*one);
        }
        together |= turning.len() > 1;
        w.phase() == Phase::Grounded
    });
    assert_eq!(seen[..6], [0, 1, 2, 3, 4, 5], "{seen:?}");
}
