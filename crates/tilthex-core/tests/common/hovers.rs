//! Hovers of vehicles that are not their model, and what a learner makes of them.

use tilthex_core::{
    GRAVITY, Matrix3, RobotState, RotorVector, Vector3, Vehicle, Wrench,
    model_learning::{HoverSample, Learnt, ModelLearner, ModelPrior, Refusal, TILT},
    random::Random,
    so3,
    vehicle::{Correction, inputs, speeds},
    wrench_observer::robot_wrench,
};

pub(crate) const DT: f64 = 0.002;
pub(crate) const CAD: ModelPrior = ModelPrior::CAD;

/// A vehicle around a model, with the errors of drawings cut at three deviations, and its centre of mass.
pub(crate) fn drawn(model: &Vehicle, prior: &ModelPrior, random: &mut Random) -> (Vehicle, Vector3) {
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
pub(crate) fn held(truth: &Vehicle, rotation_wr: &Matrix3, external: &Wrench) -> RotorVector {
    let up = rotation_wr.transpose() * Vector3::new(0.0, 0.0, truth.weight());
    let wanted = Wrench { force: up - external.force, torque: -external.torque };
    speeds(&(truth.allocation_inverse() * wanted.to_vector()))
}

/// What `model` takes for contact in a hover of `truth`, robot.
pub(crate) fn false_wrench(model: &Vehicle, truth: &Vehicle, rotation_wr: &Matrix3) -> Wrench {
    let given = Wrench::from_vector(&(model.allocation() * inputs(&held(truth, rotation_wr, &Wrench::ZERO))));
    let up = rotation_wr.transpose() * Vector3::new(0.0, 0.0, model.weight());
    Wrench { force: up - given.force, torque: -given.torque }
}

/// Level, and tilted in three directions.
pub(crate) fn attitudes() -> [Matrix3; 4] {
    let tilted = |k: f64| {
        let direction = k * core::f64::consts::TAU / 3.0;
        so3::exp(&(Vector3::new(libm::cos(direction), libm::sin(direction), 0.0) * TILT * 0.9))
    };
    [Matrix3::identity(), tilted(0.0), tilted(1.0), tilted(2.0)]
}

/// A force at the tool, world, as a wrench on the robot, robot coordinates.
pub(crate) fn at_tool(truth: &Vehicle, rotation_wr: &Matrix3, force_w: Vector3) -> Wrench {
    let tool_w = Wrench { force: force_w, torque: Vector3::zeros() };
    let at_robot = robot_wrench(&tool_w, rotation_wr, &truth.tool().position_r);
    Wrench { force: rotation_wr.transpose() * at_robot.force, torque: at_robot.torque }
}

/// A tick of a hover at an attitude in which an external wrench acts (robot coordinates), with the noise of the sensors;
/// `bias` is the accelerometer's.
pub(crate) fn sampled(
    truth: &Vehicle,
    rotation_wr: &Matrix3,
    external: &Wrench,
    bias: &Vector3,
    random: &mut Random,
) -> HoverSample {
    let mut robot = RobotState::at_rest(Vector3::zeros());
    robot.rotation_wr = *rotation_wr;
    let noise = Vector3::from_fn(|_, _| 0.1 * random.normal());
    HoverSample {
        robot,
        specific_force_r: rotation_wr.transpose() * Vector3::new(0.0, 0.0, GRAVITY) + bias + noise,
        rotor_speeds: held(truth, rotation_wr, external)
            + RotorVector::from_fn(|i, _| if i < 6 { 0.05 * random.normal() } else { 0.0 }),
        external_r: Wrench::ZERO,
    }
}

/// The accelerometer's bias that an estimator leaves.
pub(crate) fn left_bias(random: &mut Random) -> Vector3 {
    Vector3::from_fn(|_, _| 0.005 * random.normal())
}

/// A calibration: hovers of a truth at some attitudes, with an external wrench (robot coordinates) by hover and time. Returns
/// also the learner, which goes on slowly.
pub(crate) fn calibrate(
    model: &Vehicle,
    prior: &ModelPrior,
    truth: &Vehicle,
    attitudes: &[Matrix3],
    random: &mut Random,
    external: impl Fn(usize, f64) -> Wrench,
) -> Result<(Learnt, ModelLearner), Refusal> {
    let mut learner = ModelLearner::default();
    let bias = left_bias(random);
    for (k, rotation_wr) in attitudes.iter().enumerate() {
        for tick in 0..2400 {
            let sample = sampled(truth, rotation_wr, &external(k, tick as f64 * DT), &bias, random);
            learner.observe(model, true, &sample, DT);
        }
        let moving = HoverSample {
            robot: RobotState::at_rest(Vector3::zeros()),
            specific_force_r: Vector3::zeros(),
            rotor_speeds: RotorVector::zeros(),
            external_r: Wrench::ZERO,
        };
        learner.observe(model, false, &moving, DT);
    }
    learner.finish(model, prior).map(|learnt| (learnt, learner))
}

pub(crate) fn nobody(_: usize, _: f64) -> Wrench {
    Wrench::ZERO
}

/// The largest false force and torque in hovers tilted by 15 degrees in twelve directions.
pub(crate) fn largest(model: &Vehicle, truth: &Vehicle) -> (f64, f64) {
    let mut worst = (0.0, 0.0);
    for k in 0..12 {
        let direction = f64::from(k) * core::f64::consts::TAU / 12.0;
        let axis = Vector3::new(libm::cos(direction), libm::sin(direction), 0.0);
        let found = false_wrench(model, truth, &so3::exp(&(axis * TILT)));
        worst = (f64::max(worst.0, found.force.norm()), f64::max(worst.1, found.torque.norm()));
    }
    worst
}
