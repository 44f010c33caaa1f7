//! The gate on samples.

#![allow(clippy::unwrap_used)]

use proptest::{collection::vec, prelude::*};
use tilthex_link::{Gate, GateParams, Verdict};

const PARAMS: GateParams<2> =
    GateParams { min: [-10.0; 2], max: [10.0; 2], jump: [1.0, 2.0], patience: 3, longest: 5 };

fn gate() -> Gate<2> {
    Gate::new(PARAMS).unwrap()
}

#[test]
fn a_spike_is_refused_and_a_step_is_believed() {
    let mut gate = gate();
    assert_eq!(gate.step(&[0.0, 0.0], 0), Verdict::Pass);
    assert_eq!(gate.step(&[5.0, 0.0], 0), Verdict::Jump);
    assert_eq!(gate.step(&[0.5, 0.0], 0), Verdict::Pass);
    let verdicts = [5.0, 5.5, 5.2, 5.1].map(|x| gate.step(&[x, 0.0], 0));
    assert_eq!(verdicts, [Verdict::Jump, Verdict::Jump, Verdict::Jump, Verdict::Pass]);
    assert_eq!(gate.step(&[5.1, f64::NAN], 0), Verdict::OutOfRange);
    assert_eq!(gate.step(&[5.1, 10.1], 0), Verdict::OutOfRange);
    let counters = gate.counters();
    assert_eq!((counters.passed, counters.jumps, counters.out_of_range), (3, 4, 2));
}

#[test]
fn a_stream_that_shakes_is_not_refused_for_long() {
    let mut gate = gate();
    let (mut refused, mut longest) = (0, 0);
    for i in 0..600 {
        // No two that are near each other for a while.
        let x = (7.3 * f64::from(i)) % 19.0 - 9.5;
        refused = if gate.step(&[x, 0.0], 0) == Verdict::Pass { 0 } else { refused + 1 };
        longest = longest.max(refused);
    }
    assert_eq!(longest, 5);
    // With gaps it is not the stream that shakes.
    let passed = (0..600).filter(|i| gate.step(&[9.0 * f64::from(i % 3 - 1), 0.0], 1) == Verdict::Pass);
    assert!(passed.count() <= 201);
}

/// Flipped bits bring back into the range what is no measurement, now and then: never believed.
#[test]
fn samples_about_an_interruption_are_not_in_a_row() {
    let mut gate = gate();
    gate.step(&[0.0, 0.0], 0);
    for _ in 0..50 {
        assert_eq!(gate.step(&[9.0, 0.0], 0), Verdict::Jump);
        gate.interrupt();
    }
    assert_eq!(gate.step(&[0.5, 0.0], 0), Verdict::Pass);
}

#[test]
fn a_gap_widens_the_jump() {
    let mut gate = gate();
    gate.step(&[0.0, 0.0], 0);
    assert_eq!(gate.step(&[2.5, 0.0], 1), Verdict::Jump);
    assert_eq!(gate.step(&[2.5, 0.0], 2), Verdict::Pass);
    gate.forget();
    assert_eq!(gate.step(&[-9.0, 9.0], 0), Verdict::Pass);
}

#[test]
fn parameters_are_refused() {
    assert!(Gate::new(GateParams { max: [f64::NAN; 2], ..PARAMS }).is_err());
    assert!(Gate::new(GateParams { max: [-11.0; 2], ..PARAMS }).is_err());
    assert!(Gate::new(GateParams { jump: [-1.0; 2], ..PARAMS }).is_err());
    assert!(Gate::new(GateParams { jump: [f64::INFINITY; 2], ..PARAMS }).is_ok());
}

proptest! {
    #[test]
    fn what_passes_is_in_range_and_near(samples in vec((any::<f64>(), -12.0..12.0_f64), 1..100)) {
        let mut gate = gate();
        let mut last: Option<[f64; 2]> = None;
        let mut refused_since = 0;
        for (a, b) in samples {
            // A third of the numbers are anything; the others walk through the range.
            let sample = if a.to_bits() % 3 == 0 { [a, b] } else { [b / 2.0, b] };
            if gate.step(&sample, 0) == Verdict::Pass {
                prop_assert!(sample.iter().all(|x| x.abs() <= 10.0));
                if let Some(last) = last {
                    let near = (sample[0] - last[0]).abs() <= 1.0 && (sample[1] - last[1]).abs() <= 2.0;
                    prop_assert!(near || refused_since >= 3);
                }
                last = Some(sample);
                refused_since = 0;
            } else {
                refused_since += 1;
            }
        }
    }

    #[test]
    fn a_smooth_stream_passes_whole(phase in 0.0..6.0_f64, rate in 0.0..0.1_f64) {
        let mut gate = gate();
        for i in 0..200 {
            let x = 9.0 * (phase + rate * f64::from(i)).sin();
            prop_assert_eq!(gate.step(&[x, -x], 0), Verdict::Pass);
        }
    }
}
