//! The fault campaign itself: its flights are reproducible, and its judge is awake.

mod pairs;
mod stories;

use std::{path::Path, sync::Mutex};

use proptest::prelude::*;
use tilthex_config::{Config, TruthSection};
use tilthex_core::supervisor::{Fault, Reaction};
use tilthex_link::LinkedFlight;
use tilthex_sim::{
    Push, Pushes, Simulation, SimulationParams,
    campaign::{self, Injection, Kind, Part, World},
};

use pairs::{all_stand, each, hovering, none_fails};
use stories::fault;

/// With keys of the vehicle.
fn hovering_with(keys: &str) -> World {
    let text = format!("[vehicle]\npreset = \"tilt-hex\"\n{keys}");
    let config = Config::from_text(&text, Path::new("")).expect("valid");
    campaign::hover(&config).expect("it hovers")
}

fn injection(kind: Kind, duration: f64) -> Injection {
    Injection { kind, begin: 1.0, duration, strength: 0.5, index: 0 }
}

#[test]
fn without_faults_nothing_is_reported() {
    let outcome = campaign::fly(hovering(), vec![], 1);
    assert_eq!(outcome.failure, None);
    assert_eq!(outcome.reaction, Reaction::Note);
    assert!(outcome.ended, "{outcome:?}");
    assert!(outcome.deviation < 0.01, "{outcome:?}");
}

#[test]
fn the_vehicle_of_all_flights_has_the_drag_of_its_rotors() {
    let flown = |keys| campaign::fly(hovering_with(keys), vec![], 1).deviation;
    assert_ne!(flown(""), flown("rotor_drag = 1e-3"));
}

#[test]
fn the_same_seed_is_the_same_flight() {
    let world = hovering();
    let faults = vec![injection(Kind::BitFlips, 2.0), injection(Kind::CaptureNoise, 1.0)];
    let first = campaign::fly(world.clone(), faults.clone(), 5);
    assert_eq!(first, campaign::fly(world.clone(), faults.clone(), 5));
    assert_ne!(first, campaign::fly(world, faults, 6));
}

#[test]
fn faults_are_seen_and_answered_as_the_table_says() {
    let world = hovering();
    for (kind, duration, fault, reaction) in [
        (Kind::CaptureLost, 0.3, Fault::PoseLost, Reaction::Hold),
        (Kind::CaptureLost, 1.0, Fault::PoseLostLong, Reaction::Land),
        (Kind::ImuFrozen, 2.0, Fault::ImuFrozen, Reaction::Land),
        (Kind::Stopped, 0.1, Fault::OverrunLong, Reaction::Hold),
        (Kind::Unplugged, 60.0, Fault::LinkLost, Reaction::Descend),
        (Kind::DiskFull, 2.0, Fault::LogLost, Reaction::Note),
        (Kind::CaptureClock, 1.0, Fault::CaptureClock, Reaction::Note),
        (Kind::Reboot, 0.1, Fault::ImuSilent, Reaction::Land),
    ] {
        let outcome = campaign::fly(world.clone(), vec![injection(kind, duration)], 1);
        assert!(outcome.seen.contains(fault), "{kind:?}: {outcome:?}");
        assert!(outcome.reaction >= reaction, "{kind:?}: {outcome:?}");
        assert_eq!(outcome.failure, None, "{kind:?}");
    }
}

