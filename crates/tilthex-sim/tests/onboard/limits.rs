//! What the vehicle refuses, whatever its base has let through.

use tilthex_core::{Vector3, Vector6, so3, trajectory::Limits};
use tilthex_link::onboard::{GoTo, Order, Part};

use crate::world::{World, config};

/// Gives an order; returns whether the vehicle carries it out, and its newest text.
fn answered(world: &mut World, order: Order) -> (bool, String) {
    let (answers, texts) = (world.answers.len(), world.texts.len());
    world.order(order);
    world.until(1.0, |world| world.answers.len() > answers);
    world.run(0.05);
    (world.answers[answers], world.texts[texts..].concat())
}

#[test]
fn places_and_rates_are_limited_as_beside_the_vehicle() {
    let mut world = World::hover();
    let (start, most) = (world.record().setpoint, config().orders().limits());
    let place =
        GoTo { position_w: start.position_w, rotation_we: start.rotation_we, duration: 0.0, limits: most };
    // The message rounds the largest rates that may be ordered.
    assert!(answered(&mut world, Order::GoTo(place)).0);
    let fast = |limits| Order::GoTo(GoTo { limits, ..place });
    let turned = GoTo { rotation_we: so3::rot_x(2.0) * start.rotation_we, ..place };
    let away = GoTo { position_w: start.position_w + Vector3::new(2.95, 0.0, 0.0), ..place };
    for (order, says) in [
        (fast(Limits { velocity: 1.01 * most.velocity, ..most }), "a rate is above"),
        (fast(Limits { acceleration: 1.01 * most.acceleration, ..most }), "a rate is above"),
        (fast(Limits { angular_velocity: 1.01 * most.angular_velocity, ..most }), "a rate is above"),
        (fast(Limits { angular_acceleration: 1.01 * most.angular_acceleration, ..most }), "a rate is above"),
        (Order::GoTo(turned), "cannot hover in this attitude"),
        (Order::GoTo(away), "outside the geofence"),
    ] {
        let (accepted, said) = answered(&mut world, order);
        assert!(!accepted && said.contains(says), "{order:?} {said}");
    }
}

#[test]
fn an_admittance_that_is_not_safe_is_refused() {
    let mut world = World::hover();
    let admittance = config().controller().admittance;
    let (mass, damping) = (admittance.mass.diagonal(), admittance.damping.diagonal());
    let heavy = mass * 1.1 * (damping.component_div(&mass)).max() / 0.5;
    for (part, diagonal, refused) in [
        (Part::Mass, mass * 0.01, Some("the mass is too small")),
        (Part::Damping, damping * 0.01, Some("the damping is too weak")),
        // It would be used with the damping, which is too weak for it.
        (Part::Mass, heavy, None),
        (Part::Damping, damping, Some("the damping is too weak")),
        (Part::Damping, heavy, None),
        (Part::Stiffness, Vector6::zeros(), None),
        // What is as it is needs no check.
        (Part::Mass, mass, None),
        (Part::Damping, damping, None),
    ] {
        let (accepted, said) = answered(&mut world, Order::Admittance(part, diagonal));
        let expected = refused.is_none_or(|says| said.contains(says));
        assert!(accepted == refused.is_none() && expected, "{part:?} {diagonal} {said}");
    }
}
