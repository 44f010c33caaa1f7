use super::*;
use crate::vehicle::{Mounting, Rotor, tests::tilt_hex};
use crate::{Matrix3, Vector3};
use proptest::prelude::*;
use std::vec::Vec;

/// Rotors anywhere, thrust mostly upwards, one-way or reversing, not all alike.
fn rotor() -> impl Strategy<Value = Rotor> {
    let axis = (-1.0..1.0f64, -1.0..1.0f64, 0.2..2.0f64);
    let position = prop::array::uniform3(-0.5..0.5f64);
    (
        axis,
        position,
        any::<bool>(),
        5e-4..2e-3f64,
        prop_oneof![Just(16.0), Just(0.0), Just(-80.0)],
        80.0..120.0f64,
    )
        .prop_map(|((x, y, z), p, spin, thrust_coefficient, min_speed, max_speed)| Rotor {
            position_r: Vector3::from(p),
            axis_r: Vector3::new(x, y, z).normalize(),
            spin: if spin { 1.0 } else { -1.0 },
            thrust_coefficient,
            drag_coefficient: 2.4e-5,
            min_speed,
            max_speed,
        })
}

fn vehicle() -> impl Strategy<Value = Vehicle> {
    vehicle_of(4..=MAX_ROTORS)
}

fn vehicle_of(rotors: impl Into<prop::collection::SizeRange>) -> impl Strategy<Value = Vehicle> {
    prop::collection::vec(rotor(), rotors).prop_filter_map("the rotors turn it", |rotors| {
        let (tool, imu) = (Mounting::default(), Mounting::default());
        Vehicle::new(2.0, Matrix3::identity(), &rotors, 0.03, tool, imu).ok().filter(|v| v.condition() < 1e4)
    })
}

/// Three rotors lift, two push along x and one along y, without drag: some parts of a wrench have no effect on some rotors.
fn blocks() -> impl Strategy<Value = Vehicle> {
    const ROTORS: [([f64; 2], [f64; 3]); 6] = [
        ([0.4, 0.0], [0.0, 0.0, 1.0]),
        ([-0.2, 0.3], [0.0, 0.0, 1.0]),
        ([-0.2, -0.3], [0.0, 0.0, 1.0]),
        ([0.0, 0.3], [1.0, 0.0, 0.0]),
        ([0.0, -0.3], [1.0, 0.0, 0.0]),
        ([0.0, 0.0], [0.0, 1.0, 0.0]),
    ];
    (0..6usize, prop_oneof![Just(0.0), Just(2.4e-5)]).prop_filter_map(
        "a full rank",
        |(first, drag_coefficient)| {
            let mut rotors = ROTORS.map(|([x, y], axis)| Rotor {
                position_r: Vector3::new(x, y, 0.0),
                axis_r: Vector3::from(axis),
                spin: 1.0,
                thrust_coefficient: 1e-3,
                drag_coefficient,
                min_speed: -80.0,
                max_speed: 110.0,
            });
            rotors.rotate_left(first);
            let (tool, imu) = (Mounting::default(), Mounting::default());
            Vehicle::new(2.0, Matrix3::identity(), &rotors, 0.03, tool, imu).ok()
        },
    )
}

/// Inside the reach, at its edge (all rotors at limits), around, far away, not numbers.
fn wrench() -> impl Strategy<Value = Wanted> {
    let sides = prop::array::uniform12(prop_oneof![Just(0.0), Just(0.5), Just(1.0)]);
    prop_oneof![
        prop::array::uniform12(0.0..1.0f64).prop_map(|u| Wanted::Reach(u, 1.0)),
        (sides, prop_oneof![Just(1.0), Just(1.0 + 1e-9), Just(2.0), Just(1e9), Just(1e300)])
            .prop_map(|(u, far)| Wanted::Reach(u, far)),
        (prop::array::uniform3(-60.0..60.0f64), prop::array::uniform3(-8.0..8.0f64))
            .prop_map(|(f, t)| Wanted::Wrench([f[0], f[1], f[2] + 20.0, t[0], t[1], t[2]])),
        (0..6usize, prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-1e308), Just(0.0)])
            .prop_map(|(i, x)| Wanted::Wrench(core::array::from_fn(|j| if i == j { x } else { 1.0 }))),
    ]
}

#[derive(Clone, Copy, Debug)]
enum Wanted {
    /// Fractions of the inputs' range, and a factor.
    Reach([f64; MAX_ROTORS], f64),
    Wrench([f64; 6]),
}

impl Wanted {
    fn of(self, vehicle: &Vehicle, allocator: &Allocator) -> Vector6 {
        match self {
            Self::Wrench(w) => Vector6::from(w),
            Self::Reach(fractions, far) => {
                let range = allocator.upper - allocator.lower;
                let u = allocator.lower + range.component_mul(&RotorVector::from(fractions));
                vehicle.allocation() * u * far
            }
        }
    }
}

