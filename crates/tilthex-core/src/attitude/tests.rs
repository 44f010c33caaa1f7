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
            // Far beyond the largest turn the search may end early.
            if f.norm() > 45.0 || turn.norm() > 1.0 {
                continue;
            }
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
            prop_assert_eq!(out, Attitude { reference, force_w });
        }
    }

    /// Neither forces nor turns are ever not numbers, nor larger than allowed.
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
            prop_assert!(state.turn.norm() <= s.params.max_turn + 1e-9, "{:?}", state.turn);
        }
    }

    /// Rate and acceleration are the derivatives of the attitude.
    #[test]
    fn the_reference_is_consistent(f in force(), r in rotation(), spin in -1.0..1.0f64) {
        let s = selector(&collinear());
        let mut state = AttitudeState::default();
        let dt = 1e-4;
        let at = |t: f64| Reference {
            rotation_wr: r * so3::rot_z(spin * t),
            angular_velocity_r: Vector3::new(0.0, 0.0, spin),
            ..Reference::hold(Vector3::zeros(), r)
        };
        let step = |state: &mut AttitudeState, t: f64| s.step(state, &at(t), &f, &RotorStatus::default(), dt).reference;
        let mut last = step(&mut state, 0.0);
        for k in 1..400 {
            let next = step(&mut state, f64::from(k) * dt);
            let rate = so3::log(&(last.rotation_wr.transpose() * next.rotation_wr)) / dt;
            let middle = 0.5 * (last.angular_velocity_r + next.angular_velocity_r);
            prop_assert!((rate - middle).norm() < 2e-3 * (1.0 + middle.norm()), "{rate} {middle}");
            last = next;
        }
    }
}

#[test]
fn a_collinear_vehicle_points_its_thrust() {
    let s = selector(&collinear());
    let f = Vector3::new(3.0, -4.0, 24.0);
    let turn = s.turn(&mut AttitudeState::default(), &so3::rot_z(1.0), &f, &RotorStatus::default());
    let up = so3::rot_z(1.0) * so3::exp(&turn) * Vector3::z();
    assert!((up - f.normalize()).norm() < 1e-7, "{up}");
}

#[test]
fn a_level_attitude_keeps_the_heading() {
    let params = AttitudeParams { mode: AttitudeMode::ZeroTilt, ..AttitudeParams::default() };
    let s = AttitudeSelector::new(&tilt_hex(), params).unwrap();
    let r = so3::rot_z(0.7) * so3::rot_y(0.3) * so3::rot_x(-0.2);
    let reference = Reference::hold(Vector3::zeros(), r);
    let force = Vector3::new(30.0, 0.0, 20.0);
    let out = s.step(&mut AttitudeState::default(), &reference, &force, &RotorStatus::default(), 0.002);
    assert!((out.reference.rotation_wr - so3::rot_z(0.7)).amax() < 1e-12);
    assert_eq!(out.force_w, force);
    let refused = AttitudeSelector::new(&collinear(), params).unwrap_err();
    assert!(std::string::ToString::to_string(&refused).contains("zero-tilt"));
}
