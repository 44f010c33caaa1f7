//! Hovers of drawn vehicles tell the errors of their model.
#![allow(clippy::unwrap_used)]

mod common;

use common::{
    hovers::{CAD, at_tool, attitudes, calibrate, drawn, false_wrench, largest, nobody},
    tilt_hex,
};
use tilthex_core::{
    Matrix3, Vector3, Wrench,
    model_learning::{ModelDeviation, ModelPrior, Refusal},
    random::Random,
    so3,
};

#[test]
fn tilted_hovers_take_the_false_wrench_away_at_any_attitude() {
    let model = tilt_hex();
    let mut random = Random::new(2001);
    let (mut before, mut after, mut misfit) = (vec![], vec![], 0.0);
    const COUNT: usize = 60;
    for _ in 0..COUNT {
        let (truth, _) = drawn(&model, &CAD, &mut random);
        let (learnt, _) = calibrate(&model, &CAD, &truth, &attitudes(), &mut random, nobody).unwrap();
        before.push(largest(&model, &truth));
        after.push(largest(&learnt.vehicle, &truth));
        misfit += learnt.misfit / COUNT as f64;
        assert!(learnt.deviation.is_excited(&ModelDeviation::prior(&model, &CAD)));
    }
    let median = |all: &[(f64, f64)]| {
        let (mut force, mut torque): (Vec<_>, Vec<_>) = all.iter().copied().unzip();
        force.sort_by(f64::total_cmp);
        torque.sort_by(f64::total_cmp);
        (force[COUNT / 2], torque[COUNT / 2], force[COUNT - 1], torque[COUNT - 1])
    };
    let (b, a) = (median(&before), median(&after));
    println!("before {b:.3?} after {a:.3?} misfit {misfit:.2}");
    assert!(b.0 > 0.5 && b.1 > 0.15, "{b:?}");
    assert!(a.0 < 0.04 && a.1 < 0.008 && a.2 < 0.1 && a.3 < 0.02, "{a:?}");
    assert!(misfit < 1.3, "{misfit}");
}

#[test]
fn deviations_are_those_of_the_errors() {
    let model = tilt_hex();
    let mut random = Random::new(2002);
    let mut squares = [0.0; 5];
    let mut numbers = [0.0; 5];
    let mut add = |i: usize, error: f64, deviation: f64| {
        squares[i] += (error / deviation).powi(2);
        numbers[i] += 1.0;
    };
    for _ in 0..100 {
        let (truth, centre_r) = drawn(&model, &CAD, &mut random);
        let (learnt, _) = calibrate(&model, &CAD, &truth, &attitudes(), &mut random, nobody).unwrap();
        let (made, deviation) = (learnt.vehicle, learnt.deviation);
        add(0, truth.mass() / made.mass() - 1.0, deviation.mass);
        for axis in 0..3 {
            add(1, learnt.centre_r[axis] - centre_r[axis], deviation.centre_of_mass_r[axis]);
        }
        for (i, (a, b)) in made.rotors().iter().zip(truth.rotors()).enumerate() {
            add(2, b.thrust_coefficient / a.thrust_coefficient - 1.0, deviation.thrust[i]);
            // Two axes: the mean square of the turn's size is the sum of both variances.
            add(3, so3_angle(&a.axis_r, &b.axis_r), deviation.rotor_axis[i]);
        }
        add(
            4,
            truth.rotors()[0].drag_coefficient / made.rotors()[0].drag_coefficient - 1.0,
            deviation.drag_moment,
        );
    }
    for (i, (sum, count)) in squares.iter().zip(numbers).enumerate() {
        let mean = sum / count;
        println!("{i}: {mean:.2} over {count}");
        assert!((0.6..1.4).contains(&mean), "{i}: {mean}");
    }
}

/// A vehicle that was weighed keeps its mass: the thrust is corrected, and forces have the right scale.
#[test]
fn a_known_mass_gives_forces_their_scale() {
    let model = tilt_hex();
    let mut random = Random::new(2004);
    let weighed = ModelPrior { mass: 0.001, ..CAD };
    for _ in 0..20 {
        let (truth, _) = drawn(&model, &weighed, &mut random);
        let scale = |prior: &ModelPrior, random: &mut Random| {
            let (learnt, _) = calibrate(&model, prior, &truth, &attitudes(), random, nobody).unwrap();
            (learnt.vehicle.mass() / truth.mass() - 1.0, learnt.deviation.mass)
        };
        let ((known, sure), (guessed, unsure)) = (scale(&weighed, &mut random), scale(&CAD, &mut random));
        assert!(known.abs() < 0.005 && sure <= 0.001, "{known} {sure}");
        assert!(guessed.abs() < 5.0 * unsure && unsure > 0.02, "{guessed} {unsure}");
    }
}

