//! A shell script takes the part of the world's process.

use super::*;
use crate::Failure;
use tilthex_config::VehicleSection;

fn world(script: &str) -> Result<World, Failure> {
    let mut command = Command::new("sh");
    command.args(["-c", script]);
    let vehicle = VehicleSection::preset("tilt-hex").expect("a preset");
    World::from_command(command, *vehicle.vehicle()).map_err(Failure::from)
}

/// A greeting and a first state, as octal escapes of printf.
fn begins(rotors: f64) -> String {
    let mut words: Vec<[u8; 8]> = vec![*b"tilthex2", rotors.to_le_bytes(), 2.4_f64.to_le_bytes()];
    words.extend([[0; 8]; 25]);
    // Time, position and velocity, then a level body.
    words.extend([[0; 8]; 7]);
    for i in 0..9 {
        words.push(if i % 4 == 0 { 1.0_f64.to_le_bytes() } else { [0; 8] });
    }
    words.extend([[0; 8]; 30]);
    assert_eq!(8 * words.len(), GREETING + STATE);
    let escaped: String = words.as_flattened().iter().map(|byte| format!("\\{byte:03o}")).collect();
    format!("printf '{escaped}'")
}

fn refusal(script: &str) -> Failure {
    world(script).map(|_| ()).expect_err("refused")
}

fn step(world: &mut World) {
    let cycle = Cycle { at: 1_000_000, dt: 1e-3, since_start: None };
    world.advance(&cycle, &RotorVector::zeros());
}

#[test]
fn what_keeps_it_from_beginning_is_said_once() {
    let refused = refusal("echo 'no experiment sliedin' >&2; exit 2");
    assert_eq!(refused, Failure::usage("no experiment sliedin"));
    let refused = refusal("echo 'No module named tilthex' >&2; exit 1");
    assert_eq!(refused.exit_status(), 2);
    assert!(refused.message.contains("No module named tilthex"), "{refused}");
    let missing = World::from_command(
        Command::new("/no/such/python"),
        *VehicleSection::preset("tilt-hex").expect("a preset").vehicle(),
    );
    let refused = Failure::from(missing.map(|_| ()).expect_err("refused"));
    assert_eq!(refused.exit_status(), 2);
    assert!(refused.message.contains("/no/such/python"), "{refused}");
}

#[test]
fn rubbish_is_no_greeting() {
    let refused = refusal("yes rubbish");
    assert_eq!(refused.exit_status(), 3);
    assert!(refused.message.contains("rubbish"), "{refused}");
}

#[test]
fn another_vehicle_is_refused() {
    let refused = refusal(&format!("{}; cat >&2", begins(4.0)));
    assert_eq!(refused.exit_status(), 2);
    assert!(refused.message.contains("4 rotors"), "{refused}");
}

#[test]
fn one_that_dies_in_flight_fails_and_keeps_its_last_state() {
    let mut world =
        world(&format!("{}; head -c 104 >/dev/null; echo why >&2; exit 7", begins(6.0))).expect("begins");
    assert!(!world.failed() && world.rests());
    step(&mut world);
    assert!(world.failed());
    let before = *world.state();
    step(&mut world);
    assert_eq!(*world.state(), before);
    let failure = Failure::from(world.finish().expect_err("it died"));
    assert_eq!(failure.exit_status(), 3);
    assert!(failure.message.contains("why") && failure.message.contains('7'), "{failure}");
}

#[test]
fn an_answer_to_another_question_is_none() {
    let script = format!("{}; head -c 104 >/dev/null; yes | head -c 368; cat >/dev/null", begins(6.0));
    let mut world = world(&script).expect("begins");
    step(&mut world);
    let failure = world.finish().expect_err("rubbish");
    assert!(failure.to_string().contains("expected 1000000 ns"), "{failure}");
}

#[test]
fn the_end_of_its_input_ends_it_and_its_status_counts() {
    let mut good = world(&format!("{}; cat >/dev/null", begins(6.0))).expect("begins");
    assert_eq!(good.finish(), Ok(()));
    let script = format!("{}; cat >/dev/null; echo 'no space left' >&2; exit 1", begins(6.0));
    let mut full = world(&script).expect("begins");
    assert!(full.finish().expect_err("not written").to_string().contains("no space left"));
}
