//! A true vehicle, drawn around the model.

use super::{sections::ErrorSection, spread::stream};
use tilthex_core::{Error, Matrix3, Rotor, Vector3, Vehicle, random::Random, so3, vehicle::Mounting};

/// Number of draws of the moments of inertia before an error, if no body can have them.
const ATTEMPTS: usize = 1000;

/// The true vehicle of a model, and its centre of mass in the model's robot frame, m.
///
/// # Errors
/// Names the impossible value, such as a mass below zero.
pub(super) fn vehicle(
    errors: &ErrorSection,
    model: &Vehicle,
    seed: u64,
) -> Result<(Vehicle, Vector3), Error> {
    let random = |key: &str| stream(seed, &format!("truth.error.{key}"));
    let one = |key: &str, spread: &super::spread::Spread| 1.0 + spread.draw(&mut random(key));
    let three = |key: &str, spread: &super::spread::Spread| {
        let mut random = random(key);
        Vector3::from_fn(|_, _| spread.draw(&mut random))
    };
    let centre = three("centre_of_mass", &errors.centre_of_mass);
    let thrust = one("thrust", &errors.thrust);
    let drag = one("drag_moment", &errors.drag_moment);
    let (mut each, mut turns) = (random("thrust_each"), random("rotor_axis_deg"));
    let rotors: Vec<Rotor> = model
        .rotors()
        .iter()
        .map(|rotor| {
            let turn = Vector3::from_fn(|_, _| errors.rotor_axis_deg.draw(&mut turns).to_radians());
            // The part of the turn along the axis has no effect.
            let across = turn - rotor.axis_r * rotor.axis_r.dot(&turn);
            Rotor {
                position_r: rotor.position_r - centre,
                axis_r: turned(&rotor.axis_r, &across),
                thrust_coefficient: rotor.thrust_coefficient * (thrust + errors.thrust_each.draw(&mut each)),
                drag_coefficient: rotor.drag_coefficient * drag,
                ..*rotor
            }
        })
        .collect();
    let tool = Mounting {
        position_r: model.tool().position_r - centre + three("tool_tip", &errors.tool_tip),
        ..*model.tool()
    };
    let imu = Mounting { position_r: model.imu().position_r - centre, ..*model.imu() };
    let vehicle = Vehicle::new(
        model.mass() * one("mass", &errors.mass),
        inertia(errors, model.inertia(), &mut random("inertia")),
        &rotors,
        model.rotor_time_constant() * one("rotor_lag", &errors.rotor_lag),
        tool,
        imu,
    )?;
    Ok((vehicle, centre))
}

/// An axis after a turn. Without a turn, it is exactly the same axis.
fn turned(axis: &Vector3, turn: &Vector3) -> Vector3 {
    if *turn == Vector3::zeros() { *axis } else { (so3::exp(turn) * axis).normalize() }
}

/// Moments of inertia with errors along the model's principal axes.
fn inertia(errors: &ErrorSection, model: &Matrix3, random: &mut Random) -> Matrix3 {
    let axes = model.symmetric_eigen();
    let possible = |moments: &Vector3| moments.iter().all(|j| *j > 0.0 && 2.0 * j <= moments.sum());
    for _ in 0..ATTEMPTS {
        let moments = axes.eigenvalues.map(|j| j * (1.0 + errors.inertia.draw(random)));
        if possible(&moments) || !possible(&axes.eigenvalues) {
            if moments == axes.eigenvalues {
                return *model;
            }
            let turned = axes.eigenvectors * Matrix3::from_diagonal(&moments) * axes.eigenvectors.transpose();
            return 0.5 * (turned + turned.transpose());
        }
    }
    *model
}
