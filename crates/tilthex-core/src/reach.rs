//! The force that a vehicle can exert with its tool while it hovers.

use crate::{
    Vehicle,
    allocation::Allocator,
    so3,
    types::{Matrix3, Vector3, Vector6, Wrench},
    vehicle::Actuation,
};
use libm::atan2;

/// The rotors produce a wrench if its error (N and N m) is below this part of the weight (N).
const GIVEN: f64 = 1e-3;
/// Number of turns that are tried to produce a lateral force, in equal steps up to the largest.
const TURNS: usize = 16;
/// Number of halvings in the search for the largest wrench.
const HALVINGS: usize = 12;
/// Largest force and torque that the search tries, N and N m.
const MOST: f64 = 900.0;

/// The wrenches that a vehicle can exert at its tool in hover.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    vehicle: Vehicle,
    allocator: Allocator,
    max_turn: f64,
}

impl Reach {
    /// The reach of a vehicle that turns by at most `max_turn`, rad, to produce a lateral force.
    #[must_use]
    pub fn of(vehicle: &Vehicle, max_turn: f64) -> Self {
        Self { vehicle: *vehicle, allocator: Allocator::new(vehicle), max_turn }
    }

    /// Whether the rotors can hold the vehicle at rest, within their limits, while the tool exerts a wrench on its environment
    /// (world, at the tip). The tool has the given attitude, turned if the force needs it.
    #[must_use]
    pub fn exerts(&self, rotation_we: &Matrix3, wrench_w: &Wrench) -> bool {
        let asked_wr = rotation_we * self.vehicle.tool().rotation_r.transpose();
        let lift_w = wrench_w.force + Vector3::new(0.0, 0.0, self.vehicle.weight());
        if self.vehicle.actuation() != Actuation::Pose {
            // The thrust is along the vehicle's z axis, which must point in the direction of the wanted force.
            let level = so3::rot_z(atan2(asked_wr[(1, 0)], asked_wr[(0, 0)]));
            let axis = Vector3::z().cross(&lift_w);
            let angle = atan2(axis.norm(), lift_w.z);
            return angle <= self.max_turn && self.holds(&(about(&axis, angle) * level), &lift_w, wrench_w);
        }
        let axis = Vector3::z().cross(&wrench_w.force);
        // A turn helps only a lateral force.
        let turns = if axis == Vector3::zeros() { 0 } else { TURNS };
        (0..=turns).any(|i| {
            let turn = about(&axis, self.max_turn * i as f64 / TURNS as f64);
            self.holds(&(turn * asked_wr), &lift_w, wrench_w)
        })
    }

    /// Whether the rotors produce the wrench that an attitude needs. The tool's lever arm turns with the vehicle.
    fn holds(&self, rotation_wr: &Matrix3, lift_w: &Vector3, wrench_w: &Wrench) -> bool {
        let to_robot = rotation_wr.transpose();
        let torque_r =
            self.vehicle.tool().position_r.cross(&(to_robot * wrench_w.force)) + to_robot * wrench_w.torque;
        let mut required = Vector6::zeros();
        required.fixed_rows_mut::<3>(0).copy_from(&(to_robot * lift_w));
        required.fixed_rows_mut::<3>(3).copy_from(&torque_r);
        (self.allocator.allocate(&required).wrench - required).norm() < GIVEN * self.vehicle.weight()
    }

    /// The largest force that the level vehicle can exert in any direction, N.
    #[must_use]
    pub fn largest_force(&self) -> f64 {
        self.largest(|force| Wrench { force, torque: Vector3::zeros() })
    }

    /// The largest torque that the level vehicle can exert in any direction, N m.
    #[must_use]
    pub fn largest_torque(&self) -> f64 {
        self.largest(|torque| Wrench { force: Vector3::zeros(), torque })
    }

    fn largest(&self, wrench: impl Fn(Vector3) -> Wrench) -> f64 {
        let exerts = |direction: &Vector3, size: f64| {
            let wrench_w = wrench(direction * size);
            let lift_w = wrench_w.force + Vector3::new(0.0, 0.0, self.vehicle.weight());
            self.holds(&Matrix3::identity(), &lift_w, &wrench_w)
        };
        let largest = |direction: Vector3| {
            let (mut low, mut high) = (0.0, MOST);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                if exerts(&direction, middle) { low = middle } else { high = middle }
            }
            low
        };
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        axes.iter().flat_map(|axis| [largest(*axis), largest(-axis)]).fold(0.0, f64::max)
    }
}

/// The rotation by an angle about an axis, which may have any length.
fn about(axis: &Vector3, angle: f64) -> Matrix3 {
    let length = axis.norm();
    if length > 0.0 { so3::exp(&(axis * (angle / length))) } else { Matrix3::identity() }
}
