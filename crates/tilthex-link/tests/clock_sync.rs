//! Clock synchronisation against its closed form, and against clocks whose truth is known.

#![allow(clippy::unwrap_used)]

use proptest::{collection::vec, prelude::*};
use tilthex_core::clock_sync::{ClockEvent, ClockParams, ClockSync};
use tilthex_link::{Arrival, SequenceClock};

const PERIOD: f64 = 0.002;

fn clock() -> ClockSync {
    ClockSync::new(ClockParams::default()).unwrap()
}

/// When each sample was made on our clock, for a remote clock of a known offset and relative drift.
fn made(remote: f64, offset: f64, drift: f64) -> f64 {
    remote * (1.0 + drift) + offset
}

fn latencies() -> impl Strategy<Value = Vec<f64>> {
    vec(0.0..0.008_f64, 2..300)
}

proptest! {
    #[test]
    fn the_offset_is_the_closed_form(latencies in latencies(), offset in -1e3..1e3_f64) {
        let mut clock = clock();
        let drift = ClockParams::default().drift;
        let seen: Vec<f64> = latencies.iter().map(|latency| offset + latency).collect();
        for (i, latency) in latencies.iter().enumerate() {
            let remote = i as f64 * PERIOD;
            let stamp = clock.step(remote, remote + offset + latency);
            let closed_form = (i.min(1)..=i)
                .map(|j| seen[j].max(seen[j.saturating_sub(1)]) + drift * (i - j) as f64 * PERIOD)
                .fold(f64::INFINITY, f64::min);
            prop_assert!((clock.offset(remote).unwrap() - closed_form).abs() < 1e-9);
            let expected = remote + closed_form.min(seen[i]);
            prop_assert!((stamp.time - expected).abs() < 1e-9);
        }
    }

    #[test]
    fn a_stamp_lies_between_making_and_arrival(
        latencies in latencies(), offset in -1e3..1e3_f64, drift in -1e-3..1e-3_f64,
    ) {
        let mut clock = clock();
        for (i, latency) in latencies.iter().enumerate() {
            let remote = i as f64 * PERIOD;
            let truth = made(remote, offset, drift);
            let stamp = clock.step(remote, truth + latency);
            prop_assert!(stamp.time >= truth - 1e-9 && stamp.time <= truth + latency + 1e-9);
        }
    }

    #[test]
    fn the_error_is_that_of_the_luckiest_pair_lately(
        latencies in vec(0.0..0.008_f64, 50..300), drift in -1e-3..1e-3_f64,
    ) {
        let mut clock = clock();
        for (i, latency) in latencies.iter().enumerate() {
            let remote = i as f64 * PERIOD;
            let truth = made(remote, 5.0, drift);
            let error = clock.step(remote, truth + latency).time - truth;
            if i >= 50 {
                let pairs = latencies[i - 50..=i].windows(2).map(|pair| pair[0].max(pair[1]));
                let luckiest = pairs.fold(f64::INFINITY, f64::min);
                prop_assert!(error <= luckiest + 2e-3 * 50.0 * PERIOD + 1e-9);
            }
        }
    }

    #[test]
    fn one_corrupt_stamp_does_not_pull_the_clock(
        latencies in vec(0.0..0.008_f64, 20..100), at in 5..15_usize, error in -10.0..10.0_f64,
    ) {
        let mut clock = clock();
        for (i, latency) in latencies.iter().enumerate() {
            let remote = i as f64 * PERIOD;
            let told = if i == at { remote + error } else { remote };
            let stamp = clock.step(told, remote + latency);
            prop_assert!(stamp.time <= remote + latency);
            if i != at {
                prop_assert!(stamp.time >= remote - 1e-9, "{} after {}", remote - stamp.time, i);
            }
        }
        prop_assert_eq!(clock.resets(), 0);
    }

    #[test]
    fn a_clock_that_was_set_is_noticed(jump in prop_oneof![0.05..100.0_f64, -100.0..-0.05_f64]) {
        let mut clock = clock();
        let latency = |i: usize| 0.001 * (i % 3) as f64;
        for i in 0..1000 {
            let time = i as f64 * PERIOD;
            let remote = if i < 500 { time } else { time + jump };
            let stamp = clock.step(remote, time + latency(i));
            // 0.25 s of patience are 125 periods.
            let settled = !(500..=500 + 127).contains(&i);
            prop_assert!(stamp.time <= time + latency(i));
            if settled {
                prop_assert!(i == 0 || stamp.event == ClockEvent::Expected);
                prop_assert!((stamp.time - time).abs() < 0.003, "{i}: {stamp:?}");
            }
        }
        prop_assert_eq!(clock.resets(), 1);
    }

    #[test]
    fn a_host_that_was_held_up_keeps_the_clock(held in 0.02..0.2_f64) {
        let mut clock = SequenceClock::new(PERIOD, ClockParams::default()).unwrap();
        for i in 0..2000_u32 {
            let made = f64::from(i) * PERIOD;
            let arrival = if (2.0..2.0 + held).contains(&made) { 2.0 + held } else { made + 1e-4 };
            match clock.step(i as u8, arrival) {
                Arrival::New { time, lost: 0, .. } => prop_assert!((time - made).abs() < 5e-4),
                other => prop_assert!(false, "{i}: {other:?}"),
            }
        }
        prop_assert_eq!(clock.resets(), 0);
    }

    #[test]
    fn numbers_unwrap_over_losses_and_duplicates(
        fates in vec(prop_oneof![6 => Just(1_u8), 2 => Just(0), 1 => Just(2)], 300..1500), first in any::<u8>(),
    ) {
        let mut clock = SequenceClock::new(PERIOD, ClockParams::default()).unwrap();
        let (mut lost, mut duplicates, mut pending, mut last) = (0, 0, 0, f64::NEG_INFINITY);
        for (i, &fate) in fates.iter().enumerate() {
            let made = i as f64 * PERIOD;
            let arrival = made + 0.0005 * (i % 4) as f64;
            if fate == 0 {
                pending += 1;
            }
            for again in 0..fate {
                let number = first.wrapping_add(i as u8);
                match clock.step(number, arrival) {
                    Arrival::New { time, lost: gap, .. } => {
                        prop_assert_eq!(again, 0);
                        let first_of_all = last == f64::NEG_INFINITY;
                        prop_assert_eq!(gap, if first_of_all { 0 } else { pending });
                        prop_assert!(time >= last && time <= arrival);
                        prop_assert!((time - made).abs() < 0.002);
                        lost += gap;
                        pending = 0;
                        last = time;
                    }
                    Arrival::Duplicate => duplicates += u32::from(again == 1),
                    Arrival::Suspect => prop_assert!(false, "sample {i} is suspect"),
                }
            }
        }
        let counters = clock.counters();
        prop_assert_eq!((counters.lost, counters.duplicates, counters.suspect), (lost, duplicates, 0));
    }

    #[test]
    // A flip in the very first number may cost a reset, and so may the same flip in two numbers in a row.
    fn flipped_bits_in_numbers_do_no_harm(flips in vec((0..500_usize, 0..8_u32), 1..20)) {
        let flips: Vec<_> = flips.into_iter().map(|(at, bit)| (3 * at + 1, bit)).collect();
        let mut clock = SequenceClock::new(PERIOD, ClockParams::default()).unwrap();
        for i in 0..1500_usize {
            let made = i as f64 * PERIOD;
            let flipped = flips.iter().any(|&(at, _)| at == i);
            let number = flips.iter().filter(|&&(at, _)| at == i).fold(i as u8, |n, &(_, bit)| n ^ (1 << bit));
            if let Arrival::New { time, .. } = clock.step(number, made + 1e-4) {
                let near_a_flip = flips.iter().any(|&(at, _)| at <= i && i <= at + 2);
                prop_assert!(time <= made + 1e-4);
                prop_assert!(flipped || near_a_flip || (time - made).abs() < 1e-3, "{i}: {time} {made}");
            }
        }
        prop_assert_eq!(clock.resets(), 0);
        prop_assert!(clock.counters().new + clock.counters().suspect + clock.counters().duplicates == 1500);
    }

    #[test]
    fn a_board_that_rebooted_resumes(silence in 0.3..5.0_f64, number in any::<u8>()) {
        let mut clock = SequenceClock::new(PERIOD, ClockParams::default()).unwrap();
        for i in 0..1000_u32 {
            let made = f64::from(i) * PERIOD + if i < 500 { 0.0 } else { silence };
            let sent = if i < 500 { i as u8 } else { number.wrapping_add(i as u8) };
            let arrival = clock.step(sent, made + 1e-4);
            let resumed = matches!(arrival, Arrival::New { time, lost: 0, .. } if (time - made).abs() < 1e-3);
            prop_assert!(resumed, "{}: {:?}", i, arrival);
        }
        prop_assert_eq!(clock.resets(), 1);
    }

    #[test]
    fn no_number_breaks_a_clock(stamps in vec((any::<f64>(), any::<f64>(), any::<u8>()), 0..50)) {
        let mut clock = clock();
        let mut numbers = SequenceClock::new(PERIOD, ClockParams::default()).unwrap();
        for (remote, arrival, number) in stamps {
            let _ = clock.step(remote, arrival);
            let _ = numbers.step(number, arrival);
            prop_assert!(clock.offset(0.0).is_none_or(f64::is_finite));
        }
    }
}

#[test]
fn parameters_are_refused() {
    let refused = |params| ClockSync::new(params).unwrap_err().to_string();
    let default = ClockParams::default();
    assert_eq!(
        refused(ClockParams { drift: -1.0, ..default }),
        "clock drift is -1; expected a number from 0 to 0.1"
    );
    assert!(refused(ClockParams { jump: f64::NAN, ..default }).starts_with("clock jump (s)"));
    assert!(SequenceClock::new(0.0, default).unwrap_err().to_string().starts_with("stream period (s) is 0"));
}
