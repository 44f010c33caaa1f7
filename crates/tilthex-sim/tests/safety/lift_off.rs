//! Wiring, axes and mounting that show before the ramp or in the first decimetres.

use crate::world::World;
use tilthex_core::{
    Matrix3, PoseSample, Vector3, so3,
    supervisor::{Fault, TABLE},
};

/// It never rises, or is stopped in the first decimetres, and does not get far.
fn ends_gently(world: &mut World, what: &str) {
    world.until(30.0, |w| w.stopped_at.is_some() || w.linked.flight.on_mission());
    let seen = world.linked.flight.supervisor().active();
    assert!(world.ended_by().is_some() || world.linked.flight.start_refused().is_some(), "{what}: {seen:?}");
    world.run(2.0);
    assert!(world.highest < 0.36, "{what}: {:.2} m high", world.highest);
    assert!(world.farthest < 0.7, "{what}: {:.2} m away", world.farthest);
}

#[test]
fn exchanged_motors_never_leave_the_ground_far() {
    for (a, b) in [(0, 3), (1, 4), (2, 5), (0, 1), (2, 3), (0, 2), (1, 5)] {
        let mut world = World::preset("tilt-hex", "measured", 141 + a as u64);
        world.cruelty.borrow_mut().order.swap(a, b);
        ends_gently(&mut world, &format!("motors {a} and {b}"));
        assert_eq!(world.ended_by(), Some(Fault::MotorOrder), "{a} {b}");
    }
}

#[test]
fn a_captured_body_that_is_askew_is_refused_before_the_ramp() {
    for degrees in [3.0_f64, 14.0] {
        let mut world = World::preset("tilt-hex", "exact", 151);
        let askew = so3::exp(&Vector3::new(degrees.to_radians(), 0.0, 0.0));
        world.capture =
            Box::new(move |_, pose| Some(PoseSample { rotation_wr: pose.rotation_wr * askew, ..pose }));
        world.run(15.0);
        let why = world.linked.flight.start_refused().map(|e| e.to_string()).unwrap_or_default();
        assert!(why.contains("degrees apart"), "{degrees}: {why}");
        assert!(world.stopped_at.is_none());
    }
}

#[test]
fn axes_of_motion_capture_that_are_wrong_show_in_the_first_decimetres() {
    let yawed = |degrees: f64| so3::rot_z(degrees.to_radians());
    for degrees in [60.0, 90.0, -120.0, 180.0] {
        let mut world = World::preset("tilt-hex", "measured", 161);
        let turn = yawed(degrees);
        world.capture =
            Box::new(move |_, pose| Some(PoseSample { rotation_wr: pose.rotation_wr * turn, ..pose }));
        ends_gently(&mut world, &format!("yaw {degrees}"));
    }
    let mut world = World::preset("tilt-hex", "measured", 162);
    world.capture = Box::new(|_, pose| {
        let p = pose.position_w;
        // Level it reads as the identity: a body that was defined so.
        Some(PoseSample { position_w: Vector3::new(p.x, p.z, -p.y), ..pose })
    });
    ends_gently(&mut world, "y up");
    assert_eq!(world.ended_by(), Some(Fault::CaptureAxes));
}

/// A yaw that makes the flight unstable so slowly that the vehicle is in its first hover when it shows.
#[test]
fn a_captured_body_that_is_turned_a_little_is_turned_back_and_the_vehicle_lands() {
    let mut corrected = 0;
    for (k, degrees) in [36.0_f64, -40.0, 44.0, -48.0].into_iter().enumerate() {
        let mut world = World::preset("tilt-hex", "exact", 171 + k as u64);
        let turn = so3::rot_z(degrees.to_radians());
        world.capture =
            Box::new(move |_, pose| Some(PoseSample { rotation_wr: pose.rotation_wr * turn, ..pose }));
        world.until(60.0, |w| w.stopped_at.is_some());
        let clearance = world.stopped_at.unwrap_or(f64::INFINITY);
        let gentle = world.farthest < 0.3 && world.fastest < 1.0;
        assert!(gentle, "{degrees}: {:.2} m away, {:.2} m/s", world.farthest, world.fastest);
        assert!(clearance < 0.1 || world.highest < 0.36, "{degrees}: stopped at {clearance:.2} m");
        if world.saw(Fault::CaptureAxes) && world.highest >= 0.36 {
            corrected += 1;
            let estimate = world.linked.flight.robot_state().rotation_wr;
            let off = so3::angle(&(estimate.transpose() * world.simulation.truth().robot.rotation_wr));
            assert!(off < 10_f64.to_radians(), "{degrees}: off by {off} rad");
        }
    }
    assert!(corrected >= 2, "{corrected}");
}

