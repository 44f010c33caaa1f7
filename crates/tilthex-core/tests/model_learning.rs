//! Hovers of drawn vehicles tell the errors of their model.
#![allow(clippy::unwrap_used)]

mod common;

use common::tilt_hex;
use tilthex_core::{
    GRAVITY, Matrix3, RobotState, RotorVector, Vector3, Vehicle, Wrench,
    model_learning::{HoverSample, ModelDeviation, ModelLearner, ModelPrior, Refusal, TILT},
    random::Random,
    so3,
    vehicle::{Correction, inputs, speeds},
    wrench_observer::robot_wrench,
};

const DT: f64 = 0.002;
const CAD: ModelPrior = ModelPrior::CAD;

/// A vehicle around a model, with the errors of drawings cut at three deviations, and its centre of mass.
fn drawn(model: &Vehicle, prior: &ModelPrior, random: &mut Random) -> (Vehicle, Vector3) {
    let mut normal = |deviation: f64| loop {
        let x = random.normal();
        if x.abs() <= 3.0 {
            break deviation * x;
        }
    };
    let thrust = normal(prior.thrust);
    let mut correction = Correction { mass: 1.0 + normal(prior.mass), ..Correction::NONE };
    correction.drag = 1.0 + normal(prior.drag_moment);
    correction.centre_r = Vector3::from_fn(|_, _| normal(prior.centre_of_mass));
    for (i, rotor) in model.rotors().iter().enumerate() {
        correction.thrust[i] = 1.0 + thrust + normal(prior.thrust_each);
        let turn = Vector3::from_fn(|_, _| normal(prior.rotor_axis));
        correction.axis_r[i] = turn.cross(&rotor.axis_r);
    }
    (model.corrected(&correction).unwrap(), correction.centre_r)
}

/// Speeds in a hover in which a wrench acts: force and torque on the robot, robot coordinates.
fn held(truth: &Vehicle, rotation_wr: &Matrix3, external: &Wrench) -> RotorVector {
    let up = rotation_wr.transpose() * Vector3::new(0.0, 0.0, truth.weight());
    let wanted = Wrench { force: up - external.force, torque: -external.torque };
    speeds(&(truth.allocation_inverse() * wanted.to_vector()))
}

/// What `model` takes for contact in a hover of `truth`, robot.
fn false_wrench(model: &Vehicle, truth: &Vehicle, rotation_wr: &Matrix3) -> Wrench {
    let given = Wrench::from_vector(&(model.allocation() * inputs(&held(truth, rotation_wr, &Wrench::ZERO))));
    let up = rotation_wr.transpose() * Vector3::new(0.0, 0.0, model.weight());
    Wrench { force: up - given.force, torque: -given.torque }
}

/// Level, and tilted in three directions.
fn attitudes() -> [Matrix3; 4] {
    let tilted = |k: f64| {
        let direction = k * core::f64::consts::TAU / 3.0;
        so3::exp(&(Vector3::new(libm::cos(direction), libm::sin(direction), 0.0) * TILT * 0.9))
    };
    [Matrix3::identity(), tilted(0.0), tilted(1.0), tilted(2.0)]
}