/// Flights of the campaign that failed: with poses of a clock that jumps, with motors that started again on the ground, with
/// the poses of another body after missing samples, with a wrong attitude on the ground, and with a wrong vertical speed.
#[test]
fn what_failed_once_is_mended() {
    let clock = fault(Kind::CaptureClock, 2.0592582656768093, 2.6022380754951784, 0.16019811796131012, 5);
    let silence = fault(Kind::CommandsLost, 1.8774138265466533, 1.7121289415127916, 0.6809567021571429, 2);
    let late = fault(Kind::LineLate, 1.74, 0.16348389710778313, 0.5672472237816106, 12);
    let other = fault(Kind::CaptureOtherBody, 1.0, 2.0338712583723986, 0.45592490780023376, 16);
    let saturated = fault(Kind::ImuSaturated, 1.4880252259392854, 0.8359211810164432, 0.4511280775971922, 5);
    let default = fault(Kind::CaptureDefault, 1.867198968403799, 2.718878208183625, 0.9383029871001973, 29);
    let another =
        fault(Kind::CaptureOtherBody, 1.960270130591542, 1.3816752064462055, 0.7654194374305122, 14);
    let step = fault(Kind::AccelerometerBias, 2.134336106888703, 1.2305387291654717, 0.8201846049629365, 35);
    none_fails(&[
        (973403, &[clock]),
        (974797, &[silence]),
        (975012, &[late, other]),
        (1106573, &[saturated, default]),
        (1107846, &[another, step]),
    ]);
}

/// Poses of another body that were refused by a certain state are not believed because samples are missing or a blow comes. Poses
/// that freeze while no inertial sample comes are found, and true poses are no lie where nothing had corrected the state.
#[test]
fn false_poses_stay_false_and_true_poses_true_while_samples_are_missing() {
    let stall = fault(Kind::StalledInTick, 2.1044563673786745, 0.37538753085642795, 0.40442138811715667, 25);
    let other = fault(Kind::CaptureOtherBody, 0.8608897513524225, 1.628697315747216, 0.6766497466600844, 19);
    let another =
        fault(Kind::CaptureOtherBody, 0.39843548559912156, 2.215054589998305, 0.32571773028482476, 15);
    let flips = fault(Kind::BitFlips, 1.7466054532988635, 0.9116068308494976, 0.05918952021153134, 32);
    let default = fault(Kind::CaptureDefault, 2.3905016354150055, 0.90686430453314, 0.424531976441891, 5);
    let unplugged = fault(Kind::Unplugged, 1.9948748518967045, 0.9078124170237521, 0.3508920403397777, 3);
    let gone = fault(Kind::Unplugged, 1.1617832274320248, 0.9103695958480195, 0.37585703305821183, 14);
    let frozen = fault(Kind::CaptureFrozen, 1.932740662199862, 1.6880573660865734, 0.8402144822399374, 5);
    none_fails(&[
        (1109479, &[stall, other]),
        (1602983, &[another, flips]),
        (1605599, &[default, unplugged]),
        (1900999, &[gone, frozen]),
    ]);
}

/// Missing samples explain only what a vehicle can have flown since the last pose that agreed; and a gyro that drifts while no true
/// pose comes is found by the poses that return.
#[test]
fn missing_samples_do_not_make_another_body_possible() {
    let reboot = fault(Kind::Reboot, 2.402063094642229, 0.08241236345636162, 0.359695192278897, 30);
    let soon = fault(Kind::CaptureOtherBody, 2.5385853526886852, 0.684022011130634, 0.2836590775900274, 7);
    let flips = fault(Kind::BitFlips, 0.913832468532816, 0.34109206281954896, 0.05612155382619188, 7);
    let brief = fault(Kind::CaptureOtherBody, 1.231733654657786, 0.25731662581407944, 0.4265415475253834, 12);
    let long = fault(Kind::CaptureOtherBody, 2.259956250369118, 1.4616696030660634, 0.22477633262567698, 33);
    let stall = fault(Kind::StalledInTick, 1.8145670771325513, 0.29122027377039983, 0.7993490516335626, 2);
    let near = fault(Kind::CaptureOtherBody, 1.2791612861462802, 1.3118279194483808, 0.08512884069799698, 26);
    let lost = fault(Kind::FramesLost, 1.0736042186116157, 1.5849906204293114, 0.8287448822611206, 3);
    let default = fault(Kind::CaptureDefault, 0.6724988275375497, 0.9065214493539674, 0.275347222992225, 20);
    let gyro = fault(Kind::GyroBias, 0.5025744758461451, 1.9884078167863959, 0.6567178272035775, 3);
    none_fails(&[
        (1970521, &[reboot, soon]),
        (1972314, &[flips, brief]),
        (1958706, &[long, stall]),
        (1959331, &[near, lost]),
        (1974389, &[default, gyro]),
    ]);
}

