//! Flights of the campaign with pairs of faults in which the IMU does not show the motion, or shows it late: a board that restarts,
//! a late line, a gyro at the end of its range.

mod pairs;
mod stories;

use tilthex_sim::campaign::{self, Kind};

use pairs::{all_stand, each, hovering, none_fails};
use stories::fault;

/// Samples whose numbers begin anew say nothing about the line: one that is taken for late without reason turns the vehicle over.
#[test]
fn a_board_that_restarts_makes_no_line_late() {
    // The numbers repeat after 0.512 s.
    let pair = |(k, after)| {
        let reboot = fault(Kind::Reboot, 1.0 + after, 0.1, 0.5, 0);
        [reboot, fault(Kind::TelemetryZero, 0.9 + after, 0.9, 0.5, k)]
    };
    all_stand(41, each((0..6).step_by(2), &[0.0, 0.1, 0.2, 0.3, 0.4]).map(pair));
    let zero = fault(Kind::TelemetryZero, 1.285331577953296, 1.2023597458414796, 0.14052471275535616, 17);
    let reboot = fault(Kind::Reboot, 1.5793305559564454, 0.18055106068215673, 0.9108458799098571, 17);
    none_fails(&[(2243730, &[zero, reboot])]);
}

/// The shorter the delay of a line is, the faster a push is answered over it.
#[test]
fn a_push_over_a_late_line_turns_no_vehicle_over() {
    let pair = |(k, after)| {
        let late = fault(Kind::LineLate, 1.0, 1.8, 0.1 + 0.03 * k as f64, k);
        [late, fault(Kind::Push, 1.0 + after, 0.3, 0.45, k)]
    };
    all_stand(43, each((0..18).step_by(3), &[0.01, 0.3, 0.7]).map(pair));
    let push = fault(Kind::Push, 0.017966949922980868, 0.023954052946790122, 0.7482554331994714, 18);
    let late = fault(Kind::LineLate, 0.005735589710296862, 0.740157027793006, 0.3336071240448166, 31);
    none_fails(&[(2220083, &[push, late])]);
}

/// A gyro at the end of its range: readings that return from there are not believed if poses show another rate, and a vehicle
/// that has turned over is not given up while poses show how.
#[test]
fn a_gyro_at_the_end_of_its_range_spins_no_vehicle_up() {
    let pair = |(k, after)| {
        [fault(Kind::Push, 1.0 - after, 1.0, 0.6, k), fault(Kind::ImuSaturated, 1.85, 1.0, 0.5, k)]
    };
    all_stand(47, each((0..36).step_by(6), &[0.0, 0.05, 0.1]).map(pair));
    let saturated =
        fault(Kind::ImuSaturated, 1.5931431669972738, 0.22348177959983914, 0.45715469758433624, 35);
    let push = fault(Kind::Push, 0.632765617248039, 1.0972626809839656, 0.7645123435611334, 4);
    let arm = fault(Kind::PushOnArm, 2.07965808536414, 0.6008350401318177, 0.8400482716104118, 12);
    let late = fault(Kind::ImuSaturated, 2.417301968787624, 1.6531628778292424, 0.9369787977040968, 13);
    none_fails(&[(2275437, &[saturated, push]), (2279765, &[arm, late])]);
    // Where the ground stops a spin, the state holds the error of the model's rate, which is no bias of a good gyro.
    let stuck = fault(Kind::RotorStuck, 1.3384650585760718, 0.6350114087058969, 0.6541811634060191, 10);
    let outcome = campaign::fly(hovering(), vec![stuck], 9010105);
    assert!(outcome.failure.is_none() && outcome.ended, "{outcome:?}");
}
