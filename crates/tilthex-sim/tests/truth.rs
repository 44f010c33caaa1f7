//! Whole flights of vehicles that are not their model, from the ground and back, on virtual time.

#![allow(clippy::unwrap_used)]

use tilthex_config::{Config, TruthSection, VehicleSection};
use tilthex_link::LinkedFlight;
use tilthex_sim::{
    Simulation, SimulationParams,
    campaign::{self, Outcome, World},
};

/// Take-off, seven seconds on a mission and landing of a drawn vehicle, through the real codecs.
fn flown(vehicle: &str, level: &str, seed: u64) -> Outcome {
    let config = Config::default_for(VehicleSection::preset(vehicle).unwrap());
    let params = config.linked_params(true).unwrap();
    let drawn = TruthSection::named(level).unwrap().draw(config.vehicle(), seed).unwrap();
    let simulation = Simulation::new(SimulationParams::of(&drawn).unwrap());
    let world = World::new(simulation, LinkedFlight::new(params, None).unwrap(), seed);
    campaign::fly(world, vec![], seed)
}

#[test]
fn vehicles_that_are_not_their_model_take_off_hover_and_land() {
    for vehicle in ["tilt-hex", "tilt-hex-light"] {
        for level in ["exact", "measured", "cad", "outdoors"] {
            for seed in 0..4 {
                let outcome = flown(vehicle, level, seed);
                assert_eq!(outcome.failure, None, "{vehicle} {level} {seed}");
                assert!(outcome.ended && !outcome.toppled, "{vehicle} {level} {seed}");
            }
        }
    }
}

#[test]
fn a_seed_is_a_flight_and_another_level_is_another() {
    assert_eq!(flown("tilt-hex", "outdoors", 9), flown("tilt-hex", "outdoors", 9));
    assert_ne!(flown("tilt-hex", "outdoors", 9).deviation, flown("tilt-hex", "measured", 9).deviation);
}
