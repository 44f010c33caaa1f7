//! From a wanted body wrench to rotor inputs within their limits; (12), (26).
//!
//! If the rotors can produce the wrench, they produce it: `u = A^-1 w`. If several inputs
//! produce it, the allocator takes the inputs that are nearest to the hover inputs. If the
//! rotors cannot produce the wrench, the allocator serves its parts in the strict order of
//! [`Priority`]: it never makes the error of a part larger to improve a part that comes later
//! (see `hierarchy`; where only the last part is missed, `last_part` gives the same inputs in
//! closed form). Torques are about robot axes, because the axis about which the rotors are weak
//! is fixed in the vehicle. A vehicle that can hover in every attitude has its
//! vertical and lateral forces along world axes, so that the force that carries the weight
//! has the same priority in every attitude. All other vehicles stay near upright, and their
//! forces are along robot axes.

mod hierarchy;
mod last_part;
mod levels;
mod priority;
mod search;
mod section;

use crate::{
    Error, Vehicle,
    error::check_range,
    types::{MAX_ROTORS, Matrix3, RotorVector, Vector3, Vector6, Wrench},
    vehicle::{Allocation as Matrix, AllocationInverse, inputs, inputs_for, wrench_of},
};
use hierarchy::{ROWS, Side};
use levels::{Levels, turned};
use libm::{exp, sqrt};
pub use priority::Priority;
use search::Asked;
pub use section::ForceSection;

/// Largest number of steps of one search. No known input needs half of them. A
/// search that reaches this number returns its best inputs so far, within the limits.
pub const MAX_ITERATIONS: u32 = hierarchy::MAX_ITERATIONS;

/// How the allocator treats the limits of the rotors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AllocatorParams {
    /// The parts of the wrench, most important first; each once.
    pub order: [Priority; 4],
    /// Inputs are limited to what the rotors, with their first-order lag, can
    /// reach from their measured speeds within this time, s; 0 for no such limit.
    pub horizon: f64,
}

impl Default for AllocatorParams {
    fn default() -> Self {
        Self { order: Priority::ORDER, horizon: 0.0 }
    }
}

/// The allocator of one vehicle.
///
/// ```
/// use tilthex_core::{Vector3, Wrench, allocation::{Allocator, Priority}, examples, vehicle::speeds};
///
/// let vehicle = examples::tilt_hex()?;
/// let allocator = Allocator::new(&vehicle);
/// let lift = |z: f64| Wrench { force: Vector3::new(0.0, 0.0, z), torque: Vector3::zeros() }.to_vector();
/// let hover = allocator.allocate(&lift(vehicle.weight()));
/// assert!(!hover.saturated && speeds(&hover.inputs)[0] > 16.0);
/// // More than the rotors have: what is given up is named.
/// let most = allocator.allocate(&lift(1000.0));
/// assert_eq!(most.given_up, Some(Priority::VerticalForce));
/// # Ok::<(), tilthex_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Allocator {
    matrix: Matrix,
    /// Inputs of a wrench where no limit is active: `inverse * wrench + offset`.
    inverse: AllocationInverse,
    offset: RotorVector,
    hover: RotorVector,
    min_speed: RotorVector,
    max_speed: RotorVector,
    lower: RotorVector,
    upper: RotorVector,
    rotor_count: usize,
    rank: usize,
    rotor_time_constant: f64,
    params: AllocatorParams,
    levels: Levels,
    /// Whether the vehicle can hover in every attitude: then the forces of [`Priority`] are along world axes.
    by_world: bool,
    /// An error up to this value, N or N m, counts as no error.
    tolerance: f64,
}

/// The result of the last search, from which the next search starts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AllocatorState {
    inputs: RotorVector,
    side: [Side; MAX_ROTORS],
    searched: bool,
}

/// The state of the rotors when a wrench is allocated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RotorStatus {
    /// Measured speeds, Hz; used with [`AllocatorParams::horizon`].
    pub speeds: RotorVector,
    /// Bit `i` is set if rotor `i` (from 0) is lost and stands still.
    pub lost: u16,
}

/// The rotor inputs for a wrench, and the parts of the wrench that they do not produce.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Allocation {
    /// Rotor inputs, Hz^2.
    pub inputs: RotorVector,
    /// The body wrench they produce, `[force_r; torque_r]`.
    pub wrench: Vector6,
    /// Whether a limit is active that changes the inputs.
    pub saturated: bool,
    /// The most important part that is not met.
    pub given_up: Option<Priority>,
    /// Norm of each part's error, N or N m, in the order of [`Priority::ORDER`].
    pub shortfall: [f64; 4],
    /// Bit `i` is set if rotor `i` is at its lower limit.
    pub at_lower: u16,
    /// Bit `i` is set if rotor `i` is at its upper limit.
    pub at_upper: u16,
    /// Steps of the search, or edges that the closed form has tried; 0 if no limit is active.
    pub iterations: u32,
}

/// Whether exactly one set of inputs produces each wrench, for a vehicle of this rank with so many rotors.
fn has_own_inputs(rank: usize, rotors: usize) -> bool {
    rank == ROWS && rotors == ROWS
}

