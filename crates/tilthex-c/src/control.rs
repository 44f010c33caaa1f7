//! The blocks of the controller, each alone, and the whole controller.

use crate::{
    TILTHEX_MAX_ROTORS,
    block::{
        TilthexAdmittance, TilthexAllocator, TilthexController, TilthexObserver, content, fill, read, write,
    },
    numbers::{
        TilthexAdmittanceParams, TilthexControllerParams, TilthexMeasured, TilthexObserverGains,
        TilthexSetpoint, TilthexWrench, check_period, matrix6, require, rotation, speeds,
    },
    status::{Complaint, TilthexMessage, TilthexStatus},
    vehicle::{TilthexVehicle, checked},
};
use tilthex_core::{
    admittance::{AdmittanceFilter, AdmittanceParams, AdmittanceState, Axes},
    allocation::{Allocator, AllocatorParams, AllocatorState, RotorStatus},
    controller::{Controller, ControllerInput, ControllerParams, ControllerState},
    pose_control::PoseGains,
    vehicle::speeds as speeds_of,
    wrench_observer::{ObserverGains, ObserverInput, WrenchObserver, WrenchObserverState},
};

impl TilthexObserverGains {
    fn gains(&self) -> ObserverGains {
        ObserverGains { force: self.force.into(), torque: self.torque.into() }
    }
}

impl TilthexAdmittanceParams {
    fn params(&self) -> AdmittanceParams {
        AdmittanceParams {
            axes: if self.tool_axes == 0 { Axes::World } else { Axes::Tool },
            mass: matrix6(&self.mass),
            damping: matrix6(&self.damping),
            stiffness: matrix6(&self.stiffness),
            max_translation: self.max_translation,
            max_rotation: self.max_rotation,
        }
    }
}

impl TilthexControllerParams {
    fn params(&self) -> ControllerParams {
        ControllerParams {
            pose: PoseGains {
                position: self.position_gain.into(),
                velocity: self.velocity_gain.into(),
                rotation: self.rotation_gain.into(),
                angular_velocity: self.angular_velocity_gain.into(),
            },
            observer: self.observer.gains(),
            admittance: self.admittance.params(),
            force_dead_zone: self.force_dead_zone,
            torque_dead_zone: self.torque_dead_zone,
            low_pass_hz: self.low_pass_hz,
            allocation: AllocatorParams { horizon: self.horizon, ..AllocatorParams::default() },
            ..ControllerParams::default()
        }
    }
}

/// Makes a wrench observer for a vehicle. `message` (may be null) gets the sentence of a refusal.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_observer_init(
    observer: *mut TilthexObserver,
    vehicle: *const TilthexVehicle,
    gains: *const TilthexObserverGains,
    message: *mut TilthexMessage,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    TilthexStatus::of(unsafe {
        let complaint = Complaint::to(message);
        checked(vehicle, &complaint).and_then(|vehicle| {
            let made = complaint.check(WrenchObserver::new(&vehicle, read(gains)?.gains()))?;
            fill(observer, &(made, WrenchObserverState::default()))
        })
    })
}

/// Takes the sample at the end of a period of `dt` s (0 to 1) and writes the external wrench: force in world, torque in
/// robot coordinates about the centre of mass, which the environment exerts on the robot. The first sample only marks
/// the start. The position and the velocity of the sample are not used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_observer_step(
    observer: *mut TilthexObserver,
    measured: *const TilthexMeasured,
    dt: f64,
    wrench: *mut TilthexWrench,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    let step = || unsafe {
        let (block, state) = content(observer)?;
        let measured = read(measured)?;
        check_period(dt)?;
        let robot = measured.robot()?;
        let input = ObserverInput {
            rotation_wr: robot.rotation_wr,
            angular_velocity_r: robot.angular_velocity_r,
            specific_force_r: measured.specific_force()?,
            rotor_speeds: speeds(&measured.rotor_speeds)?,
        };
        let mut next = *state;
        let found = block.step(&mut next, &input, dt);
        require(found.is_finite(), TilthexStatus::NotFinite)?;
        write(wrench, found.into())?;
        *state = next;
        Ok(())
    };
    TilthexStatus::of(step())
}

/// Makes an admittance filter for steps of about `period` s; steps of another period take several times as long.
/// `message` (may be null) gets the sentence of a refusal.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_admittance_init(
    admittance: *mut TilthexAdmittance,
    params: *const TilthexAdmittanceParams,
    period: f64,
    message: *mut TilthexMessage,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    TilthexStatus::of(unsafe {
        let complaint = Complaint::to(message);
        read(params).and_then(|params| {
            check_period(period)?;
            let mut filter = complaint.check(AdmittanceFilter::new(params.params()))?;
            filter.prepare(period);
            fill(admittance, &(filter, AdmittanceState::default()))
        })
    })
}