/// The errors of the parts.
fn cost(
    vehicle: &Vehicle,
    r: &Matrix3,
    by_world: bool,
    wanted: &Vector6,
    inputs: &RotorVector,
    order: &[Priority; 4],
) -> Vec<f64> {
    let error_r = wanted - vehicle.allocation() * inputs;
    let error = if by_world { turned(r, &error_r) } else { error_r };
    order.iter().map(|p| p.rows().iter().map(|r| error[*r].powi(2)).sum::<f64>().sqrt()).collect()
}

fn attitude() -> impl Strategy<Value = Matrix3> {
    prop::array::uniform3(-3.0..3.0f64).prop_map(|v| crate::so3::exp(&Vector3::from(v)))
}

fn order() -> impl Strategy<Value = [Priority; 4]> {
    Just(Priority::ORDER.to_vec()).prop_shuffle().prop_map(|v| [v[0], v[1], v[2], v[3]])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn limits_hold_and_the_search_ends(v in vehicle(), w in wrench(), order in order()) {
        let a = Allocator::with_params(&v, AllocatorParams { order, horizon: 0.0 }).unwrap();
        let out = a.allocate(&w.of(&v, &a));
        prop_assert!(within(MAX_ROTORS, &out.inputs, &a.lower, &a.upper), "{out:?}");
        prop_assert!(out.wrench.iter().chain(&out.shortfall).all(|x| x.is_finite()));
        prop_assert!(out.iterations <= 8 * v.rotors().len() as u32, "{}", out.iterations);
    }

    #[test]
    fn a_wrench_within_reach_is_produced(v in vehicle(), u in prop::array::uniform12(0.0..=1.0f64)) {
        let a = Allocator::new(&v);
        let wanted = Wanted::Reach(u, 1.0).of(&v, &a);
        let out = a.allocate(&wanted);
        prop_assert!((out.wrench - wanted).amax() < 1e-9 * (1.0 + wanted.amax()), "{out:?}");
        prop_assert_eq!(out.given_up, None);
        if v.rank() == v.rotors().len() {
            let exact = v.allocation_inverse() * wanted;
            prop_assert!((out.inputs - exact).amax() < 1e-9 * a.upper.amax() * v.condition());
        }
    }

    /// No inputs are better in the order of priorities: not the clip, not small changes.
    #[test]
    fn no_other_inputs_are_better(
        v in vehicle(), w in wrench(), order in order(), r in attitude(),
        turn in prop::array::uniform12(-1.0..1.0f64), size in -6.0..0.0f64,
    ) {
        let a = Allocator::with_params(&v, AllocatorParams { order, horizon: 0.0 }).unwrap();
        let wanted = wanted(&w.of(&v, &a));
        prop_assume!(wanted.amax() < 1e6);
        let out = a.step(&mut AllocatorState::default(), &wanted, &r, &RotorStatus::default());
        let best = cost(&v, &r, a.by_world, &wanted, &out.inputs, &order);
        let clip = v.allocation_inverse() * wanted;
        let moved = out.inputs + RotorVector::from(turn) * a.upper.amax() * libm::pow(10.0, size);
        for other in [clip, moved, a.hover] {
            let other = other.sup(&a.lower).inf(&a.upper);
            for (mine, theirs) in best.iter().zip(cost(&v, &r, a.by_world, &wanted, &other, &order)) {
                let tolerance = 1e-8 * (1.0 + wanted.amax());
                prop_assert!(theirs > mine - tolerance, "{best:?} {theirs} {out:?}");
                if theirs > *mine { break; }
            }
        }
    }

    #[test]
    fn a_warm_start_changes_nothing(v in vehicle(), before in wrench(), w in wrench(), r in attitude(), turn in attitude()) {
        let a = Allocator::new(&v);
        let status = RotorStatus::default();
        let mut state = AllocatorState::default();
        let _ = a.step(&mut state, &before.of(&v, &a), &(r * turn), &status);
        let wanted = wanted(&w.of(&v, &a));
        prop_assume!(wanted.amax() < 1e6);
        let warm = a.step(&mut state, &wanted, &r, &status);
        let cold = a.step(&mut AllocatorState::default(), &wanted, &r, &status);
        let tolerance = 1e-7 * (1.0 + wanted.amax());
        prop_assert!((warm.wrench - cold.wrench).amax() < tolerance, "{warm:?} {cold:?}");
        prop_assert!(warm.iterations <= MAX_ITERATIONS);
    }

    /// Where only the last part is missed, the closed form gives the inputs of the search.
    #[test]
    fn the_last_part_alone_needs_no_search(
        v in prop_oneof![vehicle_of(6).boxed(), blocks().boxed()], u in prop::array::uniform12(0.01..0.99f64),
        off in prop::array::uniform2(-100.0..100.0f64),
        others in prop_oneof![Just([0.0; 6]), prop::array::uniform6(-30.0..30.0f64)],
        lateral_last in any::<bool>(), r in attitude(), by_world in any::<bool>(),
    ) {
        prop_assume!(v.rank() == 6);
        let mut order = Priority::ORDER;
        if !lateral_last { order.reverse(); }
        let a = Allocator::with_params(&v, AllocatorParams { order, horizon: 0.0 }).unwrap();
        // The other parts are those of possible inputs.
        let identity = Matrix3::identity();
        let r = if by_world { &r } else { &identity };
        let mut wanted = turned(r, &Wanted::Reach(u, 1.0).of(&v, &a));
        for (row, off) in order[3].rows().iter().zip(off) { wanted[*row] += off; }
        // With `others` they may be impossible.
        let wanted = turned(&r.transpose(), &(wanted + Vector6::from(others)));
        let (inputs, limits) = (v.allocation_inverse() * wanted, (&a.lower, &a.upper));
        let asked = Asked { wrench: &wanted, inputs: &inputs, rotation_wr: by_world.then_some(r), limits };
        let closed = a.without_last(&asked);
        let far = inputs.amax() > 30.0 * a.upper.amax();
        // Edges that are parallel, and rotors without effect, are left to the search.
        let apart = v.allocation_inverse().iter().all(|x| x.abs() > 1e-9 * a.upper.amax());
        prop_assert!(closed.is_some() || far || !apart || others != [0.0; 6]);
        let Some((inputs, side, _)) = closed else { return Ok(()) };
        let mut state = AllocatorState::default();
        a.search_levels(&mut state, &asked);
        let parts = |inputs: &RotorVector| cost(&v, r, by_world, &wanted, inputs, &order);
        for (closed, searched) in parts(&inputs).iter().zip(parts(&state.inputs)) {
            prop_assert!((closed - searched).abs() < 1e-8 * (1.0 + wanted.amax()), "{inputs:?} {:?}", state.inputs);
        }
        prop_assert!((inputs - state.inputs).amax() < 1e-9 * a.upper.amax() * v.condition());
        for i in 0..MAX_ROTORS {
            prop_assert!(side[i] != Side::Lower || inputs[i] == a.lower[i]);
            prop_assert!(side[i] != Side::Upper || inputs[i] == a.upper[i]);
        }
    }

    #[test]
    fn a_lost_rotor_stands_still(v in vehicle(), w in wrench(), lost in 0..4096u16, r in attitude()) {
        let a = Allocator::new(&v);
        let status = RotorStatus { lost, ..Default::default() };
        let out = a.step(&mut AllocatorState::default(), &w.of(&v, &a), &r, &status);
        for i in 0..MAX_ROTORS {
            prop_assert!(lost >> i & 1 == 0 || out.inputs[i] == 0.0);
        }
        prop_assert!(out.iterations <= MAX_ITERATIONS && out.wrench.iter().all(|x| x.is_finite()));
    }

    /// What a first-order lag reaches within the horizon, and not more.
    #[test]
    fn the_horizon_is_what_the_rotors_reach(w in wrench(), now in prop::array::uniform6(16.0..110.0f64), horizon in 0.001..0.5f64) {
        let v = tilt_hex();
        let a = Allocator::with_params(&v, AllocatorParams { horizon, ..Default::default() }).unwrap();
        let mut status = RotorStatus::default();
        status.speeds.rows_mut(0, 6).copy_from_slice(&now);
        let out = a.step(&mut AllocatorState::default(), &w.of(&v, &a), &Matrix3::identity(), &status);
        let reached = |now: f64, limit: f64| limit + (now - limit) * libm::exp(-horizon / 0.03);
        for (u, now) in out.inputs.iter().zip(now) {
            let speed = libm::sqrt(*u);
            prop_assert!(speed > reached(now, 16.0) - 1e-9 && speed < reached(now, 110.0) + 1e-9);
        }
    }
}