/// An error counts as no error below this fraction of the vehicle's weight, N (for torques: of the weight times 1 m).
const SHORTFALL_TOLERANCE: f64 = 1e-7;
/// The magnitude of a wanted component is limited to this value, so that its square is finite.
const LARGEST_WANTED: f64 = 1e60;

impl Allocator {
    /// The allocator of a vehicle, with the limits of its rotors and [`Priority::ORDER`].
    #[must_use]
    pub fn new(vehicle: &Vehicle) -> Self {
        Self::build(vehicle, AllocatorParams::default())
    }

    /// The allocator of a vehicle, with parameters.
    ///
    /// # Errors
    /// An order that does not hold each part once, or a horizon out of range.
    pub fn with_params(vehicle: &Vehicle, params: AllocatorParams) -> Result<Self, Error> {
        check_range("horizon", params.horizon, 0.0, 10.0)?;
        let found = Priority::ORDER.iter().filter(|p| params.order.contains(p)).count();
        if found < 4 {
            return Err(Error::Count {
                name: "different parts of the wrench in order",
                found,
                min: 4,
                max: 4,
            });
        }
        Ok(Self::build(vehicle, params))
    }

    /// An allocator with the same parameters for a vehicle whose model has been corrected.
    #[must_use]
    pub fn for_vehicle(&self, vehicle: &Vehicle) -> Self {
        Self::build(vehicle, self.params)
    }

    fn build(vehicle: &Vehicle, params: AllocatorParams) -> Self {
        let (min_speed, max_speed) = vehicle.speed_limits();
        let mut allocator = Self {
            matrix: *vehicle.allocation(),
            inverse: *vehicle.allocation_inverse(),
            offset: RotorVector::zeros(),
            hover: RotorVector::zeros(),
            min_speed,
            max_speed,
            lower: inputs(&min_speed),
            upper: inputs(&max_speed),
            rotor_count: vehicle.rotors().len(),
            rank: vehicle.rank(),
            rotor_time_constant: vehicle.rotor_time_constant(),
            params,
            tolerance: SHORTFALL_TOLERANCE * vehicle.weight(),
            levels: Levels::by_priority(vehicle, &params.order),
            by_world: false,
        };
        if vehicle.rank() < ROWS {
            allocator.inverse = allocator.ordered_inverse();
        }
        let weight = Vector6::new(0.0, 0.0, vehicle.weight(), 0.0, 0.0, 0.0);
        allocator.hover = allocator.allocate(&weight).inputs;
        // With redundant rotors, stay near hover in the directions that produce no wrench.
        if allocator.rotor_count > vehicle.rank() {
            allocator.offset = allocator.hover - allocator.inverse * (allocator.matrix * allocator.hover);
        }
        allocator.by_world = allocator.carries_any_way_up(vehicle.weight());
        allocator
    }

    /// Whether the rotors carry a weight, N, along either direction of every robot axis.
    fn carries_any_way_up(&self, weight: f64) -> bool {
        let carries = |force_r: Vector3| {
            let wrench = Wrench { force: force_r, torque: Vector3::zeros() };
            self.allocate(&wrench.to_vector()).given_up.is_none()
        };
        [Vector3::x(), Vector3::y(), Vector3::z()]
            .iter()
            .all(|axis| carries(axis * weight) && carries(axis * -weight))
    }

    /// The parameters.
    #[must_use]
    pub fn params(&self) -> &AllocatorParams {
        &self.params
    }

    /// The inputs of a level hover, Hz^2. Where several inputs produce a wrench, the search takes the nearest to these.
    #[must_use]
    pub fn hover_inputs(&self) -> &RotorVector {
        &self.hover
    }

    /// Lowest and highest inputs, Hz^2, that the rotors can reach from their present state.
    #[must_use]
    pub fn limits(&self, status: &RotorStatus) -> (RotorVector, RotorVector) {
        let (mut lower, mut upper) = (self.lower, self.upper);
        if self.params.horizon > 0.0 && self.rotor_time_constant > 0.0 {
            let held = exp(-self.params.horizon / self.rotor_time_constant);
            let now = status.speeds.zip_map(&self.min_speed, f64::max).zip_map(&self.max_speed, f64::min);
            lower = inputs(&(self.min_speed + (now - self.min_speed) * held));
            upper = inputs(&(self.max_speed + (now - self.max_speed) * held));
        }
        if status.lost != 0 {
            for i in 0..MAX_ROTORS {
                if status.lost >> i & 1 == 1 {
                    lower[i] = 0.0;
                    upper[i] = 0.0;
                }
            }
        }
        (lower, upper)
    }

    /// Rotor inputs for a body wrench `[force_r; torque_r]` of a level vehicle that has lost no rotor, without horizon.
    ///
    /// Never fails: a component that is NaN counts as zero.
    #[must_use]
    pub fn allocate(&self, wrench: &Vector6) -> Allocation {
        let wrench = wanted(wrench);
        let inputs = inputs_for(&self.inverse, &wrench, self.rotor_count) + self.offset;
        if within(self.rotor_count, &inputs, &self.lower, &self.upper) {
            return self.unlimited(&wrench, inputs);
        }
        let limits = (&self.lower, &self.upper);
        let asked = Asked { wrench: &wrench, inputs: &inputs, rotation_wr: None, limits };
        self.search(&mut AllocatorState::default(), &asked)
    }

