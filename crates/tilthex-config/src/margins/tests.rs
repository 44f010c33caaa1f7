use super::*;
use crate::{Config, PRESETS, TruthSection, VehicleSection};
use tilthex_core::{Vector3, vehicle::Actuation};

fn of(overlay: &str) -> LoopModel {
    let config = Config::default_for(VehicleSection::preset("tilt-hex").unwrap());
    LoopModel::of(&config.overlaid(overlay.parse().unwrap()).unwrap())
}

/// Compares with the loop `(rate s + proportional) / s^2` with a lag of 0.03 s and a delay of 5 ms, of which half a period is
/// the hold.
#[test]
fn margins_are_those_of_the_loop_in_closed_form() {
    let model = of(
        "[link]\nloop_delay = 0.004\nmotor_rate = 250\n[wrench_observer]\nforce_gain = 1e-6\ntorque_gain = 1e-6\n\
                    [pose_control]\nposition_gain = 100\nvelocity_gain = 20\nrotation_gain = 225\nangular_velocity_gain = 30",
    );
    let margins = model.hover();
    for (axis, proportional, rate) in [(0, 100.0, 20.0), (2, 100.0, 20.0), (4, 225.0, 30.0), (5, 225.0, 30.0)]
    {
        let gain = |w: f64| f64::hypot(rate * w, proportional) / (w * w * f64::hypot(1.0, 0.03 * w));
        let (mut low, mut high) = (1.0_f64, 100.0_f64);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if gain(middle) > 1.0 { low = middle } else { high = middle }
        }
        let phase = (rate * low / proportional).atan() - (0.03 * low).atan() - 0.005 * low;
        let found = margins.axes[axis];
        assert!((found.crossover / low - 1.0).abs() < 2e-3, "{axis}: {found:?}, {low}");
        assert!((found.phase_margin_deg - phase.to_degrees()).abs() < 0.2, "{axis}: {found:?}, {phase}");
        // |S| at the crossover is a lower bound of its peak.
        assert!(found.sensitivity_peak >= 0.5 / (0.5 * phase).sin() * 0.999, "{axis}: {found:?}");
    }
}

#[test]
fn a_gain_of_nine_hundred_is_unstable_and_a_soft_one_stable() {
    let hard = of("[pose_control]\nrotation_gain = 90000\nangular_velocity_gain = 900").hover();
    assert!(!hard.stable && hard.axes[3].phase_margin_deg < 0.0, "{hard:?}");
    assert!(of("").hover().stable);
}

/// Above the observer's bandwidth, a vehicle that is lighter than its model accelerates more, by the ratio of the masses.
#[test]
fn a_lighter_vehicle_has_so_much_less_gain_margin() {
    let config = Config::default_for(VehicleSection::preset("tilt-hex").unwrap());
    let truth = TruthSection::from_table("vehicle.mass = 2.0".parse().unwrap()).unwrap();
    let light = LoopModel::of_true(&config, &truth.draw(config.vehicle(), 1).unwrap()).hover();
    let model = LoopModel::of(&config).hover();
    for axis in 0..3 {
        let ratio = light.axes[axis].gain_margin / model.axes[axis].gain_margin;
        assert!((ratio - 2.0 / 2.4).abs() < 0.03, "{axis}: {ratio}");
    }
}

#[test]
fn contact_without_damping_ends_before_contact_with_it_and_no_preset_is_left_out() {
    for (name, _) in PRESETS {
        let model = LoopModel::of(&Config::default_for(VehicleSection::preset(name).unwrap()));
        assert!(model.hover().stable, "{name}");
        let without = model.contact(Contact::along(Vector3::z()));
        let with = model.contact(Contact { damping_time: 1e-3, ..Contact::along(Vector3::z()) });
        assert!(0.0 < without.border() && without.border() <= with.border(), "{name}: {without:?}, {with:?}");
        assert!(with.holds(100.0) && !with.holds(2e6), "{name}");
    }
}

