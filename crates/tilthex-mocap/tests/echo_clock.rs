//! Two-way clock synchronisation against a clock whose truth is known.

use proptest::{collection::vec, prelude::*};
use tilthex_mocap::echo_clock::EchoClock;

const DRIFT: f64 = 1e-4;

proptest! {
    #[test]
    fn the_truth_lies_within_the_uncertainty(
        trips in vec((0.0..0.01_f64, 0.0..0.01_f64), 1..50), offset in -1e4..1e4_f64, drift in -DRIFT..DRIFT,
    ) {
        let mut clock = EchoClock::new(DRIFT);
        let mut narrowest = f64::INFINITY;
        for (i, (there, back)) in trips.into_iter().enumerate() {
            let asked = i as f64;
            // The remote clock: ours without the offset, and drifting.
            let remote = |ours: f64| ours * (1.0 - drift) - offset;
            let answered = asked + there + back;
            prop_assert!(!clock.step(asked, remote(asked + there), answered));
            let (ours, uncertainty) = clock.to_ours(remote(answered), answered).expect("an answer came");
            prop_assert!((ours - answered).abs() <= uncertainty + 1e-9);
            narrowest = f64::min(narrowest + DRIFT * 1.1, (there + back) / 2.0);
            prop_assert!(uncertainty <= narrowest + 1e-6);
        }
    }

    #[test]
    fn a_clock_that_was_set_is_noticed(jump in prop_oneof![0.1..100.0_f64, -100.0..-0.1_f64]) {
        let mut clock = EchoClock::new(DRIFT);
        for i in 0..20_u32 {
            let asked = f64::from(i);
            let told = asked + 0.001 + if i < 10 { 0.0 } else { jump };
            prop_assert_eq!(clock.step(asked, told, asked + 0.002), i == 10);
        }
        prop_assert_eq!(clock.resets(), 1);
        let (ours, _) = clock.to_ours(20.0 + jump, 20.0).expect("an answer came");
        prop_assert!((ours - 20.0).abs() < 1e-9);
    }

    #[test]
    fn no_number_breaks_it(answers in vec((any::<f64>(), any::<f64>(), any::<f64>()), 0..20)) {
        let mut clock = EchoClock::new(DRIFT);
        for (asked, remote, answered) in answers {
            clock.step(asked, remote, answered);
        }
        prop_assert!(clock.to_ours(0.0, 0.0).is_none_or(|(ours, _)| ours.is_finite()));
    }
}
