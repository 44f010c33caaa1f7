//! Flights of the campaign from power-on, mostly with a capture system that is wrong: late poses, or those of a turned body.

mod stories;

use tilthex_config::TruthSection;
use tilthex_core::supervisor::{Fault, Reaction};
use tilthex_link::LinkedFlight;
use tilthex_sim::{
    Simulation, SimulationParams,
    campaign::{self, Injection, Kind, Outcome, World},
};

/// A fault that is there from power-on.
fn built_in(kind: Kind, strength: f64, index: usize) -> Injection {
    stories::fault(kind, 0.0, 1e6, strength, index)
}

/// A flight from power-on.
fn fly(faults: &[Injection], seed: u64) -> Outcome {
    let params = stories::config().linked_params(true).expect("valid");
    let simulation = Simulation::new(SimulationParams::new(params.flight.vehicle));
    let world = World::new(simulation, LinkedFlight::new(params, None).expect("valid"), seed);
    campaign::fly(world, faults.to_vec(), seed)
}

/// A latency that is found in the first hover is subtracted: the vehicle lands and needs no emergency.
#[test]
fn poses_that_were_found_late_land_the_vehicle() {
    let config = stories::config();
    let exact = TruthSection::named("exact").expect("a level");
    for seed in [1300011, 1300020, 1300030, 2136949] {
        let again = campaign::again(&config, &exact, &[Kind::CaptureLatency], seed);
        let (outcome, _) = again.expect("it flies");
        assert!(outcome.seen.contains(Fault::CaptureLate), "{outcome:?}");
        assert!(outcome.failure.is_none() && outcome.reaction <= Reaction::Land, "{outcome:?}");
    }
}

/// Late poses show a rising vehicle lower than it is: its motors are stopped only where it really is low.
#[test]
fn late_poses_stop_no_motors_high_above_the_ground() {
    for strength in [0.62, 0.66, 0.699_493_072_806_754_3, 0.74, 0.78, 0.82] {
        let outcome = fly(&[built_in(Kind::CaptureLatency, strength, 4)], 2_136_949);
        assert!(outcome.failure.is_none() && outcome.ended, "{outcome:?}");
    }
}

/// The instability of a small yaw or a short delay grows so slowly that the mission begins before it shows: it is found in the
/// landing to which it leads, or in the one at the end.
#[test]
fn a_capture_system_that_is_only_a_little_wrong_lands_the_vehicle_on_its_feet() {
    let stands = |outcome: &Outcome| {
        assert!(outcome.failure.is_none() && outcome.ended && !outcome.toppled, "{outcome:?}");
    };
    for k in 0..5 {
        let yawed = built_in(Kind::CaptureYawed, 0.25 + 0.006 * f64::from(k), 3 * k as usize);
        stands(&fly(&[yawed], 41));
        // Two delays are one delay of their sum: 53 to 68 ms.
        let late = |strength| built_in(Kind::CaptureLatency, strength, 0);
        stands(&fly(&[late(0.3), late(0.3 + 0.025 * f64::from(k))], 43));
    }
    let late = |strength, k| built_in(Kind::CaptureLatency, strength, k);
    let frozen = stories::fault(Kind::ImuFrozen, 0.556, 0.211, 0.674, 12);
    for (seed, faults, found) in [
        (2203126, &[frozen, built_in(Kind::CaptureYawed, 0.26800890635013397, 15)][..], Fault::CaptureAxes),
        (2203759, &[late(0.2954215580289439, 20), late(0.38079586986892955, 4)], Fault::CaptureLate),
        (2300322, &[late(0.5527077929831646, 6)], Fault::CaptureLate),
        (2300387, &[late(0.5557977130172717, 9)], Fault::CaptureLate),
    ] {
        let outcome = fly(faults, seed);
        stands(&outcome);
        assert!(outcome.seen.contains(found), "{outcome:?}");
    }
}

/// A step of the accelerometer's bias in the take-off is not taken for late poses.
#[test]
fn an_accelerometer_that_steps_in_the_take_off_makes_no_pose_late() {
    for k in 0..6 {
        let begin = 8.3 + 0.1 * f64::from(k % 3);
        let step = stories::fault(Kind::AccelerometerBias, begin, 1.2, 0.7, 6 * k as usize + 5);
        let outcome = fly(&[step], 51);
        assert!(outcome.failure.is_none() && outcome.ended && !outcome.toppled, "{outcome:?}");
        assert!(!outcome.seen.contains(Fault::CaptureLate), "{outcome:?}");
    }
    let step =
        stories::fault(Kind::AccelerometerBias, 8.51174693635913, 1.1444420552803447, 0.6987750540446815, 23);
    assert_eq!(fly(&[step], 2270300).failure, None);
}

/// A gyro whose bias changes on the ground does not excuse poses that contradict the IMU in the take-off.
#[test]
fn a_gyro_that_steps_on_the_ground_excuses_no_false_poses() {
    for k in 0..6 {
        let step = stories::fault(Kind::GyroBias, 2.8 + 0.3 * f64::from(k), 2.0, 0.6, 3 * k as usize);
        let outcome = fly(&[built_in(Kind::CaptureYUp, 0.1, 17), step], 53);
        assert!(outcome.failure.is_none() && outcome.ended && !outcome.toppled, "{outcome:?}");
    }
    let step = stories::fault(Kind::GyroBias, 2.8064311599715115, 2.532439019395715, 0.5326775537005088, 8);
    let outcome = fly(&[built_in(Kind::CaptureYUp, 0.10507857849288704, 17), step], 2243217);
    assert_eq!(outcome.failure, None, "{outcome:?}");
}

/// Late poses of a body that is turned by a wrong yaw, which the vehicle has refused, are not taken for its own because it touches
/// the ground.
#[test]
fn a_vertical_motion_does_not_show_that_turned_poses_are_true() {
    let both =
        |(yaw, k), (late, j)| [built_in(Kind::CaptureYawed, yaw, k), built_in(Kind::CaptureLatency, late, j)];
    for (seed, faults) in [
        (2300650, both((0.2896100784900174, 17), (0.522825903923164, 6))),
        (2300962, both((0.31100752181290925, 31), (0.6284154790929172, 14))),
    ] {
        let outcome = fly(&faults, seed);
        assert!(outcome.failure.is_none() && outcome.ended && !outcome.toppled, "{outcome:?}");
    }
}