/// Without an IMU nothing shows whether a rotor that reports a stop lifts: the model that replaces the IMU takes it as turning, and
/// the vehicle lands on its feet.
#[test]
fn a_false_stop_turns_no_vehicle_over_that_has_no_imu() {
    let frozen = fault(Kind::ImuFrozen, 0.9, 0.7, 0.5, 0);
    let zero = |rotor| fault(Kind::TelemetryZero, 1.05, 0.2 + 0.3 * rotor as f64, 0.5, rotor);
    all_stand(7, (0..6).map(|rotor| [frozen, zero(rotor)]));
    // A motor that itself says that it has stopped is believed.
    let frozen = fault(Kind::ImuFrozen, 0.93, 1.0, 0.5, 0);
    all_stand(100, (0..6).map(|rotor| [frozen, fault(Kind::MotorEmergency, 1.0, 0.6, 0.5, rotor)]));
    let frozen = fault(Kind::ImuFrozen, 0.8775960566237254, 0.7285766965964035, 0.10399596276051604, 24);
    let zero = fault(Kind::TelemetryZero, 1.005862695348532, 0.17691847344051576, 0.5681027679608214, 3);
    let early = fault(Kind::ImuFrozen, 0.09672116760268201, 0.40087822551766217, 0.7462576474237289, 27);
    let long = fault(Kind::TelemetryZero, 0.28003483840594623, 1.8688580117828326, 0.6399573328912002, 15);
    none_fails(&[(2040586, &[frozen, zero]), (1993097, &[early, long])]);
}

/// A torque that a blow makes, or that an IMU feigns by freezing in a turn, does not last: the model that replaces the IMU goes on
/// without it, and the vehicle lands on its feet.
#[test]
fn an_imu_that_freezes_in_a_blow_turns_no_vehicle_over() {
    let pair = |(arm, after)| {
        [fault(Kind::PushOnArm, 1.0, 0.18, 0.5, arm), fault(Kind::ImuFrozen, 1.0 + after, 1.0, 0.5, 0)]
    };
    all_stand(11, each(0..6, &[0.03, 0.09, 0.15, 0.21]).map(pair));
    let caught = fault(Kind::ImuFrozen, 1.416055248560844, 1.293565639464017, 0.18295884032742227, 13);
    let blow = fault(Kind::PushOnArm, 1.32788698616188, 0.18277540236589693, 0.5510703844157652, 2);
    let early = fault(Kind::ImuFrozen, 1.4954400413526174, 1.216689602108047, 0.5211663999078567, 20);
    let long = fault(Kind::PushOnArm, 1.11249360268513, 0.5521942951615554, 0.7894736637065416, 13);
    let hidden = fault(Kind::ImuFrozen, 1.9295447501616456, 2.0978683268215588, 0.8536802961328909, 21);
    let unfelt = fault(Kind::PushOnArm, 2.865134591044849, 0.1124408624703631, 0.5587939585010256, 32);
    none_fails(&[(2080271, &[caught, blow]), (3000173, &[early, long]), (3000203, &[hidden, unfelt])]);
}

/// A step of the gyro's bias is not taken for false poses, also while something pushes the vehicle or just before.
#[test]
fn a_push_hides_no_step_of_the_gyros_bias() {
    let pair = |(k, after)| {
        [fault(Kind::Push, 1.0, 1.0, 0.35, k), fault(Kind::GyroBias, 1.0 + after, 2.0, 0.7, k + 1)]
    };
    all_stand(17, each((0..36).step_by(6), &[-0.3, 0.2, 0.9]).map(pair));
    let zero = fault(Kind::TelemetryZero, 0.6616214274922589, 0.6470534807704698, 0.7721728514413592, 5);
    let late = fault(Kind::GyroBias, 2.761916074738453, 1.2616007711623303, 0.8463960682831544, 33);
    let early = fault(Kind::GyroBias, 0.8043024411076091, 1.7011704402769101, 0.7253342934481132, 21);
    let arm = fault(Kind::PushOnArm, 0.0021030735357033814, 1.252071201610366, 0.5219929158117803, 5);
    none_fails(&[(2138734, &[zero, late]), (2128049, &[early, arm])]);
}

