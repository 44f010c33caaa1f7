//! Any stable filter against its law, written another way and stepped finely, and its energy.

use super::common::{vector, wrench};
use proptest::prelude::*;
use tilthex_core::{
    Matrix3, Matrix6, Setpoint, Vector3, Vector6, Wrench,
    admittance::{AdmittanceFilter, AdmittanceParams, AdmittanceState, Axes},
    so3,
};

/// Numbers of a symmetric matrix with this diagonal, whose axes act on each other by up to 15 %.
fn coupled(diagonal: [f64; 6], coupling: [f64; 15]) -> Matrix6 {
    let mut m = Matrix6::from_diagonal(&Vector6::from(diagonal));
    let mut next = coupling.iter();
    for i in 0..6 {
        for j in 0..i {
            m[(i, j)] = 0.15 * next.next().unwrap() * (diagonal[i] * diagonal[j]).sqrt();
            m[(j, i)] = m[(i, j)];
        }
    }
    m
}

/// Filters of all kinds: heavy and light, soft and hard, damped little and much, axes coupled or not.
fn params() -> impl Strategy<Value = AdmittanceParams> {
    let decade = |low: f64, high: f64| (low.log10()..high.log10()).prop_map(|e| 10f64.powf(e));
    let six = |t: (f64, f64), r: (f64, f64)| {
        (prop::array::uniform3(decade(t.0, t.1)), prop::array::uniform3(decade(r.0, r.1)))
            .prop_map(|([a, b, c], [d, e, f])| [a, b, c, d, e, f])
    };
    let coupling = || prop_oneof![Just([0.0; 15]), prop::array::uniform15(-1.0..1.0f64)];
    (
        (six((0.5, 5.0), (0.005, 2.0)), coupling()),
        (six((1.0, 30.0), (0.02, 6.0)), coupling()),
        (six((1.0, 80.0), (4.0, 10.0)), coupling()),
    )
        .prop_map(|(m, d, k)| AdmittanceParams {
            mass: coupled(m.0, m.1),
            damping: coupled(d.0, d.1),
            stiffness: coupled(k.0, k.1),
            max_translation: 100.0,
            max_rotation: 3.1,
            axes: Axes::World,
        })
}

/// The filter's law written another way: the spring's torque is the difference of its potential, the
/// rotation is nine numbers, and classical Runge-Kutta steps are short beside the fastest mode.
struct Law {
    params: AdmittanceParams,
    mass_inverse: Matrix6,
    push: Vector6,
    setpoint_velocity: Vector3,
}

#[derive(Clone, Copy)]
struct Deviation {
    position: Vector3,
    rotation: Matrix3,
    twist: Vector6,
}

impl Law {
    fn potential(&self, position: &Vector3, rotation: &Matrix3) -> f64 {
        let k = &self.params.stiffness;
        let rotational = k.fixed_view::<3, 3>(3, 3);
        let g = 0.5 * rotational.trace() * Matrix3::identity() - rotational;
        0.5 * position.dot(&(k.fixed_view::<3, 3>(0, 0) * position))
            + position.dot(&(k.fixed_view::<3, 3>(0, 3) * so3::vee(rotation)))
            + (g * (Matrix3::identity() - rotation)).trace()
    }

    fn rates(&self, at: &Deviation) -> Deviation {
        let h = 1e-5;
        let slope = |i: usize| {
            let (mut move_by, mut turn) = (Vector3::zeros(), Vector3::zeros());
            if i < 3 {
                move_by[i] = h
            } else {
                turn[i - 3] = h
            }
            let moved =
                |s: f64| self.potential(&(at.position + s * move_by), &(so3::exp(&(s * turn)) * at.rotation));
            (moved(1.0) - moved(-1.0)) / (2.0 * h)
        };
        let spring = Vector6::from_fn(|i, _| slope(i));
        let (v, w) = (at.twist.fixed_rows::<3>(0).into_owned(), at.twist.fixed_rows::<3>(3).into_owned());
        let turning = w + self.setpoint_velocity - at.rotation * self.setpoint_velocity;
        Deviation {
            position: v,
            rotation: so3::hat(&turning) * at.rotation,
            twist: self.mass_inverse * (self.push - self.params.damping * at.twist - spring),
        }
    }

    fn advance(&self, start: &Deviation, dt: f64, steps: usize) -> Deviation {
        let h = dt / steps as f64;
        let mut at = *start;
        for _ in 0..steps {
            let on = |k: &Deviation, h: f64| Deviation {
                position: at.position + h * k.position,
                rotation: at.rotation + h * k.rotation,
                twist: at.twist + h * k.twist,
            };
            let k1 = self.rates(&at);
            let k2 = self.rates(&on(&k1, 0.5 * h));
            let k3 = self.rates(&on(&k2, 0.5 * h));
            let k4 = self.rates(&on(&k3, h));
            let mut end = at;
            for (k, part) in [(k1, 1.0), (k2, 2.0), (k3, 2.0), (k4, 1.0)] {
                end = Deviation {
                    position: end.position + part * h / 6.0 * k.position,
                    rotation: end.rotation + part * h / 6.0 * k.rotation,
                    twist: end.twist + part * h / 6.0 * k.twist,
                };
            }
            at = end;
        }
        at
    }
}