/// Vehicles that are not their model, and fly well all the same.
#[test]
fn good_vehicles_are_not_stopped() {
    for (preset, truth, seeds) in [
        ("tilt-hex", "cad", 170..182),
        ("tilt-hex-light", "measured", 182..188),
        ("hexarotor", "measured", 188..192),
    ] {
        for seed in seeds {
            let mut world = World::preset(preset, truth, seed);
            let flew = world.until(30.0, |w| w.linked.flight.on_mission());
            let seen = world.linked.flight.supervisor().seen();
            let why = world.linked.flight.start_refused().map(|e| e.to_string());
            assert!(flew, "{preset} {truth} {seed}: {seen:?} {why:?}");
        }
    }
}

/// What comes of a take-off with a capture system that changes every pose in the same way.
fn with_capture(seed: u64, change: impl Fn(PoseSample) -> PoseSample + 'static, what: &str) -> Option<Fault> {
    let mut world = World::preset("tilt-hex", "measured", seed);
    world.capture = Box::new(move |_, pose| Some(change(pose)));
    ends_gently(&mut world, what);
    world.ended_by()
}

#[test]
fn mirrored_streams_and_positions_in_other_axes_end_gently() {
    for (axis, name) in [(0, "x"), (1, "y"), (2, "z")] {
        let mut mirror = Matrix3::identity();
        mirror[(axis, axis)] = -1.0;
        let whole = move |pose: PoseSample| PoseSample {
            position_w: mirror * pose.position_w,
            rotation_wr: mirror * pose.rotation_wr * mirror,
            ..pose
        };
        let ended = with_capture(163, whole, &format!("mirrored {name}"));
        let ends = [Fault::CaptureMirrored, Fault::CaptureAxes];
        assert!(ended.is_some_and(|fault| ends.contains(&fault)), "mirrored {name}: {ended:?}");
        assert!(axis < 2 || ended == Some(Fault::CaptureMirrored));
        let places = move |pose: PoseSample| PoseSample { position_w: mirror * pose.position_w, ..pose };
        let ended = with_capture(164, places, &format!("places mirrored {name}"));
        assert!(ended.is_some_and(|fault| ends.contains(&fault)), "places mirrored {name}: {ended:?}");
    }
    for degrees in [90.0_f64, -90.0, 180.0] {
        let turn = so3::rot_z(degrees.to_radians());
        let turned = move |pose: PoseSample| PoseSample { position_w: turn * pose.position_w, ..pose };
        let ended = with_capture(165, turned, &format!("places turned by {degrees}"));
        assert_eq!(ended, Some(Fault::CaptureAxes), "places turned by {degrees}");
    }
}

#[test]
fn poses_with_a_latency_that_nobody_told_of_end_gently() {
    for (latency, seed) in [(0.045, 166), (0.075, 167), (0.15, 168), (0.25, 169)] {
        let mut world = World::preset("tilt-hex", "measured", seed);
        let mut under_way = std::collections::VecDeque::new();
        world.capture = Box::new(move |_, pose| {
            under_way.push_back(pose);
            let old: &PoseSample = under_way.front()?;
            if pose.time - old.time < latency {
                return None;
            }
            let old = under_way.pop_front()?;
            Some(PoseSample { position_w: old.position_w, rotation_wr: old.rotation_wr, ..pose })
        });
        world.until(40.0, |w| w.linked.finished() || w.now() > 25.0);
        let ended = world.ended_by();
        let what = format!("{latency}: {ended:?}, {:.2} m away, {:.2} m high", world.farthest, world.highest);
        assert!(world.farthest < 0.5 && world.highest < 1.0, "{what}");
        if latency < 0.05 {
            // It flies all the same.
            assert!(ended.is_none() || ended == Some(Fault::CaptureLate), "{what}");
            continue;
        }
        // What has hardly moved when it is stopped cannot be told from a body that stands still: that sentence names both.
        let ends = [Fault::CaptureLate, Fault::PoseContradicts];
        assert!(ended.is_some_and(|fault| ends.contains(&fault)), "{what}");
        assert!(latency > 0.2 || ended == Some(Fault::CaptureLate), "{what}");
        assert!(world.stopped_at.is_some_and(|height| height < 0.36), "{what}");
    }
    let remark = TABLE[Fault::PoseContradicts as usize].remark.to_string();
    assert!(remark.contains("the latency of its poses"), "{remark}");
}

/// With its propeller on it: it presses down where it should lift.
#[test]
fn a_rotor_that_turns_the_wrong_way_round_never_leaves_the_ground_far() {
    for motor in 0..6 {
        let mut world = World::preset("tilt-hex", "measured", 821 + motor as u64);
        world.cruelty.borrow_mut().reversed = Some((motor, false));
        ends_gently(&mut world, &format!("reversed {motor}"));
        // Its number cannot be told from its direction: legs bear the difference. The sentence names both.
        assert_eq!(world.ended_by(), Some(Fault::MotorOrder), "{motor}");
        assert!(TABLE[Fault::MotorOrder as usize].remark.to_string().contains("spin direction"));
    }
}