/// A push that begins or ends while no IMU shows it: the poses show its torque, and the vehicle lands on its feet.
#[test]
fn poses_show_a_push_that_no_imu_shows() {
    let pair =
        |(k, after)| [fault(Kind::Push, 1.0, 1.0, 0.6, k), fault(Kind::ImuFrozen, 1.0 + after, 1.5, 0.5, 0)];
    all_stand(13, each((0..36).step_by(6), &[0.1, 0.4, 0.8]).map(pair));
    let tool = fault(Kind::Push, 0.9077587051501463, 1.0040564201148678, 0.5082264949360532, 10);
    let soon = fault(Kind::ImuFrozen, 0.9965070835659816, 2.1163981840898094, 0.4951286668956746, 28);
    let arm = fault(Kind::PushOnArm, 2.6903183322027235, 0.7027979113062089, 0.9920841584729305, 26);
    let late = fault(Kind::ImuFrozen, 2.8162485660156946, 1.3427396612869946, 0.7172646485891743, 24);
    none_fails(&[(2123785, &[soon, tool]), (2113047, &[late, arm])]);
}

/// True poses that a state refuses because something led it astray are found to be those of the vehicle: a wrong bias of the
/// accelerometer, wrong poses that were believed or that hid a turn, a second change of the gyro's bias.
#[test]
fn refused_poses_that_move_as_the_vehicle_does_are_used_again() {
    let pair = |(k, after)| {
        let step = fault(Kind::AccelerometerBias, 1.0, 2.0, 0.9, k);
        [step, fault(Kind::CaptureJumps, 1.0 + after, 0.22, 0.5, 5 * k + 1)]
    };
    all_stand(19, each(0..6, &[0.1, 0.3]).map(pair));
    let step = fault(Kind::AccelerometerBias, 1.1844170089568942, 2.079480282765382, 0.9481104305458261, 9);
    let brief = fault(Kind::CaptureJumps, 1.2812090430785021, 0.21958508710995736, 0.44387823820072314, 13);
    let late = fault(Kind::AccelerometerBias, 0.8852201989442083, 1.6995933416665512, 0.9853608051209416, 5);
    let early = fault(Kind::CaptureJumps, 0.05913823179027544, 1.9387050823350147, 0.7327285859220268, 15);
    let believed = fault(Kind::CaptureJumps, 1.1142916100316325, 0.02293640554186039, 0.14502412824690092, 1);
    let flips = fault(Kind::BitFlips, 0.7212364245892933, 0.4123598565333136, 0.4212322164048009, 13);
    let hides = fault(Kind::CaptureFrozen, 1.6103520989851952, 0.475319661303734, 0.47047596619724064, 29);
    let slow = fault(Kind::RotorSlow, 1.3635716052306242, 0.24818300967010654, 0.494198092216945, 15);
    let unfelt = fault(Kind::ImuFrozen, 0.3040230336507016, 1.8963186317813363, 0.21918819196271366, 27);
    let long = fault(Kind::CaptureJumps, 1.117453646845732, 2.3169413479649004, 0.5567927457450397, 34);
    let first = fault(Kind::GyroBias, 0.18436443200224262, 0.8677472091059999, 0.21464425263724718, 8);
    let again = fault(Kind::GyroBias, 2.5875175312958656, 1.4462949208802351, 0.6894524069927984, 7);
    none_fails(&[
        (2044182, &[step, brief]),
        (1985161, &[late, early]),
        (2134547, &[believed, flips]),
        (2134931, &[hides, slow]),
        (2040806, &[long, unfelt]),
        (3080935, &[first, again]),
    ]);
}

