//! A landing ends on the ground, whatever pushes the vehicle and whatever the admittance was.

use std::path::Path;

use crate::world::World;
use proptest::{
    prelude::*,
    strategy::ValueTree,
    test_runner::{RngSeed, TestRunner},
};
use tilthex_config::{Config, TruthSection, VehicleSection};
use tilthex_core::{
    Vector3,
    plant::SensorParams,
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

/// A landing that is made hard.
#[derive(Clone, Copy, Debug)]
struct Hard {
    /// Chooses the true vehicle and the sensors' noise.
    seed: u64,
    /// Believed mass by the true one's.
    believed: f64,
    /// The push, of the weight, world, and where it acts: at the tool, or a place of the airframe, m.
    push: Vector3,
    at: Option<Vector3>,
    /// When it begins and when it ends, s, from the landing's order on.
    begins: f64,
    ends: f64,
    /// How far the tool stands below the feet, m, where it does.
    below: Option<f64>,
}

fn hard() -> impl Strategy<Value = Hard> {
    let vector = |size: f64| prop::array::uniform3(-1.0..1.0_f64).prop_map(move |v| Vector3::from(v) * size);
    (
        any::<u64>(),
        0.8..1.2_f64,
        (vector(1.0), 0.0..0.9_f64),
        prop::option::of(vector(0.4)),
        (-3.0..6.0_f64, 0.5..30.0_f64),
        prop::option::weighted(0.3, 0.01..0.15_f64),
    )
        .prop_map(|(seed, believed, (direction, size), at, (begins, length), below)| Hard {
            seed,
            believed,
            push: direction.try_normalize(1e-3).unwrap_or_default() * size,
            at,
            begins,
            ends: begins + length,
            below,
        })
}

/// Height of the lowest point, the tool's tip included where it stands below the feet, at which motors were stopped.
fn stopped_at(hard: &Hard) -> Option<f64> {
    let model = Config::default_for(VehicleSection::preset("tilt-hex").unwrap());
    let drawn = TruthSection::named("measured").unwrap().draw(model.vehicle(), hard.seed).unwrap();
    let plant = drawn.plant().unwrap();
    let text =
        format!("[vehicle]\npreset = \"tilt-hex\"\nmass = {}\n", hard.believed * plant.vehicle().mass());
    let config = Config::from_text(&text, Path::new("")).unwrap();
    let reach = -plant.vehicle().tool().position_r.z;
    let leg = hard.below.map(|below| (reach - below).max(0.12));
    let mut world = World::of(&config, plant, SensorParams::EXPERIMENTS, leg, hard.seed);
    if !world.until(30.0, |w| w.linked.flight.on_mission() || w.stopped_at.is_some())
        || world.stopped_at.is_some()
    {
        return world.stopped_at;
    }
    world.cruelty.borrow_mut().tip = hard.below.is_some();
    let force = hard.push * world.simulation.vehicle().weight();
    let at = hard.at.unwrap_or_else(|| world.tool());
    let begin = world.now() + (-hard.begins).max(0.0);
    while world.stopped_at.is_none() && world.now() < begin + 60.0 {
        let since = world.now() - begin;
        world.host.land = since > 0.0;
        let pushes = (hard.begins..hard.ends).contains(&since);
        world.push(if pushes { force } else { Vector3::zeros() }, at);
        world.tick(None);
    }
    world.stopped_at
}

/// Flies this many cases; `seed` chooses them, or chance where there is none.
fn never_stop_in_the_air(cases: u32, seed: Option<u64>) {
    let rng_seed = seed.map_or(RngSeed::Random, RngSeed::Fixed);
    let config = ProptestConfig {
        cases,
        rng_seed,
        failure_persistence: None,
        max_shrink_iters: 0,
        ..Default::default()
    };
    let found = TestRunner::new(config).run(&hard(), |hard| {
        let stopped = stopped_at(&hard);
        prop_assert!(
            stopped.is_none_or(|height| height < GROUND),
            "{:.3} m above the ground",
            stopped.unwrap_or(0.0)
        );
        Ok(())
    });
    if let Err(error) = found {
        panic!("{error}");
    }
}

/// Pushes of any direction and size, at the tool and anywhere on the airframe, before and while it lands, on vehicles 20 % off
/// their model, some with a tool that stands below their feet.
#[test]
fn motors_never_stop_in_the_air_whatever_pushes() {
    never_stop_in_the_air(24, Some(48_213));
}

/// The same on cases that nobody has seen: `LANDINGS=2000 cargo test --release --test safety -- --ignored landings`.
#[test]
#[ignore = "takes a flight a case"]
fn many_landings() {
    let cases: u32 = std::env::var("LANDINGS").ok().and_then(|text| text.parse().ok()).unwrap_or(200);
    let mut runner = TestRunner::new(ProptestConfig { rng_seed: RngSeed::Random, ..Default::default() });
    let one = |_| {
        let case = hard().new_tree(&mut runner).expect("a case").current();
        stopped_at(&case).filter(|height| *height >= GROUND).map(|height| (height, case))
    };
    let failed: Vec<_> = (0..cases).filter_map(one).collect();
    assert!(failed.is_empty(), "{} of {cases}: {failed:?}", failed.len());
}

/// A hand turns the vehicle over and carries most of its weight: hanging there, it does not lie on the ground.
#[test]
fn a_vehicle_that_hangs_upside_down_keeps_its_motors() {
    let push = Vector3::new(0.23924813724772537, 0.1843357327421812, 0.8182433538951629);
    let (begins, ends) = (1.2149818420578433, 5.1409398911125725);
    let (seed, believed) = (5918292463587306438, 1.0768423182073705);
    let carried = Hard { seed, believed, push, at: None, begins, ends, below: None };
    let stopped = stopped_at(&carried);
    assert!(stopped.is_none_or(|height| height < GROUND), "{stopped:?}");
}

/// A push carries a vehicle that has toppled through the air, and its poses are lost: what it feels there is not the ground.
#[test]
fn what_carries_a_toppled_vehicle_away_is_no_ground() {
    let push = Vector3::new(0.3151313824417712, 0.05560765954738734, 0.82);
    let at = Some(Vector3::new(-0.17569515932544758, -0.03353474874317371, -0.07791478755243836));
    let (begins, ends) = (3.3161244228163076, 20.31612442281631);
    let (seed, believed) = (7667427362361224824, 1.0921145538964254);
    let stopped = stopped_at(&Hard { seed, believed, push, at, begins, ends, below: None });
    assert!(stopped.is_none_or(|height| height < GROUND), "{stopped:?}");
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
    assert!(world.stopped_at.is_none_or(|height| height < GROUND), "{:?}", world.stopped_at);
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