/// Moves the reference by `dt` s (0 to 1) under a wrench at the tool (world), and writes it. Where nothing pushes, spring
/// and damper move it back to the set-point.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_admittance_step(
    admittance: *mut TilthexAdmittance,
    setpoint: *const TilthexSetpoint,
    wrench_w: *const TilthexWrench,
    dt: f64,
    reference: *mut TilthexSetpoint,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    let step = || unsafe {
        let (filter, state) = content(admittance)?;
        let (setpoint, push_w) = (read(setpoint)?.setpoint()?, read(wrench_w)?.wrench()?);
        check_period(dt)?;
        let mut next = *state;
        let found = filter.step(&mut next, &setpoint, &push_w, dt).reference;
        require(found.is_finite(), TilthexStatus::NotFinite)?;
        write(reference, (&found).into())?;
        *state = next;
        Ok(())
    };
    TilthexStatus::of(step())
}

/// What the allocator needs in a step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexAllocatorInput {
    /// Wanted wrench of the rotors, robot coordinates, torque about the centre of mass.
    pub wrench_r: TilthexWrench,
    /// Orientation: maps robot coordinates to world coordinates.
    pub rotation_wr: [[f64; 3]; 3],
    /// Measured rotor speeds, Hz; used if the horizon is not 0.
    pub rotor_speeds: [f64; TILTHEX_MAX_ROTORS],
    /// Bit `i` is set if rotor `i` (from 0) is lost and stands still.
    pub lost_rotors: u32,
}

/// Rotor speeds for a wrench, and the parts of the wrench that they do not produce.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexAllocation {
    /// Rotor speeds, Hz; those after the vehicle's count are zero.
    pub rotor_speeds: [f64; TILTHEX_MAX_ROTORS],
    /// The wrench that they produce: force and torque, robot coordinates.
    pub wrench_r: [f64; 6],
    /// Missing roll and pitch torque (N m), vertical force (N), yaw torque (N m), lateral force (N).
    pub shortfall: [f64; 4],
    /// 1 if a limit is active that changes the speeds, otherwise 0.
    pub saturated: u32,
}

impl From<&tilthex_core::allocation::Allocation> for TilthexAllocation {
    fn from(a: &tilthex_core::allocation::Allocation) -> Self {
        Self {
            rotor_speeds: speeds_of(&a.inputs).into(),
            wrench_r: a.wrench.into(),
            shortfall: a.shortfall,
            saturated: u32::from(a.saturated),
        }
    }
}

/// Makes the allocator of a vehicle. Speeds are limited to those that the rotors can reach within `horizon` s; 0 for no
/// such limit. `message` (may be null) gets the sentence of a refusal.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_allocator_init(
    allocator: *mut TilthexAllocator,
    vehicle: *const TilthexVehicle,
    horizon: f64,
    message: *mut TilthexMessage,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    TilthexStatus::of(unsafe {
        let complaint = Complaint::to(message);
        checked(vehicle, &complaint).and_then(|vehicle| {
            let params = AllocatorParams { horizon, ..AllocatorParams::default() };
            let made = complaint.check(Allocator::with_params(&vehicle, params))?;
            fill(allocator, &(made, AllocatorState::default()))
        })
    })
}

/// Finds the rotor speeds for a wrench. What the limits do not allow is given up in the order lateral force, yaw torque,
/// vertical force, roll and pitch torque.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_allocator_step(
    allocator: *mut TilthexAllocator,
    input: *const TilthexAllocatorInput,
    allocation: *mut TilthexAllocation,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    let step = || unsafe {
        let (block, state) = content(allocator)?;
        let input = read(input)?;
        let (wrench, rotation_wr) = (input.wrench_r.wrench()?, rotation(&input.rotation_wr)?);
        let rotors = RotorStatus { speeds: speeds(&input.rotor_speeds)?, lost: lost(input.lost_rotors) };
        let mut next = *state;
        let found = block.step(&mut next, &wrench.to_vector(), &rotation_wr, &rotors);
        require(found.inputs.iter().all(|x| x.is_finite()), TilthexStatus::NotFinite)?;
        write(allocation, (&found).into())?;
        *state = next;
        Ok(())
    };
    TilthexStatus::of(step())
}

/// The bits of the rotors that exist.
fn lost(bits: u32) -> u16 {
    (bits & ((1 << TILTHEX_MAX_ROTORS) - 1)) as u16
}

