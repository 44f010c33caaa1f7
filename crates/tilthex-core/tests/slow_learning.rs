//! After a calibration, hovers without contact go on correcting the model, and touches do not.
#![allow(clippy::unwrap_used)]

mod common;

use common::{
    hovers::{
        CAD, DT, at_tool, attitudes, calibrate, drawn, false_wrench, largest, left_bias, nobody, sampled,
    },
    tilt_hex,
};
use tilthex_core::{
    Matrix3, Vector3, Vehicle,
    model_learning::{Learnt, ModelLearner, TILT},
    random::Random,
    so3,
    vehicle::Correction,
};

/// A hover of the mission lasts this long, s, and the vehicle moves as long before it.
const HOVER: f64 = 5.0;

/// A vehicle after its calibration.
struct Flown {
    learner: ModelLearner,
    model: Vehicle,
    truth: Vehicle,
    bias: Vector3,
    random: Random,
}

impl Flown {
    fn new(seed: u64) -> Self {
        let (mut random, drawings) = (Random::new(seed), tilt_hex());
        let (truth, _) = drawn(&drawings, &CAD, &mut random);
        let (learnt, learner) =
            calibrate(&drawings, &CAD, &truth, &attitudes(), &mut random, nobody).unwrap();
        let bias = left_bias(&mut random);
        Self { learner, model: learnt.vehicle, truth, bias, random }
    }

    /// Moves, then hovers while something pulls at the tool.
    fn hover(&mut self, rotation_wr: &Matrix3, force_w: Vector3) -> Option<Learnt> {
        let mut found = None;
        for (still, ticks) in [(false, 1), (true, (HOVER / DT) as usize)] {
            let dt = if still { DT } else { HOVER };
            for _ in 0..ticks {
                let external = at_tool(&self.truth, rotation_wr, force_w);
                let sample = sampled(&self.truth, rotation_wr, &external, &self.bias, &mut self.random);
                let learnt = self.learner.observe_slowly(&self.model, &CAD, still, &sample, dt);
                if let Some(learnt) = learnt {
                    self.model = learnt.vehicle;
                    found = Some(learnt);
                }
            }
        }
        found
    }

    /// Some attitude within the tilt of the calibration.
    fn attitude(&mut self) -> Matrix3 {
        let direction = 7.0 * self.random.normal();
        let tilt = TILT * (self.random.normal() / 3.0).clamp(-1.0, 1.0);
        so3::exp(&(Vector3::new(libm::cos(direction), libm::sin(direction), 0.0) * tilt))
    }

    fn falsely_felt(&self) -> (f64, f64) {
        let found = false_wrench(&self.model, &self.truth, &Matrix3::identity());
        (found.force.norm(), found.torque.norm())
    }
}

/// What a payload or a battery does in a minute: part of mass and thrust, and way of the centre of mass, m.
fn changed(truth: &Vehicle, mass: f64, thrust: f64, centre_r: Vector3) -> Vehicle {
    let mut correction = Correction { mass: 1.0 + mass, centre_r, ..Correction::NONE };
    correction.thrust.iter_mut().for_each(|x| *x += thrust);
    truth.corrected(&correction).unwrap()
}

#[test]
fn a_payload_and_a_battery_are_followed() {
    for seed in 3101..3107 {
        let mut flown = Flown::new(seed);
        let never = flown.model;
        let mut worst: (f64, f64) = (0.0, 0.0);
        // Ten minutes: 8 % of the mass are used up, 8 % of the thrust fade, and the centre of mass moves by 6 mm.
        for _ in 0..60 {
            let step = 1.0 / 60.0;
            let way = Vector3::new(0.006, -0.003, 0.0) * step;
            flown.truth = changed(&flown.truth, -0.08 * step, -0.08 * step, way);
            let attitude = flown.attitude();
            flown.hover(&attitude, Vector3::zeros());
            let (force, torque) = flown.falsely_felt();
            worst = (worst.0.max(force), worst.1.max(torque));
        }
        flown.truth = changed(&flown.truth, 0.0, -0.03, Vector3::zeros());
        let without = false_wrench(&never, &flown.truth, &Matrix3::identity());
        println!("{seed}: {worst:.3?}, without it {:.3} {:.3}", without.force.norm(), without.torque.norm());
        assert!(worst.0 < 0.12 && worst.1 < 0.03, "{seed}: {worst:?}");
        assert!(without.force.norm() > 5.0 * worst.0, "{seed}: nothing was there to learn");
    }
}

/// Also if it lasts, and also in the directions in which payloads pull.
#[test]
fn a_touch_that_is_felt_is_not_learnt() {
    for seed in 3201..3205 {
        let mut flown = Flown::new(seed);
        for round in 0..30 {
            let attitude = flown.attitude();
            let direction = Vector3::from_fn(|_, _| flown.random.normal()).normalize();
            let direction = if round % 3 == 0 { -Vector3::z() } else { direction };
            let size = 0.3 + 0.3 * f64::from(round % 10);
            let before = flown.model;
            for _ in 0..3 {
                let learnt = flown.hover(&attitude, direction * size);
                assert!(learnt.is_none(), "{seed}: {size} N along {direction:?}");
            }
            assert_eq!(before, flown.model);
        }
    }
}

/// What is too weak to be felt is learnt in part, and given back when it ends.
#[test]
fn a_weak_touch_is_given_back() {
    for seed in 3301..3304 {
        let mut flown = Flown::new(seed);
        let (level, down) = (Matrix3::identity(), Vector3::new(0.0, 0.0, -0.05));
        for _ in 0..20 {
            flown.hover(&level, down);
        }
        let kept = flown.falsely_felt().0;
        for _ in 0..20 {
            flown.hover(&level, Vector3::zeros());
        }
        let back = flown.falsely_felt().0;
        println!("{seed}: {kept:.3} N, then {back:.3} N");
        assert!(kept < 0.08 && back < 0.04, "{seed}: {kept} {back}");
    }
}

/// A vehicle that does not change is not made worse by hours of hovers, and the deviations stay those of the errors.
#[test]
fn nothing_drifts_by_itself() {
    let mut squares = (0.0, 0.0);
    const SEEDS: u64 = 6;
    for seed in 3401..3401 + SEEDS {
        let mut flown = Flown::new(seed);
        let first = largest(&flown.model, &flown.truth);
        let mut last = None;
        for _ in 0..400 {
            let attitude = flown.attitude();
            last = flown.hover(&attitude, Vector3::zeros()).or(last);
        }
        let now = largest(&flown.model, &flown.truth);
        let deviation = last.unwrap().deviation;
        println!(
            "{seed}: {first:.3?} then {now:.3?}, {:.3} {:.3}",
            deviation.false_force, deviation.false_torque
        );
        assert!(now.0 < 0.05 && now.1 < 0.015, "{seed}: {now:?}");
        let mean = |found: f64, deviation: f64| (found / deviation).powi(2) / SEEDS as f64;
        squares.0 += mean(now.0, deviation.false_force);
        squares.1 += mean(now.1, deviation.false_torque);
    }
    println!("{squares:.2?}");
    // The largest of twelve directions is above the mean of all.
    assert!(squares.0 < 4.0 && squares.1 < 4.0, "{squares:?}");
}