/// Poses that become still noisier, or are displaced, while the estimator already knows that they are noisy.
#[test]
fn noisy_poses_that_become_noisier_disturb_little() {
    let pair = |(k, strength)| {
        let first = fault(Kind::CaptureNoise, 0.5, 1.5, strength, k);
        [first, fault(Kind::CaptureNoise, 2.0, 1.2, strength + 0.45, k + 7)]
    };
    all_stand(23, each(0..4, &[0.3, 0.4]).map(pair));
    let noisy = fault(Kind::CaptureNoise, 1.1443702294489206, 1.2443433483687993, 0.39672562338191486, 7);
    let noisier = fault(Kind::CaptureNoise, 2.392463709915414, 1.5120889201921701, 0.8685676776607527, 6);
    let long = fault(Kind::CaptureNoise, 0.7193076452925964, 2.857801816972074, 0.8497872943495788, 25);
    let jump = fault(Kind::CaptureJumps, 2.5604527722825954, 1.8262007732557175, 0.3228165894847592, 28);
    none_fails(&[(3060406, &[noisy, noisier]), (2002270, &[long, jump])]);
}

/// A vehicle that followed another body's poses since samples were missing goes on from what it knew before them.
#[test]
fn false_poses_that_begin_while_the_program_stands_still_lead_no_vehicle_away() {
    let pair = |(k, after)| {
        let other = fault(Kind::CaptureOtherBody, 1.0 + after, 1.3, 0.2, 6 * k + 3);
        [fault(Kind::Stopped, 1.0, 0.5, 0.63, 0), other]
    };
    all_stand(29, each(0..6, &[0.05, 0.1, 0.2]).map(pair));
    let stopped = fault(Kind::Stopped, 1.066849853192733, 0.5007916290594163, 0.6336711235066702, 29);
    let other = fault(Kind::CaptureOtherBody, 1.1642977837805342, 1.2598018940051652, 0.20201555389325188, 3);
    none_fails(&[(2162919, &[stopped, other])]);
}

/// Without IMU and poses a vehicle that nothing pushes keeps its attitude for a second.
#[test]
fn a_vehicle_that_neither_feels_nor_sees_stays_upright_for_a_second() {
    let pair = |(k, after)| {
        let unseen = [Kind::CaptureLost, Kind::CaptureDefault, Kind::CaptureOtherBody][k % 3];
        let unfelt = if k < 3 { Kind::ImuFrozen } else { Kind::ImuSaturated };
        [fault(unfelt, 1.0, 2.0, 0.5, k), fault(unseen, 1.0 + after, 1.2, 0.5, k)]
    };
    all_stand(31, each(0..6, &[0.2, 0.4, 0.7]).map(pair));
}

/// A line that becomes late while the program stands still is found to be late.
#[test]
fn a_line_that_becomes_late_unseen_is_late() {
    let pair = |(k, after)| {
        let late = fault(Kind::LineLate, 1.0 + after, 2.0, 0.7 + 0.03 * k as f64, k);
        [fault(Kind::Stopped, 1.0, 0.2, 0.78, 0), late]
    };
    all_stand(37, each(0..5, &[0.05, 0.16, 0.25]).map(pair));
}

/// No law acts while no command reaches the vehicle, and a vehicle without a rotor balances no push: neither is judged as the
/// flight of a vehicle that can carry itself.
#[test]
fn what_no_command_can_prevent_is_not_judged() {
    let push = fault(Kind::Push, 1.1937441541548113, 0.14120358835866106, 0.8192113198356831, 4);
    let stall = fault(Kind::StalledInTick, 1.1789303268831124, 0.22462998598402334, 0.9246264340702102, 18);
    let motor = fault(Kind::MotorEmergency, 2.8798102181081786, 1.3500975260289696, 0.04951972101242952, 2);
    let arm = fault(Kind::PushOnArm, 2.3692490191351654, 2.4763095187029003, 0.9341258744705702, 21);
    let turning = fault(Kind::PushOnArm, 1.587463144936935, 0.6107865908165586, 0.9860977969850758, 30);
    let boot = fault(Kind::Reboot, 1.6278935668228216, 0.05909055035153188, 0.22645361000453224, 16);
    none_fails(&[(1904933, &[push, stall]), (1802474, &[motor, arm]), (2120775, &[turning, boot])]);
}

