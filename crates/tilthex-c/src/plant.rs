//! The simulated vehicle.

use crate::{
    TILTHEX_MAX_ROTORS,
    block::{Flown, TilthexPlant, content, fill, read, write},
    numbers::{TilthexMeasured, TilthexWrench, check_period, require, rows, speeds},
    status::{Complaint, TilthexMessage, TilthexStatus},
    vehicle::{TilthexVehicle, checked},
};
use tilthex_core::{
    GRAVITY, Vector3,
    plant::{Loads, Plant},
    types::{Wrench, is_finite3},
};

/// The true state of the simulated vehicle, and what a perfect inertial sensor reads.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexPlantState {
    /// State of the centre of mass, specific force there, and rotor speeds.
    pub measured: TilthexMeasured,
    /// Angular velocity at the inertial sensor, rad/s, its coordinates.
    pub gyro_i: [f64; 3],
    /// Specific force at the inertial sensor, m/s^2, its coordinates.
    pub specific_force_i: [f64; 3],
    /// Position of the tool tip, m, world.
    pub tool_position_w: [f64; 3],
    /// Orientation of the tool: maps tool coordinates to world coordinates.
    pub tool_rotation_we: [[f64; 3]; 3],
}

/// Makes a simulated vehicle, a rigid body with rotor lag, that hovers level with its centre of mass at
/// `position_w[3]` (m, world). `message` (may be null) gets the sentence of a refusal.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_plant_init(
    plant: *mut TilthexPlant,
    vehicle: *const TilthexVehicle,
    position_w: *const f64,
    message: *mut TilthexMessage,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid, and the array has three numbers.
    TilthexStatus::of(unsafe {
        let complaint = Complaint::to(message);
        checked(vehicle, &complaint).and_then(|vehicle| {
            let position_w = Vector3::from(read(position_w.cast::<[f64; 3]>())?);
            require(is_finite3(&position_w), TilthexStatus::NotFinite)?;
            let made = Plant::new(vehicle);
            fill(plant, &Flown { plant: made, state: made.hover(position_w), wrench_tool_w: Wrench::ZERO })
        })
    })
}

/// Moves the vehicle by `dt` s (0 to 1) under commanded speeds (Hz, `rotor_speeds[TILTHEX_MAX_ROTORS]`) and a wrench that
/// the environment exerts on the tool (world, about its tip; null for none).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_plant_step(
    plant: *mut TilthexPlant,
    rotor_speeds: *const f64,
    wrench_tool_w: *const TilthexWrench,
    dt: f64,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid, and the array has a number for each rotor.
    let step = || unsafe {
        let flown = content(plant)?;
        let command = speeds(&read(rotor_speeds.cast::<[f64; TILTHEX_MAX_ROTORS]>())?)?;
        check_period(dt)?;
        let push_w = if wrench_tool_w.is_null() { Wrench::ZERO } else { read(wrench_tool_w)?.wrench()? };
        let mut next = Flown { wrench_tool_w: push_w, ..*flown };
        let loads = Loads { external: Wrench::ZERO, tool_w: push_w };
        flown.plant.step_under(&mut next.state, &command, &loads, dt);
        require(next.state.robot.is_finite(), TilthexStatus::NotFinite)?;
        *flown = next;
        Ok(())
    };
    TilthexStatus::of(step())
}

/// Writes the present state, under the wrench of the last step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_plant_state(
    plant: *mut TilthexPlant,
    state: *mut TilthexPlantState,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    let look = || unsafe {
        let Flown { plant, state: flown, wrench_tool_w } = content(plant)?;
        let external = plant.from_tool(flown, wrench_tool_w);
        let (acceleration_w, _) = plant.accelerations(flown, &external);
        let free_w = acceleration_w + Vector3::new(0.0, 0.0, GRAVITY);
        let specific_force_r = flown.robot.rotation_wr.transpose() * free_w;
        let (imu, (tool_position_w, tool_rotation_we)) =
            (plant.imu(flown, &external), plant.tool_pose(flown));
        let mut measured =
            TilthexMeasured { rotor_speeds: flown.rotor_speeds.into(), ..TilthexMeasured::default() };
        measured.set(&flown.robot, &specific_force_r);
        write(
            state,
            TilthexPlantState {
                measured,
                gyro_i: imu.gyro_i.into(),
                specific_force_i: imu.specific_force_i.into(),
                tool_position_w: tool_position_w.into(),
                tool_rotation_we: rows(&tool_rotation_we),
            },
        )
    };
    TilthexStatus::of(look())
}