fn so3_angle(a: &Vector3, b: &Vector3) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

#[test]
fn a_level_hover_tells_itself_and_says_that_it_tells_no_more() {
    let model = tilt_hex();
    let mut random = Random::new(2003);
    for _ in 0..10 {
        let (truth, _) = drawn(&model, &CAD, &mut random);
        let (learnt, _) =
            calibrate(&model, &CAD, &truth, &[Matrix3::identity()], &mut random, nobody).unwrap();
        let level = false_wrench(&learnt.vehicle, &truth, &Matrix3::identity());
        assert!(level.force.norm() < 0.1 && level.torque.norm() < 0.01, "{level:?}");
        let prior = ModelDeviation::prior(&model, &CAD);
        let (now, then) = (learnt.deviation.centre_of_mass_r.z, prior.centre_of_mass_r.z);
        assert!(now > 0.9 * then && learnt.deviation.false_force > 0.05, "{:?}", learnt.deviation);
    }
}

#[test]
fn what_touches_is_refused_with_a_sentence() {
    let model = tilt_hex();
    let mut random = Random::new(2004);
    let (truth, _) = drawn(&model, &CAD, &mut random);
    let touched = |k: usize, force_w: Vector3| at_tool(&truth, &attitudes()[k], force_w);
    // A hand that comes and goes.
    let hand = |k: usize, time: f64| touched(k, Vector3::new(if time > 3.0 { 1.0 } else { 0.0 }, 0.0, 0.0));
    let refused = calibrate(&model, &CAD, &truth, &attitudes(), &mut random, hand).unwrap_err();
    assert!(matches!(refused, Refusal::NotStill { hover: 1, .. }), "{refused:?}");
    assert!(refused.to_string().contains("nothing may touch"), "{refused}");
    // A rope that pulls the same all the time, but not with the vehicle's attitude.
    let rope = |k: usize, _: f64| touched(k, Vector3::new(3.0, 0.0, 0.0));
    let refused = calibrate(&model, &CAD, &truth, &attitudes(), &mut random, rope).unwrap_err();
    assert!(matches!(refused, Refusal::NotTheModel { .. }), "{refused:?}");
    // Something that is there at one attitude only.
    let table = |k: usize, _: f64| touched(k, Vector3::new(0.0, 0.0, if k == 2 { 1.0 } else { 0.0 }));
    let refused = calibrate(&model, &CAD, &truth, &attitudes(), &mut random, table).unwrap_err();
    assert!(matches!(refused, Refusal::NotTheModel { .. }), "{refused:?}");
    let nothing = calibrate(&model, &CAD, &truth, &[], &mut random, nobody).unwrap_err();
    assert_eq!(nothing, Refusal::NoHover);
}

/// It does not turn with the vehicle, as errors of the model do.
#[test]
fn a_steady_wind_is_not_learnt_as_an_error_of_the_model() {
    let model = tilt_hex();
    let turn = so3::rot_z(core::f64::consts::FRAC_PI_2);
    let [level, a, b, c] = attitudes();
    let turned = [level, turn * a, turn * b, turn * c];
    let left = |attitudes: &[Matrix3; 4], wind: f64| {
        let (mut random, mut worst) = (Random::new(2011), (0.0, 0.0));
        for k in 0..20 {
            let (truth, _) = drawn(&model, &CAD, &mut random);
            let direction = so3::rot_z(f64::from(k));
            let (force_w, torque_w) =
                (direction * Vector3::x() * wind, direction * Vector3::y() * 0.1 * wind);
            let air = |k: usize, _: f64| {
                let turn = attitudes[k].transpose();
                Wrench { force: turn * force_w, torque: turn * torque_w }
            };
            let (learnt, _) = calibrate(&model, &CAD, &truth, attitudes, &mut random, air).unwrap();
            let (force, torque) = largest(&learnt.vehicle, &truth);
            worst = (f64::max(worst.0, force), f64::max(worst.1, torque));
        }
        worst
    };
    for wind in [0.0, 0.3, 1.0] {
        let (found, level) = (left(&turned, wind), left(&attitudes(), wind));
        println!("{wind} N: {found:.3?}, at one heading {level:.3?}");
        assert!(found.0 < 0.08 && found.1 < 0.01, "{wind}: {found:?}");
    }
    assert!(left(&attitudes(), 1.0).0 > 0.8, "at one heading a wind is learnt as an error of the model");
}