/// What the controller needs in a step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexControllerInput {
    /// State of the robot, specific force and rotor speeds.
    pub measured: TilthexMeasured,
    /// The set-point of the tool.
    pub setpoint: TilthexSetpoint,
    /// Not 0: contact moves the reference. 0: it does not, and the reference moves back to the set-point.
    pub compliant: u32,
    /// Not 0: a hover without contact, from which the bias of the observed wrench is learnt; it counts when this
    /// becomes 0.
    pub learn_bias: u32,
    /// Not 0: take-off or landing. The observed wrench is compensated only as far as errors of the model explain it, and
    /// the vertical force of the rotors is between `least_lift` and `most_lift`.
    pub unyielding: u32,
    /// Smallest vertical force of the rotors, N, if `unyielding`.
    pub least_lift: f64,
    /// Largest vertical force of the rotors, N, if `unyielding`.
    pub most_lift: f64,
    /// Bit `i` is set if rotor `i` (from 0) is lost and stands still.
    pub lost_rotors: u32,
}

/// The command, and the values from which it follows.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexControllerOutput {
    /// Commanded rotor speeds, Hz; those after the vehicle's count are zero.
    pub rotor_speeds: [f64; TILTHEX_MAX_ROTORS],
    /// Observed external wrench: force in world, torque in robot coordinates about the centre of mass; bias included.
    pub wrench_robot: TilthexWrench,
    /// Observed external wrench at the tool, world, without the bias.
    pub wrench_tool_w: TilthexWrench,
    /// Input of the admittance filter: after low-pass and dead zones, world.
    pub wrench_admittance_w: TilthexWrench,
    /// Reference of the tool, which has yielded.
    pub reference: TilthexSetpoint,
    /// What the allocator found.
    pub allocation: TilthexAllocation,
    /// 1 if the reference is at its largest distance from the set-point, otherwise 0.
    pub excursion_limited: u32,
}

/// Writes the default parameters, which fit the Tilt-Hex.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_controller_defaults(params: *mut TilthexControllerParams) -> TilthexStatus {
    // SAFETY: the pointer is null or valid.
    TilthexStatus::of(unsafe { write(params, (&ControllerParams::default()).into()) })
}

/// Makes the controller of a vehicle for steps of about `period` s; steps of another period take longer. `message` (may
/// be null) gets the sentence of a refusal.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_controller_init(
    controller: *mut TilthexController,
    vehicle: *const TilthexVehicle,
    params: *const TilthexControllerParams,
    period: f64,
    message: *mut TilthexMessage,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    TilthexStatus::of(unsafe {
        let complaint = Complaint::to(message);
        checked(vehicle, &complaint).and_then(|vehicle| {
            let params = read(params)?.params();
            check_period(period)?;
            let mut made = complaint.check(Controller::new(vehicle, params))?;
            made.prepare(period);
            fill(controller, &(made, ControllerState::default()))
        })
    })
}

/// One tick: observer, admittance filter, pose controller, allocator. `dt` is the measured time since the last tick,
/// s (0 to 1). `output` is changed only if the status is `TILTHEX_STATUS_OK`; otherwise hold the last speeds, or land.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_controller_step(
    controller: *mut TilthexController,
    input: *const TilthexControllerInput,
    dt: f64,
    output: *mut TilthexControllerOutput,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    let step = || unsafe {
        let (block, state) = content(controller)?;
        let given = read(input)?;
        check_period(dt)?;
        let lift = [given.least_lift, given.most_lift];
        let unyielding = (given.unyielding != 0).then_some(lift);
        require(lift.iter().all(|x| x.is_finite()), TilthexStatus::NotFinite)?;
        let input = ControllerInput {
            state: given.measured.robot()?,
            specific_force_r: given.measured.specific_force()?,
            rotor_speeds: speeds(&given.measured.rotor_speeds)?,
            setpoint: given.setpoint.setpoint()?,
            compliant: given.compliant != 0,
            unyielding,
            learn_bias: given.learn_bias != 0,
            lost_rotors: lost(given.lost_rotors),
            fixed_attitude: false,
        };
        let mut next = *state;
        let found = block.step(&mut next, &input, dt);
        let finite = found.rotor_speeds.iter().all(|x| x.is_finite()) && found.reference.is_finite();
        require(finite && found.wrench_robot.is_finite(), TilthexStatus::NotFinite)?;
        write(
            output,
            TilthexControllerOutput {
                rotor_speeds: found.rotor_speeds.into(),
                wrench_robot: found.wrench_robot.into(),
                wrench_tool_w: found.wrench_tool_w.into(),
                wrench_admittance_w: found.wrench_admittance_w.into(),
                reference: (&found.reference).into(),
                allocation: (&found.allocation).into(),
                excursion_limited: u32::from(found.excursion_limited),
            },
        )?;
        *state = next;
        Ok(())
    };
    TilthexStatus::of(step())
}
