//! No contact is learnt as bias, nothing that is touched is pushed harder and harder, and no order waits for ever.

use crate::world::World;
use tilthex_core::{
    Setpoint, Vector3,
    flight::Command,
    supervisor::{Fault, Phase},
};

/// The bias that the flight removes, N: what the tool's wrench lacks of the robot's.
fn bias(world: &mut World) -> f64 {
    let record = world.tick(None);
    (record.wrench_robot.force - record.wrench_tool_w.force).norm()
}

#[test]
fn contact_that_begins_in_the_hover_to_learn_from_is_not_learnt() {
    let mut world = World::preset("tilt-hex", "measured", 71);
    assert!(world.until(30.0, |w| w.height() > 0.58));
    world.run(0.5);
    let tool = world.tool();
    world.push(Vector3::new(8.0, 0.0, 0.0), tool);
    world.fly();
    world.run(1.0);
    assert!(world.saw(Fault::BiasRefused));
    let learnt = bias(&mut world);
    assert!(learnt < 1.5, "{learnt:.2} N learnt");
    world.push(Vector3::zeros(), tool);
    assert!(world.land(30.0) && world.simulation.stands());
}

#[test]
fn an_order_to_learn_the_bias_while_something_presses_is_refused() {
    let mut world = World::preset("tilt-hex", "measured", 72);
    world.fly();
    let before = bias(&mut world);
    assert!(!world.saw(Fault::BiasRefused), "a plain hover is learnt from");
    let tool = world.tool();
    world.push(Vector3::new(0.0, 5.0, 0.0), tool);
    world.run(1.0);
    world.tick(Some(&Command::ZeroBias));
    world.run(3.0);
    assert!(world.saw(Fault::BiasRefused));
    assert!((bias(&mut world) - before).abs() < 0.05);
    assert_eq!(world.phase(), Phase::Flying);
}

#[test]
fn an_order_to_learn_the_bias_while_set_points_are_streamed_does_not_deadlock() {
    let mut world = World::preset("tilt-hex", "measured", 73);
    world.fly();
    let here = world.tick(None).setpoint;
    let stream = |world: &mut World, seconds: f64| {
        for k in 0..(seconds * 500.0) as u32 {
            let x = 0.05 * f64::from(k) / 500.0;
            let setpoint = Setpoint { position_w: here.position_w + Vector3::new(x, 0.0, 0.0), ..here };
            let command = if k == 500 { Command::ZeroBias } else { Command::Follow(setpoint) };
            world.tick(Some(&command));
        }
    };
    stream(&mut world, 4.0);
    assert!(world.saw(Fault::BiasRefused));
    assert!(world.linked.flight.on_mission() && world.phase() == Phase::Flying);
    // Once the stream has stopped, it is a hover, and later orders are obeyed.
    world.run(1.0);
    world.tick(Some(&Command::ZeroBias));
    world.run(2.5);
    assert!(world.linked.flight.on_mission(), "learning never ends");
    let here = world.tick(None).setpoint;
    assert_eq!(world.tick(Some(&Command::Follow(here))).phase, Phase::Flying);
}

/// A set-point behind a wall, where the reference does not yield: the force is bounded.
#[test]
fn what_blocks_a_take_off_is_not_pushed_harder_and_harder() {
    let mut world = World::preset("tilt-hex", "exact", 74);
    assert!(world.until(30.0, |w| w.height() > 0.2));
    let (tool, mut sum, mut count) = (world.tool(), 0.0, 0.0);
    let wall = world.simulation.truth().tool_position_w.x;
    for k in 0..1500 {
        // A wall that comes 20 mm too near, where an integral would push with 20 N in the end.
        let near = 0.02 * (f64::from(k) / 500.0).min(1.0);
        let depth = world.simulation.truth().tool_position_w.x - (wall - near);
        let force = (1000.0 * depth).max(0.0);
        if k > 500 && !world.linked.flight.on_mission() {
            (sum, count) = (sum + force, count + 1.0);
        }
        world.push(Vector3::new(-force, 0.0, 0.0), tool);
        world.tick(None);
    }
    let mean = sum / count;
    assert!(count > 200.0 && mean < 11.0, "{mean:.1} N");
    assert!(world.simulation.truth().robot.rotation_wr[(2, 2)] > 0.95);
}