#[test]
fn along_an_axis_in_which_directions_are_alike_the_border_is_the_axis_own() {
    let model = of("");
    let along = |direction: Vector3| model.contact(Contact::along(direction)).border();
    assert!((along(Vector3::x()) / along(-Vector3::x()) - 1.0).abs() < 1e-9);
    assert!((along(2.0 * Vector3::x()) / along(Vector3::x()) - 1.0).abs() < 1e-9);
    let (direction, range) = model.worst_contact(0.0);
    assert!(range.border() <= along(direction) * (1.0 + 1e-9) && range.border() <= along(Vector3::x()));
}

#[test]
fn below_the_least_apparent_mass_contact_is_unstable() {
    let model = of("");
    let least = model.least_apparent_mass(2, 1e4, 1e-3);
    assert!(least > 0.0 && least < 1.5, "{least}");
    let mut lighter = model.clone();
    lighter.params.admittance.mass[(2, 2)] = 0.8 * least;
    let contact = Contact { damping_time: 1e-3, ..Contact::along(Vector3::z()) };
    assert!(lighter.contact(contact).border() < 1e4 && model.contact(contact).border() >= 1e4);
    assert!(model.least_apparent_mass(2, 1e6, 0.0).is_infinite());
}

#[test]
fn derived_gains_have_the_margins_that_are_asked_for() {
    let truth = TruthSection::named("measured").unwrap();
    for (name, _) in PRESETS {
        let config = Config::default_for(VehicleSection::preset(name).unwrap());
        let derived = LoopModel::of(&config).derive().to_toml();
        let config = config.overlaid(derived.parse().unwrap()).unwrap();
        let model = LoopModel::of(&config);
        let found = model.hover();
        assert!(
            found.stable && found.least_phase_margin_deg() >= LEAST_PHASE_MARGIN_DEG,
            "{name}: {found:?}"
        );
        assert!(found.largest_sensitivity_peak() <= LARGEST_PEAK, "{name}: {found:?}");
        assert!(
            found.axes.iter().all(|a| a.phase_margin_deg < 48.0 || name.contains("rotor")),
            "{name}: {found:?}"
        );
        if config.vehicle().vehicle().actuation() == Actuation::Pose {
            let contact = model.contact(Contact { damping_time: 1e-3, ..Contact::along(Vector3::x()) });
            assert!(contact.border() > 5e4, "{name}: {contact:?}");
        }
        for seed in 7100..7102 {
            let drawn = truth.draw(config.vehicle(), seed).unwrap();
            let found = LoopModel::of_true(&config, &drawn).hover();
            assert!(found.stable && found.least_phase_margin_deg() >= 30.0, "{name}, {seed}: {found:?}");
        }
    }
}

#[test]
fn where_rotors_or_the_line_are_slow_the_default_gains_are_derived() {
    let of = |vehicle: &str, rest: &str| {
        let text = format!("[vehicle]\npreset = \"tilt-hex\"\n{vehicle}\n{rest}");
        Config::from_text(&text, std::path::Path::new("")).unwrap()
    };
    let (usual, slow) = (of("", ""), of("rotor_time_constant = 0.1", ""));
    let late = of("", "[link]\nloop_delay = 0.03");
    assert_eq!(usual.pose_control().rotation_gain.0, [225.0; 3]);
    for config in [slow, late] {
        let found = LoopModel::of(&config).hover();
        assert!(found.least_phase_margin_deg() >= LEAST_PHASE_MARGIN_DEG, "{found:?}");
        assert_eq!(config.warnings(), Vec::<String>::new());
    }
}

#[test]
fn low_margins_are_said_in_one_sentence_that_names_the_axes() {
    let warnings = |overlay: &str| {
        let config = Config::default_for(VehicleSection::preset("tilt-hex").unwrap());
        config.overlaid(overlay.parse().unwrap()).unwrap().warnings()
    };
    let low = warnings("[pose_control]\nrotation_gain = 900\nangular_velocity_gain = 60");
    assert!(low.len() == 1 && low[0].starts_with("[pose_control]: roll, pitch and yaw: "), "{low:?}");
    let unstable = warnings("[pose_control]\nposition_gain = 9e4\nvelocity_gain = 900");
    assert!(unstable.len() == 1 && unstable[0].contains("unstable"), "{unstable:?}");
}