#[test]
fn the_lateral_force_is_given_up_first() {
    let allocator = Allocator::new(&tilt_hex());
    let wanted = Vector6::new(30.0, 0.0, tilt_hex().weight(), 0.1, -0.2, 0.05);
    let out = allocator.allocate(&wanted);
    assert_eq!(out.given_up, Some(Priority::LateralForce));
    let kept = (out.wrench - wanted).rows(2, 4).amax();
    assert!(kept < 1e-12, "{kept}");
    assert!(out.shortfall[3] > 10.0 && out.wrench[0] > 5.0);

    let order =
        [Priority::LateralForce, Priority::RollPitchTorque, Priority::VerticalForce, Priority::YawTorque];
    let out = Allocator::with_params(&tilt_hex(), AllocatorParams { order, horizon: 0.0 })
        .unwrap()
        .allocate(&wanted);
    assert_ne!(out.given_up, Some(Priority::LateralForce).filter(|_| out.shortfall[3] < 1e-9));
    assert!(out.shortfall[3] < 1e-9 || out.wrench[0] > 5.0);
}

#[test]
fn an_order_needs_every_part() {
    let order = [Priority::LateralForce; 4];
    let refused = Allocator::with_params(&tilt_hex(), AllocatorParams { order, horizon: 0.0 });
    assert!(matches!(refused, Err(Error::Count { found: 1, .. })));
    for p in Priority::ORDER {
        assert_eq!(Priority::from_name(p.name()), Some(p));
    }
}
