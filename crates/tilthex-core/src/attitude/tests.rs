use super::*;
use crate::vehicle::{Mounting, Rotor, tests::tilt_hex};
use proptest::prelude::*;
use std::vec::Vec;

fn collinear() -> Vehicle {
    let v = tilt_hex();
    let rotors: Vec<Rotor> = v.rotors().iter().map(|r| Rotor { axis_r: Vector3::z(), ..*r }).collect();
    Vehicle::new(v.mass(), *v.inertia(), &rotors, 0.03, *v.tool(), Mounting::default()).unwrap()
}

fn selector(vehicle: &Vehicle) -> AttitudeSelector {
    AttitudeSelector::new(vehicle, AttitudeParams::default()).unwrap()
}

fn force() -> impl Strategy<Value = Vector3> {
    (-60.0..60.0f64, -60.0..60.0f64, 5.0..60.0f64).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

fn rotation() -> impl Strategy<Value = Matrix3> {
    (-0.5..0.5f64, -0.5..0.5f64, -3.0..3.0f64)
        .prop_map(|(x, y, z)| so3::rot_z(z) * so3::rot_x(x) * so3::rot_y(y))
}

fn attainable(s: &AttitudeSelector, force_r: &Vector3) -> bool {
    let f = s.section.nearest(&mut AllocatorState::default(), force_r, &RotorStatus::default()).force;
    (f - force_r).norm() < 1e-5 * force_r.norm()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// The turned attitude makes the force possible, and no smaller turn does.
    #[test]
    fn the_turn_is_the_least(f in force(), r in rotation(), others in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 60)) {
        for vehicle in [tilt_hex(), collinear()] {
            let s = selector(&vehicle);
            let turn = s.turn(&mut AttitudeState::default(), &r, &f, &RotorStatus::default());
            // No force that large, or that small.
            let Some(turn) = turn else { continue };
            let possible = so3::exp(&turn).transpose() * r.transpose() * f;
            prop_assert!(attainable(&s, &possible), "{turn:?} {possible:?}");
            for other in &others {
                let less = Vector3::from(*other).normalize() * (0.98 * turn.norm());
                let force_r = so3::exp(&less).transpose() * r.transpose() * f;
                prop_assert!(turn.norm() < 1e-3 || !attainable(&s, &force_r), "{turn:?} {less:?}");
            }
        }
    }

    /// What is possible as it is stays as it is, to the last bit.
    #[test]
    fn a_possible_force_turns_nothing(x in -4.0..4.0f64, y in -4.0..4.0f64, r in rotation(), w in -1.0..1.0f64) {
        let s = selector(&tilt_hex());
        let reference = Reference {
            angular_velocity_r: Vector3::new(w, -w, 2.0 * w),
            angular_acceleration_r: Vector3::new(w, w, -w),
            ..Reference::hold(Vector3::zeros(), r)
        };
        let force_w = r * Vector3::new(x, y, 23.5);
        let mut state = AttitudeState::default();
        for _ in 0..5 {
            let out = s.step(&mut state, &reference, &force_w, &RotorStatus::default(), 0.002);
            prop_assert_eq!(out, Attitude { reference, lead_r: Vector3::zeros(), force_w });
        }
    }

    /// Every result is a number, and a turn for horizontal force is never larger than allowed.
    #[test]
    fn anything_is_survived(f in prop::array::uniform3(prop_oneof![-1e3..1e3f64, Just(0.0), Just(1e12), Just(-1e12)]), r in rotation(), lost in 0..64u16) {
        for vehicle in [tilt_hex(), collinear()] {
            let s = selector(&vehicle);
            let (mut state, rotors) = (AttitudeState::default(), RotorStatus { lost, ..RotorStatus::default() });
            let reference = Reference::hold(Vector3::zeros(), r);
            for _ in 0..50 {
                let out = s.step(&mut state, &reference, &Vector3::from(f), &rotors, 0.02);
                prop_assert!(so3::rotation_defect(&out.reference.rotation_wr) < 1e-9);
                prop_assert!(crate::types::is_finite3(&out.force_w));
            }
            let up = Vector3::new(0.0, 0.0, s.weight);
            let upright = s.turn(&mut state, &r, &up, &rotors).unwrap_or_default();
            let (target, _) = s.target(&mut state, &r, &Vector3::from(f), &rotors);
            let apart = so3::angle(&(so3::exp(&upright).transpose() * so3::exp(&target)));
            prop_assert!(apart <= s.params.max_turn + 1e-9 || target == Vector3::zeros(), "{target:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Rate and acceleration are the derivatives of the attitude, also where the wanted one jumps;
    /// the acceleration stays within its limits.
    #[test]
    fn the_reference_is_consistent(f in force(), r in rotation(), jump in rotation(), spin in -1.0..1.0f64) {
        for s in [selector(&collinear()), selector(&tilt_hex())] {
            let mut state = AttitudeState::default();
            let dt = 1e-4;
            let at = |k: i32| {
                let turned = if k < 1000 { r } else { r * jump };
                Reference {
                    rotation_wr: turned * so3::rot_z(spin * f64::from(k) * dt),
                    angular_velocity_r: Vector3::new(0.0, 0.0, spin),
                    ..Reference::hold(Vector3::zeros(), r)
                }
            };
            let mut step = |k: i32| s.step(&mut state, &at(k), &f, &RotorStatus::default(), dt);
            let mut last = step(0).reference;
            for k in 1..3000 {
                let next = step(k).reference;
                let rate = so3::log(&(last.rotation_wr.transpose() * next.rotation_wr)) / dt;
                let middle = 0.5 * (last.angular_velocity_r + next.angular_velocity_r);
                prop_assert!((rate - middle).norm() < 1e-6 * (1.0 + middle.norm()), "{k} {rate} {middle}");
                let gained = (next.angular_velocity_r - last.angular_velocity_r) / dt;
                let middle = 0.5 * (last.angular_acceleration_r + next.angular_acceleration_r);
                let defect = (gained - middle).norm() / (1.0 + middle.norm());
                // At the jump itself the carried velocity turns: a small part of an acceleration.
                prop_assert!(defect < if k == 1000 { 0.2 } else { 5e-3 }, "{k} {gained} {middle}");
                last = next;
            }
        }
    }

    /// A turn ends with the tool where its reference is, which may move; velocity and acceleration are the derivatives.
    #[test]
    fn the_tool_stays_where_it_is_told(
        lever in prop::array::uniform3(-0.5..0.5f64), turn in prop::array::uniform3(-0.8..0.8f64),
        r in rotation(), spin in prop::array::uniform3(-1.0..1.0f64),
    ) {
        let (lever, spin) = (Vector3::from(lever), Vector3::from(spin));
        let filter = AboutTool::new(&lever);
        let (mut led, turn, dt) = (Led::default(), Vector3::from(turn), 0.002);
        let tool = Vector3::new(1.0, 2.0, 3.0);
        let mut at = |k: i32| {
            let rotation_wr = r * so3::exp(&(spin * f64::from(k) * dt));
            let attitude = Reference { angular_velocity_r: spin, ..Reference::hold(tool, rotation_wr) };
            let wanted = admittance::about_tool(&Setpoint::hold(tool, rotation_wr), &attitude, &lever);
            filter.lead(&mut led, wanted, &turn, dt)
        };
        let mut last = at(0);
        for k in 1..(16.0 / filter.rate / dt) as i32 {
            let next = at(k);
            let velocity = (next.position_w - last.position_w) / dt - 0.5 * (next.velocity_w + last.velocity_w);
            let gained = (next.velocity_w - last.velocity_w) / dt;
            let acceleration = gained - 0.5 * (next.acceleration_w + last.acceleration_w);
            prop_assert!(velocity.norm() < 1e-3 && acceleration.norm() < 0.02, "{k} {velocity} {acceleration}");
            last = next;
        }
        let end = last.position_w + last.rotation_wr * so3::exp(&turn) * lever;
        prop_assert!((end - tool).norm() < 1e-4, "{end}");
    }

    /// Leading the centre of mass never takes more than 0.57 of the force that the turn gives: the filter's impulse
    /// response, integrated without its sign, is `(2 + 2 / e^2) w^2`.
    #[test]
    fn leading_takes_less_than_a_turn_gives(
        lever in prop::array::uniform3(-0.5..0.5f64), angles in prop::collection::vec(-0.6..0.6f64, 30), dt in 0.001..0.01f64,
    ) {
        let lever = Vector3::from(lever);
        prop_assume!(lever.norm() > 0.02);
        let filter = AboutTool::new(&lever);
        let axis = lever.cross(&Vector3::new(0.3, -0.5, 0.7)).normalize();
        let wanted = Reference::hold(Vector3::zeros(), Matrix3::identity());
        let (mut led, mut most) = (Led::default(), 0.0f64);
        for angle in &angles {
            for _ in 0..(0.5 / dt) as usize {
                let led = filter.lead(&mut led, wanted, &(axis * *angle), dt);
                most = most.max(led.acceleration_w.norm());
            }
        }
        let largest = angles.iter().fold(0.0, |m: f64, a| m.max(a.abs()));
        prop_assert!(most < 0.57 * crate::GRAVITY * largest, "{most} {largest}");
    }

    /// Whatever the target, the turn keeps its limits, is what lagging rotors make of it, and arrives.
    #[test]
    fn a_turn_keeps_its_limits_and_arrives(target in prop::array::uniform3(-1.5..1.5f64), bandwidth in 2.0..500.0f64, dt in 0.001..0.02f64) {
        let limits = TurnLimits { tilt: 60.0, yaw: 5.0 };
        let filter = TurnFilter { limits, bandwidth, lag: 0.03 };
        let (mut state, target) = (TurnState::default(), Vector3::from(target));
        let wanted = Reference::hold(Vector3::zeros(), Matrix3::identity());
        let (mut farthest, mut lagged) = (0.0f64, Vector3::zeros());
        for _ in 0..(16.0 / dt) as usize {
            let lead = filter.step(&mut state, &mut { wanted }, &target, dt);
            let a = state.acceleration_r;
            // Rotors that follow with the lag give the acceleration.
            let asked = a + lead;
            lagged = asked + (lagged - asked) * libm::exp(-dt / 0.03);
            prop_assert!((lagged - a).norm() < 60.0 * dt / 0.03, "{lagged} {a}");
            prop_assert!(a.xy().norm() <= 60.0 + 1e-9 && a.z.abs() <= 5.0 + 1e-9, "{a:?}");
            farthest = farthest.max(state.turn.norm());
        }
        let left = so3::angle(&(so3::exp(&state.turn).transpose() * so3::exp(&target)));
        prop_assert!(left < 1e-5, "{left} {state:?}");
        prop_assert!(farthest < 1.2 * target.norm() + 1e-9, "{farthest}");
    }
}

/// However the wanted attitude rolls, a vehicle that must be upright is.
#[test]
fn a_hover_is_found_from_any_attitude() {
    let s = selector(&collinear());
    let weight = Vector3::new(0.0, 0.0, s.weight);
    for degrees in 0..=180 {
        let r = so3::rot_z(0.3) * so3::rot_x(f64::from(degrees).to_radians()) * so3::rot_y(0.1);
        let (turn, force) = s.target(&mut AttitudeState::default(), &r, &weight, &RotorStatus::default());
        let up = r * so3::exp(&turn) * Vector3::z();
        assert!(up.z > 1.0 - 1e-9, "{degrees} {up}");
        assert_eq!(force, weight);
    }
}

/// Half of what the torque limits of six rotors give, by the geometry of the Tilt-Hex.
#[test]
fn turns_use_half_of_what_a_hover_leaves() {
    let v = tilt_hex();
    let limits = TurnLimits::of(&v);
    let allocator = crate::allocation::Allocator::new(&v);
    let given_up = |alpha: Vector3| {
        let t = v.inertia() * alpha;
        allocator.allocate(&crate::types::Vector6::new(0.0, 0.0, v.weight(), t.x, t.y, t.z)).given_up
    };
    for k in 0..100 {
        let direction = Vector3::new(f64::from(k).cos(), f64::from(k).sin(), 0.0);
        let kept = given_up(direction * 1.9 * limits.tilt);
        assert!(matches!(kept, None | Some(crate::allocation::Priority::LateralForce)), "{kept:?}");
    }
    assert_eq!(given_up(Vector3::z() * 2.01 * limits.yaw), Some(crate::allocation::Priority::YawTorque));
}

#[test]
fn a_collinear_vehicle_points_its_thrust() {
    let s = selector(&collinear());
    let f = Vector3::new(3.0, -4.0, 24.0);
    let turn = s.turn(&mut AttitudeState::default(), &so3::rot_z(1.0), &f, &RotorStatus::default()).unwrap();
    let up = so3::rot_z(1.0) * so3::exp(&turn) * Vector3::z();
    assert!((up - f.normalize()).norm() < 1e-7, "{up}");
}

#[test]
fn a_level_attitude_keeps_the_heading() {
    let params = AttitudeParams { mode: AttitudeMode::ZeroTilt, ..AttitudeParams::default() };
    let s = AttitudeSelector::new(&tilt_hex(), params).unwrap();
    let r = so3::rot_z(0.7) * so3::rot_y(0.3) * so3::rot_x(-0.2);
    let mut state = AttitudeState::default();
    let reference = s.reference(&mut state, &Setpoint::hold(Vector3::zeros(), r), 0.002);
    let force = Vector3::new(30.0, 0.0, 20.0);
    let out = s.step(&mut state, &reference, &force, &RotorStatus::default(), 0.002);
    assert!((out.reference.rotation_wr - so3::rot_z(0.7)).amax() < 1e-12);
    assert_eq!(out.force_w, force);
    let refused = AttitudeSelector::new(&collinear(), params).unwrap_err();
    assert!(std::string::ToString::to_string(&refused).contains("zero-tilt"));
}

/// Every force that is neither too large nor too small is possible after some turn; rare
/// corners of the section are in here.
#[test]
fn a_turn_is_found_wherever_there_is_one() {
    let s = selector(&tilt_hex());
    let mut random = crate::random::Random::new(5);
    for _ in 0..100_000 {
        let f = Vector3::new(12.0 * random.normal(), 12.0 * random.normal(), 25.0 + 4.0 * random.normal());
        if !(10.0..55.0).contains(&f.norm()) {
            continue;
        }
        let turn = s.turn(&mut AttitudeState::default(), &Matrix3::identity(), &f, &RotorStatus::default());
        let turn = turn.unwrap_or_else(|| panic!("{f:?}"));
        assert!(attainable(&s, &(so3::exp(&turn).transpose() * f)), "{f:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// What the last call found only tells where to look first: the turn and the force are the same.
    #[test]
    fn a_search_that_starts_warm_ends_where_a_cold_one_does(
        f in force(), r in rotation(), changes in prop::collection::vec(prop::array::uniform3(-3.0..3.0f64), 8),
    ) {
        let s = selector(&tilt_hex());
        let mut warm = AttitudeState::default();
        let mut f = Vector3::from(f);
        for change in changes {
            f += Vector3::from(change);
            let found = s.target(&mut warm, &r, &f, &RotorStatus::default());
            let cold = s.target(&mut AttitudeState::default(), &r, &f, &RotorStatus::default());
            prop_assert!((found.0 - cold.0).norm() < 1e-6 && (found.1 - cold.1).norm() < 1e-3 * f.norm(), "{found:?} {cold:?}");
        }
    }

    /// A plane cuts off what is not possible, and only that: its point nearest to the force is not.
    #[test]
    fn a_plane_parts_a_force_from_the_section(f in force()) {
        let s = selector(&tilt_hex());
        let (f, rotors) = (Vector3::from(f), RotorStatus::default());
        let nearest = s.section.nearest(&mut AllocatorState::default(), &f, &rotors).force;
        let distance = (f - nearest).norm();
        match s.section.cut(&mut AllocatorState::default(), &f, &rotors, 1e-6) {
            None => prop_assert!(distance < 1e-5, "{distance}"),
            Some((normal, offset)) => {
                prop_assert!((normal.norm() - 1.0).abs() < 1e-12);
                let beyond = normal.dot(&f) - offset;
                prop_assert!(beyond > 1e-6 && beyond < distance + 1e-6, "{beyond} {distance}");
                prop_assert!(normal.dot(&nearest) < offset + 1e-6);
            }
        }
    }
}

/// The search ends at the border, wherever it begins, after few trials if turns grow smoothly, and after some if they do not.
#[test]
fn the_largest_step_is_found_in_few_trials() {
    let mut random = crate::random::Random::new(6);
    let (mut most, mut sum) = ([0u32; 2], 0u32);
    const COUNT: u32 = 20_000;
    for _ in 0..COUNT {
        let uniform = |random: &mut crate::random::Random| {
            0.5 + 0.5 * libm::erf(random.normal() / core::f64::consts::SQRT_2)
        };
        let (slope, curve) = (0.3 + 3.0 * uniform(&mut random), 0.8 * uniform(&mut random) - 0.3);
        let corner = if uniform(&mut random) < 0.3 { uniform(&mut random) } else { 2.0 };
        let max = 0.6;
        let angle = |part: u16| {
            let x = f64::from(part) / f64::from(STEPS);
            (x < corner).then(|| libm::atan(slope * x + curve * x * x * slope))
        };
        let border = (0..=STEPS).rev().find(|p| angle(*p).is_some_and(|a| a <= max)).unwrap();
        for first in [STEPS, (f64::from(border) + 4.0 * random.normal()).clamp(0.0, 4096.0) as u16] {
            let mut trials = 0;
            let none = Trial { turn: Vector3::zeros(), room: max };
            let (turn, part) = search(first, STEPS, none, |part| {
                trials += 1;
                let a = angle(part)?;
                Some(Trial { turn: Vector3::new(a, 0.0, 0.0), room: max - a })
            });
            assert_eq!(part, border, "{slope} {curve} {corner} {first}");
            assert_eq!(turn.x, angle(part).unwrap());
            let smooth = usize::from(corner < 1.0);
            most[smooth] = most[smooth].max(trials);
            sum += trials;
        }
    }
    std::println!("{most:?}, mean {:.2}", f64::from(sum) / f64::from(2 * COUNT));
    assert!(most[0] <= 8 && most[1] <= 16, "{most:?}");
}

/// A force of a size has a turn if and only if the size is at most that of the farthest corner of the section.
#[test]
fn no_turn_makes_more_than_the_largest_force_possible() {
    let s = selector(&tilt_hex());
    let largest = s.section.largest().unwrap();
    let mut random = crate::random::Random::new(7);
    let mut turn = |size: f64| {
        let f = Vector3::from_fn(|_, _| random.normal()).normalize() * size;
        s.turn(&mut AttitudeState::default(), &Matrix3::identity(), &f, &RotorStatus::default())
    };
    for _ in 0..1000 {
        assert!(turn(1.0001 * largest).is_none());
        assert!(turn(0.9999 * largest).is_some());
    }
    assert!(selector(&collinear()).section.largest().is_none());
}
