//! Hybrid force and pose control, axes of the filter, its largest speed, and the energy tank: properties of the outer loop.

#![allow(clippy::unwrap_used)]

mod common;

use common::{rotation, vector, wrench};
use proptest::prelude::*;
use tilthex_core::{
    Matrix3, Matrix6, Setpoint, Vector3, Vector6, Wrench,
    admittance::{AdmittanceFilter, AdmittanceParams, AdmittanceState, Axes},
    force_axes::ForceAxes,
    reference_bounds::ReferenceBounds,
    so3,
};

const DT: f64 = 0.002;

fn params(axes: Axes) -> AdmittanceParams {
    AdmittanceParams { axes, max_translation: 10.0, ..AdmittanceParams::default() }
}

/// Rotates the six-vector's halves.
fn both(r: &Matrix3) -> Matrix6 {
    Matrix6::from_fn(|i, k| if i / 3 == k / 3 { r[(i % 3, k % 3)] } else { 0.0 })
}

/// A wall of stiffness `k`, N/m, whose normal is `normal`, through the origin, and what it exerts on a tip.
fn wall(k: f64, normal: &Vector3, tip_w: &Vector3) -> Wrench {
    Wrench { force: normal * (-k * normal.dot(tip_w)).max(0.0), torque: Vector3::zeros() }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Along the surface's normal the force is the commanded one, without the dead zone's offset and whatever the depth of the
    /// set-point; along the surface the tool is where the spring holds it.
    #[test]
    fn presses_with_the_commanded_force(
        surface in rotation(), level in rotation(), by_surface in any::<bool>(), depth in -0.05..0.2f64,
        along in vector(0.1), force in 0.5..8.0f64, stiffness in 100.0..2000.0f64,
    ) {
        let filter = AdmittanceFilter::new(AdmittanceParams {
            damping: Matrix6::from_diagonal_element(60.0), ..params(Axes::World)
        }).unwrap();
        let normal = surface * Vector3::z();
        let along = along - normal * normal.dot(&along);
        // The tool's z axis is the normal where its own axes are meant.
        let axes = ForceAxes { surface_ws: by_surface.then_some(surface), force: [false, false, true], ..ForceAxes::NONE };
        let setpoint = Setpoint {
            wrench_w: Wrench { force: -normal * force, torque: Vector3::zeros() },
            force_axes: axes,
            ..Setpoint::hold(along - normal * depth, if by_surface { level } else { surface })
        };
        let start = Setpoint::hold(along + normal * 0.01, setpoint.rotation_we);
        let mut state = AdmittanceState::at(&start, &setpoint);
        let mut felt = Wrench::ZERO;
        for _ in 0..20_000 {
            let forced = axes.at(&(state.rotation * setpoint.rotation_we));
            let drive = forced.beyond(&felt, &setpoint.wrench_w, (0.2, 0.2)) + setpoint.wrench_w;
            let tip = filter.step(&mut state, &setpoint, &drive, DT).reference.position_w;
            felt = wall(stiffness, &normal, &tip);
        }
        prop_assert!((felt.force.norm() - force).abs() < 1e-3, "{} N of {force}", felt.force.norm());
        let off = state.translation_w - normal * normal.dot(&state.translation_w);
        prop_assert!(off.norm() < 1e-3, "{off}");
    }

    /// The filter in the tool's axes is the filter in the world's axes with turned matrices.
    #[test]
    fn the_tools_axes_are_turned_matrices(
        tool in rotation(), push in wrench(3.0, 0.5), omega in vector(0.5), forced in any::<bool>(),
    ) {
        let own = params(Axes::Tool);
        let r = both(&tool);
        let turn = |m: &Matrix6| { let t = r * m * r.transpose(); (t + t.transpose()) * 0.5 };
        let turned = AdmittanceParams {
            axes: Axes::World, mass: turn(&own.mass), damping: turn(&own.damping), stiffness: turn(&own.stiffness), ..own
        };
        let (own, turned) = (AdmittanceFilter::new(own).unwrap(), AdmittanceFilter::new(turned).unwrap());
        let force_axes = ForceAxes { force: [forced, false, forced], ..ForceAxes::NONE };
        // It turns in no time: matrices and set-point keep their axes.
        let setpoint = Setpoint { angular_velocity_w: omega, force_axes, ..Setpoint::hold(Vector3::zeros(), tool) };
        let (mut a, mut b) = (AdmittanceState::default(), AdmittanceState::default());
        for _ in 0..500 {
            let x = own.step(&mut a, &setpoint, &push, DT);
            let y = turned.step(&mut b, &setpoint, &push, DT);
            prop_assert!((x.deviation_w - y.deviation_w).amax() < 1e-6);
            prop_assert!((x.reference.acceleration_w - y.reference.acceleration_w).amax() < 1e-4);
        }
    }

    /// A spring that is let go does not move the reference faster than the limit.
    #[test]
    fn the_reference_keeps_its_largest_speed(
        limit in 0.05..1.0f64, spin in 0.1..3.0f64, start in vector(1.0), turn in vector(1.0), push in wrench(50.0, 5.0),
    ) {
        let filter = AdmittanceFilter::new(AdmittanceParams {
            stiffness: Matrix6::from_diagonal_element(200.0), ..params(Axes::World)
        }).unwrap();
        let bounds = ReferenceBounds { speed: limit, spin, ..ReferenceBounds::default() };
        let mut state =
            AdmittanceState { translation_w: start, rotation: so3::exp(&turn), ..AdmittanceState::default() };
        let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        let mut level = 0.0;
        for k in 0..1000 {
            let push = if k < 300 { push } else { Wrench::ZERO };
            let before = filter.energy(&state);
            let mut reference = filter.step(&mut state, &setpoint, &push, DT).reference;
            let twist_w = state.twist_w;
            bounds.step(&mut level, (&mut state, &mut reference), &twist_w, (&Wrench::ZERO, &Vector6::zeros()), DT);
            prop_assert!(reference.velocity_w.norm() <= limit * (1.0 + 1e-12));
            prop_assert!(reference.angular_velocity_w.norm() <= spin * (1.0 + 1e-12));
            if k >= 300 {
                prop_assert!(filter.energy(&state) <= before + 1e-9);
            }
        }
    }

    /// Whatever passive environment the tool meets, through whatever delay and lag it is felt: the reference gives it no more
    /// than the tank's capacity and its power times the time.
    #[test]
    fn the_tank_bounds_the_energy(
        mass in 0.0..3.0f64, damping in 0.0..40.0f64, stiffness in 50.0..50_000.0f64, delay in 0usize..10,
        lag in 5.0..100.0f64, command in wrench(8.0, 0.5), capacity in 0.01..3.0f64, power in 0.0..2.0f64,
    ) {
        let filter = AdmittanceFilter::new(params(Axes::World)).unwrap();
        let bounds = ReferenceBounds { capacity, power, speed: 1e3, spin: 1e3 };
        let setpoint = Setpoint::hold(Vector3::zeros(), Matrix3::identity());
        let (mut state, mut level, mut given) = (AdmittanceState::default(), 0.0, 0.0);
        let mut late = [Vector6::zeros(); 10];
        let mut felt = Vector6::zeros();
        let mass_inverse = filter.params().mass.try_inverse().unwrap();
        let mut before = Vector6::zeros();
        for k in 0..3000_u32 {
            // A body on a spring and a damper behind the reference, felt late.
            let out = filter.step(&mut state, &setpoint, &(Wrench::from_vector(&felt) + command), DT);
            let mut reference = out.reference;
            let felt_w = (&Wrench::from_vector(&felt), &(mass_inverse * felt));
            let twist_w = state.twist_w;
            bounds.step(&mut level, (&mut state, &mut reference), &twist_w, felt_w, DT);
            given -= felt.dot(&state.twist_w) * DT;
            let most = capacity + power * DT * f64::from(k + 1);
            prop_assert!(given <= most + 1e-9, "{given} J of {most}");
            let exerted = -(out.deviation_w * stiffness + state.twist_w * damping + (state.twist_w - before) / DT * mass);
            before = state.twist_w;
            late.rotate_right(1);
            late[0] = exerted.map(|x| x.clamp(-100.0, 100.0));
            felt += (late[delay] - felt) * (1.0 - (-lag * DT).exp());
        }
    }
}
