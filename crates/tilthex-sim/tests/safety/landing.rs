//! A landing ends on the ground, whatever pushes the vehicle and whatever the admittance was.

use crate::world::World;
use std::path::Path;
use tilthex_config::{Config, TruthSection, VehicleSection};
use tilthex_core::{
    Vector3,
    plant::SensorParams,
    random::Random,
    supervisor::{Fault, Phase},
};

/// Higher than this above where it stands no motor may stop, m.
const GROUND: f64 = 0.1;

#[test]
fn a_push_up_at_the_tool_is_not_the_ground() {
    let mut world = World::preset("tilt-hex", "exact", 21);
    world.fly();
    let tool = world.tool();
    world.push(Vector3::new(0.0, 0.0, 8.0), tool);
    world.run(2.0);
    assert!(world.land(30.0), "{:?}", world.linked.flight.supervisor().active());
    assert!(world.stopped_at.unwrap() < GROUND, "stopped at {:.2} m", world.stopped_at.unwrap());
    assert!(world.farthest < 0.5, "{:.2} m away", world.farthest);
}

#[test]
fn a_landing_first_backs_away_from_what_the_tool_touches() {
    let mut world = World::preset("tilt-hex", "exact", 22);
    world.fly();
    let tool = world.tool();
    world.push(Vector3::new(4.0, 0.0, 0.0), tool);
    world.run(4.0);
    let before = world.simulation.truth();
    world.host.land = true;
    world.run(0.9);
    let after = world.simulation.truth();
    assert!(after.robot.position_w.x > before.robot.position_w.x + 0.08, "not away from the contact");
    assert!(after.robot.position_w.z > before.robot.position_w.z - 0.05, "sinks before it is away");
    assert!(world.land(30.0) && world.stopped_at.unwrap() < GROUND);
}

/// Pushes of any direction and size, anywhere on the vehicle, on vehicles 20 % off their model.
#[test]
fn motors_never_stop_in_the_air_whatever_pushes() {
    let model = Config::default_for(VehicleSection::preset("tilt-hex").unwrap());
    let mass = model.vehicle().vehicle().mass();
    for seed in 300..324 {
        let mut random = Random::new(seed);
        let drawn = TruthSection::named("measured").unwrap().draw(model.vehicle(), seed).unwrap();
        let believed = [1.0, 0.8, 1.2][seed as usize % 3] * mass;
        let text = format!("[vehicle]\npreset = \"tilt-hex\"\nmass = {believed}\n");
        let config = Config::from_text(&text, Path::new("")).unwrap();
        let mut world = World::of(&config, drawn.plant().unwrap(), SensorParams::EXPERIMENTS, None, seed);
        world.fly();
        let weight = world.simulation.vehicle().weight();
        let direction = random.normal3(1.0).normalize();
        let tool = world.tool();
        let at = if random.uniform() < 0.5 { tool } else { random.normal3(0.15) };
        world.push(direction * (0.9 * weight * random.uniform()), at);
        world.run(3.0 * random.uniform());
        world.host.land = true;
        world.ends(40.0);
        if let Some(height) = world.stopped_at {
            assert!(height < GROUND, "seed {seed}: motors stopped at {height:.2} m");
        }
    }
}

#[test]
fn a_tool_that_stands_below_the_feet_does_not_stop_motors_in_the_air() {
    let config = Config::default_for(VehicleSection::preset("tilt-hex").unwrap());
    let drawn = TruthSection::named("exact").unwrap().draw(config.vehicle(), 31).unwrap();
    let plant = drawn.plant().unwrap();
    let leg = (-plant.vehicle().tool().position_r.z - 0.1).max(0.12);
    let mut world = World::of(&config, plant, SensorParams::EXPERIMENTS, Some(leg), 31);
    world.fly();
    world.cruelty.borrow_mut().tip = true;
    world.host.land = true;
    world.ends(60.0);
    assert!(world.stopped_at.is_none_or(|height| height < 0.2), "{:?}", world.stopped_at);
}

#[test]
fn a_landing_has_its_own_damping_whatever_the_admittance_was() {
    for (mass, damping) in [("1.5", "0.0"), ("1e-3", "0.0"), ("1e-9", "0.0"), ("1e-3", "1e-3")] {
        let text = format!(
            "vehicle.preset = \"tilt-hex\"\n[admittance]\nmass = [{mass}, {mass}, {mass}, 0.01, 0.01, 0.02]\n\
             damping = [{damping}, {damping}, {damping}, 4.0, 4.0, 4.0]\nstiffness = [0.0, 0.0, 0.0, 10.0, 10.0, 5.0]\n\
             max_translation = 10.0\n"
        );
        let Ok(_) = Config::from_text(&text, Path::new("")) else { continue };
        let mut world = World::new(&text, "exact", 41);
        world.fly();
        let tool = world.tool();
        world.push(Vector3::new(3.0, 0.0, 0.0), tool);
        world.run(1.0);
        world.push(Vector3::zeros(), tool);
        assert!(world.land(40.0), "mass {mass}: {:?}", world.phase());
        assert!(world.farthest < 4.0 && world.stopped_at.unwrap() < GROUND, "{mass}: {:.1}", world.farthest);
    }
}

#[test]
fn nothing_but_the_landing_ends_a_plain_landing() {
    let mut world = World::preset("tilt-hex", "measured", 51);
    world.fly();
    assert!(world.land(30.0));
    assert_eq!(world.ended_by(), Some(Fault::Operator));
    assert_eq!(world.phase(), Phase::Disarmed);
    assert!(world.simulation.stands() && !world.saw(Fault::LandingFails));
}

#[test]
fn outside_the_geofence_it_lands() {
    let text = "vehicle.preset = \"tilt-hex\"\nsupervisor.geofence = 0.5\n[admittance]\n\
                stiffness = [0.0, 0.0, 0.0, 10.0, 10.0, 5.0]\n";
    let mut world = World::new(text, "exact", 61);
    world.fly();
    let tool = world.tool();
    world.push(Vector3::new(0.0, 3.0, 0.0), tool);
    assert!(world.until(10.0, |w| w.phase() == Phase::Landing));
    world.push(Vector3::zeros(), tool);
    assert!(world.ends(30.0));
    assert_eq!(world.ended_by(), Some(Fault::Geofence));
    assert!(world.farthest < 1.1, "{:.2}", world.farthest);
}
