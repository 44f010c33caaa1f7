//! Orders that are legal and unwise.

use crate::world::World;
use tilthex_core::{
    Matrix3, Setpoint, Vector3, Wrench,
    flight::{Command, Route},
    force_axes::ForceAxes,
    supervisor::{Fault, Phase},
    trajectory::{Limits, Waypoint},
};

const LIMITS: Limits =
    Limits { velocity: 0.4, acceleration: 0.8, angular_velocity: 0.5, angular_acceleration: 1.0 };

fn route(position_w: Vector3) -> Route {
    let point = Waypoint {
        position_w,
        rotation_we: Matrix3::identity(),
        wrench_w: Wrench::ZERO,
        force_axes: ForceAxes::NONE,
        duration: 0.0,
        hold: 0.0,
    };
    Route::new(&[point], &LIMITS).unwrap()
}

#[test]
fn a_wrench_that_meets_nothing_is_slow_and_ends() {
    for (text, speed, way) in [
        ("", 0.25, 0.3),
        ("admittance.stiffness = [0, 0, 0, 10, 10, 5]", 0.25, 0.3),
        (
            "admittance.stiffness = [0, 0, 0, 10, 10, 5]\nadmittance.max_wrench_speed = 0.1\nadmittance.max_wrench_way = 0.15",
            0.1,
            0.15,
        ),
    ] {
        for force in [3.0, 10.0] {
            let text = format!("vehicle.preset = \"tilt-hex\"\n{text}\n");
            let mut world = World::new(&text, "exact", 811);
            world.fly();
            let before = world.simulation.truth().tool_position_w;
            world.fastest = 0.0;
            let wrench = Wrench { force: Vector3::new(0.0, force, 0.0), torque: Vector3::zeros() };
            world.tick(Some(&Command::SetWrench(wrench, ForceAxes::NONE)));
            world.run(8.0);
            let went = (world.simulation.truth().tool_position_w - before).norm();
            assert!(world.fastest < speed + 0.08, "{force} N: {:.2} m/s", world.fastest);
            assert!((0.8 * way..way + 0.06).contains(&went), "{force} N: {went:.2} m of {way}");
        }
    }
}

#[test]
fn a_wrench_against_a_wall_is_exerted() {
    let mut world = World::preset("tilt-hex", "exact", 812);
    world.fly();
    let (tool, wall) = (world.tool(), world.simulation.truth().tool_position_w.y + 0.1);
    let wrench = Wrench { force: Vector3::new(0.0, 4.0, 0.0), torque: Vector3::zeros() };
    let (mut sum, mut count) = (0.0, 0.0);
    for k in 0..7500 {
        let depth = world.simulation.truth().tool_position_w.y - wall;
        let force = (500.0 * depth).max(0.0);
        world.push(Vector3::new(0.0, -force, 0.0), tool);
        world.tick((k == 0).then_some(&Command::SetWrench(wrench, ForceAxes::NONE)));
        if k > 5000 {
            (sum, count) = (sum + force, count + 1.0);
        }
    }
    // The spring of 6 N/m keeps what the way to the wall takes; the dead zone adds its 0.2 N.
    let mean = sum / count;
    assert!((mean - (4.0 - 0.6 + 0.2)).abs() < 0.3, "{mean:.2} N");
}

#[test]
fn orders_that_leave_the_geofence_are_refused_in_flight() {
    let mut world = World::preset("tilt-hex", "exact", 813);
    world.fly();
    let hover = world.tick(None).setpoint;
    for beyond in [Vector3::new(3.5, 0.0, 0.6), Vector3::new(0.0, -4.0, 0.6), Vector3::new(0.0, 0.0, 5.0)] {
        world.tick(Some(&Command::Play(route(beyond))));
        world.run(1.0);
        assert!(world.saw(Fault::SetpointJump));
        assert_eq!(world.tick(None).setpoint.position_w, hover.position_w);
    }
    // A stream may come as far as the fence, and no farther.
    let mut at = hover.position_w;
    for _ in 0..5000 {
        at.x += 0.001;
        world.tick(Some(&Command::Follow(Setpoint { position_w: at, ..hover })));
    }
    assert!((1.5..3.05).contains(&world.farthest), "{:.2}", world.farthest);
    assert!(!world.saw(Fault::Geofence));
    world.run(1.0);
    assert!(matches!(world.phase(), Phase::Holding | Phase::Flying));
}

#[test]
fn a_route_that_leaves_the_geofence_is_refused_before_the_motors_start() {
    let mut world = World::preset("tilt-hex", "exact", 814);
    world.tick(Some(&Command::Play(route(Vector3::new(0.0, 9.0, 0.6)))));
    world.run(8.0);
    assert_eq!(world.phase(), Phase::Disarmed);
    assert!(world.linked.flight.supervisor().refusals().contains(Fault::Geofence));
    assert!(world.simulation.truth().rotor_speeds.iter().all(|w| w.abs() < 1e-6));
    // Another route takes its place.
    world.tick(Some(&Command::Play(route(Vector3::new(0.0, 0.5, 0.4)))));
    world.fly();
}
