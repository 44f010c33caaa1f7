//! Capture systems that lie about where the vehicle is.

use crate::world::World;
use tilthex_core::{
    Matrix3, PoseSample, Vector3,
    plant::{SensorParams, Sensors},
    random::Random,
    supervisor::{Fault, Phase},
};

/// From a time on, s, the pose of that time with new numbers and this much noise of the position, m.
fn freeze(world: &mut World, from: f64, until: f64, noise: f64) {
    let (mut kept, mut random) = (None, Random::new(7));
    world.capture = Box::new(move |now, pose| {
        if !(from..until).contains(&now) {
            return Some(pose);
        }
        let first: PoseSample = *kept.get_or_insert(pose);
        Some(PoseSample {
            position_w: first.position_w + random.normal3(noise),
            rotation_wr: first.rotation_wr,
            ..pose
        })
    });
}

fn comes_down(world: &mut World, what: &str) {
    assert!(world.ends(40.0), "{what}: {:?}", world.phase());
    assert!(world.ended_by().is_some_and(|fault| fault != Fault::Operator), "{what}");
    assert!(
        world.farthest < 3.0 && world.highest < 2.0,
        "{what}: {:.1} {:.1}",
        world.farthest,
        world.highest
    );
    assert!(world.stopped_at.unwrap() < 0.1, "{what}: stopped at {:.2} m", world.stopped_at.unwrap());
}

#[test]
fn a_pose_that_freezes_in_hover_for_good_lands() {
    for seed in 101..105 {
        let mut world = World::preset("tilt-hex", "measured", seed);
        world.fly();
        let now = world.now();
        freeze(&mut world, now, f64::INFINITY, 0.0);
        comes_down(&mut world, "frozen");
        assert!(world.saw(Fault::PoseFrozen) && world.farthest < 1.0, "{:.2}", world.farthest);
    }
}

#[test]
fn a_pose_whose_rotation_freezes_under_noise_of_the_position_lands() {
    for seed in 111..117 {
        let mut world = World::preset("tilt-hex", "measured", seed);
        world.fly();
        let now = world.now();
        freeze(&mut world, now, f64::INFINITY, 0.5e-3);
        comes_down(&mut world, "frozen under noise");
        assert!(world.saw(Fault::PoseFrozen) && world.farthest < 1.0, "{:.2}", world.farthest);
    }
}

/// A gyro's bias that steps, however large and about whatever axis, is the IMU's fault and not the poses'.
#[test]
fn a_step_of_the_gyros_bias_is_no_lie_of_the_poses() {
    let mut random = Random::new(171);
    for seed in 172..180 {
        let mut world = World::preset("tilt-hex", "measured", seed);
        world.fly();
        world.run(5.0);
        let step_i = random.normal3(1.0).normalize() * (0.03 + 0.17 * random.uniform());
        let own = *world.simulation.own_sensors();
        let shifted = SensorParams { gyro_bias_i: own.gyro_bias_i + step_i, ..own };
        *world.simulation.sensors_mut() = Sensors::new(shifted, seed);
        world.run(10.0);
        let what = format!("{seed}, {:.3} rad/s: {:?}", step_i.norm(), world.phase());
        assert!(!world.saw(Fault::PoseContradicts) && world.farthest < 0.5, "{what} {:.2}", world.farthest);
    }
}

#[test]
fn motors_do_not_start_on_a_frozen_pose() {
    let mut world = World::preset("tilt-hex", "exact", 121);
    freeze(&mut world, 0.5, f64::INFINITY, 0.0);
    world.run(20.0);
    assert_eq!(world.phase(), Phase::Disarmed);
    assert!(world.saw(Fault::PoseFrozen) && world.stopped_at.is_none());
}

#[test]
fn a_pose_that_freezes_while_the_motors_start_is_seen_before_it_is_high() {
    for (after, seed) in [(1.5, 123), (5.0, 124), (7.8, 125)] {
        let mut world = World::preset("tilt-hex", "measured", seed);
        freeze(&mut world, after, f64::INFINITY, 0.0);
        world.until(30.0, |w| w.linked.finished());
        let what = format!("{after}: {:?}, {:.2} m high", world.phase(), world.highest);
        assert!(world.highest < 0.5 && world.farthest < 0.5, "{what}");
        assert!(world.phase() == Phase::Disarmed && world.saw(Fault::PoseFrozen), "{what}");
    }
}

#[test]
fn a_frozen_pose_that_moves_again_lands_or_flies_on() {
    let mut world = World::preset("tilt-hex", "measured", 122);
    world.fly();
    let now = world.now();
    freeze(&mut world, now, now + 3.0, 0.0);
    world.run(1.0);
    comes_down(&mut world, "3 s");
}

#[test]
fn default_poses_are_no_poses() {
    for (length, seed) in [(0.4, 131), (2.0, 132), (1e9, 133)] {
        let mut world = World::preset("tilt-hex", "measured", seed);
        world.fly();
        let begin = world.now();
        world.capture = Box::new(move |now, pose| {
            let lost = (begin..begin + length).contains(&now);
            let default =
                PoseSample { position_w: Vector3::zeros(), rotation_wr: Matrix3::identity(), ..pose };
            Some(if lost { default } else { pose })
        });
        world.run(1.0);
        if length < 0.5 {
            assert_eq!(world.phase(), Phase::Flying);
            assert!(world.farthest < 0.2);
        } else {
            comes_down(&mut world, "default pose");
        }
    }
}
