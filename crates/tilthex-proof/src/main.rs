//! A proof, at link time, that no step function of the core can panic.
//!
//! A function with `#[no_panic]` does not link if the optimiser finds a path from it to a panic:
//!
//! `cargo build --profile proof -p tilthex-proof --features proof`

use no_panic::no_panic;
use std::hint::black_box;
use tilthex_c as c;
use tilthex_core::{
    PoseSample, Reference, RobotState, Setpoint, Vector3, Vector6, Wrench,
    admittance::{AdmittanceFilter, AdmittanceOutput, AdmittanceState},
    allocation::{Allocation, Allocator, AllocatorState, RotorStatus},
    controller::{Controller, ControllerInput, ControllerOutput, ControllerState},
    estimator::{Estimator, Outcome},
    filters::{LowPass, LowPassState},
    flight::{Commanded, Flight, Measured},
    plant::{Plant, PlantState},
    pose_control::{PoseCommand, PoseController},
    supervisor::{Facts, FaultSet, Phase, Supervisor},
    trajectory::Trajectory,
    types::{Matrix3, RotorVector},
    wrench_observer::{ObserverInput, WrenchObserver, WrenchObserverState},
};
use tilthex_firmware::{Board, Drive, Firmware, ImuReading, RotorReading};
use tilthex_link::{
    InertialDue, Link, LinkedFlight, LinkedOutput, VehicleLink, WireInput,
    tk3::{HostMessage, Receiver, VehicleMessage},
};

#[no_panic]
fn low_pass(b: &LowPass, s: &mut LowPassState, x: &Vector6, dt: f64) -> Vector6 {
    b.step(s, x, dt)
}

#[no_panic]
fn observe(b: &WrenchObserver, s: &mut WrenchObserverState, x: &ObserverInput, dt: f64) -> Wrench {
    b.step(s, x, dt)
}

#[no_panic]
fn yield_to(
    b: &AdmittanceFilter,
    s: &mut AdmittanceState,
    x: &Setpoint,
    w: &Wrench,
    dt: f64,
) -> AdmittanceOutput {
    b.step(s, x, w, dt)
}

#[no_panic]
fn track(b: &PoseController, x: &RobotState, r: &Reference) -> PoseCommand {
    b.step(x, r)
}

#[no_panic]
fn allocate(
    b: &Allocator,
    s: &mut AllocatorState,
    w: &Vector6,
    rotation_wr: &Matrix3,
    r: &RotorStatus,
) -> Allocation {
    b.step(s, w, rotation_wr, r)
}

#[no_panic]
fn control(b: &Controller, s: &mut ControllerState, x: &ControllerInput, dt: f64) -> ControllerOutput {
    b.step(s, x, dt)
}

#[no_panic]
fn move_on(b: &Plant, s: &mut PlantState, command: &RotorVector, w: &Wrench, dt: f64) {
    b.step(s, command, w, dt);
}

#[no_panic]
fn sample(b: &Trajectory, time: f64) -> Setpoint {
    b.sample(time)
}

#[no_panic]
fn predict(b: &mut Estimator, time: f64, gyro_i: &Vector3, specific_force_i: &Vector3) {
    b.predict(time, gyro_i, specific_force_i);
}

#[no_panic]
fn update(b: &mut Estimator, pose: &PoseSample) -> Outcome {
    b.update_pose(pose)
}

#[no_panic]
fn supervise(b: &mut Supervisor, conditions: FaultSet, facts: &Facts, dt: f64) -> Phase {
    b.step(conditions, facts, dt)
}

#[no_panic]
fn receive(b: &mut Receiver<VehicleMessage>, byte: u8) -> Option<VehicleMessage> {
    b.push(byte)
}

#[no_panic]
fn encode(message: &HostMessage, out: &mut [u8]) -> usize {
    message.encode(out)
}

#[no_panic]
fn tick(b: &mut Flight, input: &Measured<'_>, out: &mut Commanded) {
    b.tick(input, out);
}

#[no_panic]
fn look(b: &mut Link, bytes: &[u8]) -> InertialDue {
    b.look(bytes)
}

#[no_panic]
fn tick_on_wire(b: &mut LinkedFlight, input: &WireInput<'_>, out: &mut LinkedOutput) {
    b.tick(input, out);
}

