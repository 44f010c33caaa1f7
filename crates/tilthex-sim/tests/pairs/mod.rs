//! What the tests of flights with pairs of faults share.

use tilthex_sim::campaign::{self, Injection, World};

use crate::stories::config;

/// Flies stories, each with its seed and its faults: none fails.
pub(crate) fn none_fails(stories: &[(u64, &[Injection])]) {
    for &(seed, faults) in stories {
        let outcome = campaign::fly(hovering(), faults.to_vec(), seed);
        assert_eq!(outcome.failure, None, "{outcome:?}");
    }
}

/// Flies with each pair of faults: nothing fails, the flight ends, and the vehicle stands on its feet.
pub(crate) fn all_stand(seed: u64, pairs: impl IntoIterator<Item = [Injection; 2]>) {
    let world = hovering();
    for pair in pairs {
        let outcome = campaign::fly(world.clone(), pair.to_vec(), seed);
        assert_eq!(outcome.failure, None, "{outcome:?}");
        assert!(outcome.ended && !outcome.toppled, "{outcome:?}");
    }
}

/// All pairs of a number and a time.
pub(crate) fn each(
    numbers: impl Iterator<Item = usize>,
    times: &[f64],
) -> impl Iterator<Item = (usize, f64)> {
    numbers.flat_map(move |k| times.iter().map(move |time| (k, *time)))
}

/// The moment at which the mission begins.
pub(crate) fn hovering() -> World {
    campaign::hover(&config()).expect("it hovers")
}
