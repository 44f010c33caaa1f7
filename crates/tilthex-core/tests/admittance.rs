//! The admittance filter against closed forms and symmetry.

#![allow(clippy::unwrap_used)]

#[path = "admittance/law.rs"]
mod law;

mod common;

use common::{rotation, vector, wrench};
use proptest::prelude::*;
use tilthex_core::{
    Matrix3, Matrix6, Setpoint, Vector3, Vector6, Wrench,
    admittance::{AdmittanceFilter, AdmittanceParams, AdmittanceState, Axes, centre_of_mass_reference},
    so3,
    vehicle::Mounting,
};

fn diagonal(mass: [f64; 6], damping: [f64; 6], stiffness: [f64; 6]) -> AdmittanceParams {
    let m = |d: [f64; 6]| Matrix6::from_diagonal(&Vector6::from(d));
    AdmittanceParams {
        mass: m(mass),
        damping: m(damping),
        stiffness: m(stiffness),
        max_translation: 100.0,
        max_rotation: 3.0,
        axes: Axes::World,
    }
}

/// Position of m x'' + d x' + k x = f from rest at 0 after t.
fn spring(m: f64, d: f64, k: f64, f: f64, t: f64) -> f64 {
    let disc = d * d - 4.0 * m * k;
    let end = f / k;
    if disc.abs() < 1e-9 {
        let s = -d / (2.0 * m);
        return end * (1.0 - (1.0 - s * t) * (s * t).exp());
    }
    if disc > 0.0 {
        let (a, b) = ((-d + disc.sqrt()) / (2.0 * m), (-d - disc.sqrt()) / (2.0 * m));
        end * (1.0 + (b * (a * t).exp() - a * (b * t).exp()) / (a - b))
    } else {
        let (s, w) = (-d / (2.0 * m), (-disc).sqrt() / (2.0 * m));
        end * (1.0 - (s * t).exp() * ((w * t).cos() - s / w * (w * t).sin()))
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn equals_the_spring_in_closed_form(
        m in 0.5..5.0f64, d in 1.0..30.0f64, k in 1.0..40.0f64, force in vector(5.0), dt in 0.5e-3..5e-3f64,
    ) {
        let filter = AdmittanceFilter::new(diagonal([m, m, m, 0.1, 0.1, 0.1], [d, d, d, 1.0, 1.0, 1.0], [k, k, k, 5.0, 5.0, 5.0])).unwrap();
        let mut state = AdmittanceState::default();
        let setpoint = Setpoint::hold(Vector3::new(0.0, 0.0, 1.0), Matrix3::identity());
        let push = Wrench { force, torque: Vector3::zeros() };
        for i in 1..=500 {
            filter.step(&mut state, &setpoint, &push, dt);
            let x = spring(m, d, k, 1.0, f64::from(i) * dt);
            prop_assert!((state.translation_w - force * x).amax() < 1e-6);
        }
    }

    #[test]
    fn a_torque_about_one_axis_turns_about_it(axis in vector(1.0), torque in 0.1..3.0f64) {
        prop_assume!(axis.norm() > 0.1);
        let axis = axis.normalize();
        let filter = AdmittanceFilter::new(diagonal([1.5; 6], [4.0; 6], [8.0; 6])).unwrap();
        let mut state = AdmittanceState::default();
        let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        let push = Wrench { force: Vector3::zeros(), torque: axis * torque };
        for _ in 0..20_000 {
            filter.step(&mut state, &setpoint, &push, 0.002);
        }
        // At rest K sin(angle) = torque.
        let turned = so3::log(&state.rotation);
        prop_assert!((turned - axis * (torque / 8.0).asin()).amax() < 1e-9);
    }

    #[test]
    fn turning_the_world_turns_the_reference(
        yaw in -3.0..3.0f64, position in vector(1.0), attitude in rotation(), push in wrench(3.0, 0.5), omega in vector(0.5),
    ) {
        let p = diagonal([1.5, 1.5, 1.5, 0.05, 0.05, 0.02], [10.0, 10.0, 8.0, 4.0, 4.0, 2.0], [6.0, 6.0, 9.0, 3.0, 3.0, 5.0]);
        let filter = AdmittanceFilter::new(p).unwrap();
        let turn = so3::rot_z(yaw);
        let setpoint = Setpoint { angular_velocity_w: omega, ..Setpoint::hold(position, attitude) };
        let turned = Setpoint { angular_velocity_w: turn * omega, ..Setpoint::hold(turn * position, turn * attitude) };
        let turned_push = Wrench { force: turn * push.force, torque: turn * push.torque };
        let (mut a, mut b) = (AdmittanceState::default(), AdmittanceState::default());
        for _ in 0..200 {
            let x = filter.step(&mut a, &setpoint, &push, 0.002);
            let y = filter.step(&mut b, &turned, &turned_push, 0.002);
            prop_assert!((turn * x.reference.position_w - y.reference.position_w).amax() < 1e-10);
            prop_assert!((turn * x.reference.rotation_we - y.reference.rotation_we).amax() < 1e-10);
        }
    }

    #[test]
    fn enabling_does_not_jump(
        position in vector(1.0), attitude in rotation(), to in vector(1.0), new_attitude in rotation(), push in wrench(3.0, 0.3),
    ) {
        let filter = AdmittanceFilter::new(diagonal([1.5; 6], [10.0; 6], [6.0; 6])).unwrap();
        let here = Setpoint::hold(position, attitude);
        let mut state = AdmittanceState::default();
        let mut reference = here;
        for _ in 0..100 {
            reference = filter.step(&mut state, &here, &push, 0.002).reference;
        }
        // Within the excursion limit: beyond it the filter must pull back.
        prop_assume!(so3::angle(&(reference.rotation_we * new_attitude.transpose())) < 2.9);
        let there = Setpoint::hold(to, new_attitude);
        let mut state = AdmittanceState::at(&reference, &there);
        let after = filter.step(&mut state, &there, &push, 1e-9).reference;
        prop_assert!((after.position_w - reference.position_w).amax() < 1e-7);
        prop_assert!((after.rotation_we - reference.rotation_we).amax() < 1e-7);
        prop_assert!((after.velocity_w - reference.velocity_w).amax() < 1e-6);
    }

    #[test]
    fn excursion_stays_within_its_limits(push in wrench(50.0, 20.0), limit in 0.05..0.5f64, turn in 0.1..1.0f64) {
        let p = AdmittanceParams { max_translation: limit, max_rotation: turn, ..diagonal([1.5; 6], [5.0; 6], [2.0; 6]) };
        let filter = AdmittanceFilter::new(p).unwrap();
        let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        let mut state = AdmittanceState::default();
        for _ in 0..1000 {
            let out = filter.step(&mut state, &setpoint, &push, 0.002);
            prop_assert!(out.reference.position_w.norm() <= limit + 1e-12);
            prop_assert!(so3::angle(&out.reference.rotation_we) <= turn + 1e-9);
        }
    }

    /// At its limits the reference stands still, and nothing is fed forward that would move it.
    #[test]
    fn a_reference_at_its_limit_is_not_accelerated_outwards(push in wrench(50.0, 20.0), limit in 0.05..0.5f64, turn in 0.1..1.0f64) {
        prop_assume!(push.force.norm() > 10.0 && push.torque.norm() > 5.0);
        let p = AdmittanceParams { max_translation: limit, max_rotation: turn, ..diagonal([1.5; 6], [5.0; 6], [2.0; 6]) };
        let filter = AdmittanceFilter::new(p).unwrap();
        let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        let mut state = AdmittanceState::default();
        for _ in 0..3000 {
            let out = filter.step(&mut state, &setpoint, &push, 0.002);
            if out.reference.position_w.norm() >= limit - 1e-12 && out.limited {
                prop_assert!(out.reference.acceleration_w.dot(&out.reference.position_w) < 1e-9);
            }
        }
        let rest = filter.step(&mut state, &setpoint, &push, 0.002).reference;
        prop_assert!(rest.velocity_w.norm() < 1e-6 && rest.acceleration_w.norm() < 1e-6);
        prop_assert!(rest.angular_velocity_w.norm() < 1e-6 && rest.angular_acceleration_w.norm() < 1e-6);
    }

    #[test]
    fn the_robot_reference_is_the_derivative_of_itself(
        position in vector(1.0), attitude in rotation(), v in vector(1.0), w in vector(1.0), a in vector(1.0), alpha in vector(1.0),
        tool in (vector(0.5), rotation()),
    ) {
        let tool = Mounting { position_r: tool.0, rotation_r: tool.1 };
        // The tool after a time t of constant acceleration, to second order.
        let at = |t: f64| centre_of_mass_reference(&Setpoint {
            position_w: position + v * t + 0.5 * a * t * t,
            rotation_we: so3::exp(&(w * t + 0.5 * alpha * t * t)) * attitude,
            velocity_w: v + a * t,
            angular_velocity_w: w + alpha * t,
            acceleration_w: a,
            angular_acceleration_w: alpha,
            ..Setpoint::hold(position, attitude)
        }, &tool);
        let h = 1e-5;
        let (before, now, after) = (at(-h), at(0.0), at(h));
        let velocity = (after.position_w - before.position_w) / (2.0 * h);
        let acceleration = (after.velocity_w - before.velocity_w) / (2.0 * h);
        prop_assert!((velocity - now.velocity_w).amax() < 1e-7);
        prop_assert!((acceleration - now.acceleration_w).amax() < 1e-7);
        let omega = so3::log(&(before.rotation_wr.transpose() * after.rotation_wr)) / (2.0 * h);
        prop_assert!((omega - now.angular_velocity_r).amax() < 1e-7);
    }
}

/// A turn that ends where it began gains nothing; printed as it is, the spring gives 0.92 J away.
#[test]
fn the_spring_gains_nothing_on_a_closed_way() {
    let work = |stiffness: [f64; 3]| {
        let [a, b, c] = stiffness;
        let p = diagonal([1.0; 6], [1.0; 6], [1.0, 1.0, 1.0, a, b, c]);
        let filter = AdmittanceFilter::new(p).unwrap();
        let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        // Of a filter at rest the acceleration is the spring's pull, by its unit inertia.
        let torque = |rotation: Matrix3| {
            let mut state = AdmittanceState { rotation, ..AdmittanceState::default() };
            filter.step(&mut state, &setpoint, &Wrench::ZERO, 0.0).reference.angular_acceleration_w
        };
        let corner = 30f64.to_radians();
        let way = [Vector3::x(), Vector3::y(), Vector3::z(), -Vector3::x(), -Vector3::y()];
        let mut rotation = Matrix3::identity();
        let (mut sum, steps) = (0.0, 4000);
        let mut turn = |rotation: &mut Matrix3, by: Vector3| {
            for _ in 0..steps {
                let half = so3::exp(&(by / (2.0 * f64::from(steps))));
                let middle = half * *rotation;
                sum += torque(middle).dot(&(by / f64::from(steps)));
                *rotation = half * middle;
            }
        };
        for axis in way {
            turn(&mut rotation, axis * corner);
        }
        let back = -so3::log(&rotation);
        turn(&mut rotation, back);
        sum
    };
    assert!(work([8.0, 5.0, 10.0]).abs() < 1e-7, "{}", work([8.0, 5.0, 10.0]));
    assert!(work([8.0, 5.0, 35.0]).abs() > 0.1, "no potential here: {}", work([8.0, 5.0, 35.0]));
}

#[test]
fn a_filter_says_whether_its_spring_has_a_potential() {
    let filter = |k: [f64; 3]| {
        AdmittanceFilter::new(diagonal([1.0; 6], [1.0; 6], [1.0, 1.0, 1.0, k[0], k[1], k[2]])).unwrap()
    };
    assert!(filter([10.0, 10.0, 5.0]).has_potential() && filter([0.0, 5.0, 5.0]).has_potential());
    assert!(!filter([8.0, 5.0, 35.0]).has_potential() && !filter([0.0, 0.0, 5.0]).has_potential());
    // Without one it is the printed form, K vee(Q).
    let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
    let rotation = so3::exp(&Vector3::new(0.3, -0.5, 0.4));
    let mut state = AdmittanceState { rotation, ..AdmittanceState::default() };
    let out = filter([8.0, 5.0, 35.0]).step(&mut state, &setpoint, &Wrench::ZERO, 0.0).reference;
    let printed = Vector3::new(8.0, 5.0, 35.0).component_mul(&so3::vee(&rotation));
    assert!((out.angular_acceleration_w + printed).amax() < 1e-12);
}

#[test]
fn bad_matrices_are_named() {
    let good = diagonal([1.0; 6], [1.0; 6], [1.0; 6]);
    let mut bad = good;
    bad.stiffness[(0, 0)] = -1.0;
    assert!(
        AdmittanceFilter::new(bad)
            .unwrap_err()
            .to_string()
            .starts_with("admittance stiffness has the eigenvalue")
    );
    let mut bad = good;
    bad.damping[(0, 1)] = 0.5;
    assert!(AdmittanceFilter::new(bad).unwrap_err().to_string().contains("differs from its transpose"));
    let mut bad = good;
    bad.mass[(3, 3)] = f64::NAN;
    assert!(AdmittanceFilter::new(bad).unwrap_err().to_string().contains("NaN"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// About one axis the filter is the spring in the sine of the angle, to 1e-6 rad.
    #[test]
    fn a_turn_about_one_axis_is_the_spring_in_the_sine(
        m in 0.01..0.1f64, d in 0.5..4.0f64, k in 0.0..10.0f64, torque in -1.75..1.75f64,
    ) {
        let filter = AdmittanceFilter::new(AdmittanceParams {
            max_rotation: 2.9, ..diagonal([1.0, 1.0, 1.0, m, m, m], [1.0, 1.0, 1.0, d, d, d], [1.0, 1.0, 1.0, k, k, k])
        }).unwrap();
        let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        let push = Wrench { force: Vector3::zeros(), torque: Vector3::new(0.0, 0.0, torque) };
        let rate = |y: [f64; 2]| [y[1], (torque - d * y[1] - k * y[0].sin()) / m];
        let (mut state, mut y) = (AdmittanceState::default(), [0.0, 0.0]);
        for _ in 0..100 {
            filter.step(&mut state, &setpoint, &push, 0.002);
            for _ in 0..100 {
                let h = 2e-5;
                let on = |a: [f64; 2], b: [f64; 2], h: f64| [a[0] + h * b[0], a[1] + h * b[1]];
                let k1 = rate(y);
                let k2 = rate(on(y, k1, 0.5 * h));
                let k3 = rate(on(y, k2, 0.5 * h));
                let k4 = rate(on(y, k3, h));
                y = core::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
            }
            if y[0].abs() > 2.5 {
                break;
            }
            prop_assert!((so3::log(&state.rotation).z - y[0]).abs() < 1e-6, "{state:?} {y:?}");
        }
    }
}
