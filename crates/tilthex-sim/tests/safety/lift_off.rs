//! Wiring, axes and mounting that show before the ramp or in the first decimetres.

use crate::world::World;
use tilthex_core::{PoseSample, Vector3, so3, supervisor::Fault};

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