/// A board whose readings the optimiser does not know.
struct AnyBoard;

impl Board for AnyBoard {
    fn now_us(&mut self) -> u64 {
        black_box(0)
    }
    fn imu(&mut self) -> Option<ImuReading> {
        black_box(None)
    }
    fn rotor(&mut self, rotor: usize) -> RotorReading {
        black_box(rotor);
        black_box(RotorReading::default())
    }
    fn battery(&mut self) -> Option<f64> {
        black_box(None)
    }
    fn drive(&mut self, rotor: usize, drive: Drive) {
        black_box((rotor, drive));
    }
    fn read(&mut self, bytes: &mut [u8]) -> usize {
        bytes.fill(black_box(0));
        black_box(0)
    }
    fn write(&mut self, bytes: &[u8]) {
        black_box(bytes);
    }
}

#[no_panic]
fn tick_on_board(b: &mut Firmware, board: &mut AnyBoard) {
    b.tick(board);
}

/// The step functions of the C interface, with pointers that the optimiser does not know.
mod in_c {
    #![allow(unsafe_code)]
    use super::{c, no_panic};

    macro_rules! steps {
        ($($name:ident: $called:ident($($argument:ident: $kind:ty),*);)*) => {
            $(
                #[no_panic]
                pub(super) fn $name($($argument: $kind),*) -> c::TilthexStatus {
                    // SAFETY: the caller gives null or valid pointers.
                    unsafe { c::$called($($argument),*) }
                }
            )*
            pub(super) fn keep() {
                $( std::hint::black_box($name as fn($($kind),*) -> _); )*
            }
        };
    }
    steps! {
        observe: tilthex_observer_step(
            b: *mut c::TilthexObserver, x: *const c::TilthexMeasured, dt: f64, w: *mut c::TilthexWrench);
        yield_to: tilthex_admittance_step(
            b: *mut c::TilthexAdmittance, x: *const c::TilthexSetpoint, w: *const c::TilthexWrench, dt: f64,
            r: *mut c::TilthexSetpoint);
        allocate: tilthex_allocator_step(
            b: *mut c::TilthexAllocator, x: *const c::TilthexAllocatorInput, a: *mut c::TilthexAllocation);
        control: tilthex_controller_step(
            b: *mut c::TilthexController, x: *const c::TilthexControllerInput, dt: f64,
            out: *mut c::TilthexControllerOutput);
        predict: tilthex_estimator_predict(
            b: *mut c::TilthexEstimator, time: f64, gyro: *const f64, force: *const f64);
        update: tilthex_estimator_update(
            b: *mut c::TilthexEstimator, pose: *const c::TilthexPose, out: *mut c::TilthexOutcome);
        state: tilthex_estimator_state(
            b: *mut c::TilthexEstimator, x: *mut c::TilthexMeasured, health: *mut c::TilthexHealth);
        move_on: tilthex_plant_step(
            b: *mut c::TilthexPlant, speeds: *const f64, w: *const c::TilthexWrench, dt: f64);
    }
}

/// Calls every function with inputs that the optimiser does not know, so that all of them stay in the program.
fn main() {
    black_box(low_pass as fn(_, _, _, _) -> _);
    black_box(observe as fn(_, _, _, _) -> _);
    black_box(yield_to as fn(_, _, _, _, _) -> _);
    black_box(track as fn(_, _, _) -> _);
    black_box(allocate as fn(_, _, _, _, _) -> _);
    black_box(control as fn(_, _, _, _) -> _);
    black_box(move_on as fn(_, _, _, _, _));
    black_box(sample as fn(_, _) -> _);
    black_box(predict as fn(_, _, _, _));
    black_box(update as fn(_, _) -> _);
    black_box(supervise as fn(_, _, _, _) -> _);
    black_box(receive as fn(_, _) -> _);
    black_box(encode as fn(_, _) -> _);
    black_box(tick as fn(_, _, _));
    black_box(look as fn(_, _) -> _);
    black_box(tick_on_wire as fn(_, _, _));
    black_box(tick_on_board as fn(_, _));
    in_c::keep();
    println!("no step function can panic");
}