    /// Rotor inputs for a body wrench in any attitude, within the limits of the rotors' status. The search starts from the
    /// result of the last search.
    #[must_use]
    #[inline(always)]
    pub fn step(
        &self,
        state: &mut AllocatorState,
        wrench: &Vector6,
        rotation_wr: &Matrix3,
        status: &RotorStatus,
    ) -> Allocation {
        let wrench = wanted(wrench);
        let inputs = inputs_for(&self.inverse, &wrench, self.rotor_count) + self.offset;
        let reached;
        let (lower, upper) = if self.params.horizon > 0.0 || status.lost != 0 {
            reached = self.limits(status);
            (&reached.0, &reached.1)
        } else {
            (&self.lower, &self.upper)
        };
        if within(self.rotor_count, &inputs, lower, upper) {
            state.searched = false;
            return self.unlimited(&wrench, inputs);
        }
        let rotation_wr = Some(rotation_wr).filter(|_| self.by_world);
        self.search(state, &Asked { wrench: &wrench, inputs: &inputs, rotation_wr, limits: (lower, upper) })
    }

    /// The inputs to stay near. `None` without redundant rotors: then no two inputs produce the same wrench.
    fn preferred(&self) -> Option<&RotorVector> {
        (self.rotor_count > self.rank).then_some(&self.hover)
    }

    #[inline]
    fn unlimited(&self, wrench: &Vector6, inputs: RotorVector) -> Allocation {
        if self.rank < ROWS {
            return self.report(wrench, inputs, None, None, 0);
        }
        Allocation {
            inputs,
            wrench: *wrench,
            saturated: false,
            given_up: None,
            shortfall: [0.0; 4],
            at_lower: 0,
            at_upper: 0,
            iterations: 0,
        }
    }

    /// The linear map from wrenches to inputs: the result of a search without limits.
    fn ordered_inverse(&self) -> AllocationInverse {
        let mut inverse = AllocationInverse::zeros();
        let (mut lower, mut upper) = (RotorVector::zeros(), RotorVector::zeros());
        lower.iter_mut().take(self.rotor_count).for_each(|x| *x = f64::NEG_INFINITY);
        upper.iter_mut().take(self.rotor_count).for_each(|x| *x = f64::INFINITY);
        for (r, mut column) in inverse.column_iter_mut().enumerate() {
            let mut unit = Vector6::zeros();
            unit[r] = 1.0;
            let mut state = AllocatorState::default();
            self.levels.solve(&mut state, &unit, (&lower, &upper), Some(&RotorVector::zeros()));
            column.copy_from(&state.inputs);
        }
        inverse
    }

    fn report(
        &self,
        wanted: &Vector6,
        inputs: RotorVector,
        rotation_wr: Option<&Matrix3>,
        limits: Option<(&RotorVector, &RotorVector)>,
        iterations: u32,
    ) -> Allocation {
        let wrench = wrench_of(&self.matrix, &inputs, self.rotor_count);
        let error_r = wanted - wrench;
        let error = rotation_wr.map_or(error_r, |r| turned(r, &error_r));
        let shortfall =
            Priority::ORDER.map(|p| sqrt(p.rows().iter().filter_map(|r| error.get(*r)).map(|e| e * e).sum()));
        let given_up = self.params.order.into_iter().find(|p| shortfall[*p as usize] > self.tolerance);
        let (mut at_lower, mut at_upper) = (0, 0);
        if let Some((lower, upper)) = limits {
            for i in 0..self.rotor_count.min(MAX_ROTORS) {
                at_lower |= u16::from(inputs[i] <= lower[i]) << i;
                at_upper |= u16::from(inputs[i] >= upper[i]) << i;
            }
        }
        let saturated = limits.is_some();
        Allocation { inputs, wrench, saturated, given_up, shortfall, at_lower, at_upper, iterations }
    }
}

/// The wrench with its components limited to [`LARGEST_WANTED`]; zero in the place of NaN.
#[inline]
fn wanted(wrench: &Vector6) -> Vector6 {
    // No sum of NaN is below anything.
    if wrench.norm_squared() < LARGEST_WANTED {
        return *wrench;
    }
    wrench.map(|x| if x.is_nan() { 0.0 } else { x.clamp(-LARGEST_WANTED, LARGEST_WANTED) })
}

/// Whether the inputs of `count` rotors are within their limits.
#[inline(always)]
fn within(count: usize, inputs: &RotorVector, lower: &RotorVector, upper: &RotorVector) -> bool {
    let limits = lower.as_slice().iter().zip(upper.as_slice());
    inputs.as_slice().iter().zip(limits).take(count).all(|(u, (l, h))| l <= u && u <= h)
}

#[cfg(test)]
mod tests;