/// A step of the accelerometer's bias is a wrong accelerometer, not false poses: while it lasts and after it has ended.
#[test]
fn a_step_of_the_accelerometers_bias_leaves_the_poses_in_use() {
    for (seed, begin, duration, strength, index) in [
        (1600615, 0.27, 0.55, 0.951, 0),
        (1700079, 0.78, 2.14, 0.743, 3),
        (1700103, 1.51, 0.81, 0.866, 34),
        (1700107, 0.19, 1.08, 0.941, 29),
    ] {
        let fault = Injection { kind: Kind::AccelerometerBias, begin, duration, strength, index };
        let outcome = campaign::fly(hovering(), vec![fault], seed);
        assert!(!outcome.seen.contains(Fault::PoseContradicts), "{outcome:?}");
        assert_eq!(outcome.failure, None, "{outcome:?}");
    }
}

#[test]
fn the_judge_sees_a_vehicle_that_flies_away() {
    let params = stories::config().linked_params(true).expect("valid");
    let mut simulated = SimulationParams::new(params.flight.vehicle);
    // More than its rotors can hold against.
    let push = Push { at: 10.0, duration: 20.0, force: [60.0, 0.0, 0.0], torque: [0.0; 3] };
    simulated.pushes = Pushes::new(vec![push]);
    let world = World::new(Simulation::new(simulated), LinkedFlight::new(params, None).expect("valid"), 1);
    let failure = campaign::fly(world, vec![], 1).failure.expect("seen");
    assert!(failure.contains("flew "), "{failure}");
}

/// Parts of one campaign, in any order and in any groups, give exactly the whole.
#[test]
fn merged_parts_are_the_whole() {
    const FIRST: u64 = 4_200_001;
    const SEEDS: u64 = 6;
    let config = stories::config();
    let exact = TruthSection::named("exact").expect("a level");
    let kinds = [Kind::BitFlips, Kind::RotorStuck, Kind::CaptureLost];
    let fly = |kinds: &[Kind], count, first| {
        let told = Mutex::new(vec![]);
        let tell = |ended| told.lock().expect("no panic").push(ended);
        let summary = campaign::run(&config, &exact, kinds, count, first, &tell).expect("it flies");
        assert!(told.into_inner().expect("no panic").into_iter().eq(1..=count));
        Part::new(&config, &exact, kinds, count, first, summary)
    };
    let whole = fly(&kinds, SEEDS, FIRST);
    assert_eq!(whole.flights(), SEEDS);
    let single: Vec<_> = (0..SEEDS).map(|k| fly(&kinds, 1, FIRST + k)).collect();
    let order = Just((0..SEEDS as usize).collect::<Vec<_>>()).prop_shuffle();
    proptest!(|(order in order, cut in 1..SEEDS as usize)| {
        let join = |places: &[usize]| {
            let mut joined = single[places[0]].clone();
            for &k in &places[1..] {
                joined.join(single[k].clone()).expect("another seed of the same campaign");
            }
            joined
        };
        let (mut one, other) = (join(&order[..cut]), join(&order[cut..]));
        let ranges = one.seeds().to_vec();
        prop_assert!(one.clone().join(one.clone()).is_err(), "{ranges:?}");
        one.join(other).expect("the other seeds");
        prop_assert_eq!(one.seeds(), &[(FIRST, FIRST + SEEDS - 1)]);
        prop_assert_eq!(one.summary().table(), whole.summary().table());
        prop_assert_eq!(&one, &whole);
    });
    let why = whole.clone().join(fly(&[Kind::BitFlips], 1, 1)).expect_err("other kinds");
    assert!(why.contains("--faults"), "{why}");
    let other =
        Config::from_text("vehicle.preset = \"tilt-hex\"\nadmittance.low_pass_hz = 7.0", Path::new(""));
    let cad = TruthSection::named("cad").expect("a level");
    for (config, truth, said) in [(&other.expect("valid"), &exact, "7.0"), (&config, &cad, "another truth")] {
        let part = Part::new(config, truth, &kinds, 1, 1, whole.summary().clone());
        let why = whole.clone().join(part).expect_err("another campaign");
        assert!(why.contains(said), "{why}");
    }
}