/// Farthest that pose and twist come from those of [`Law`] in 0.4 s, as parts of 1 m, 1 rad and of the fastest.
fn distance(
    params: AdmittanceParams,
    push: &Wrench,
    setpoint_velocity: Vector3,
    periods: &[f64],
) -> (f64, f64) {
    let filter = AdmittanceFilter::new(params).unwrap();
    let mut law = Law {
        params,
        mass_inverse: params.mass.try_inverse().unwrap(),
        push: Vector6::zeros(),
        setpoint_velocity,
    };
    let mut state = AdmittanceState::default();
    let mut truth =
        Deviation { position: Vector3::zeros(), rotation: Matrix3::identity(), twist: Vector6::zeros() };
    let fastest =
        (law.mass_inverse * params.damping).norm() + (law.mass_inverse * params.stiffness).norm().sqrt();
    let (mut time, mut pose, mut twist, mut largest) = (0.0f64, 0.0f64, 0.0f64, 1.0f64);
    for dt in periods.iter().cycle().take(200) {
        // Slow and sudden changes.
        let part = (7.0 * time).sin() * if time < 0.2 { 1.0 } else { -0.5 };
        time += dt;
        let push = Wrench { force: push.force * part, torque: push.torque * part };
        let setpoint = Setpoint {
            angular_velocity_w: setpoint_velocity,
            ..Setpoint::hold(Vector3::zeros(), Matrix3::identity())
        };
        filter.step(&mut state, &setpoint, &push, *dt);
        law.push = push.to_vector();
        truth = law.advance(&truth, *dt, (dt * fastest / 0.05).ceil() as usize);
        largest = largest.max(truth.twist.amax());
        pose = pose.max((state.translation_w - truth.position).amax());
        pose = pose.max((state.rotation - truth.rotation).amax());
        twist = twist.max((state.twist_w - truth.twist).amax());
    }
    (pose, twist / largest)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn equals_a_finely_stepped_runge_kutta(
        params in params(), push in wrench(10.0, 2.0), omega in vector(1.0), jitter in prop::array::uniform3(-0.02..0.02f64),
        late in 0.5..3.0f64,
    ) {
        prop_assume!(AdmittanceFilter::new(params).unwrap().has_potential());
        for periods in [vec![0.002], jitter.map(|j| 0.002 * (1.0 + j)).to_vec(), vec![0.002, 0.002, 0.002, 0.002 * late]] {
            let (pose, twist) = distance(params, &push, omega, &periods);
            // A late tick is a longer step.
            let bound = if late > 1.1 && periods.len() == 4 { 1e-4 } else { 1e-5 };
            prop_assert!(pose < bound && twist < bound, "{pose:e} {twist:e} {periods:?}");
        }
    }

    /// Whatever the parameters, the deviation stays finite, and without a push it loses energy only.
    #[test]
    fn any_stable_filter_is_passive(
        m in (-8.0..2.0f64, -8.0..1.0f64), d in (-8.0..6.0f64, -8.0..6.0f64), k in (-3.0..6.0f64, -3.0..6.0f64),
        coupling in prop_oneof![Just([0.0; 15]), prop::array::uniform15(-1.0..1.0f64)], start in (vector(0.3), vector(1.0)),
    ) {
        let six = |(t, r): (f64, f64)| {
            let (t, r) = (10f64.powf(t), 10f64.powf(r));
            coupled([t, 0.8 * t, 0.7 * t, r, 0.8 * r, 0.7 * r], coupling)
        };
        let params = AdmittanceParams {
            mass: six(m), damping: six(d), stiffness: six(k), max_translation: 100.0, max_rotation: 3.1, axes: Axes::World,
        };
        let filter = AdmittanceFilter::new(params);
        prop_assume!(filter.is_ok());
        let filter = filter.unwrap();
        prop_assume!(filter.has_potential());
        let mut state = AdmittanceState {
            translation_w: start.0, rotation: so3::exp(&start.1), ..AdmittanceState::default()
        };
        let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        let first = filter.energy(&state);
        let mut before = first;
        for i in 0..500 {
            if filter.step(&mut state, &setpoint, &Wrench::ZERO, 0.002).limited {
                // Held back at the excursion limit: that is no motion of the spring.
                break;
            }
            let energy = filter.energy(&state);
            prop_assert!(energy <= before + 1e-5 * first, "{i}: {before:e} J, then {energy:e} J");
            before = energy;
        }
    }
}