/// Flies hovers of a truth, and what they teach of a model.
fn hover(
    model: &Vehicle,
    prior: &ModelPrior,
    truth: &Vehicle,
    attitudes: &[Matrix3],
    random: &mut Random,
    touch: impl Fn(usize, f64) -> Vector3,
) -> Result<tilthex_core::model_learning::Learnt, Refusal> {
    let mut learner = ModelLearner::default();
    let bias = Vector3::from_fn(|_, _| 0.005 * random.normal());
    for (k, rotation_wr) in attitudes.iter().enumerate() {
        for tick in 0..2400 {
            let time = tick as f64 * DT;
            // A force at the tool, world.
            let tool_w = Wrench { force: touch(k, time), torque: Vector3::zeros() };
            let at_robot = robot_wrench(&tool_w, rotation_wr, &truth.tool().position_r);
            let external =
                Wrench { force: rotation_wr.transpose() * at_robot.force, torque: at_robot.torque };
            let mut robot = RobotState::at_rest(Vector3::zeros());
            robot.rotation_wr = *rotation_wr;
            let noise = Vector3::from_fn(|_, _| 0.1 * random.normal());
            let sample = HoverSample {
                robot,
                specific_force_r: rotation_wr.transpose() * Vector3::new(0.0, 0.0, GRAVITY) + bias + noise,
                rotor_speeds: held(truth, rotation_wr, &external)
                    + RotorVector::from_fn(|i, _| if i < 6 { 0.05 * random.normal() } else { 0.0 }),
            };
            learner.observe(model, true, &sample, DT);
        }
        let sample = HoverSample {
            robot: RobotState::at_rest(Vector3::zeros()),
            specific_force_r: Vector3::zeros(),
            rotor_speeds: RotorVector::zeros(),
        };
        learner.observe(model, false, &sample, DT);
    }
    learner.finish(model, prior)
}

fn nobody(_: usize, _: f64) -> Vector3 {
    Vector3::zeros()
}

/// The largest false force and torque in hovers tilted by 15 degrees in twelve directions.
fn largest(model: &Vehicle, truth: &Vehicle) -> (f64, f64) {
    let mut worst = (0.0, 0.0);
    for k in 0..12 {
        let direction = f64::from(k) * core::f64::consts::TAU / 12.0;
        let axis = Vector3::new(libm::cos(direction), libm::sin(direction), 0.0);
        let found = false_wrench(model, truth, &so3::exp(&(axis * TILT)));
        worst = (f64::max(worst.0, found.force.norm()), f64::max(worst.1, found.torque.norm()));
    }
    worst
}

#[test]
fn tilted_hovers_take_the_false_wrench_away_at_any_attitude() {
    let model = tilt_hex();
    let mut random = Random::new(2001);
    let (mut before, mut after, mut misfit) = (vec![], vec![], 0.0);
    const COUNT: usize = 60;
    for _ in 0..COUNT {
        let (truth, _) = drawn(&model, &CAD, &mut random);
        let learnt = hover(&model, &CAD, &truth, &attitudes(), &mut random, nobody).unwrap();
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
        let learnt = hover(&model, &CAD, &truth, &attitudes(), &mut random, nobody).unwrap();
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
            let learnt = hover(&model, prior, &truth, &attitudes(), random, nobody).unwrap();
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
        let learnt = hover(&model, &CAD, &truth, &[Matrix3::identity()], &mut random, nobody).unwrap();
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
    // A hand that comes and goes.
    let hand = |_: usize, time: f64| Vector3::new(if time > 3.0 { 1.0 } else { 0.0 }, 0.0, 0.0);
    let refused = hover(&model, &CAD, &truth, &attitudes(), &mut random, hand).unwrap_err();
    assert!(matches!(refused, Refusal::NotStill { hover: 1, .. }), "{refused:?}");
    assert!(refused.to_string().contains("nothing may touch"), "{refused}");
    // A rope that pulls the same all the time, but not with the vehicle's attitude.
    let rope = |_: usize, _: f64| Vector3::new(3.0, 0.0, 0.0);
    let refused = hover(&model, &CAD, &truth, &attitudes(), &mut random, rope).unwrap_err();
    assert!(matches!(refused, Refusal::NotTheModel { .. }), "{refused:?}");
    // Something that is there at one attitude only.
    let table = |k: usize, _: f64| Vector3::new(0.0, 0.0, if k == 2 { 1.0 } else { 0.0 });
    let refused = hover(&model, &CAD, &truth, &attitudes(), &mut random, table).unwrap_err();
    assert!(matches!(refused, Refusal::NotTheModel { .. }), "{refused:?}");
    let nothing = hover(&model, &CAD, &truth, &[], &mut random, nobody).unwrap_err();
    assert_eq!(nothing, Refusal::NoHover);
}
